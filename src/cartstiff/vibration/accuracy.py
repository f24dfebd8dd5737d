r"""How sure pose, stiffness and frequencies are, from the tolerances of a mechanism's parameters.

To first order, with the derivatives of `cartstiff.vibration.sensitivities`: of each number x

    sd(x)^2 = sum_pq (dx/dp sd_p) R_pq (dx/dq sd_q)

with the correlation R of measured springs [GUM]_. Each parameter's share of the variance says who
the main contributors are.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from statistics import NormalDist
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from cartstiff.analysis.tolerances import Tolerances
from cartstiff.arrays import checked_array
from cartstiff.checked_call import checked
from cartstiff.errors import CartstiffError, InputError, UndefinedError, one_line
from cartstiff.geometry.se3 import Array
from cartstiff.mechanisms.elements import CompliancePattern, Elements
from cartstiff.mechanisms.identified import Identified, linearised
from cartstiff.statics.rest import Equilibrium
from cartstiff.stiffness.compute import PostureStiffness
from cartstiff.vibration.changes import MATRICES, Home, change_of_squares
from cartstiff.vibration.mode_set import Modes
from cartstiff.vibration.sensitivities import Sensitivities, in_hertz, modes_of, sensitivities

# Contributors that are told of each number.
_MAIN = 3


@dataclass(frozen=True, eq=False)
class Accuracy:
    """Standard deviations that tolerances leave, and who contributes.

    Attributes
    ----------
    names : tuple of str
        Parameters with a tolerance, p of them.
    spreads : ndarray (p,)
        Their standard deviations, in their units.
    nominal, deviations : mapping of str to ndarray
        By quantity, to first order: "pose" (6,), of a mechanism that comes to rest by itself, the
        rotation vector and the place of M's origin along the axes of F; "A", "B", "K", "F" (6, 6)
        where they exist; "frequencies" (k,) in Hz.
    shares : mapping of str to ndarray
        Share (p, ...) of each parameter in the variance of each number; NaN where that is zero.
    level, factor : float
        Probability of an interval of `factor` deviations to both sides.
    left_out : str or None
        Which parameters are not varied, and why.
    """

    names: tuple[str, ...]
    spreads: Array
    nominal: Mapping[str, Array]
    deviations: Mapping[str, Array]
    shares: Mapping[str, Array]
    level: float
    factor: float
    left_out: str | None = None

    def main(self, quantity: str, index: int | tuple[int, ...]) -> list[tuple[str, float]]:
        """The largest contributors to the variance of one number, with their shares."""
        shares = self.shares[quantity].T[index if isinstance(index, int) else index[::-1]]
        order = np.argsort(-np.nan_to_num(shares), kind="stable")[:_MAIN]
        return [(self.names[i], float(shares[i])) for i in order if shares[i] > 0.0]

    def as_dict(self) -> dict[str, Any]:
        """Plain data."""
        answer: dict[str, Any] = {}
        for quantity, sd in self.deviations.items():
            diagonal = [(i, i) if sd.ndim == 2 else (i,) for i in range(len(sd))]
            answer[quantity] = {
                "nominal": _or_none(self.nominal[quantity]),
                "deviation": _or_none(sd),
                "main": [
                    [{"name": n, "share": x} for n, x in self.main(quantity, i)] for i in diagonal
                ],
            }
        pairs = zip(self.names, self.spreads.tolist(), strict=True)
        return {
            "level": self.level,
            "factor": self.factor,
            "left_out": self.left_out,
            **answer,
            "parameters": [{"name": name, "deviation": x} for name, x in pairs],
        }


def _or_none(values: Array) -> list[Any]:
    cells = np.where(np.isfinite(values), values, np.nan).astype(object)
    cells[~np.isfinite(values)] = None
    return list(cells.tolist())


@checked
def accuracy(
    subject: Modes | PostureStiffness | Equilibrium,
    tolerances: Tolerances | None = None,
    *,
    level: float | None = None,
    given: Sensitivities | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> Accuracy:
    """Pose, stiffness and frequencies with what tolerances leave of them, to first order.

    Parameters
    ----------
    subject : Modes, PostureStiffness or Equilibrium
        A posture that is held, whose rest positions follow; or where a mechanism came to rest by
        itself: only that has an error of its pose.
    tolerances : Tolerances, optional
        Standard deviations of stiffnesses (relative), lengths and angles. Without one of the
        stiffness measured springs bring theirs.
    level : float, optional
        Probability between 0 and 1; default that of the measured springs, else 0.95.
    given : Sensitivities, optional
        Those of `subject`, where they are known.
    progress : callable, optional
        Called with how many parameters are done, and of how many.

    Raises
    ------
    InputError
        For a level outside (0, 1).
    UndefinedError
        If no parameter has a tolerance.

    Examples
    --------
    >>> import cartstiff
    >>> from cartstiff.analysis.tolerances import Tolerances
    >>> state = cartstiff.equilibrium(cartstiff.load("stewart-gough"), wrench=[0, 0, 0, 0, 0, -50])
    >>> spread = cartstiff.accuracy(state, Tolerances(length=0.01))
    >>> spread.deviations["pose"][3:].round(3).tolist()
    [0.046, 0.043, 0.019]
    """
    modes = subject if isinstance(subject, Modes) else modes_of(subject)
    if modes is not None and modes.spectrum.is_complex:
        modes = None
    home = Home(subject, tolerances=tolerances or Tolerances())
    named, R = home.parameters.named, home.parameters.correlation
    known = home.nominal.elastic.identified
    if level is None:
        level = 0.95 if known is None else known.level
    if not 0.0 < level < 1.0:
        raise InputError("level cannot be used", expected="between 0 and 1", got=level)
    effects: dict[str, list[Array]] = {}
    missing = [] if (left_out := home.parameters.left_out) is None else [left_out]
    varied = np.zeros(len(named), bool)
    for i, (name, t) in enumerate(named.items()):
        if progress is not None:
            progress(i + 1, len(named))
        try:
            row = None if given is None else given.row(name)
            row = home.row(name, modes) if row is None else row
        except CartstiffError as error:
            missing.append(f"{name} is not varied: {one_line(str(error), 200)}")
            continue
        varied[i] = True
        if home.state is not None:
            effects.setdefault("pose", []).append(row.pose * t.deviation)
        for letter, dK in zip(MATRICES, row.matrices, strict=True):
            effects.setdefault(letter, []).append(dK * t.deviation)
        if modes is not None:
            effects.setdefault("frequencies", []).append(
                in_hertz(modes, row.squares[None])[0] * t.deviation
            )
    if not varied.any():
        raise UndefinedError("; ".join(missing), code="no-parameters")
    R = np.eye(len(named)) if R is None else R
    deviations, shares = {}, {}
    for quantity, rows in effects.items():
        x = np.array(rows)
        parts = x * np.tensordot(R[np.ix_(varied, varied)], x, 1)
        variance = np.maximum(parts.sum(axis=0), 0.0)
        if quantity == "frequencies" and modes is not None:
            for alike in modes.groups:  # modes with one frequency part: see `intervals`
                parts[:, alike] = parts[:, alike].sum(axis=1, keepdims=True)
                variance[alike] = variance[alike].sum()
        with np.errstate(invalid="ignore", divide="ignore"):
            shares[quantity] = parts / np.where(variance > 0.0, variance, np.nan)
        deviations[quantity] = np.sqrt(variance)
    matrices = home.result.matrices
    nominal = {n: np.asarray(K) for n in MATRICES if (K := matrices[n]) is not None}
    if home.state is not None:
        nominal["pose"] = home.state.displacement
    if modes is not None:
        nominal["frequencies"] = modes.frequencies
    kept = [name for name in deviations if name in nominal]
    spreads = np.array([t.deviation for t in named.values()])[varied]
    factor = NormalDist().inv_cdf(0.5 + 0.5 * level)
    if known is not None and level == known.level and np.isfinite(home.parameters.degrees):
        factor = known.factor
    return Accuracy(
        tuple(n for n, there in zip(named, varied, strict=True) if there),
        spreads,
        {n: nominal[n] for n in kept},
        {n: deviations[n] for n in kept},
        {n: shares[n] for n in kept},
        level,
        factor,
        "; ".join(missing) or None,
    )


def _by_compliance(modes: Modes, measured: Identified) -> Array:
    """d(omega^2) (P, k) for a standard deviation along each axis of the compliances' covariance."""
    if not measured.patterns:
        return np.zeros((0, modes.frequencies.size))
    elastic = linearised(replace(modes.elastic, identified=measured), modes.posture.q)
    measured, elements = elastic.identified or measured, Elements(elastic)
    forces = elements.stiffness @ elements.rows(modes.posture)
    rows = [
        change_of_squares(modes, -forces.T @ S @ forces)
        for S in np.tensordot(measured.roots.T, elements.patterns(measured.patterns), axes=1)
    ]
    return np.array(rows).reshape(len(rows), modes.frequencies.size)


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
            "level": self.level,
            "deviations": _or_none(self.deviations),
            "low": _or_none(self.low),
            "high": _or_none(self.high),
        }


