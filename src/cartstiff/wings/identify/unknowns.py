"""Parameters to be found: compliances, ties between them, and geometry beside them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations_with_replacement

import numpy as np
from numpy.typing import NDArray

from cartstiff.core import numerics
from cartstiff.core.arrays import Array
from cartstiff.core.errors import InputError, UnknownNameError
from cartstiff.core.geometry import se3
from cartstiff.core.mechanisms.elastic import ElasticMechanism
from cartstiff.core.mechanisms.identified import CompliancePattern, size_of_compliance
from cartstiff.core.potentials.contract import BEAM, key_of_pair
from cartstiff.kinematics.joint_poses import Kinematics
from cartstiff.wings.identify.measurements import (
    POSITION,
    TURN,
    Measurements,
    Observations,
)

#: Probability of intervals.
LEVEL = 0.95
#: Groups that can be sought, besides single springs by name.
_GROUPS = ("joints", "links", "lines", "all")
#: Geometry that can be sought beside springs; "JOINT.zero" is one of the zeros.
GEOMETRY, ZERO = ("zeros", "tool", "base"), ".zero"


@dataclass(frozen=True)
class Unknown:
    """One parameter: a compliance, in the units of the mechanism.

    Attributes
    ----------
    pattern : CompliancePattern
        Compliances of the mechanism on which it acts.
    unit : str
        Unit of its stiffness.
    nominal : float
        Start of the search: the mechanism's own.
    size : float
        Natural size of its changes.
    has_stiffness : bool
        Whether its inverse is a stiffness, so that it is not negative. False for
        off-diagonal entries of a matrix, and for a polynomial's higher coefficients.
    law : (str, int), optional
        Joint, and power of the deflection, of a polynomial spring.
    """

    pattern: CompliancePattern
    unit: str
    nominal: float
    size: float
    has_stiffness: bool = True
    law: tuple[str, int] | None = None

    @property
    def name(self) -> str:
        """Name of the parameter."""
        return self.pattern.name

    @property
    def is_scale(self) -> bool:
        """Whether it is a factor on a beam's own compliance."""
        return self.pattern.is_share


@dataclass(frozen=True, eq=False)
class Unknowns:
    """All parameters.

    Attributes
    ----------
    elastic : ElasticMechanism
        The mechanism.
    parameters : tuple of Unknown
        In their order.
    geometry : tuple of str
        Further unknowns of measured positions: "JOINT.zero", "tool", "base".
    sessions : {"rigid", "translation", "none"}
        Unknown part of the pose of the measuring frame in each session.
    """

    elastic: ElasticMechanism
    parameters: tuple[Unknown, ...]
    geometry: tuple[str, ...] = ()
    sessions: str = "rigid"

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters."""
        return tuple(u.name for u in self.parameters)

    @property
    def nominal(self) -> Array:
        """Start values (P,)."""
        return np.array([u.nominal for u in self.parameters])

    @property
    def is_bounded(self) -> Array:
        """Parameters that cannot be negative (P,)."""
        return np.array([u.has_stiffness for u in self.parameters], bool)

    @property
    def sizes(self) -> Array:
        """Natural size of each parameter (P,), from the mechanism's own compliances."""
        return np.array([u.size for u in self.parameters])

    @property
    def least(self) -> Array:
        """Least values (P,) that a mechanism can have: of compliances,
        a small share of its own.
        """
        share = numerics.NEGLIGIBLE_DIFFERENCE * np.abs(self.nominal)
        return np.where(self.is_bounded, share, -np.inf)

    def mechanism(self, theta: Array) -> ElasticMechanism:
        """The mechanism with these compliances; those at zero become very small."""
        theta = np.maximum(theta, self.least)
        pairs = zip(self.parameters, theta.tolist(), strict=True)
        return self.elastic.with_compliances(
            {key: weight * x for u, x in pairs for key, weight in u.pattern.keys}
        )

    def per_share(self, theta: Array) -> Array:
        """Factors (P,) of derivatives by compliances of `mechanism`.

        A beam's share is there that of what it has become.
        """
        share = np.where([u.is_scale for u in self.parameters], theta, 1.0)
        return 1.0 / np.maximum(share, self.least)


