r"""The workspace of a platform: its volume, the limit that cuts each boundary, what fits inside.

From a centre, rays leave in directions of a product rule on the sphere (Gauss in height, equal
steps around). Along each the poses are scanned and every boundary is bisected: that says which
limit cuts where. The volume is that of columns along z over a grid of the box around them, each
scanned and bisected too, so that holes and parts that are not connected count.

Of orientations the same rays run in the ball of rotation vectors, where a turn by up to theta about
an axis takes ``(theta - sin theta) / pi`` of all rotations in that direction.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from cartstiff.arrays import checked_flag, checked_input, checked_length
from cartstiff.checked_call import checked
from cartstiff.choices import Distribution
from cartstiff.errors import InputError
from cartstiff.geometry import se3
from cartstiff.geometry.se3 import Array
from cartstiff.kinematics.architecture import architecture_of, orientation_rank
from cartstiff.kinematics.at_pose import COORDINATES
from cartstiff.mechanisms.chain import Chain
from cartstiff.mechanisms.elastic import ElasticMechanism, checked_elastic, gravity_loads
from cartstiff.mechanisms.platform import Platform
from cartstiff.notebook import ShownInLines
from cartstiff.notes import Note
from cartstiff.reach.margins import CarriedLoad, LegMargins, Margins
from cartstiff.reach.regions import (
    Columns,
    Moved,
    Progress,
    Rays,
    columns_inside,
    inscribed,
    rays_to_boundaries,
    shifted,
)
from cartstiff.reach.singularities import Singular, least_ratio, singular_around
from cartstiff.stiffness.applied_load import LoadKind, checked_load


def carried(
    kind: LoadKind, wrench: Array, axes: Literal["body", "world"], start: Array
) -> CarriedLoad:
    """The load along the axes in which it is the same at all poses, from those at the start."""
    if kind.kind == "conservative":
        raise InputError(
            "a moment that turns by half depends on where the body comes from",
            where="load_kind",
            expected="dead or follower",
            got=kind.kind,
        )
    parts, R = wrench.reshape(2, 3), start[:3, :3]
    if kind.kind == "follower":
        return kind, (parts @ R if axes == "world" else parts).reshape(6), "body"
    return kind, (parts @ R.T if axes == "body" else parts).reshape(6), "world"


def singular_note(platform: Platform, pose: Array, margins: Margins) -> Note | None:
    """The note on an architecture, or an orientation, that is singular everywhere."""
    note = architecture_of(platform).note()
    if note is not None or margins.is_spread:
        return note
    rank = orientation_rank(platform, pose[:3, :3])
    if rank == 6:
        return None
    message = (
        f"with this orientation the legs' lines have rank {rank} at every position, though the "
        "architecture is regular (as Fichter's platform turned by a right angle)"
    )
    return Note("orientation-singularity", message, {"rank": rank})


def reach_of_lines(platform: Platform, pose: Array, radius: float | None) -> float:
    """How far from the centre any position can be: where the legs' longest lengths end."""
    if radius is not None:
        return checked_length(radius, "radius")
    longest = np.inf if platform.limits is None else platform.limits[:, 1]
    ends = platform.points @ pose[:3, :3].T + pose[:3, 3] - platform.anchors
    farthest = float(np.min(np.linalg.norm(ends, axis=1) + longest))
    if not np.isfinite(farthest):
        raise InputError(
            "the lengths of the legs have no upper limit, so that the workspace has no bound",
            expected="legs.limits, or a radius",
        )
    return farthest


#: Name and version of the form of `Workspace.as_dict`.
WORKSPACE_SCHEMA = "cartstiff-workspace/1"


