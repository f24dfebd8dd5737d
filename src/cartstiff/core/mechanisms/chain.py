r"""Mechanisms made of a kinematic tree: serial arms, and closed chains where
frames are tied.

A closure ties frame b to frame a: a weld's residual is log(T_a_b), a common point's the
position of one in the other's directions. At closure its second derivative is the bracket
form along the path from a to b (up to terms that vanish on the motions that keep the
closure).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from copy import copy
from dataclasses import dataclass, replace
from functools import partial
from math import sqrt
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from cartstiff.core.arrays import Array, is_pose, read_only
from cartstiff.core.errors import ConvergenceError, InputError, UnknownNameError
from cartstiff.core.geometry import se3
from cartstiff.core.lazily import cached_property
from cartstiff.core.mechanisms.clearances import clearances
from cartstiff.core.mechanisms.closures import (
    LONGEST_STEP,
    ClosureState,
    LoopClosures,
    ReferencePosture,
    held_map,
)
from cartstiff.core.mechanisms.closures import Closure as Closure
from cartstiff.core.mechanisms.contract import (
    Mechanism,
    MechanismPosture,
    Quantities,
    Skeleton,
)
from cartstiff.core.mechanisms.cut_joints import CutPosture
from cartstiff.core.mechanisms.tree import WORLD, FixedFrame, KinematicTree, TreeState
from cartstiff.core.notes import Note
from cartstiff.core.numerics import (
    ATTAINABLE_PRECISION,
    LEAST_CLOSURE_RATE,
    LOST_ERROR,
    NEGLIGIBLE_DIFFERENCE,
    NEGLIGIBLE_DISTANCE,
    ROUNDOFF,
)
from cartstiff.core.numerics.searches import least_change
from cartstiff.core.potentials.contract import (
    IDENTITY,
    POSE,
    Evaluation,
    Number,
    SecondOrderMap,
    rescaled,
)
from cartstiff.core.units import Units

if TYPE_CHECKING:
    from cartstiff.core.mechanisms.shapes import Piece


@dataclass(frozen=True)
class Description:
    """How a part of a chain looks: a robot description file, or shapes of links.

    Attributes
    ----------
    path : Path or None
        URDF or MJCF file.
    prefix : str
        Prefix of the file's frame names in the tree.
    pieces : tuple of Piece or None
        Shapes on frames, where they do not come from the file.
    text : str or None
        The URDF, where it differs from the file's contents.
    packages : tuple of Path
        Folders in which package:// names are searched first.
    """

    path: Path | None
    prefix: str = ""
    pieces: tuple[Piece, ...] | None = None
    text: str | None = None
    packages: tuple[Path, ...] = ()

    @property
    def name(self) -> str:
        """The file's name, for messages."""
        return "the robot" if self.path is None else self.path.name


#: Ends of the names of a placement's numbers: its coordinates, and turns about its axes.
PLACE_AXES = ("x", "y", "z", "rx", "ry", "rz")
# Sums up the angular and the linear components.
_HALVES = np.repeat(np.eye(2), 3, axis=1)


def _mean_distance(jacobian: Array, reach: float) -> float | None:
    """Root mean square distance of axes from the origin;
    None without axes and if all meet it.

    A coordinate that turns the body by less than `NEGLIGIBLE_DISTANCE` has no axis:
    joints with opposite turns, as in a parallelogram, turn the body by round-off only.
    Nor has one that turns it by less than `LOST_ERROR` about an axis as many times beyond
    the reach: parallel axes that are not quite so in the file would make a length of
    kilometres.
    """
    turning, moments = _HALVES.dot(jacobian * jacobian).tolist()
    small, far = LOST_ERROR**2, (reach / LOST_ERROR) ** 2
    axes = [
        (t, m)
        for t, m in zip(turning, moments, strict=True)
        if t > NEGLIGIBLE_DISTANCE**2 and not (t < small and m > far * t)
    ]
    if not axes:
        return None
    length = sqrt(sum(m for _, m in axes) / sum(t for t, _ in axes))
    return length if length > NEGLIGIBLE_DIFFERENCE * (reach + length) else None