def unknowns_of(
    elastic: ElasticMechanism,
    sought: Sequence[str] = (),
    *,
    ties: Sequence[Sequence[str]] = (),
) -> Unknowns:
    """Parameters to be found in a mechanism.

    Parameters
    ----------
    elastic : ElasticMechanism
        Its springs are the start of the search.
    sought : sequence of str
        Names of springs (joints, legs, lines), of flexible links (their whole 6x6, or
        "LINK:diagonal"; a beam's factor), or "joints", "links", "lines", "all". Default:
        "joints". A joint with a polynomial in the file, sought by its own name only, has
        one unknown for each of its coefficients that is not zero. Beside springs: "zeros"
        of all joints or "JOINT.zero", "tool" (the measured point), "base" (its place),
        unless a spring or link has that name.
    ties : sequence of sequences of str
        Springs with equal stiffness.

    Raises
    ------
    UnknownNameError
        For a name that is no spring.
    InputError
        For one that is named twice or is not allowed.
    """
    geometry, springs = _geometry(elastic, sought)
    names = _expanded(elastic, springs or ("joints",))
    parameters = [u for name in names for u in _made(elastic, name)]
    name, times = Counter(u.name for u in parameters).most_common(1)[0]
    if times > 1:
        raise InputError(f"{name!r} is sought twice", where="--unknown")
    for group in ties:
        parameters = _tied(parameters, group)
    return Unknowns(elastic, tuple(parameters), geometry)


def zeros_of(elastic: ElasticMechanism) -> list[str]:
    """Names of the zeros that can be sought: those of an open chain's joints."""
    mechanism = elastic.mechanism
    is_open = not (mechanism.closures or mechanism.coordinates_are_pose)
    return [f"{name}{ZERO}" for name in mechanism.joint_names] if is_open else []


def _geometry(
    elastic: ElasticMechanism, sought: Sequence[str]
) -> tuple[tuple[str, ...], list[str]]:
    """Sought geometry, each once, and the remaining words."""
    zeros = [f"{name}{ZERO}" for name in elastic.mechanism.joint_names]
    own = {*elastic.compliances, *_links(elastic)}
    names: list[str] = []
    others = []
    for word in sought:
        if word in own or word not in (*GEOMETRY, *zeros):
            others.append(word)
            continue
        if word not in ("tool", "base") and not zeros_of(elastic):
            raise InputError(
                "zeros of joints are found for open chains only",
                where="--unknown",
                got=word,
            )
        names += [n for n in (zeros if word == "zeros" else [word]) if n not in names]
    return tuple(names), others


def _expanded(elastic: ElasticMechanism, sought: Sequence[str]) -> list[str]:
    """Single springs and links, each once."""
    links = _links(elastic)
    within = {n for members in links.values() for n in members}
    own = [n for n in elastic.compliances if _part_of(n) not in within]
    # Polynomials are sought by their own names only, and then all coefficients.
    bent = [n for n in polynomials(elastic) if n in own]
    linear = [n for n in own if _part_of(n) not in bent and not n.endswith(BEAM)]
    lines = [n for n in linear if n.startswith("line") and n not in elastic.names]
    joints = [n for n in linear if n not in lines]
    names: list[str] = []
    for word in sought:
        more = {
            "joints": joints,
            "links": list(links),
            "lines": lines,
            "all": [*joints, *links, *lines],
        }.get(word, [word])
        singles = (*joints, *bent, *lines, *links, *within)
        if more == [word] and word not in singles and word.partition(":")[0] not in links:
            valid = (*_GROUPS, *GEOMETRY, *singles)
            raise UnknownNameError("spring", word, valid, where="--unknown")
        if not more:
            raise InputError(
                f"the mechanism has no {word}",
                where="--unknown",
                expected=", ".join([*linear, *links]),
            )
        names += [name for name in more if name not in names]
    if not names:
        raise InputError("the mechanism has no spring to be found")
    return names


def _part_of(key: str) -> str:
    """The first deflection of a compliance: its joint, line, or axis of a link."""
    return key.partition(" x^")[0].partition("*")[0]


def polynomials(elastic: ElasticMechanism) -> dict[str, tuple[float, ...]]:
    """Coefficients of the polynomial springs by joint."""
    laws = {} if elastic.springs is None else elastic.springs.laws
    return {elastic.names[j]: law.powers for j, law in laws.items() if law.powers}