def intervals(
    modes: Modes,
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
    modes : Modes
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
    measured = modes.elastic.identified
    if compliance_covariance is not None:
        names = modes.elastic.spring_names if joints is None else joints
        patterns = tuple(CompliancePattern(name, ((name, name, 1.0),)) for name in names)
        C = checked_array(compliance_covariance, (len(names),) * 2, "covariance of compliances")
        measured = Identified(patterns, np.zeros(len(names)), C)
    measured = measured or Identified((), np.zeros(0), np.zeros((0, 0)))
    measured = measured if level is None else replace(measured, level=level)
    if not 0.0 < measured.level < 1.0:
        raise InputError("level cannot be used", expected="between 0 and 1", got=measured.level)
    t = tolerances or Tolerances()
    if given is None and t.any:
        given = sensitivities(modes, geometry=bool(t.length or t.angle))
    variance = (in_hertz(modes, _by_compliance(modes, measured)) ** 2).sum(axis=0)
    found_out = {name for p in measured.patterns for a, b, _ in p.entries for name in (a, b)}
    if given is not None and t.any:
        each = zip(given.names, given.values, given.frequencies, given.angles, strict=True)
        for name, value, row, is_angle in each:
            group, _, spring = name.partition(".")
            if group == "stiffness":
                deviation = 0.0 if spring in found_out else t.stiffness * value
            elif group in ("mass", "parameter"):
                deviation = 0.0
            else:
                deviation = t.angle if is_angle else t.length
            variance += (row * deviation) ** 2
    for alike in modes.groups:
        variance[alike] = variance[alike].sum()
    deviations = np.sqrt(variance)
    reach = measured.factor * deviations
    return FrequencyInterval(
        deviations, modes.frequencies - reach, modes.frequencies + reach, measured.level
    )