class ChainPosture(MechanismPosture):
    """A chain at given coordinates."""

    def __init__(self, chain: Chain, q: Array) -> None:
        self.q = q
        self._chain = chain
        self._state: TreeState = chain.tree.at(q)

    @cached_property
    def _of_body(self) -> tuple[Array, SecondOrderMap]:
        return self._state.relative(self._chain.world, self._chain.body)

    @cached_property
    def pose(self) -> Array:  # type: ignore[override]
        """Pose ``T_F_M``."""
        return self._of_body[0]

    @cached_property
    def motion(self) -> SecondOrderMap:  # type: ignore[override]
        """Body twist of M per coordinate rate, with its curvature."""
        return self._of_body[1]

    @cached_property
    def length(self) -> float:  # type: ignore[override]
        """Root mean square distance of the joint axes from the body frame's origin.

        The axes are those of the joints on the way to the body; those of all joints where
        the former meet in its origin (a free-floating base, a wrist and its centre); else
        it is 1.
        """
        # Distances have the round-off of positions in F.
        reach = max(map(abs, self.pose[:3, 3].tolist()))
        length = _mean_distance(self.motion.jacobian, reach)
        if length is None:
            everywhere = se3.adjoint_of_inverse(self.pose) @ self._state.world_jacobian
            length = _mean_distance(everywhere, reach)
        return 1.0 if length is None else length

    @cached_property
    def coordinate_lengths(self) -> Array:  # type: ignore[override]
        """1 for angles, the characteristic length for distances."""
        chain = self._chain
        if chain.has_lengths:
            return np.where(chain.is_length, self.length, 1.0)
        return chain.angles

    def pose_at(self, placement: FixedFrame) -> Array:
        """Return the pose ``T_F_f`` of a frame fixed to a joint, without its map."""
        return self._state.pose(placement)

    def joint_poses(self, joints: Sequence[int]) -> Array:
        """Return the poses ``T_F_j`` (m, 4, 4) of some joints of the tree."""
        return self._state.joint_poses(joints)

    def pose_of_frame(self, name: str) -> Array:
        """Return the pose ``T_F_b`` of a frame, without its map."""
        return self._state.pose(self._chain.placement(name))

    def drawn(self) -> Skeleton:
        """From joint to joint to M, and to the frames of the closures; all joints."""
        chain, state, supports = self._chain, self._state, self._chain.tree.model.supports
        ends = [
            chain.body,
            *(chain.placement(f) for c in chain.closures for f in (c.frame_a, c.frame_b)),
        ]
        origins = self.joint_poses(range(chain.tree.model.njoints))[:, :3, 3]
        paths = [
            np.vstack([origins[list(supports[end.joint])], state.pose(end)[:3, 3]])
            for end in ends
        ]
        return Skeleton(paths, np.vstack([self.pose[:3, 3], origins]))

    def relative(self, frame_a: str, frame_b: str) -> tuple[Array, SecondOrderMap]:
        """Return the pose ``T_a_b`` and its map."""
        if frame_a == "world" and frame_b == "body":
            return self.pose, self.motion
        return self._state.relative(
            self._chain.placement(frame_a), self._chain.placement(frame_b)
        )

    def gravity(self, acceleration: Array) -> Evaluation:
        """Potential energy of the masses in a uniform field."""
        return self._state.gravity(acceleration)

    def cut(self) -> CutPosture:
        """The same with all joints cut."""
        return CutPosture(self._chain, self)

    def mass_matrix(self) -> Array:
        """Mass matrix (n, n)."""
        return self._state.mass_matrix()

    def momentum(self) -> tuple[Array, float]:
        """Linear momentum (3, n) in F per coordinate rate, and the moving mass [kg]."""
        return self._state.momentum()

    @cached_property
    def _tied(self) -> ClosureState | None:
        ties = self._chain.ties
        return None if ties is None else ClosureState(ties, self._state)

    @cached_property
    def residual(self) -> Array | None:  # type: ignore[override]
        """Closure residual (m,), lengths and angles mixed; None without closures."""
        tied, rigid = self._tied, self._chain.rigid
        if not rigid:
            return None if tied is None else tied.residual
        held = np.zeros(len(rigid))  # where they are
        return held if tied is None else np.concatenate([tied.residual, held])

    @cached_property
    def closure(self) -> SecondOrderMap | None:  # type: ignore[override]
        """Map to the closure residual, followed by the rigid coordinates in order."""
        tied, rigid = self._tied, sorted(self._chain.rigid)
        if tied is None and not rigid:
            return None
        return held_map(tied, rigid, self.coordinate_lengths, self.length)

    @property
    def actuation(self) -> Array | None:  # type: ignore[override]
        """Rows of the actuated coordinates of a closed chain."""
        return self._chain.selection

    def chart(self) -> SecondOrderMap | str:
        """Return the joint coordinates, or the actuated ones of a closed chain,
        if they are six.
        """
        chain = self._chain
        actuated, n = chain.actuated, self.q.size
        if actuated is None:
            if n == 6 and not chain.closures:
                return IDENTITY
            if chain.closures:
                return "K^F needs six actuated coordinates: the mechanism names none"
            return f"K^F needs exactly six joint coordinates; this chain has {n}"
        select = self.actuation
        if select is None or len(actuated) != 6:
            return (
                f"K^F needs six actuated coordinates: this mechanism has {len(actuated)}"
            )
        return SecondOrderMap(select, lambda _: np.zeros((n, n)))