def _made(elastic: ElasticMechanism, word: str) -> list[Unknown]:
    """Parameters of one word: a spring, a polynomial spring, or a link."""
    own = elastic.compliances
    if word in polynomials(elastic):
        if not 0.0 < own[word].value < np.inf:
            raise InputError(
                "a polynomial spring that is sought needs a first coefficient",
                where=f"--unknown {word}",
                expected="above zero",
                got=1.0 / own[word].value,
            )
        keys = [key for key in own if _part_of(key) == word and own[key].value != 0.0]
        return [_unknown(elastic, key) for key in keys]
    links = _links(elastic)
    if word in own:
        return [_unknown(elastic, word)]
    for link, members in links.items():
        if word in members:
            _refuse_of_beam(word, link, "--unknown")
    return _of_link(elastic, word)


def _unknown(elastic: ElasticMechanism, key: str) -> Unknown:
    """The parameter of one compliance."""
    number, units = elastic.compliances[key], elastic.units
    joint, _, power = key.partition(" x^")
    # A compliance of a distance has the unit of length over force.
    unit = units.spring(number.length > 0.0) if number.length else units.force
    if power:
        j = elastic.names.index(joint)
        unit = units.spring(elastic.mechanism.coordinates[j].is_length) + f"^{power}"
    law = (joint, int(power or 1)) if joint in polynomials(elastic) else None
    if key.endswith(BEAM):
        unit = "of the file's"
    return Unknown(
        CompliancePattern(key, ((key, 1.0),)),
        unit,
        number.value,
        size_of_compliance(key, elastic.compliances),
        number.is_positive,
        law,
    )


def _refuse_of_beam(name: str, link: str, where: str) -> None:
    """Refuse one axis of a beam: a beam's compliance is a multiple of its own."""
    raise InputError(
        f"{name!r}: one axis of a beam has no stiffness of its own",
        where=where,
        expected=f"--unknown {link}, a factor on the whole beam",
    )


def _links(elastic: ElasticMechanism) -> dict[str, list[str]]:
    """Flexible links, with the names of their virtual joints."""
    links = {}
    for potential in elastic.potentials:
        if potential.members:
            members = [elastic.names[j] for j in potential.members]
            links[potential.link or members[0].rpartition(".")[0]] = members
    return links


def _of_link(elastic: ElasticMechanism, word: str) -> list[Unknown]:
    """Parameters of a link: entries of its 6x6 compliance,
    or a factor on a beam's own.
    """
    name, _, form = word.partition(":")
    members = _links(elastic)[name]
    if (key := name + BEAM) in elastic.compliances:
        if form:
            _refuse_of_beam(members[0], name, f"--unknown {word}")
        return [_unknown(elastic, key)]
    # A spring has one for each chosen axis, or each pair of them.
    axes = [member.rpartition(".")[2] for member in members]
    if form not in ("", "diagonal"):
        chosen = [part.strip() for part in form.split(",")]
    else:
        chosen = axes
    for part in chosen:
        if part not in axes:
            where = f"--unknown {word}"
            raise UnknownNameError(
                "axis of a link", part, ["diagonal", *axes], where=where
            )
    places = [
        member for member, axis in zip(members, axes, strict=True) if axis in chosen
    ]
    pairs = combinations_with_replacement(places, 2)
    return [_unknown(elastic, key_of_pair(a, b)) for a, b in pairs if a == b or not form]


def _tied(parameters: Sequence[Unknown], group: Sequence[str]) -> list[Unknown]:
    """The parameters, those of a group as one."""
    if len(group) < 2:
        raise InputError(
            "a tie needs two springs", where="--tie", expected="A=B", got="=".join(group)
        )
    able = {
        u.name: u for u in parameters if u.has_stiffness and not (u.law or u.is_scale)
    }
    members = []
    for name in group:
        if name not in able:
            raise InputError(
                f"spring {name!r} cannot be tied",
                where="--tie",
                expected=f"one that is sought and not tied twice: {', '.join(able)}",
            )
        members.append(able.pop(name))
    if len({u.unit for u in members}) > 1:
        raise InputError(
            "a tie joins an angle and a distance", where="--tie", got="=".join(group)
        )
    keys = tuple(key for u in members for key in u.pattern.keys)
    one = replace(
        members[0],
        pattern=CompliancePattern(" = ".join(group), keys),
        nominal=float(np.mean([u.nominal for u in members])),
        size=max(u.size for u in members),
    )
    return [one if u is members[0] else u for u in parameters if u not in members[1:]]