@dataclass(frozen=True, eq=False, repr=False)
class Workspace(ShownInLines):
    """What a platform, or a body on legs, reaches with one orientation, and around one position.

    Attributes
    ----------
    elastic : ElasticMechanism
        The mechanism.
    pose : ndarray (4, 4)
        Centre of the rays: orientation and position of M.
    positions, turns : Rays or None
        Rays of positions with the orientation of `pose`, and of rotations at its position.
    columns : Columns or None
        The positions inside, as columns along z.
    sphere, cube : tuple of (centre (3,), size) or None
        Largest sphere (radius) and cube along the axes of F (edge) found inside.
    singularity : tuple of (ratio, position) or None
        Least ratio of singular values of six legs' lines, moments over the body's length, on the
        poses inside, and where it is.
    singular : Singular or None
        Where the determinant of six legs changes its sign, and how far the nearest such pose is.
    margin : float
        Least margin at the centre: negative where it is outside.
    distribution : dict
        Name of the "distribution" of tensions and those "at_centre" (m,); empty where no tensions
        are limited.
    axes : tuple of str
        Coordinates of the pose that are followed: x, y, z, or those that a body with fewer freedoms
        takes. Rays and columns count angles as lengths, a quarter of a turn as the reach.
    scales : ndarray (3,)
        What makes them coordinates again.
    load : mapping, optional
        The wrench that is carried, its kind, point and axes.
    notes : tuple of Note
        What was assumed, and what does not exist.
    """

    elastic: ElasticMechanism
    pose: Array
    positions: Rays | None = None
    turns: Rays | None = None
    columns: Columns | None = None
    sphere: tuple[Array, float] | None = None
    cube: tuple[Array, float] | None = None
    singularity: tuple[float, Array] | None = None
    singular: Singular | None = None
    margin: float | None = None
    distribution: dict[str, Any] = field(default_factory=dict)
    axes: tuple[str, ...] = ("x", "y", "z")
    scales: Array = field(default_factory=lambda: np.ones(3))
    load: Mapping[str, Any] | None = None
    notes: tuple[Note, ...] = ()

    @property
    def volume(self) -> float | None:
        """Of the positions with this orientation, in the units of the axes."""
        return None if self.columns is None else self.columns.volume * float(self.scales.prod())

    @property
    def volume_error(self) -> float | None:
        """Estimate of the volume's error.

        The larger of three standard errors of the columns' sum, `Columns.error`, and the difference
        from the volume that the rays enclose, ``4 pi/3`` of the mean of their lengths cubed.
        """
        if self.columns is None or self.positions is None:
            return None
        by_rays = self.positions.total(lambda r: 4.0 / 3.0 * np.pi * r**3)
        error = max(self.columns.error, abs(by_rays - self.columns.volume))
        return error * float(self.scales.prod())

    @property
    def share_of_rotations(self) -> float | None:
        """Of all rotations, the share that is allowed at this position."""
        if self.turns is None:
            return None
        return self.turns.total(lambda angle: (angle - np.sin(angle)) / np.pi)

    @property
    def least_turn(self) -> float | None:
        """Angle in rad that the body can turn by about every axis, from the centre."""
        return None if self.turns is None else float(self.turns.first.min())

    @property
    def boundary(self) -> Array:
        """Values (k, 3) of the axes on the boundary: the last ones within the limits."""
        if self.positions is None:
            return np.empty((0, 3))
        return _places(self.positions) * self.scales + self.centre

    @property
    def centre(self) -> Array:
        """Values (3,) of the axes where the rays start."""
        every = np.append(self.pose[:3, 3], se3.roll_pitch_yaw(self.pose))
        return np.asarray(every[[COORDINATES.index(name) for name in self.axes]])

    @property
    def slices(self) -> list[tuple[float, float]]:
        """Values of the last axis, and areas across it, at equal distances."""
        (a, b, c), z = self.scales, self.centre[2]
        areas = [] if self.columns is None else self.columns.slices(9)
        return [(z + c * (x - z), a * b * area) for x, area in areas]

    def _lines(self) -> list[str]:
        return [
            f"Workspace of {self.elastic.name}: volume {self.volume}",
            f"  turns in every direction {self.least_turn} rad",
        ]

    def as_dict(self) -> dict[str, Any]:
        """For JSON: numbers, lists, texts, None."""
        elastic, units = self.elastic, self.elastic.units
        sphere, cube, near = self.sphere, self.cube, self.singularity
        return {
            "schema": WORKSPACE_SCHEMA,
            "mechanism": {
                "name": elastic.name,
                "kind": elastic.mechanism.kind,
                "joints": list(elastic.names),
            },
            **elastic.mechanism.frames_as_dict(),
            "units": {"length": units.length, "force": units.force, "angle": "rad"},
            "pose": self.pose.tolist(),
            **gravity_loads(elastic).as_dict(),
            "load": None if self.load is None else dict(self.load),
            "volume": self.volume,
            "volume_error": self.volume_error,
            "cut_by": {} if self.positions is None else self.positions.shares(),
            "axes": list(self.axes),
            "slices": [{"z": z, "area": area} for z, area in self.slices],
            "poses": sum(
                r.poses for r in (self.positions, self.turns, self.columns) if r is not None
            ),
            "sphere": None
            if sphere is None
            else {"centre": sphere[0].tolist(), "radius": sphere[1]},
            "cube": None if cube is None else {"centre": cube[0].tolist(), "edge": cube[1]},
            "rotations": None
            if self.turns is None
            else {
                "share": self.share_of_rotations,
                "every_axis": self.least_turn,
                "cut_by": self.turns.shares(),
            },
            "singularity": None
            if near is None
            else {"least_ratio": near[0], "position": near[1].tolist()},
            "singular": None if self.singular is None else self.singular.as_dict(),
            "tensions": self.distribution or None,
            "boundary": self.boundary.tolist(),
            "limits": [] if self.positions is None else [e[3] for e in self.positions.edges],
            "notes": [note.as_dict() for note in self.notes],
        }