def _is_closed(posture: ChainPosture) -> bool:
    """Whether the closures are satisfied to rounding."""
    residual = posture.residual
    return residual is None or bool(
        np.abs(residual).max() <= ATTAINABLE_PRECISION * max(1.0, posture.length)
    )


# Three times as many welds as hold all of `MOST_COORDINATES`.
_MOST_CLOSURES = 100


class Chain(Mechanism):
    """A kinematic tree with a body frame, and frames tied together or not.

    Parameters
    ----------
    tree : KinematicTree
        The joints.
    frame : str
        Name of the frame that the frame of interest is fixed to.
    offset : array_like, shape (4, 4), optional
        ``T_frame_M``; default the identity.
    closures : sequence of Closure
        Tied frames; none for a serial arm.
    actuated : sequence of int, optional
        Indices of the actuated coordinates of a closed chain.
    virtual : sequence of int
        Indices of the virtual joints of compliant links.
    kind : str
        As in mechanism files.
    descriptions : sequence of Description
        How the links look.
    """

    length_powers: ClassVar = {
        "body": 0,
        "base_pose": POSE,
        "frame_offset": POSE,
        "legs": 0,
    }

    def __init__(
        self,
        tree: KinematicTree,
        frame: str,
        *,
        offset: ArrayLike | None = None,
        closures: Sequence[Closure] = (),
        actuated: Sequence[int] | None = None,
        virtual: Sequence[int] = (),
        kind: str = "serial",
        descriptions: Sequence[Description] = (),
    ) -> None:
        self.tree = tree
        self.descriptions = tuple(descriptions)
        self.frame = frame
        self.kind = kind
        self.coordinates = tree.coordinates
        self.closures = tuple(closures)
        if (many := len(self.closures)) > _MOST_CLOSURES:
            raise InputError(
                "too many closures", expected=f"at most {_MOST_CLOSURES}", got=many
            )
        driven = tuple(range(tree.n))
        self.actuated: tuple[int, ...] | None = None
        self.selection: Array | None = None
        if actuated is not None:
            self.actuated = driven = tuple(actuated)
            self.selection = np.eye(tree.n)[list(driven)]
        self.virtual = frozenset(virtual)
        self.held: list[int] = sorted({*(self.actuated or ()), *virtual})
        self.undriven = self.virtual | (frozenset(range(tree.n)) - frozenset(driven))
        self.has_lengths = bool(self.is_length.any())
        #: Natural sizes of the coordinates of a chain of angles only.
        self.angles = read_only(np.ones(tree.n))
        at = tree.placement(frame)
        if offset is not None and not is_pose(np.asarray(offset, float)):
            raise InputError(
                "frame offset is not a rigid motion", got=np.asarray(offset).tolist()
            )
        T_frame_M = np.eye(4) if offset is None else np.asarray(offset, float)
        self.body = FixedFrame(at.joint, at.T_j_f @ T_frame_M)
        self.frame_offset = read_only(T_frame_M.copy())
        #: Mass [kg] of the payload on each joint that carries some, and that of the links
        #: there.
        self.payload: dict[int, tuple[float, float]] = {}
        #: Those with kinematics in closed form, as `kinematics.leg_shapes` has them.
        self.legs: tuple[Any, ...] = ()
        self.home: ReferencePosture | None = None  # the file's posture, closed
        self.world = WORLD
        for closure in self.closures:
            for name in (closure.frame_a, closure.frame_b):
                self.placement(name)

    def with_rigid(self, rigid: frozenset[int]) -> Chain:
        """Return the chain with other rigid coordinates."""
        other = copy(self)
        other.rigid = rigid
        return other

    @cached_property
    def ties(self) -> LoopClosures | None:
        """The constants of the closures; None without closures."""
        places = [
            (self.placement(c.frame_a), self.placement(c.frame_b)) for c in self.closures
        ]
        return LoopClosures(self.closures, places, self.tree) if places else None

    def placement(self, name: str) -> FixedFrame:
        """Return the frame "world", "body", or a named one of the tree."""
        if name in ("body", "world"):
            return self.body if name == "body" else self.world
        try:
            return self.tree.placement(name)
        except UnknownNameError:
            raise UnknownNameError(
                "frame", name, ["world", "body", *self.tree.frames]
            ) from None

    def with_placements(
        self,
        placements: Mapping[int, Array],
        T_j_M: ArrayLike,
        frames: Mapping[str, FixedFrame] | None = None,
    ) -> Chain:
        """The chain with other places of joints, of M on its joint, and of frames."""
        other = copy(self)
        other.tree = self.tree.changed(placements, frames=frames)
        other.body, other.legs = FixedFrame(self.body.joint, np.array(T_j_M, float)), ()
        vars(other).pop("ties", None)
        return other

    @property
    def frames_of_body(self) -> list[str]:
        """Names of the frames on the link that carries M, its own among them."""
        if self.kind not in ("serial", "closed-chain"):
            return [self.frame]
        joint = self.body.joint
        names = [name for name, place in self.tree.frames.items() if place.joint == joint]
        return names if self.frame in names else [self.frame, *names]

    def with_frame(self, name: str) -> Chain:
        """Return the chain with M at a frame of the same link; joints and masses stay."""
        at = self.placement(name)
        if at.joint != self.body.joint:
            raise UnknownNameError("frame", name, self.frames_of_body)
        other = copy(self)
        other.frame, other.frame_offset, other.body = name, read_only(np.eye(4)), at
        return other

    def with_tool(self, T_M_tool: Array) -> Chain:
        """Return the chain with M at a pose in the present one."""
        other, at = copy(self), self.body
        other.frame_offset = read_only(self.frame_offset @ T_M_tool)
        other.body = FixedFrame(at.joint, at.T_j_f @ T_M_tool)
        return other

    def with_mass(
        self, mass: float, centre: Array, carrier: FixedFrame | None = None
    ) -> Chain:
        """The chain with a point mass [kg] added at a point of M, or of another frame."""
        other, at = copy(self), carrier or self.body
        other.tree = self.tree.with_mass(at, mass, centre)
        if at.joint > 0:
            own = float(self.tree.model.inertias[at.joint].mass)
            hung, bare = self.payload.get(at.joint, (0.0, own))
            other.payload = self.payload | {at.joint: (hung + mass, bare)}
        return other

    def with_masses(self, masses: Mapping[str, float]) -> Chain:
        """Return the chain with other masses [kg] of links at the same mass centres."""
        other, links = copy(self), self.tree.links().items()
        other.tree = self.tree.changed(
            masses={j: masses[n] for j, n in links if n in masses}
        )
        return other

    @property
    def frames(self) -> tuple[str, ...]:
        """Names of the frames for potentials and for --frame."""
        return (
            "body",
            *(n for n in self.tree.frames if n.rpartition("/")[2] != "universe"),
        )

    def masses(self) -> dict[str, float]:
        """Masses [kg] that each joint carries, by its first link, and of the payload."""
        own, _ = self.tree.masses()
        # A model put together by hand may have masses on joints without a frame.
        joints = {
            int(j) + 1: str(self.tree.model.names[int(j) + 1])
            for j in np.flatnonzero(own)
        }
        links = sorted({**joints, **self.tree.links()}.items())
        masses = {name: float(own[j - 1]) for j, name in links}
        if not self.payload:
            return masses
        carriers = self.tree.links()
        bare = {carriers[j]: own for j, (_, own) in self.payload.items() if j in carriers}
        return masses | bare | {"payload": sum(hung for hung, _ in self.payload.values())}

    @property
    def is_open_tree(self) -> bool:  # type: ignore[override]
        """Whether it has neither closures nor joints that follow others."""
        return not self.closures and self.mimic is None

    @property
    def mimic(self) -> Array | None:  # type: ignore[override]
        """That of the tree."""
        return self.tree.mimic

    def screws(self) -> Array:
        """Return those of the tree."""
        return self.tree.screws()

    @property
    def root(self) -> str:  # type: ignore[override]
        """The first joint on the way to M."""
        joints = [] if self.closures else self.tree.support(self.body.joint)
        return str(self.tree.model.names[joints[0]]) if joints else ""

    @property
    def reach(self) -> float | None:  # type: ignore[override]
        """Sum of the ways between the joints of an arm, and to M."""
        if self.kind != "serial":
            return None
        model, body = self.tree.model, self.body
        joints = [int(j) for j in model.supports[body.joint] if j]
        ways = [model.jointPlacements[j].translation for j in joints[1:]]
        return float(sum(map(np.linalg.norm, [*ways, body.T_j_f[:3, 3]])))

    def quantities(self) -> list[Quantities]:
        """Return the distances of the rods of legs with diameters."""
        legs = self.legs
        if not any(leg.diameter for leg in legs):
            return []

        def ends(q: Array, pose: Array) -> tuple[Array, Array]:
            starts, ends = zip(*(leg.rod(q, pose) for leg in legs), strict=True)
            return np.stack(starts, axis=-2), np.stack(ends, axis=-2)

        anchors = np.array([leg.shape.anchor for leg in legs])
        points = np.array([leg.T_M_end[:3, 3] for leg in legs])
        are_fixed = np.array([leg.shape.family == "strut" for leg in legs])
        diameters = [leg.diameter for leg in legs]
        return [clearances(diameters, anchors, points, are_fixed, ends)]

    def numbers(self) -> dict[str, Number]:
        """Return placements of joints, of M and of the closures' frames,
        and masses of links.

        "placement.JOINT.x" to ".rz", "frame.x" to ".rz", "closure.FRAME.x" to ".rz", each
        against what carries it, rotations about its own axes and nominally zero;
        "mass.LINK". Virtual joints are within a link, and of frames that share a point
        the rotations do not matter.
        """
        welded = {
            f for c in self.closures if c.type == "weld" for f in (c.frame_a, c.frame_b)
        }
        found = dict[str, Number]()
        for name, (_, T) in self._placed().items():
            group, _, frame = name.partition(".")
            count = 3 if group == "closure" and frame not in welded else 6
            values = [*T[:3, 3].tolist(), 0.0, 0.0, 0.0][:count]
            for axis, x in zip(PLACE_AXES, values, strict=False):
                found[f"{name}.{axis}"] = Number(x, float(axis in "xyz"))
        own, _ = self.tree.masses()
        for j, name in sorted(self.tree.links().items()):
            if own[j - 1] > 0.0:
                found[f"mass.{name}"] = Number(float(own[j - 1]), is_positive=True)
        return found

    def with_numbers(self, values: Mapping[str, float]) -> Chain:
        """Return the chain with some of `numbers` changed; other names are ignored."""
        joints, ends, frame = dict[int, Array](), dict[str, FixedFrame](), self.body.T_j_f
        other, placed, group = self, self._placed(), "mass."
        named = dict.fromkeys(key.rpartition(".")[0] for key in values)
        moved = list(filter(placed.__contains__, named))
        for name in moved:
            joint, T = placed[name]
            T = _displaced(T, name, values)
            kind, _, end = name.partition(".")
            if kind == "placement":
                joints[joint] = T
            elif kind == "closure":
                ends[end] = FixedFrame(joint, T)
            else:
                frame = T
        if moved:
            other = self.with_placements(joints, frame, ends)
        masses = {
            n.removeprefix(group): x for n, x in values.items() if n.startswith(group)
        }
        return other.with_masses(masses) if masses else other

    def _placed(self) -> dict[str, tuple[int, Array]]:
        """Joint and placement on it of what has a place, by its name;
        of joints their own.
        """
        tree, model = self.tree, self.tree.model
        joints = list(range(1, model.njoints))
        if not self.closures:
            joints = tree.support(self.body.joint)
        within = {self.coordinates[i].name for i in self.virtual}
        places = tree.placements()
        found = {
            f"placement.{name}": (j, places[j - 1])
            for j in joints
            if (name := str(model.names[j])) not in within
        }
        found["frame"] = (self.body.joint, np.asarray(self.body.T_j_f))
        for name in (n for c in self.closures for n in (c.frame_a, c.frame_b)):
            if name not in ("body", "world"):
                at = self.placement(name)
                found[f"closure.{name}"] = (at.joint, np.asarray(at.T_j_f))
        return found

    def in_units(self, a: float, units: Units) -> Chain:
        """Return the chain with lengths times `a`."""
        other: Chain = rescaled(self, a)
        other.units = units
        vars(other).pop("ties", None)
        other.tree = self.tree.in_units(a)
        other.coordinates = other.tree.coordinates
        return other

    def at(self, q: ArrayLike) -> ChainPosture:
        """Return the posture at coordinates q (n,)."""
        return ChainPosture(self, self.checked(q))

    def closed(
        self,
        q_start: ArrayLike,
        *,
        named: Sequence[int] | None = None,
        hold: Sequence[int] | None = None,
        tolerance: float = ROUNDOFF,
    ) -> ChainPosture:
        """Return the posture near `q_start` that satisfies the closures.

        Newton's method with steps of least change; each is limited to 0.2 rad (or 0.2
        characteristic lengths). The held coordinates do not change if the others can
        close the chain: those that were named, else actuated joints, and virtual joints
        of links. If the others are as at `home`, the held ones move from there
        (`ReferencePosture.continue_from`), so that the assembly mode is kept.

        Parameters
        ----------
        q_start : array_like, shape (n,)
            Coordinates to start from.
        named : sequence of int, optional
            Coordinates with given values; default, where no joint is actuated: those that
            differ from `home`.
        hold : sequence of int, optional
            Coordinates to hold, and no others; `home` is not used.
        tolerance : float
            Largest residual accepted, in rad and characteristic lengths.

        Raises
        ------
        ConvergenceError
            If the closures cannot be met from there.
        """
        posture = self.at(q_start)
        if posture.residual is None or _is_closed(posture):
            return posture
        closed: ChainPosture | None
        if hold is None:
            home, sets = self.home, list(self._held_sets(posture.q, named))
        else:
            home, sets = None, [list(hold)]
        for held in sets:
            movable, closed = ~np.isin(np.arange(posture.q.size), held), None
            if home is not None:
                close = partial(self._close_from, movable=movable, tolerance=tolerance)
                closed = replace(home, held=held).lead_to(posture.q, close)
            if closed is None and held:
                closed, *_ = self._close(posture, movable, tolerance)
            if closed is not None:
                return closed
        closed, iterations, size = self._close(posture, np.ones_like(movable), tolerance)
        if closed is None:
            raise ConvergenceError(
                "the closures cannot be assembled from this posture",
                iterations=iterations,
                residual=size,
            )
        return closed

    def given(self, q: Array) -> Array:
        """Which coordinates q (..., n) were given: those that differ from `home`.

        No coordinate where joints are actuated, so that these are held, or where all
        differ.
        """
        given = np.zeros(q.shape, bool)
        if self.actuated is None and self.home is not None and self.closures:
            given = q != self.home.q
            given[..., list(self.virtual)] = False
            given &= (given.sum(axis=-1) < self.tree.n - len(self.virtual))[..., None]
        return given

    def adjusted(
        self, given: Array, q: Array, named: Sequence[int] | None = None
    ) -> tuple[Note, ...]:
        """Return a note on coordinates that closing moved, see `Mechanism.adjusted`."""
        if not self.closures:
            return ()
        meant = {*(self.actuated or ()), *(named or ())}
        if self.actuated is None and named is None and self.home is not None:
            meant = set(np.flatnonzero(given != self.home.q).tolist())
        differs = np.flatnonzero(np.abs(q - given) > NEGLIGIBLE_DIFFERENCE).tolist()
        changes, each = dict[str, float](), []
        for j in filter(meant.__contains__, differs):
            c, old, new = self.coordinates[j], float(given[j]), float(q[j])
            changes[c.name] = new - old
            each.append(
                f"{c.name} {old:g} -> {new:g} {self.units.coordinate(c.is_length)}"
            )
        if not changes:
            return ()
        words = (
            "the chain does not close with its joints as given, and they moved: "
            f"{', '.join(each)}"
        )
        return (Note("actuators-adjusted", words, changes),)

    def closed_as_given(self, q: Array) -> Array:
        """Close those of coordinates (N, n) of which a part was given (see `given`)."""
        which = np.flatnonzero(self.given(q).any(axis=1))
        if which.size:
            q = q.copy()
        for i in which:
            with suppress(ConvergenceError):  # the caller meets it again at this posture
                q[i] = self.closed(q[i]).q
        return q

    def _held_sets(self, q: Array, named: Sequence[int] | None) -> list[list[int]]:
        """Sets of held coordinates that are tried in turn to close the chain."""
        named = np.flatnonzero(self.given(q)).tolist() if named is None else named
        if set(named) <= set(self.held):
            return [self.held]
        return [sorted({*named, *self.virtual}), self.held]

    def _close_from(
        self, start: Array, movable: Array, tolerance: float
    ) -> ChainPosture | None:
        return self._close(self.at(start), movable, tolerance)[0]

    def _close(
        self, posture: ChainPosture, movable: Array, tolerance: float
    ) -> tuple[ChainPosture | None, int, float]:
        def equations(at: ChainPosture) -> tuple[Array, Array]:
            residual, closure, unit = at.residual, at.closure, max(1.0, at.length)
            assert residual is not None  # a chain without closures is closed
            assert closure is not None
            return residual / unit, closure.jacobian * (
                at.coordinate_lengths * movable
            ) / unit

        def retract(at: ChainPosture, step: Array) -> ChainPosture:
            return self.at(at.q + at.coordinate_lengths * movable * step)

        closed, size, iterations = least_change(
            posture,
            equations,
            retract,
            evaluations=100,
            longest_step=LONGEST_STEP,
            tolerance=tolerance,
            rank=LEAST_CLOSURE_RATE,
        )
        return (closed if size <= tolerance else None), iterations, size


def _displaced(T: Array, name: str, values: Mapping[str, float]) -> Array:
    """Placement with its named numbers: position, and turns about its own axes."""
    nominal = [*T[:3, 3].tolist(), 0.0, 0.0, 0.0]
    each = zip(PLACE_AXES, nominal, strict=True)
    x = np.array([values.get(f"{name}.{axis}", own) for axis, own in each])
    R = se3.exp(np.array([*x[3:], 0.0, 0.0, 0.0]))[:3, :3]
    return se3.pose(T[:3, :3] @ R, x[:3])
