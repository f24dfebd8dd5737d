r"""Natural frequencies and modes of small undamped motions about a rest state, under its load.

On the motions that keep the closures

    K_q phi = omega^2 M phi,    phi^T M phi = 1

K_q is the second derivative of all energies with the load's part, the matrix that decides the
stability of `cartstiff.equilibrium`, and M the masses' matrix. A load moves the frequencies as it
moves the stiffness: modes belong to one load, which every result names.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from html import escape
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from cartstiff import numerics
from cartstiff.analysis.screws import Screw, screw_of_twist
from cartstiff.arrays import fixed
from cartstiff.errors import InputError, UndefinedError, joined
from cartstiff.geometry.se3 import Array
from cartstiff.mechanisms.contract import MechanismPosture, Units, convert_length
from cartstiff.mechanisms.elastic import ElasticMechanism, Note
from cartstiff.potentials.contract import Potential
from cartstiff.statics.rest import Equilibrium
from cartstiff.statics.small_motions import Spectrum, kinetic_matrix, spectrum_of
from cartstiff.stiffness.compute import PostureStiffness, analyse
from cartstiff.vibration.plausible import masses_that_move, notes_on_masses

__all__ = ["MODES_SCHEMA", "Modes", "modes", "stiffness_under_load"]

#: Name and version of the form of `Modes.as_dict`.
MODES_SCHEMA = "cartstiff-modes/1"


@dataclass(frozen=True, eq=False)
class Modes:
    """Small vibrations about a rest state.

    Attributes
    ----------
    elastic : ElasticMechanism
        The mechanism with the rest positions that were used.
    posture : MechanismPosture
        Where it rests.
    basis : ndarray (n, f)
        Motions that the constraints leave, as coordinate rates; spectrum and matrices are on them.
    stiffness, mass : ndarray (f, f)
        K and M on the basis.
    spectrum : Spectrum
        Their solutions, in the mechanism's units.
    result : PostureStiffness or None
        What a held posture was analysed as; None of an equilibrium.
    """

    elastic: ElasticMechanism
    posture: MechanismPosture
    basis: Array
    stiffness: Array
    mass: Array
    spectrum: Spectrum
    result: PostureStiffness | None = None
    _rest: tuple[Mapping[str, Any], tuple[Note, ...]] | None = None

    def __repr__(self) -> str:
        shown = ", ".join("unstable" if f is None else f"{f:.4g}" for f in self._plain_frequencies)
        codes = ", ".join(dict.fromkeys(note.code for note in self.notes)) or "none"
        return joined([
            f"Modes of {self.elastic.name} at {self.elastic.mechanism.frame}, {self.load['words']}",
            f"  frequencies  {shown} Hz",
            f"  notes        {codes}",
        ])  # fmt: skip

    def _repr_html_(self) -> str:
        return f"<pre>{escape(repr(self))}</pre>"

    @cached_property
    def _said(self) -> tuple[Mapping[str, Any], tuple[Note, ...]]:
        """The load and the notes of the rest state, found when they are read."""
        if self._rest is not None or self.result is None:
            return self._rest or ({}, ())
        return _load_and_notes(self.result)

    @property
    def load(self) -> Mapping[str, Any]:
        """What acted: kind, point, wrench in the body frame, and words."""
        return self._said[0]

    # -- frequencies and shapes -------------------------------------------------------------

    @property
    def q(self) -> Array:
        """Coordinates (n,) of the rest state."""
        return self.posture.q

    @cached_property
    def squares(self) -> Array:
        """omega^2 (k,) in 1/s^2, by increasing real part; complex where motions flutter."""
        length, force = convert_length(Units(), self.elastic.units)  # F L over kg L^2
        return fixed(self.spectrum.squares * (length / force))

    @cached_property
    def frequencies(self) -> Array:
        """In Hz (k,); 0 of a motion that nothing holds, NaN where a motion grows."""
        squares = self.squares
        with np.errstate(invalid="ignore"):
            if np.iscomplexobj(squares):
                return fixed(np.where(np.abs(squares.imag) > 0.0, np.nan,
                                      np.sqrt(squares.real)) / (2 * np.pi))  # fmt: skip
            return fixed(np.sqrt(squares) / (2 * np.pi))

    @cached_property
    def shapes(self) -> Array:
        """Coordinate rates (n, k) of each mode, in columns; ``phi^T M phi = 1``."""
        vectors = self.basis @ self.spectrum.vectors
        if np.iscomplexobj(vectors):
            return vectors
        largest = np.argmax(np.abs(vectors) / self._sizes[:, None], axis=0)
        return fixed(vectors * np.where(np.take_along_axis(vectors, largest[None], 0) < 0, -1, 1))

    @cached_property
    def twists(self) -> Array:
        """Body twists (6, k) of M, (angular, linear), of the shapes."""
        return self.posture.motion.jacobian @ self.shapes

    @cached_property
    def _sizes(self) -> Array:
        return self.posture.coordinate_lengths

    @cached_property
    def groups(self) -> list[list[int]]:
        """Numbers (from 0) of the modes, those with the same frequency together."""
        squares = self.squares.real
        size = float(np.abs(squares).max(initial=0.0))
        found: list[list[int]] = []
        for i, x in enumerate(squares):
            near = numerics.REPEATED * abs(x) + numerics.ZERO * size
            if found and abs(x - squares[found[-1][-1]]) <= near:
                found[-1].append(i)
            else:
                found.append([i])
        return found

    @cached_property
    def nodal_axes(self) -> list[Screw]:
        """Axis and pitch of each mode's twist, in M: what it turns about.

        Of repeated modes any axis of the subspace is one.
        """
        return [screw_of_twist(t, self.posture.length) for t in self.twists.real.T]

    # -- masses -----------------------------------------------------------------------------

    @cached_property
    def _momentum(self) -> tuple[Array, float, Array] | None:
        return self.posture.momentum()

    @cached_property
    def effective_masses(self) -> Array | None:
        """Mass [kg] (k, 3) that each mode moves along x, y, z of F; None without masses.

        ``(A_d phi)^2`` with the momentum A per rate: what a shaken base feels. Over all modes they
        make up what moves, less what only turns or is held.
        """
        if self._momentum is None or self.spectrum.is_complex:
            return None
        A = self._momentum[0][3:]
        if self.spectrum.left is self.spectrum.vectors:
            return fixed((A @ self.shapes).T ** 2)
        left = self.basis @ self.spectrum.left
        return fixed(((A @ left) * (A @ self.basis @ self.spectrum.vectors)).T)

    @cached_property
    def participation(self) -> Array:
        """Share (k, n) of each coordinate in the kinetic energy of each mode; rows sum to 1."""
        moved = self.full_mass @ self.shapes
        shares = (np.conj(self.shapes) * moved).real
        with np.errstate(invalid="ignore", divide="ignore"):
            return fixed((shares / shares.sum(axis=0)).T)

    @cached_property
    def full_mass(self) -> Array:
        """Masses' matrix (n, n) on all coordinates, kg and the mechanism's unit of length."""
        found = kinetic_matrix(self.posture, self.elastic.terms(), self.elastic.units)
        n = self.posture.coordinate_lengths.size
        return np.zeros((n, n)) if found is None else found

    # -- what is told -----------------------------------------------------------------------

    @cached_property
    def notes(self) -> tuple[Note, ...]:
        """What was assumed and found."""
        return (*self._said[1], *notes_on_masses(self.elastic), *self._states())

    def _states(self) -> list[Note]:
        notes: list[Note] = []
        squares = self.squares
        zero = np.flatnonzero(squares == 0.0)
        if zero.size:
            words = f"{zero.size} motion(s) cost no energy: free motions, of frequency 0"
            values = {"modes": (zero + 1).tolist(), "shapes": self.shapes[:, zero].real.T.tolist()}
            notes.append(Note("free-motion", words, values))
        if np.iscomplexobj(squares):
            pairs = np.flatnonzero(np.abs(squares.imag) > 0.0)
            words = "motions meet and grow as they swing (flutter): the rest state is unstable"
            swing = np.sqrt(squares[pairs]).real / (2 * np.pi)
            notes.append(Note("flutter", words, {"modes": (pairs + 1).tolist(),
                                                 "frequencies": swing.tolist()}))  # fmt: skip
        negative = np.flatnonzero((squares.real < 0.0) & (np.abs(squares.imag) == 0.0))
        if negative.size:
            words = "the rest state is unstable: the mechanism leaves it along these motions"
            values = {
                "modes": (negative + 1).tolist(),
                "growth": np.sqrt(-squares.real[negative]).tolist(),
                "shapes": self.shapes[:, negative].real.T.tolist(),
            }
            notes.append(Note("unstable", words, values))
        for group in self.groups:
            if len(group) > 1 and squares[group[0]] != 0.0:
                numbers = ", ".join(str(i + 1) for i in group)
                words = (
                    f"modes {numbers} have one frequency: they are a subspace, and any motion in "
                    "it is a mode"
                )
                notes.append(Note("repeated-modes", words, {"modes": [i + 1 for i in group]}))
        found = self.spectrum
        if found.following.shape[1]:
            words = (
                f"{found.following.shape[1]} motion(s) have stiffness and no mass: they follow the "
                "others at once and have no frequency of their own"
            )
            values = {"shapes": (self.basis @ found.following).T.tolist()}
            notes.append(Note("massless-motion", words, values))
        if found.loose.shape[1]:
            words = (
                f"{found.loose.shape[1]} motion(s) have neither mass nor stiffness: nothing says "
                "how they move, and they are left out"
            )
            values = {"shapes": (self.basis @ found.loose).T.tolist()}
            notes.append(Note("massless-free-motion", words, values))
        return notes

    @property
    def _plain_frequencies(self) -> list[float | None]:
        return [None if np.isnan(f) else float(f) for f in self.frequencies]

    def as_dict(self) -> dict[str, Any]:
        """The object of ``cartstiff modes --json``; complex numbers as [real, imaginary]."""
        elastic, masses = self.elastic, self.effective_masses
        total = None if self._momentum is None else self._momentum[1]
        return {
            "schema": MODES_SCHEMA,
            "mechanism": {
                "name": elastic.name, "kind": elastic.mechanism.kind,
                "joints": list(elastic.names),
            },
            "frame": elastic.mechanism.frame,
            "order": "angular-linear",
            "units": elastic.units.as_dict(),
            "q": self.q.tolist(),
            "frequencies": self._plain_frequencies,
            "eigenvalues": _plain(self.squares),
            "modes": _plain(self.shapes.T),
            "twists": _plain(self.twists.T),
            "nodal_axes": [_screw_dict(s) for s in self.nodal_axes],
            "repeated": [[i + 1 for i in g] for g in self.groups if len(g) > 1],
            "participation": _finite(self.participation),
            "effective_masses": None if masses is None else masses.tolist(),
            "moving_mass": total,
            "mass_matrix": self.full_mass.tolist(),
            "stiffness_matrix": self.stiffness.tolist(),
            "basis": self.basis.tolist(),
            "load": {k: v for k, v in self.load.items() if k != "words"},
            "weighed": [
                {"name": name, "mass": mass} for name, mass in masses_that_move(elastic).items()
            ],
            "notes": [note.as_dict() for note in self.notes],
        }  # fmt: skip


def _plain(values: Array) -> list[Any]:
    if not np.iscomplexobj(values):
        return values.tolist()
    return np.stack([values.real, values.imag], axis=-1).tolist()


def _finite(values: Array) -> list[Any]:
    return [[None if not np.isfinite(x) else x for x in row] for row in values.tolist()]


def _screw_dict(screw: Screw) -> dict[str, Any]:
    """Axis and pitch; None of a pure translation or of no motion at all."""
    turns = bool(np.isfinite(screw.pitch))
    moves = bool(np.isfinite(screw.direction).all())
    return {
        "direction": screw.direction.tolist() if moves else None,
        "point": screw.point.tolist() if turns else None,
        "pitch": screw.pitch if turns else None,
    }


def modes(
    subject: ElasticMechanism | PostureStiffness | Equilibrium,
    q: ArrayLike | Mapping[str, float] | None = None,
    *,
    wrench: ArrayLike | None = None,
    load_kind: Literal["dead", "follower", "conservative"] = "dead",
    load_at: ArrayLike = (0.0, 0.0, 0.0),
    load_axes: Literal["body", "world"] = "body",
) -> Modes:
    r"""Natural frequencies and modes of small motions about a rest state, under its load.

    ``K_q phi = omega^2 M phi`` on the motions that keep the closures.

    Parameters
    ----------
    subject : ElasticMechanism, PostureStiffness or Equilibrium
        A mechanism from `cartstiff.load`, which is held at q by rest positions as in
        `cartstiff.analyse`; or the result of `analyse`, or of `equilibrium`, where it came to rest.
    q, wrench, load_kind, load_at, load_axes
        As in `cartstiff.analyse`; for a mechanism only.

    Returns
    -------
    Modes
        Frequencies, shapes, twists, effective masses, nodal axes, notes.

    Raises
    ------
    InputError
        For q or a load beside a result, or what `analyse` refuses.
    UndefinedError
        If the posture is no rest state, no mass moves, or a motion without mass and stiffness takes
        part in the forces of others.

    Examples
    --------
    >>> import cartstiff
    >>> found = cartstiff.modes(cartstiff.load("stewart-simscape"))
    >>> [round(float(f), 1) for f in found.frequencies]
    [780.6, 780.6, 903.9, 1061.4, 1061.4, 1269.7]
    """
    if isinstance(subject, ElasticMechanism):
        subject = analyse(
            subject, q, wrench=wrench, load_kind=load_kind,
            load_at=load_at if np.any(load_at) else (0.0, 0.0, 0.0), load_axes=load_axes,
        )  # fmt: skip
    elif q is not None or wrench is not None:
        raise InputError("a result has its posture and its load", expected="no q and no wrench",
                         got="q" if q is not None else "wrench")  # fmt: skip
    if isinstance(subject, Equilibrium):
        return _at_rest(subject)
    return _held_at(subject)


def _at_rest(state: Equilibrium) -> Modes:
    """Modes where a mechanism came to rest, with its contacts as they are."""
    balance, posture = state._solution.balance, state.posture
    terms, units = state._system.terms, state.elastic.units
    columns = posture.coordinate_lengths
    basis = np.diag(columns) if balance.free is None else columns[:, None] * balance.free
    sizes = np.abs(balance.stiffness) + np.diag(balance.hardness)
    told = tuple(n for n in state.notes if n.code not in ("unstable", "flutter", "divergence"))
    load = {
        "kind": "potentials", "at": None, "wrench": None, "given": bool(state.loads),
        "meaning": "the loads of the equilibrium, each as it is",
        "words": "at rest under its loads" if state.loads else "at rest, no load",
    }  # fmt: skip
    elastic = state.elastic.with_potential(*state.loads)
    return _solved(
        elastic, posture, basis, balance.stiffness, sizes, terms, units, rest=(load, told)
    )


def _held_at(result: PostureStiffness) -> Modes:
    """Modes of a posture that springs hold under a load."""
    reduction, posture, W = result.reduction, result.posture, result.wrench
    if W is None:
        state = reduction.states[-1]
        raise UndefinedError(state.message, code=state.code, values=state.values)
    columns = posture.coordinate_lengths
    H, terms = stiffness_under_load(result)
    D, basis = result.change_by_load, np.diag(columns)
    if posture.closure is not None and reduction.motions is not None:
        stiff = np.abs(H * np.outer(columns, columns)).max(axis=0, initial=0.0)
        basis = columns[:, None] * numerics.graded_basis(reduction.motions, stiff)[0]
    terms = terms + _rounded(result) / np.outer(columns, columns)
    K, size = basis.T @ H @ basis, np.abs(basis).T @ terms @ np.abs(basis)
    if not (result.energy != result.energy or not _is_symmetric(D)):
        K = 0.5 * (K + K.T)
    elastic = result.elastic
    return _solved(elastic, posture, basis, K, size, elastic.terms(), elastic.units, result=result)


def _load_and_notes(result: PostureStiffness) -> tuple[Mapping[str, Any], tuple[Note, ...]]:
    """What held a posture, and what its analysis says."""
    W = np.zeros(6) if result.wrench is None else result.wrench
    loaded = result.is_loaded
    load = {
        "kind": result.load.kind, "at": list(result.load.at),
        "wrench": W.tolist() if loaded else [0.0] * 6, "given": result._load_is_given,
        "meaning": result.load.words,
        "words": f"under its {result.load.kind} load" if loaded else "unloaded",
    }  # fmt: skip
    told = list(result.notes_on_posture)
    told = [n for n in told if n.code not in ("deficient", "near-singular")]
    if loaded and not result._load_is_given:
        told.append(Note(
            "load-from-springs",
            "no load was given: the wrench that the springs exert here is taken for a "
            f"{result.load.kind} load that holds the posture",
            {"wrench": W.tolist()},
        ))  # fmt: skip
    return load, tuple(told)


def stiffness_under_load(result: PostureStiffness) -> tuple[Array, Array]:
    """K_q (n, n) on all coordinates with the parts of load and closures; sizes of its terms.

    ``Hess Phi - S_W + J^T (K^load - K^B) J + sum lam_k c_k''``.
    """
    posture, W, D = result.posture, result.wrench, result.change_by_load
    H, terms = result.evaluation.hessian, np.abs(result.evaluation.hessian)
    if W is not None and np.any(W):
        J, curvature = posture.motion.jacobian, posture.motion.curvature(W)
        H = H - curvature + J.T @ D @ J
        terms = terms + np.abs(curvature) + np.abs(J.T) @ np.abs(D) @ np.abs(J)
    if posture.closure is not None and result.reduction.multipliers.any():
        curvature = posture.closure.curvature(result.reduction.multipliers)
        H, terms = H + curvature, terms + np.abs(curvature)
    return H, terms


def _rounded(result: PostureStiffness) -> float:
    """Stiffness, in natural units, that the rounding of forces may feign, over `IDLE`.

    Of the closures' forces and of the load, and of what springs exert over a rounding error.
    """
    columns, reduction = result.posture.coordinate_lengths, result.reduction
    g = np.abs(result.evaluation.gradient * columns)
    stiff = np.abs(result.evaluation.hessian * np.outer(columns, columns)).max(axis=0, initial=0.0)
    least = float(np.minimum(g, numerics.ROUNDING * stiff).sum())
    forces = float(np.abs(reduction.multipliers).sum())
    if reduction.force is not None:
        forces += float(np.abs(reduction.force).sum())
    return (least + numerics.EPSILON * forces * max(1.0, result.posture.length)) / numerics.IDLE


def _is_symmetric(D: Array) -> bool:
    return bool(np.abs(D - D.T).max() <= numerics.ROUNDING * np.abs(D).max(initial=0.0))


def _solved(
    elastic: ElasticMechanism, posture: MechanismPosture, basis: Array, stiffness: Array,
    terms: Array, potentials: Sequence[Potential], units: Units,
    result: PostureStiffness | None = None,
    rest: tuple[Mapping[str, Any], tuple[Note, ...]] | None = None,
) -> Modes:  # fmt: skip
    full = kinetic_matrix(posture, potentials, units)
    mass = None if full is None else basis.T @ full @ basis
    if mass is None or full is None or not np.diag(mass).any():
        raise UndefinedError(
            f"nothing that moves in {elastic.name} has a mass: it has no frequencies "
            "(give inertias in the robot's file, body and legs.mass, or a payload)",
            code="no-mass", values={"links": list(elastic.mechanism.masses())},
        )  # fmt: skip
    size = np.abs(basis).T @ np.abs(full) @ np.abs(basis)
    found = spectrum_of(stiffness, 0.5 * (mass + mass.T), terms, size)
    if found.coupled:
        raise UndefinedError(
            "a motion with neither mass nor stiffness takes part in the forces of the others: "
            "there are no modes",
            code="massless-free-motion",
            values={"shapes": (basis @ found.loose).T.tolist()},
        )
    return Modes(elastic, posture, basis, stiffness, mass, found, result, rest)
