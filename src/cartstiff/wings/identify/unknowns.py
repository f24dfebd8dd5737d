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
from cartstiff.core.mechanisms.elements import (
    Elements,
    law_of,
    laws_of,
    with_coefficients,
)
from cartstiff.core.mechanisms.identified import BEAM, CompliancePattern
from cartstiff.core.potentials.springs import SpringLaw
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
        Elements on which it acts.
    unit : str
        Unit of its stiffness.
    nominal : float
        Start of the search: the mechanism's own.
    is_scale : bool
        Whether it is a factor on a beam's own compliance.
    """

    pattern: CompliancePattern
    unit: str
    nominal: float
    is_scale: bool = False

    @property
    def name(self) -> str:
        """Name of the parameter."""
        return self.pattern.name

    @property
    def has_stiffness(self) -> bool:
        """Whether its inverse is a stiffness, so that it is not negative.

        False for off-diagonal entries of a matrix, and for a polynomial's higher
        coefficients.
        """
        return self.pattern.is_diagonal

    @property
    def law(self) -> tuple[str, int] | None:
        """Joint, and power of the deflection, of a polynomial spring."""
        return self.pattern.law


@dataclass(frozen=True, eq=False)
class Unknowns:
    """All parameters, and the compliances that are known.

    Attributes
    ----------
    elements : Elements
        Elements of the mechanism.
    parameters : tuple of Unknown
        In their order.
    patterns : ndarray (P, E, E)
        S of each.
    known : ndarray (E, E)
        Compliances that are not sought.
    geometry : tuple of str
        Further unknowns of measured positions: "JOINT.zero", "tool", "base".
    sessions : {"rigid", "translation", "none"}
        Unknown part of the pose of the measuring frame in each session.
    """

    elements: Elements
    parameters: tuple[Unknown, ...]
    patterns: Array
    known: Array
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
        own = np.sqrt(np.diag(self.elements.compliance))
        both = np.multiply.outer(own, own)

        def size(unknown: Unknown, S: Array) -> float:
            if unknown.law:
                return abs(unknown.nominal)
            return float((both[S != 0] / np.abs(S[S != 0])).max())

        return np.array([*map(size, self.parameters, self.patterns)])

    @property
    def least(self) -> Array:
        """Least values (P,) that a mechanism can have: of compliances,
        a small share of its own.
        """
        share = numerics.NEGLIGIBLE_DIFFERENCE * np.abs(self.nominal)
        return np.where(self.is_bounded, share, -np.inf)

    def compliance(self, theta: Array) -> Array:
        """Gamma (E, E)."""
        return self.known + np.tensordot(theta, self.patterns, axes=1)

    def mechanism(self, theta: Array) -> ElasticMechanism:
        """The mechanism with these compliances; those at zero become very small."""
        theta = np.maximum(theta, self.least)
        elastic = self.elements.with_compliance(self.compliance(theta))
        return with_coefficients(elastic, self._coefficients(theta))

    def laws(self, theta: Array) -> dict[str, SpringLaw]:
        """Nonlinear springs by joint, with the sought coefficients replaced by these."""
        elastic = with_coefficients(self.elements.elastic, self._coefficients(theta))
        return {elastic.names[j]: law for j, law in laws_of(elastic).items()}

    def _coefficients(self, theta: Array) -> dict[tuple[str, int], float]:
        return {
            u.law: x
            for u, x in zip(self.parameters, theta.tolist(), strict=True)
            if u.law
        }


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
    elements = Elements(elastic)
    geometry, springs = _geometry(elastic, elements, sought)
    names = _expanded(elastic, elements, springs or ("joints",))
    parameters = [u for name in names for u in _made(elastic, elements, name)]
    name, times = Counter(u.name for u in parameters).most_common(1)[0]
    if times > 1:
        raise InputError(f"{name!r} is sought twice", where="--unknown")
    for group in ties:
        parameters = _tied(parameters, group)
    patterns = elements.patterns([u.pattern for u in parameters])
    rest = np.where(patterns.any(axis=0), 0.0, elements.compliance)
    return Unknowns(elements, tuple(parameters), patterns, rest, geometry)


def zeros_of(elastic: ElasticMechanism) -> list[str]:
    """Names of the zeros that can be sought: those of an open chain's joints."""
    mechanism = elastic.mechanism
    is_open = not (mechanism.closures or mechanism.coordinates_are_pose)
    return [f"{name}{ZERO}" for name in mechanism.joint_names] if is_open else []