#: Numbers of the place of a tool or base.
PARTS = ("x", "y", "z", "rx", "ry", "rz")
# Share of its standard deviation below which an offset is not corrected any more.
_NEGLIGIBLE = 0.1


@dataclass(frozen=True, eq=False)
class Offsets:
    """Columns of the offsets.

    Attributes
    ----------
    columns : ndarray (m, S)
        In the regressor.
    names : tuple of str (S,)
        "session.tx" and so on; after them those that are sought.
    geometry : tuple of str
        "JOINT.zero", "tool.x", "base.rz" and so on: the names of the last columns.
    """

    columns: Array
    names: tuple[str, ...]
    geometry: tuple[str, ...]


@dataclass(frozen=True)
class OffsetEstimate:
    """Error of a joint's zero, or offset of tool or base, with its interval;
    None if not known.
    """

    name: str
    unit: str
    value: float | None
    sd: float | None
    interval: tuple[float, float] | None

    @property
    def identifiable(self) -> bool:
        """Whether the rows determine it."""
        return self.value is not None


def offsets_of(unknowns: Unknowns, seen: Observations, measured: Measurements) -> Offsets:
    """Columns of all offsets; those without an effect are left out.

    Raises
    ------
    InputError
        If geometry is sought and no position or orientation is measured.
    """
    of_sessions: dict[str, Array] = {}
    sessions = np.array(measured.session)[seen.row] if measured.session else np.zeros(0)
    for name in dict.fromkeys(measured.session) if unknowns.sessions != "none" else ():
        mine = (sessions == name) & seen.is_absolute
        points = seen.place[mine & ~seen.is_angle]
        placed = _placement(
            seen, mine, points.mean(axis=0) if len(points) else np.zeros(3)
        )
        for part, column in zip(
            ("tx", "ty", "tz", "rx", "ry", "rz"), placed, strict=True
        ):
            if column.any() and (unknowns.sessions == "rigid" or part[0] == "t"):
                of_sessions[f"{name}.{part}"] = column
    geometry = _of_geometry(unknowns, seen, measured)
    columns = [*of_sessions.values(), *geometry.values()]
    table = np.array(columns).reshape(len(columns), len(seen)).T
    return Offsets(table, (*of_sessions, *geometry), tuple(geometry))


def _placement(
    seen: Observations, mine: NDArray[np.bool_], centre: Array, axes: Array | None = None
) -> Array:
    """Columns (6, m) of translations along three axes and small rotations about
    a point of F.
    """
    R = np.eye(3) if axes is None else axes
    shift = np.where((mine & ~seen.is_angle)[:, None], seen.axis, 0.0)
    about = np.where(
        seen.is_angle[:, None], seen.axis, np.cross(seen.place - centre, seen.axis)
    )
    return np.vstack([(shift @ R).T, (np.where(mine[:, None], about, 0.0) @ R).T])


def _of_geometry(
    unknowns: Unknowns, seen: Observations, measured: Measurements
) -> dict[str, Array]:
    """Columns of zeros, tool and base."""
    absolute, elastic = seen.is_absolute, unknowns.elastic
    if unknowns.geometry and not absolute.any():
        raise InputError(
            f"differences do not show {', '.join(unknowns.geometry)}",
            where="--unknown",
            expected="measured positions x, y, z (or roll, pitch, yaw)",
        )
    _, first, groups = np.unique(
        measured.postures, return_index=True, return_inverse=True
    )
    kinematics, at = Kinematics(elastic.mechanism).at(measured.q[first]), groups[seen.row]
    columns = {}
    for word in unknowns.geometry:
        if word.endswith(ZERO):
            j = elastic.names.index(word.removesuffix(ZERO))
            twists = kinematics.jacobian[at, :, j]
            column = np.where(
                absolute, np.einsum("mi,mi->m", seen.functional, twists), 0.0
            )
            # Of a point nearly on the axis it would be confused with the tool's place.
            length = elastic.mechanism.at(measured.q[0]).length
            lever = numerics.NEGLIGIBLE_CHANGE * length
            columns[word] = column * (np.abs(column).max() > lever)
            continue
        if word == "tool":
            axes = kinematics.pose[at, :3, :3]
            along = np.einsum(
                "mij,mi->jm", axes, np.where(absolute[:, None], seen.axis, 0.0)
            )
            parts = np.vstack([along * ~seen.is_angle, along * seen.is_angle])
        else:
            B = elastic.mechanism.base_pose
            parts = _placement(seen, absolute, B[:3, 3], B[:3, :3])
        columns |= {
            f"{word}.{n}": x for n, x in zip(PARTS, parts, strict=True) if x.any()
        }
    return columns


