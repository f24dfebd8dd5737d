"""What a reduction gave: stiffness, forces, motions, and the states it found."""

from __future__ import annotations

from dataclasses import dataclass, field

from cartstiff import numerics
from cartstiff.errors import UndefinedError
from cartstiff.geometry.se3 import Array
from cartstiff.lazily import cached_property
from cartstiff.notebook import ShownInLines
from cartstiff.notes import Note
from cartstiff.stiffness.free_motions import FreeMotions


@dataclass(frozen=True, repr=False)
class Reduction(ShownInLines):
    """What equation (2) of `cartstiff.stiffness.reduction` gave, or why not, and what (3) is of.

    Attributes
    ----------
    force : ndarray (6,) or None
        Output force w; None if the posture is unbalanced.
    stiffness : ndarray (6, 6) or None
        K; None if it does not exist, for which `states` has the reason.
    multipliers : ndarray (m,)
        Closure forces lam.
    singular_values : ndarray
        Singular values of the length-scaled J_N.
    rank : int
        Rank of J_N.
    freedoms : int
        Number of free motions, the columns of N.
    free : FreeMotions or None
        The motions that (3) is made of, idle ones left out; None where the posture is unbalanced or
        its self-motion has no minimum.
    reachable, reachable_stiffness : ndarray (6, r), (r, r)
        U and Y^T S Y: the stiffness on the motions that exist.
    rates : ndarray (n, 6) or None
        Coordinate rates per output rate, N J_N^-1, where that is one to one.
    motions : ndarray (n, f) or None
        Motions that keep the closures, in scaled coordinates; None if all do.
    states : list of Note
        Named states found.
    closures : ndarray or None
        Singular values of the length-scaled closures, where there are any.
    """

    force: Array | None
    stiffness: Array | None
    multipliers: Array
    singular_values: Array
    rank: int
    freedoms: int
    free: FreeMotions | None = None
    reachable: Array | None = None
    reachable_stiffness: Array | None = None
    rates: Array | None = None
    motions: Array | None = None
    states: list[Note] = field(default_factory=list)
    closures: Array | None = None

    def _lines(self) -> list[str]:
        force = (
            "none: unbalanced"
            if self.force is None
            else ", ".join(f"{x:.6g}" for x in self.force.tolist())
        )
        return [
            f"Reduction of {self.freedoms} free motions to rank {self.rank}",
            f"  force     {force}",
            f"  stiffness {'none' if self.stiffness is None else 'array (6, 6)'}",
            f"  states    {', '.join(state.code for state in self.states) or 'none'}",
        ]

    @cached_property
    def compliance_with_error(self) -> numerics.Inverse | None:
        """C of equation (3) with its relative error; None where a motion costs nothing."""
        return None if self.free is None else self.free.compliance()

    @property
    def compliance(self) -> Array | None:
        """C (6, 6) of equation (3); None where a motion costs nothing."""
        with_error = self.compliance_with_error
        return None if with_error is None else with_error.matrix

    def undefined(self) -> UndefinedError:
        """The error for whoever needs the stiffness where it does not exist."""
        state = self.states[-1]
        return UndefinedError(state.message, code=state.code, values=state.values)