@checked
def workspace(
    elastic: ElasticMechanism,
    q: ArrayLike | None = None,
    *,
    wrench: ArrayLike | None = None,
    load_kind: Literal["dead", "follower"] = "dead",
    load_at: ArrayLike = (0.0, 0.0, 0.0),
    load_axes: Literal["body", "world"] = "body",
    directions: int | None = None,
    scan: int = 48,
    radius: float | None = None,
    through_singularities: bool = False,
    tensions: Distribution = "any",
    fits: bool = True,
    progress: Progress | None = None,
) -> Workspace:
    """Where a platform, or a body on cables or legs, can be within all limits of its file.

    Parameters
    ----------
    elastic : ElasticMechanism
        With limits of legs: lengths, angles of joints, diameters, forces or tensions; or a body on
        legs made of joints, with their limits and what its legs reach. Of a body with fewer than
        six freedoms the first three coordinates that it takes are followed.
    q : array_like (6,), optional
        Pose whose orientation is kept, and around whose position rotations are tried; rays start
        there. Default the file's pose.
    wrench : array_like (6,), optional
        Load W (moment, force) that the environment applies to the body at `load_at`; it counts
        where forces or tensions are limited, as the body's weight does under gravity.
    load_kind : {"dead", "follower"}
        Whether it keeps its direction in the room while the body turns, or turns with it.
    load_at : array_like (3,)
        The point of the body, in M, about which its moment is and at which its force acts.
    load_axes : {"body", "world"}
        Whose axes its components are along: those of M at the pose the rays start from, or F's.
    directions : int, optional
        About how many rays, and columns; 1000, or 200 for cables, for more than six legs with
        limited forces, for struts with flexures, and for legs made of joints.
    scan : int
        Poses along each ray before boundaries are bisected: gaps and parts thinner than
        ``reach / scan`` may be missed.
    radius : float, optional
        How far positions are followed; default where the longest lengths end.
    through_singularities : bool
        Count poses beyond singular ones, where the determinant of six legs has the other sign.
    tensions : {"any", "closed-form"}
        Of cables, and of more than six legs with limited forces: a pose counts where any tensions
        within the limits carry the load, or where those nearest to the middle of the limits do.
    fits : bool
        Look for the largest sphere and cube inside.
    progress : callable, optional
        Called with (done, total).

    Returns
    -------
    Workspace
        Volumes, boundaries with the limit that cuts each, sphere and cube, singularities.

    Raises
    ------
    InputError
        For mechanisms without legs, without limits, or an unbounded workspace.
    """
    checked_elastic(elastic)
    through = checked_flag(through_singularities, "through_singularities")
    elastic, posture = elastic.placed(q)
    kind = checked_load(load_kind, load_at, load_axes, wrench is not None)
    if scan < 2 or (directions is not None and directions < 8):
        raise InputError("too few poses", expected="scan from 2, directions from 8")
    notes = list(elastic.notes)
    if isinstance(elastic.mechanism, Chain):
        if wrench is not None or tensions != "any":
            raise InputError(
                "is for limits of forces, which legs made of joints do not have",
                where="wrench or tensions",
                expected="neither",
            )
        pose = posture.pose
        on_legs = LegMargins(elastic, pose, through)
        margins: Margins | LegMargins = on_legs
        count, most = directions or 200, on_legs.reach(radius)
    else:
        W = None if wrench is None else checked_input(wrench, (6,), "wrench")
        load = None if W is None else partial(carried, kind, W, load_axes)
        answer = _margins(elastic, posture.q, load, through, tensions)
        if isinstance(answer, Workspace):
            return answer
        margins, pose = answer
        count = directions or (200 if margins.is_slow else 1000)
        most = reach_of_lines(margins.platform, pose, radius)
    axes, scales, moved = _followed(margins, pose, most)
    about_load = (
        None
        if wrench is None
        else {
            "wrench": np.asarray(wrench, float).tolist(),
            "kind": kind.kind,
            "at": list(kind.at),
            "axes": load_axes,
        }
    )
    here = Workspace(elastic, pose, axes=axes, scales=scales, load=about_load, notes=tuple(notes))

    def turned(vectors: Array) -> Array:
        poses = np.tile(pose, (len(vectors), 1, 1))
        turns = se3.exp(np.hstack([vectors, np.zeros_like(vectors)]))[:, :3, :3]
        poses[:, :3, :3] = pose[:3, :3] @ turns
        return poses

    at_centre, reach = margins.at(pose[None])[0], most
    first = rays_to_boundaries(margins, moved, reach, max(8, count // 8), scan)
    if first.edges and radius is None:  # the ends of the legs are far beyond most workspaces
        reach = min(reach, 1.3 * max(distance for _, distance, *_ in first.edges))
    positions = rays_to_boundaries(margins, moved, reach, count, scan, progress)
    while reach < most and positions.is_cut_short and radius is None:
        reach = min(2.0 * reach, most)
        positions = rays_to_boundaries(margins, moved, reach, count, scan, progress)
    boundary = _places(positions) + here.centre
    columns = columns_inside(
        margins, moved, here.centre, boundary, max(8, round(np.sqrt(count))), scan, most
    )
    turns = None
    if not isinstance(margins, LegMargins) or len(margins.free) == 6:
        turns = rays_to_boundaries(margins, turned, np.pi, count, scan)
    if at_centre.min() < 0.0:
        worst = margins.names[int(at_centre.argmin())]
        message = f"the pose that the rays start from is itself beyond a limit: {worst}"
        notes.append(Note("centre-outside", message, {"limit": worst}))
    sphere = cube = None
    quick = isinstance(margins, Margins) or margins.chain.legs
    if fits and at_centre.min() >= 0.0 and axes == ("x", "y", "z"):
        if quick:
            sphere, cube = inscribed(margins, moved, here.centre, positions)
        else:
            message = (
                "the largest sphere and cube are not looked for: these legs' joints follow from a "
                "pose by iterations alone"
            )
            notes.append(Note("no-fits", message, {}))
    near = least_ratio(margins, moved, positions)
    near = None if near is None else (near[0], here.centre + here.scales * near[1])
    singular = singular_around(margins, pose, moved, positions, scan)
    if singular is not None:
        singular = replace(singular, surface=singular.surface * scales + here.centre)
    return replace(
        here,
        positions=positions,
        turns=turns,
        columns=columns,
        sphere=sphere,
        cube=cube,
        singularity=near,
        singular=singular,
        margin=float(at_centre.min()),
        notes=tuple(notes),
        distribution=margins.distribution(pose),
    )


def _places(rays: Rays) -> Array:
    """Offsets (k, 3) of the boundary from the centre."""
    return np.array([x * rays.directions[r] for r, x, *_ in rays.edges]).reshape(-1, 3)


def _margins(
    elastic: ElasticMechanism,
    values: Array,
    loaded: Callable[[Array], CarriedLoad] | None,
    through: bool,
    tensions: Distribution,
) -> tuple[Margins, Array] | Workspace:
    """Margins of a platform and its pose; or all that there is, where it is singular everywhere."""
    bare, platform = Margins(elastic, tensions=tensions), elastic.mechanism
    if not isinstance(platform, Platform):
        raise TypeError("a platform")
    if loaded is not None and bare.forces is None:
        raise InputError(
            "nothing limits forces, so that a load cuts nothing",
            where="wrench",
            expected="legs.force or cables",
        )
    pose, sign = platform.pose_of(np.asarray(values, float)), 0.0
    load = None if loaded is None else loaded(pose)
    if len(platform.points) >= 6:
        singular = singular_note(platform, pose, bare)
        if singular is not None:
            return Workspace(elastic, pose, notes=(*elastic.notes, singular))
    if not bare.names:
        raise InputError(
            "no limits: every pose is within them",
            expected="limits, base_joints, diameter or force in legs",
        )
    if len(platform.points) == 6 and not through and not bare.springs.unilateral:
        sign = float(np.sign(bare.determinants(pose[None])[0]))
    return Margins(elastic, load, sign, tensions), pose


def _followed(
    margins: Margins | LegMargins, pose: Array, most: float
) -> tuple[tuple[str, ...], Array, Moved]:
    """Coordinates that rays and columns follow, what offsets are times, and poses of offsets.

    Angles go as far as a quarter of a turn where lengths go as far as `most`.
    """
    if isinstance(margins, Margins):
        return ("x", "y", "z"), np.ones(3), partial(shifted, pose)
    axes = margins.axes()
    scales = np.where(np.array(axes) < 3, 1.0, 0.5 * np.pi / most)
    home = margins.coordinates(pose[None])[0]

    def moved(offsets: Array) -> Array:
        at = np.tile(home, (len(offsets), 1))
        at[:, axes] += offsets * scales
        return np.asarray(se3.from_roll_pitch_yaw(at[:, :3], at[:, 3:]))

    return tuple(COORDINATES[i] for i in axes), scales, moved
