"""What small vibrations about a rest state are: frequencies, shapes, axes, masses, notes."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from cartstiff import numerics
from cartstiff.analysis.screws import Screw, screw_of_twist
from cartstiff.arrays import Result, fixed
from cartstiff.errors import UndefinedError
from cartstiff.geometry.se3 import Array
from cartstiff.mechanisms.contract import MechanismPosture, Units, convert_length
from cartstiff.mechanisms.elastic import ElasticMechanism
from cartstiff.notebook import ShownInLines
from cartstiff.notes import Note
from cartstiff.statics.rest import Equilibrium
from cartstiff.statics.small_motions import Spectrum, kinetic_matrix
from cartstiff.stiffness.compute import PostureStiffness
from cartstiff.stiffness.showing import codes_of
from cartstiff.vibration.diagnostics import masses_that_move, notes_on_masses, notes_on_states

#: Name and version of the form of `Modes.as_dict`.
MODES_SCHEMA = "cartstiff-modes/1"


@dataclass(frozen=True, eq=False, repr=False)
class Modes(Result, ShownInLines):
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
    state : Equilibrium or None
        Where they are those of a mechanism that came to rest by itself.
    """

    elastic: ElasticMechanism
    posture: MechanismPosture
    basis: Array
    stiffness: Array
    mass: Array
    spectrum: Spectrum
    _held: PostureStiffness | Callable[[], PostureStiffness] | None = None
    _rest: tuple[Mapping[str, Any], tuple[Note, ...]] | None = None
    state: Equilibrium | None = None

    def _lines(self) -> list[str]:
        shown = ", ".join("unstable" if f is None else f"{f:.4g}" for f in self._plain_frequencies)
        return [
            f"Modes of {self.elastic.name} at {self.elastic.mechanism.frame}, {self.load['words']}",
            f"  frequencies  {shown} Hz",
            f"  notes        {codes_of(self.notes)}",
        ]

    @cached_property
    def result(self) -> PostureStiffness | None:
        """What a held posture is analysed as; None of an equilibrium."""
        return self._held() if callable(self._held) else self._held

    @property
    def held(self) -> PostureStiffness:
        """`result` of a held posture; UndefinedError of an equilibrium."""
        if self.result is None:
            raise UndefinedError("the modes are those of no held posture", code="no-posture")
        return self.result

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
                return fixed(
                    np.where(np.abs(squares.imag) > 0.0, np.nan, np.sqrt(squares.real))
                    / (2 * np.pi)
                )
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
        groups: list[list[int]] = []
        for i, x in enumerate(squares):
            near = numerics.REPEATED * abs(x) + numerics.ZERO * size
            if groups and abs(x - squares[groups[-1][-1]]) <= near:
                groups[-1].append(i)
            else:
                groups.append([i])
        return groups

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
        full = kinetic_matrix(self.posture, self.elastic.terms(), self.elastic.units)
        n = self.posture.coordinate_lengths.size
        return np.zeros((n, n)) if full is None else full

    # -- what is told -----------------------------------------------------------------------

    @cached_property
    def notes(self) -> tuple[Note, ...]:
        """What was assumed and found."""
        return (
            *self._said[1],
            *notes_on_masses(self.elastic),
            *notes_on_states(self.squares, self.shapes, self.groups, self.basis, self.spectrum),
        )

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
                "name": elastic.name,
                "kind": elastic.mechanism.kind,
                "joints": list(elastic.names),
            },
            **elastic.mechanism.frames_as_dict(),
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
        }


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


def _load_and_notes(result: PostureStiffness) -> tuple[Mapping[str, Any], tuple[Note, ...]]:
    """What held a posture, and what its analysis says."""
    W = np.zeros(6) if result.wrench is None else result.wrench
    loaded = result.is_loaded
    load = {
        "kind": result.load.kind,
        "at": list(result.load.at),
        "wrench": W.tolist() if loaded else [0.0] * 6,
        "given": result._load_is_given,
        "meaning": result.load.words,
        "words": f"under its {result.load.kind} load" if loaded else "unloaded",
    }
    notes = list(result.notes_on_posture)
    notes = [n for n in notes if n.code not in ("fewer-than-six-freedoms", "near-singular")]
    if loaded and not result._load_is_given:
        notes.append(
            Note(
                "load-from-springs",
                "no load was given: the wrench that the springs exert here is taken for a "
                f"{result.load.kind} load that holds the posture",
                {"wrench": W.tolist()},
            )
        )
    return load, tuple(notes)