def _geometry(
    elastic: ElasticMechanism, elements: Elements, sought: Sequence[str]
) -> tuple[tuple[str, ...], list[str]]:
    """Sought geometry, each once, and the remaining words."""
    zeros = [f"{name}{ZERO}" for name in elastic.mechanism.joint_names]
    own = {*elements.names, *_links(elastic), *_polynomials(elastic)}
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


def _expanded(
    elastic: ElasticMechanism, elements: Elements, sought: Sequence[str]
) -> list[str]:
    """Single springs and links, each once."""
    links = _links(elastic)
    own = [
        n for n in elements.names if not any(n in members for members in links.values())
    ]
    bent = _polynomials(elastic)
    lines = [n for n in own if n.startswith("line") and n not in elastic.names]
    joints = [n for n in own if n not in lines]
    names: list[str] = []
    for word in sought:
        more = {
            "joints": joints,
            "links": list(links),
            "lines": lines,
            "all": [*joints, *links, *lines],
        }.get(word, [word])
        link = word.partition(":")[0]
        if more == [word] and word not in (*elements.names, *bent) and link not in links:
            valid = (*_GROUPS, *GEOMETRY, *joints, *bent, *lines, *links, *elements.names)
            raise UnknownNameError("spring", word, valid, where="--unknown")
        if not more:
            raise InputError(
                f"the mechanism has no {word}",
                where="--unknown",
                expected=", ".join(elements.names),
            )
        names += [name for name in more if name not in names]
    if not names:
        raise InputError("the mechanism has no spring to be found")
    return names


def _polynomials(elastic: ElasticMechanism) -> list[str]:
    """Joints with polynomial springs."""
    return [elastic.names[j] for j, law in laws_of(elastic).items() if law.powers]


def _made(elastic: ElasticMechanism, elements: Elements, word: str) -> list[Unknown]:
    """Parameters of one word: a spring, a polynomial spring, or a link."""
    if word in _polynomials(elastic):
        return _of_law(elastic, word)
    if word not in elements.names:
        return _of_link(elastic, elements, word)
    _refuse_of_beam(elastic, word, "--unknown")
    i = elements.index(word)
    unit = elastic.units.spring(bool(elements.is_length[i]))
    pattern = CompliancePattern(word, ((word, word, 1.0),))
    return [Unknown(pattern, unit, float(elements.compliance[i, i]))]


def _refuse_of_beam(elastic: ElasticMechanism, name: str, where: str) -> None:
    """Refuse one axis of a beam: a beam's compliance is a multiple of its own."""
    for potential in elastic.potentials:
        if potential.is_scaled and name in _links(elastic).get(potential.link, ()):
            raise InputError(
                f"{name!r}: one axis of a beam has no stiffness of its own",
                where=where,
                expected=f"--unknown {potential.link}, a factor on the whole beam",
            )


def _of_law(elastic: ElasticMechanism, name: str) -> list[Unknown]:
    """Parameters of a polynomial spring: its coefficients in the file."""
    law = law_of(elastic, name)
    if not law.powers[0] > 0.0:
        raise InputError(
            "a polynomial spring that is sought needs a first coefficient",
            where=f"--unknown {name}",
            expected="above zero",
            got=law.powers[0],
        )
    j = elastic.names.index(name)
    unit = elastic.units.spring(elastic.mechanism.coordinates[j].is_length)
    first = CompliancePattern(name, (), (name, 1))
    unknowns = [Unknown(first, unit, 1.0 / law.powers[0])]
    for power, c in enumerate(law.powers[1:], start=2):
        if c != 0.0:
            pattern = CompliancePattern(f"{name} x^{power}", (), (name, power))
            unknowns.append(Unknown(pattern, f"{unit}^{power}", c))
    return unknowns