def unit_of(elastic: ElasticMechanism, name: str) -> str:
    """Unit of a joint's zero, or of an offset of tool or base."""
    if name.endswith(ZERO):
        j = elastic.names.index(name.removesuffix(ZERO))
        return elastic.units.coordinate(elastic.mechanism.coordinates[j].is_length)
    return elastic.units.length if name[-2] == "." else elastic.units.angle


def size_of(elastic: ElasticMechanism, name: str) -> float:
    """Natural size of an offset: 1 rad, or the mechanism's length."""
    is_angle = unit_of(elastic, name) == elastic.units.angle
    return 1.0 if is_angle else float(elastic.mechanism.at(elastic.q).length)


def corrections(
    elastic: ElasticMechanism, step: Mapping[str, tuple[float, float]]
) -> dict[str, float]:
    """Part of a step to be corrected; empty if all of it is negligible."""
    if not any(abs(x) > _NEGLIGIBLE * s for x, s in step.values()):
        return {}
    return {name: x for name, (x, _) in step.items() if abs(x) <= size_of(elastic, name)}


def placement_of(found: Mapping[str, float], word: str) -> Array:
    """Pose of the "base" or the "tool", from its offsets."""
    x = [found.get(f"{word}.{part}", 0.0) for part in PARTS]
    return se3.pose(se3.exp([*x[3:], 0.0, 0.0, 0.0])[:3, :3], x[:3])


def corrected(
    elastic: ElasticMechanism, measured: Measurements, step: Mapping[str, float]
) -> Measurements:
    """Rows corrected by a further step of the offsets; loads keep their points."""
    table = np.stack(
        [measured.values.get(n, np.full(len(measured), np.nan)) for n in POSITION]
    )
    if (np.isnan(table).any(axis=0) & ~np.isnan(table).all(axis=0)).any():
        step = {
            n: x for n, x in step.items() if not n.startswith("base.")
        }  # no whole positions
    before = measured.found
    found = {**before, **{name: before.get(name, 0.0) + x for name, x in step.items()}}
    base = se3.inverse(placement_of(found, "base")) @ placement_of(before, "base")
    tools = placement_of(before, "tool"), placement_of(found, "tool")
    turn = tools[0][:3, :3] @ tools[1][:3, :3].T
    point = np.asarray(measured.point) + tools[1][:3, 3] - tools[0][:3, 3]
    zeros = [step.get(f"{name}{ZERO}", 0.0) for name in elastic.names]
    return replace(
        measured,
        q=measured.q + zeros,
        values=_moved(measured.values, np.arange(len(measured)), base, turn),
        point=tuple(point.tolist()),
        found=found,
    )


def sessions_turned_back(
    unknowns: Unknowns,
    seen: Observations,
    measured: Measurements,
    offsets: Mapping[str, float],
    deviation: Array,
) -> Measurements | None:
    """Rows of each session turned back by the rotation of its frame that a fit has found.

    None where the columns of a small rotation are right to a share of the standard
    deviations (m,).
    """
    T_F_B, sessions = (
        unknowns.elastic.mechanism.base_pose,
        np.array(measured.session),
    )
    turns = {
        name: np.array([offsets.get(f"{name}.r{axis}", 0.0) for axis in "xyz"])
        for name in measured.session
    }
    largest = max(map(np.linalg.norm, turns.values()), default=0.0)
    far = largest * np.abs(seen.place).max() + np.abs(seen.target[seen.is_absolute]).max(
        initial=0
    )
    if largest * far <= _NEGLIGIBLE * deviation.min():
        return None
    for name, w in turns.items():
        turn = se3.inverse(T_F_B) @ se3.exp([*-w, 0.0, 0.0, 0.0]) @ T_F_B
        moved = _moved(measured.values, np.flatnonzero(sessions == name), turn, np.eye(3))
        measured = replace(measured, values=moved)
    return measured


