r"""Behaviour of a load while the body moves, and the resulting tangent stiffness.

With W = (m, f) the load about its point P, along the body's axes, a small motion t = (w,
v) of the body changes these components by ``R t``, and the tangent in the frame at P is
``K^A - R``:

    follower       R = 0                               moment and force turn with the body
    dead           R = [[ [m]x, 0 ], [ [f]x, 0 ]]      both keep their direction in F
    conservative   R = [[ 1/2 [m]x, 0 ], [ [f]x, 0 ]]  the force does, the moment by half

In the frame M the tangent is ``Ad^T (K^A - R) Ad``, Ad being that of M in P: it is a
tensor. Each kind is thus a left-invariant affine connection on SE(3), one for each point;
"conservative" at M's origin is the kinematic one. A force alone has a symmetric tangent
under "dead" and "conservative"; a dead moment has none, and no potential. A moment that
turns by half is the semitangential one, as of dead forces on crossed bars: it has a
potential.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, Literal, get_args

import numpy as np
from numpy.typing import ArrayLike

from cartstiff.core.arrays import (
    Array,
    checked_input,
    checked_reach,
    checked_vector,
    read_only,
)
from cartstiff.core.choices import LOAD_KINDS
from cartstiff.core.errors import InputError, check_name
from cartstiff.core.geometry import se3
from cartstiff.core.geometry.connections import (
    CARTAN_MINUS,
    KINEMATIC,
    Connection,
    turning_symbols,
)

if TYPE_CHECKING:
    from cartstiff.core.potentials.loads import Load

#: Kinds of loads by their behaviour while the body moves, see `LOAD_KINDS`.
Behaviour = Literal["dead", "follower", "conservative"]
#: Axes of a wrench's components: those of M, or those of F.
Axes = Literal["body", "world"]
_AXES = get_args(Axes)


@dataclass(frozen=True)
class LoadKind:
    """Behaviour of a load while the body moves.

    Attributes
    ----------
    kind : {"dead", "follower", "conservative"}
        See `cartstiff.core.choices.LOAD_KINDS`.
    at : tuple of 3 floats
        The point of the body at which the force acts, in the frame M.

    Raises
    ------
    UnknownNameError
        For another kind.
    InputError
        For a point that is not three finite numbers.
    """

    kind: Behaviour = "dead"
    at: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        check_name("kind of load", self.kind, LOAD_KINDS)
        point = checked_vector(self.at, 3, "point of the load")
        checked_reach(point, "point of the load")
        object.__setattr__(self, "at", tuple(point.tolist()))

    @property
    def connection(self) -> Connection:
        """The affine connection on SE(3) whose stiffness is the tangent under this load,
        in M.
        """
        return _connection(self.kind, self.at)

    @property
    def words(self) -> str:
        """Behaviour of the load in words: "its force and moment keep their
        direction ...".
        """
        return LOAD_KINDS[self.kind]

    def changes(self, wrench: Array) -> Array:
        """``K^X - K^B`` (..., 3, 6, 6), X = A, K, load, under wrenches (..., 6) in M.

        ``K^A = K^B - 1/2 [W]`` with the bracket form [W], the asymmetry of K^A, and K^X
        is K^A less the wrench term of its connection, here ``Ad^T R Ad``.
        """
        return np.asarray(wrench.dot(self._from_b).reshape(*wrench.shape[:-1], 3, 6, 6))

    def change(self, wrench: Array) -> Array:
        """The last of `changes` (..., 6, 6), under wrenches (..., 6)."""
        return (wrench @ self._from_b[:, 72:]).reshape(*wrench.shape[:-1], 6, 6)

    @property
    def _from_b(self) -> Array:
        return _changes_from_b(self.kind, self.at)

    def acting(self, wrench: ArrayLike, pose: Array, axes: Axes = "body") -> Load:
        """The load as a term of the energy, from its components at a pose of the body.

        Parameters
        ----------
        wrench : array_like, shape (6,)
            Moment about and force at the point, on the body.
        pose : ndarray, shape (4, 4)
            ``T_F_M`` at which the components are as given.
        axes : {"body", "world"}
            Axes of the components at that pose: those of M or those of F.

        Raises
        ------
        UnknownNameError
            For other axes.
        InputError
            For a wrong count or numbers that are not finite.
        """
        from cartstiff.core.potentials.loads import (
            DeadWrench,
            FollowerWrench,
            SemitangentialWrench,
        )

        W = checked_input(wrench, (6,), "wrench")
        if self.kind == "follower":
            return FollowerWrench(wrench_in_body(W, pose, self.at, axes))
        check_name("axes", axes, _AXES)
        R = pose[:3, :3]
        inertial = W if axes == "world" else np.concatenate([R @ W[:3], R @ W[3:]])
        if self.kind == "dead":
            return DeadWrench(inertial, point=self.at)
        return SemitangentialWrench(inertial, R, point=self.at)


DEAD_AT_ORIGIN = LoadKind()


def checked_load(
    kind: str, at: ArrayLike, axes: str, given: bool, own: bool = False
) -> LoadKind:
    """The kind of a load; refused if there is no load.

    Parameters
    ----------
    kind, at, axes
        As in `cartstiff.analyse`.
    given : bool
        Whether a wrench is given.
    own : bool
        Whether the springs themselves may exert a load, which has a kind and a point as
        well.

    Raises
    ------
    UnknownNameError
        For an unknown kind or axes.
    InputError
        For a point that is not three finite numbers, or where there is no load.
    """
    if kind == "dead" and at is DEAD_AT_ORIGIN.at and axes == "body":
        return DEAD_AT_ORIGIN  # the usual case
    checked = LoadKind(kind, at)  # type: ignore[arg-type]
    check_name("axes", axes, _AXES)
    if not given:
        for name, is_given in (
            ("load_axes", axes != "body"),
            ("load_kind", checked.kind != "dead" and not own),
            ("load_at", any(checked.at) and not own),
        ):
            if is_given:
                raise InputError(
                    "is about a load, and none is given",
                    where=name,
                    expected="a wrench (--load) as well",
                )
    return checked


def wrench_in_body(
    wrench: ArrayLike, pose: Array, at: Sequence[float], axes: Axes
) -> Array:
    """W about M's origin in the axes of M, for one posture, a stack, or recorded numbers.

    Parameters
    ----------
    wrench : array_like, shape (..., 6)
        Moment about and force at the point.
    pose : ndarray, shape (..., 4, 4)
        ``T_F_M``.
    at : sequence of 3 floats
        The point, in M.
    axes : {"body", "world"}
        Axes of the components: those of M or those of F.

    Raises
    ------
    UnknownNameError
        For other axes.
    """
    check_name("axes", axes, _AXES)
    W = np.array(wrench)
    W = W if W.dtype == object else W.astype(float)
    if axes == "world":
        W = W.reshape(*W.shape[:-1], 2, 3) @ pose[..., :3, :3]
        W = W.reshape(*W.shape[:-2], 6)
    if any(at):
        W[..., :3] += W[..., 3:] @ se3.skew(np.array(at)).T
    return W


@lru_cache(maxsize=64)
def _changes_from_b(kind: str, at: tuple[float, float, float]) -> Array:
    """`LoadKind.changes` of the six basis wrenches, (6, 108)."""
    half = 0.5 * se3.bracket_form(np.eye(6)).reshape(6, 36)
    each = (CARTAN_MINUS, KINEMATIC, _connection(kind, at))
    return read_only(-np.concatenate([c._symbols_by_wrench + half for c in each], axis=1))


@lru_cache(maxsize=64)
def _connection(kind: str, at: tuple[float, float, float]) -> Connection:
    if kind == "follower":
        return CARTAN_MINUS
    symbols = turning_symbols(1.0 if kind == "dead" else 0.5)
    name = f"{kind} load"
    if any(at):
        name += f" at ({', '.join(f'{x:g}' for x in at)})"
    there = Connection(name, symbols, f"tangent: {LOAD_KINDS[kind]}")
    return there.carried_to(se3.pose(translation=np.negative(at)))