def _links(elastic: ElasticMechanism) -> dict[str, list[str]]:
    """Flexible links, with the names of their virtual joints."""
    links = {}
    for potential in elastic.potentials:
        if potential.members:
            members = [elastic.names[j] for j in potential.members]
            links[potential.link or members[0].rpartition(".")[0]] = members
    return links


def _of_link(elastic: ElasticMechanism, elements: Elements, word: str) -> list[Unknown]:
    """Parameters of a link: entries of its 6x6 compliance,
    or a factor on a beam's own.
    """
    name, _, form = word.partition(":")
    members = _links(elastic)[name]
    at = [elements.index(m) for m in members]
    C = elements.compliance[np.ix_(at, at)]
    # A beam has one unknown, its share.
    for potential in elastic.potentials:
        if potential.is_scaled and potential.link == name:
            if form:
                _refuse_of_beam(elastic, members[0], f"--unknown {word}")
            entries = tuple(
                (members[i], members[j], float(C[i, j]))
                for i in range(len(at))
                for j in range(i, len(at))
                if C[i, j] != 0.0
            )
            pattern = CompliancePattern(name + BEAM, entries)
            return [Unknown(pattern, "of the file's", 1.0, is_scale=True)]
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
    places = [i for i, axis in enumerate(axes) if axis in chosen]
    unknowns = []
    for i, j in combinations_with_replacement(places, 2):
        if i != j and form:
            continue
        slides = bool(elements.is_length[at[i]])
        alike = slides == bool(elements.is_length[at[j]])
        unit = elastic.units.spring(slides) if alike else elastic.units.force
        own = members[i] if i == j else f"{members[i]}*{axes[j]}"
        pattern = CompliancePattern(own, ((members[i], members[j], 1.0),))
        unknowns.append(Unknown(pattern, unit, float(C[i, j])))
    return unknowns


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
    entries = tuple(entry for u in members for entry in u.pattern.entries)
    one = replace(
        members[0],
        pattern=CompliancePattern(" = ".join(group), entries),
        nominal=float(np.mean([u.nominal for u in members])),
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
    absolute, elastic = seen.is_absolute, unknowns.elements.elastic
    if unknowns.geometry and not absolute.any():
        raise InputError(
            f"differences do not show {', '.join(unknowns.geometry)}",
            where="--unknown",
            expected="measured positions x, y, z (or roll, pitch, yaw)",
        )
    _, first, groups = np.unique(
        measured.postures, return_index=True, return_inverse=True
    )
    postures = [elastic.mechanism.at(q) for q in measured.q[first]]
    at = groups[seen.row]
    columns = {}
    for word in unknowns.geometry:
        if word.endswith(ZERO):
            j = elastic.names.index(word.removesuffix(ZERO))
            twists = np.array([p.motion.jacobian[:, j] for p in postures])[at]
            column = np.where(
                absolute, np.einsum("mi,mi->m", seen.functional, twists), 0.0
            )
            # Of a point nearly on the axis it would be confused with the tool's place.
            lever = numerics.NEGLIGIBLE_CHANGE * postures[0].length
            columns[word] = column * (np.abs(column).max() > lever)
            continue
        if word == "tool":
            axes = np.array([p.pose[:3, :3] for p in postures])[at]
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
        unknowns.elements.elastic.mechanism.base_pose,
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
        x[rows] = x[rows] @ T[:3, :3].T + T[:3, 3]
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
    elastic, sessions = unknowns.elements.elastic, np.array(measured.session)
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