def _moved(
    values: Mapping[str, Array], rows: NDArray[np.intp], T: Array, turn: Array
) -> dict[str, Array]:
    """Positions and orientations of some rows in another frame.

    Bodies turned in theirs.
    """
    values = dict(values)
    if all(name in values for name in POSITION):
        x = np.stack([values[name] for name in POSITION], axis=1)
        x[rows] = se3.placed(T, x[rows])
        values |= dict(zip(POSITION, x.T, strict=True))
    if all(name in values for name in TURN):
        angles = np.stack([values[name] for name in TURN], axis=1)
        R = T[:3, :3] @ se3.rotation_by_angles(angles[rows]) @ turn
        angles[rows] = se3.roll_pitch_yaw(se3.pose(R))
        values |= dict(zip(TURN, angles.T, strict=True))
    return values


def in_base(unknowns: Unknowns, measured: Measurements, poses: Array) -> Measurements:
    """Positions and orientations near the base frame; those of a base that is
    sought corrected.

    Each session's frame, or that of all rows if the base is sought, is placed so that the
    points lie next to those of the rigid mechanism.

    Parameters
    ----------
    unknowns : Unknowns
        Parameters.
    measured : Measurements
        Without all of x, y, z they are returned unchanged.
    poses : ndarray (N, 4, 4)
        ``T_F_M`` of the rigid mechanism.

    Raises
    ------
    InputError
        For a session of fewer than three places.
    """
    elastic, sessions = unknowns.elastic, np.array(measured.session)
    by_session = measured.session and unknowns.sessions == "rigid"
    if not all(n in measured.values for n in POSITION) or not (
        by_session or "base" in unknowns.geometry
    ):
        return measured
    # Points where they would be without deflection, and where they were measured.
    T_F_B = elastic.mechanism.base_pose
    points = poses[:, :3, 3] + poses[:, :3, :3] @ np.asarray(measured.point)
    points = (points - T_F_B[:3, 3]) @ T_F_B[:3, :3]
    x = np.stack([measured.values[name] for name in POSITION], axis=1)
    known = ~np.isnan(x).any(axis=1)
    if by_session and (holes := ~known & ~np.isnan(x).all(axis=1)).any():
        raise InputError(
            f"row {measured.rows[np.argmax(holes)]}: a position in a session's own frame "
            "is not "
            "whole",
            expected="all of x, y, z, or --offsets translation",
        )
    # The frame of each session, or of all rows, moved onto the base.
    names = dict.fromkeys(measured.session) if by_session else [""]
    for name in names:
        rows = np.flatnonzero(known & (sessions == name) if by_session else known)
        T = _fit(x[rows], points[rows]) if rows.size else np.eye(4)
        if T is None and by_session:
            raise InputError(
                f"the points of session {name!r} stand in one line: its frame is not "
                "known",
                where="column session",
                expected="three points that are not in line, or --offsets translation",
            )
        if T is not None and by_session:
            measured = replace(
                measured, values=_moved(measured.values, rows, T, np.eye(3))
            )
        elif T is not None:
            place = se3.inverse(T)
            parts = [*place[:3, 3], *se3.log(se3.pose(place[:3, :3]))[:3]]
            step = {
                f"base.{part}": float(v) for part, v in zip(PARTS, parts, strict=True)
            }
            measured = corrected(elastic, measured, step)
    return measured


def _fit(seen: Array, there: Array) -> Array | None:
    """Pose that moves points onto others with the least squares of distances;
    None in one line.
    """
    a, b = seen.mean(axis=0), there.mean(axis=0)
    values = np.linalg.svd((seen - a).T @ (there - b), compute_uv=False)
    if not values[1] > numerics.RANK * max(values[0], numerics.TINY):
        return None
    from scipy.spatial.transform import Rotation

    R = Rotation.align_vectors(there - b, seen - a)[0].as_matrix()
    return se3.pose(R, b - R @ a)
