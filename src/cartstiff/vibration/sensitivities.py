r"""How each frequency depends on each stiffness, mass and length, and how sure it is.

With left and right modes psi, phi and ``psi^T M phi = 1``

    d(omega^2)/dp = psi^T (dK/dp - omega^2 dM/dp) phi + mu_psi . dC phi + mu_phi . dC psi

where C is the closures' Jacobian and ``C^T mu_phi = -(K - omega^2 M) phi`` what they carry. The
posture and the load stay: rest positions follow, as in `cartstiff.analysis.tolerances`. Of repeated
modes it is the eigenvalues of that form on the subspace, in their order.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from cartstiff import numerics
from cartstiff.analysis.tolerances import Parameters, Tolerances
from cartstiff.arrays import checked_array
from cartstiff.errors import CartstiffError, InputError, UndefinedError
from cartstiff.geometry import se3
from cartstiff.geometry.se3 import Array
from cartstiff.mechanisms.chain import Chain, ChainPosture
from cartstiff.mechanisms.contract import Units, convert_length
from cartstiff.mechanisms.elements import CompliancePattern, Elements
from cartstiff.mechanisms.identified import Identified
from cartstiff.mechanisms.platform import Platform, PlatformPosture
from cartstiff.mechanisms.tree import Placement
from cartstiff.potentials.flexure_struts import ideal_joints_only
from cartstiff.potentials.line_springs import LineSprings
from cartstiff.statics.small_motions import kinetic_matrix
from cartstiff.stiffness.compute import PostureStiffness
from cartstiff.vibration.mode_set import Modes
from cartstiff.vibration.modes import stiffness_under_load

__all__ = ["FrequencyInterval", "Sensitivities", "intervals", "sensitivities"]

# Steps of central differences, in rad and characteristic lengths: the error goes with the square,
# rounding with the inverse.
_STEP = numerics.DIFFERENCE


@dataclass(frozen=True, eq=False)
class Sensitivities:
    """Derivatives of all frequencies.

    Attributes
    ----------
    names : tuple of str
        "stiffness.<spring>", "mass.<link>" (a point mass at the link's centre; of legs all alike),
        and the geometry's names of `cartstiff.analysis.tolerances.Parameters`.
    values : ndarray (p,)
        Nominal values.
    squares : ndarray (p, k)
        d(omega^2)/dp in 1/s^2 per unit of the parameter.
    frequencies : ndarray (p, k)
        df/dp in Hz per unit; NaN where f is 0 or does not exist.
    left_out : str or None
        Why no geometry is among them.
    """

    names: tuple[str, ...]
    values: Array
    squares: Array
    frequencies: Array
    left_out: str | None = None

    def of(self, name: str) -> Array:
        """df/dp (k,) of a named parameter.

        Raises
        ------
        InputError
            For another name.
        """
        if name not in self.names:
            raise InputError("unknown parameter", expected=", ".join(self.names), got=repr(name))
        return self.frequencies[self.names.index(name)]

    @property
    def relative(self) -> Array:
        """Change (p, k) in Hz for one per cent of each parameter; NaN of those that are zero."""
        return 0.01 * np.where(self.values, self.values, np.nan)[:, None] * self.frequencies

    def as_dict(self) -> dict[str, Any]:
        """Plain data: df/dp in Hz per unit, and the change for one per cent."""
        rows = zip(self.names, self.values, self.frequencies, self.relative, strict=True)
        return {
            "left_out": self.left_out,
            "parameters": [
                {"name": name, "value": float(x), "frequencies": _plain(row),
                 "for_one_per_cent": _plain(relative)}
                for name, x, row, relative in rows
            ],
        }  # fmt: skip


def _plain(values: Array) -> list[float | None]:
    return [float(x) if np.isfinite(x) else None for x in values]


def sensitivities(found: Modes, *, geometry: bool = True) -> Sensitivities:
    """Derivatives of the frequencies by stiffnesses, masses and geometry.

    Parameters
    ----------
    found : Modes
        Modes of a held posture, or of an equilibrium (then without geometry).
    geometry : bool
        Whether placements of joints, or points of platforms, are varied.

    Raises
    ------
    UndefinedError
        Where modes flutter: a complex frequency has no derivative here.
    """
    if found.spectrum.is_complex:
        raise UndefinedError("modes that flutter have no sensitivities", code="flutter")
    names: list[str] = []
    values: list[float] = []
    rows: list[Array] = []
    nothing = np.zeros_like(found.full_mass)
    closure = None if found.posture.closure is None else found.posture.closure.jacobian
    still = None if closure is None else np.zeros_like(closure)
    for name, value, dK in _stiffnesses(found):
        names, values = [*names, name], [*values, value]
        rows.append(_derivative(found, dK, nothing, still))
    for name, value, dM in _masses(found):
        names, values = [*names, name], [*values, value]
        rows.append(_derivative(found, nothing, dM, still))
    left_out = "of an equilibrium the geometry is not varied" if found.result is None else None
    if geometry and found.result is not None:
        parameters = Parameters(found.result, Tolerances(length=1.0, angle=1.0))
        left_out = parameters.left_out
        try:
            named = parameters.named
        except UndefinedError:
            named = {}
        for name, entry in named.items():
            step = _STEP * (1.0 if _is_angle(name) else found.posture.length)
            ends = []
            try:
                for sign in (1.0, -1.0):
                    ends.append(_matrices(parameters.at({name: entry.nominal + sign * step})))
            except CartstiffError:
                continue
            (K_1, M_1, C_1), (K_2, M_2, C_2) = ends
            per = 1 / (2 * step)
            dC = None if C_1 is None or C_2 is None else per * (C_1 - C_2)
            change = _derivative(found, per * (K_1 - K_2), per * (M_1 - M_2), dC)
            names, values = [*names, name], [*values, entry.nominal]
            rows.append(change)
    squares = np.array(rows).reshape(len(names), -1)
    return Sensitivities(tuple(names), np.array(values), squares, _hertz(found, squares), left_out)


def _hertz(found: Modes, squares: Array) -> Array:
    """Changes (p, k) in Hz of those of omega^2; NaN where f is 0 or does not exist."""
    with np.errstate(divide="ignore", invalid="ignore"):
        f = found.frequencies
        return np.where(f > 0.0, squares / (8 * np.pi**2 * f), np.nan)


def _by_compliance(found: Modes, measured: Identified) -> Array:
    """d(omega^2) (P, k) for a standard deviation along each axis of the compliances' covariance."""
    elements = Elements(found.elastic)
    forces = elements.stiffness @ elements.rows(found.posture)
    nothing, closure = np.zeros_like(found.full_mass), found.posture.closure
    still = None if closure is None else np.zeros_like(closure.jacobian)
    variances, axes = np.linalg.eigh(measured.covariance)
    roots = axes * np.sqrt(np.maximum(variances, 0.0))
    rows = [
        _derivative(found, -forces.T @ S @ forces, nothing, still)
        for S in np.tensordot(roots.T, elements.patterns(measured.patterns), axes=1)
    ]
    return np.array(rows).reshape(len(rows), found.frequencies.size)


def _is_angle(name: str) -> bool:
    return name.endswith((".rx", ".ry", ".rz"))


def _matrices(result: PostureStiffness) -> tuple[Array, Array, Array | None]:
    """K and M on all coordinates, and the closures' Jacobian."""
    elastic, closure = result.elastic, result.posture.closure
    mass = kinetic_matrix(result.posture, elastic.terms(), elastic.units)
    K = stiffness_under_load(result)[0]
    mass = np.zeros_like(K) if mass is None else mass
    return K, mass, None if closure is None else closure.jacobian


def _derivative(found: Modes, dK: Array, dM: Array, dC: Array | None) -> Array:
    """d(omega^2) (k,) in 1/s^2 for changes of the matrices on all coordinates."""
    length, force = convert_length(Units(), found.elastic.units)
    right, left = found.basis @ found.spectrum.vectors, found.basis @ found.spectrum.left
    squares, units = found.spectrum.squares, length / force
    carried = _carried(found, right, left, squares) if dC is not None else None
    rates = np.empty(squares.size)
    for group in found.groups:
        phi, psi, x = right[:, group], left[:, group], squares[group]
        form = psi.T @ dK @ phi - (psi.T @ dM @ phi) * x
        if dC is not None and carried is not None:
            mu_phi, mu_psi = carried[0][:, group], carried[1][:, group]
            form += mu_psi.T @ dC @ phi + (dC @ psi).T @ mu_phi
        if len(group) == 1:
            rates[group] = form[0, 0]
        else:
            rates[group] = np.sort(np.linalg.eigvals(form).real)
    return rates * units


def _carried(found: Modes, right: Array, left: Array, squares: Array) -> tuple[Array, Array]:
    """What the closures carry while each mode swings, to the right and to the left modes."""
    closure, result = found.posture.closure, found.result
    if closure is None or result is None:
        return np.zeros((0, 0)), np.zeros((0, 0))
    K, M = stiffness_under_load(result)[0], found.full_mass
    columns = found.posture.coordinate_lengths[:, None]
    C = (closure.jacobian.T * columns).astype(float)
    mu_right, mu_left = (
        -np.linalg.lstsq(C, columns * (A @ x - M @ x * squares), rcond=numerics.RANK)[0]
        for A, x in ((K, right), (K.T, left))
    )
    return mu_right, mu_left


def _stiffnesses(found: Modes) -> list[tuple[str, float, Array]]:
    """Name, value and dK/dk of each spring."""
    elastic, posture = found.elastic, found.posture
    springs, n = elastic.springs, posture.coordinate_lengths.size
    entries: list[tuple[str, float, Array]] = []
    if springs is None:
        return entries
    ideal_joints_only(springs, "sensitivities to springs")
    laws = getattr(springs, "laws", {})
    lines = posture.lines.lines if isinstance(posture, PlatformPosture) else None
    for i, name in enumerate(elastic.spring_names):
        k = float(springs.stiffness[i])
        if not k > 0.0 or i in laws:
            continue
        along = np.zeros(n)
        if isinstance(springs, LineSprings):
            if lines is None or (springs.unilateral and i + 1 in springs.slack(posture)):
                continue
            along = lines[i]
        else:
            along[i] = 1.0
        entries.append((f"stiffness.{name}", k, np.outer(along, along)))
    return entries


def _masses(found: Modes) -> list[tuple[str, float, Array]]:
    """Name, value and dM/dm of each mass."""
    mechanism, posture = found.elastic.mechanism, found.posture
    entries: list[tuple[str, float, Array]] = []
    if isinstance(mechanism, Platform) and isinstance(posture, PlatformPosture):
        if mechanism.mass > 0.0:
            v = np.concatenate([-se3.skew(mechanism.mass_centre), np.eye(3)], axis=1)
            entries.append((f"mass.{mechanism.frame}", mechanism.mass, v.T @ v))
        if mechanism.struts is not None and mechanism.struts.mass > 0.0:
            legs = mechanism.struts.mass_matrix(posture.lines, mechanism.points)
            total = mechanism.struts.mass
            entries.append(("mass.legs", total, legs / total))
    if isinstance(mechanism, Chain) and isinstance(posture, ChainPosture):
        masses, centres = mechanism.tree.masses()
        for j, name in sorted(mechanism.tree.links().items()):
            if not masses[j - 1] > 0.0:
                continue
            at = Placement(j, se3.pose(translation=centres[j - 1]))
            J = posture._state.relative(mechanism.world, at)[1].jacobian[3:]
            entries.append((f"mass.{name}", float(masses[j - 1]), J.T @ J))
    return entries


@dataclass(frozen=True, eq=False)
class FrequencyInterval:
    """What tolerances and identified springs leave of each frequency.

    Attributes
    ----------
    deviations : ndarray (k,)
        Standard deviations in Hz, to first order.
    low, high : ndarray (k,)
        Bounds of the interval.
    level : float
        Its probability, for normal deviations.
    """

    deviations: Array
    low: Array
    high: Array
    level: float

    def as_dict(self) -> dict[str, Any]:
        """Plain data."""
        return {
            "level": self.level, "deviations": _plain(self.deviations), "low": _plain(self.low),
            "high": _plain(self.high),
        }  # fmt: skip


def intervals(
    found: Modes,
    tolerances: Tolerances | None = None,
    *,
    compliance_covariance: ArrayLike | None = None,
    joints: tuple[str, ...] | None = None,
    level: float | None = None,
    given: Sensitivities | None = None,
) -> FrequencyInterval:
    """Intervals of the frequencies from tolerances, and from the covariance of identified springs.

    A compliance with pattern S on the elements B changes the stiffness by ``-B^T K S K B``. Modes
    with one frequency part under any change: each of them gets the variances of all, which bound
    ``tr F^2`` of the form F that parts them.

    Parameters
    ----------
    found : Modes
        The modes.
    tolerances : Tolerances, optional
        Standard deviations of stiffnesses (relative), lengths and angles. Where compliances are
        identified that of the stiffness is for the other springs.
    compliance_covariance : array_like, shape (j, j), optional
        Covariance of the joints' compliances (``1/k``), as ``cartstiff identify`` gives it; default
        what the mechanism's file says of its measured springs.
    joints : tuple of str, optional
        Their names; default all springs, in order.
    level : float, optional
        Probability between 0 and 1; default that of the measured springs, else 0.95.
    given : Sensitivities, optional
        Where they are known.

    Raises
    ------
    InputError
        For a covariance of another shape, unknown joints or a level outside (0, 1).
    """
    measured = found.elastic.identified
    if compliance_covariance is not None:
        names = found.elastic.spring_names if joints is None else joints
        patterns = tuple(CompliancePattern(name, ((name, name, 1.0),)) for name in names)
        C = checked_array(compliance_covariance, (len(names),) * 2, "covariance of compliances")
        measured = Identified(patterns, np.zeros(len(names)), C)
    measured = measured or Identified((), np.zeros(0), np.zeros((0, 0)))
    measured = measured if level is None else replace(measured, level=level)
    if not 0.0 < measured.level < 1.0:
        raise InputError("level cannot be used", expected="between 0 and 1", got=measured.level)
    t = tolerances or Tolerances()
    known = sensitivities(found, geometry=bool(t.length or t.angle)) if given is None else given
    variance = (_hertz(found, _by_compliance(found, measured)) ** 2).sum(axis=0)
    found_out = {name for p in measured.patterns for a, b, _ in p.entries for name in (a, b)}
    for name, value, row in zip(known.names, known.values, known.frequencies, strict=True):
        group = name.partition(".")[0]
        if group == "stiffness":
            deviation = 0.0 if name.partition(".")[2] in found_out else t.stiffness * value
        elif group == "mass":
            deviation = 0.0
        else:
            deviation = t.angle if _is_angle(name) else t.length
        variance += (row * deviation) ** 2
    for alike in found.groups:
        variance[alike] = variance[alike].sum()
    deviations = np.sqrt(variance)
    reach = measured.factor * deviations
    return FrequencyInterval(
        deviations, found.frequencies - reach, found.frequencies + reach, measured.level
    )
