"""The answer at one posture: what is read from its matrices, the equilibrium,
and its notes.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from cartstiff.answer.analysis.asymmetry import asymmetries
from cartstiff.answer.analysis.ellipsoids import Freedom, Others, softest, stiffest
from cartstiff.answer.analysis.indices import spectrum
from cartstiff.answer.analysis.metrics import length_of_pair
from cartstiff.answer.analysis.posture import (
    FoundDeflection,
    deflection_found,
    is_tangent,
)
from cartstiff.answer.analysis.principal import block_ellipsoid, matrix_pair
from cartstiff.answer.analysis.sections import Notes
from cartstiff.answer.data import (
    Answer,
    Displacement,
    Extreme,
    Load,
    Motion,
    Quantity,
    Share,
    Shares,
    Statement,
    Table,
    Vector,
    rounded,
    said,
    table,
)
from cartstiff.answer.strength import strength_statements
from cartstiff.answer.verdict import UNRESOLVED, Verdict, decide, facts_of
from cartstiff.core import numerics
from cartstiff.core.arrays import Array
from cartstiff.core.errors import CartstiffError, UndefinedError
from cartstiff.core.geometry import se3
from cartstiff.core.mechanisms.elastic import ElasticMechanism
from cartstiff.core.mechanisms.gravity_loads import gravity_loads
from cartstiff.core.mechanisms.limits import Limits
from cartstiff.core.notes import Note
from cartstiff.core.potentials.contract import Potential
from cartstiff.core.stiffness.applied_load import Behaviour, LoadKind
from cartstiff.core.stiffness.compute import PostureStiffness
from cartstiff.core.stiffness.forces import DriveForce
from cartstiff.core.stiffness.posture import StiffnessInFrame
from cartstiff.core.units import Units

if TYPE_CHECKING:
    from cartstiff.core.mechanisms.contract import MechanismPosture
    from cartstiff.core.statics.rest import Equilibrium

_FREEDOMS: tuple[Freedom, Freedom] = ("translation", "rotation")
_OTHERS: tuple[Others, Others] = ("free", "held")
#: Decimal places up to which shares are compared.
_SAME_SHARE = 9


def answer_at(
    result: PostureStiffness,
    *,
    connection: str | None = None,
    at: Array | None = None,
    wrench: Array | None = None,
    load_at: Array | None = None,
    load_kind: Behaviour = "dead",
    allowed: float | None = None,
) -> Answer:
    """The answer at a posture.

    Parameters
    ----------
    result : PostureStiffness
        The posture.
    connection : str, optional
        Letter of the matrix that is read; default the tangent under a load, without one
        B.
    at : ndarray (4, 4), optional
        ``T_M_N``: the point that moves is the origin of N; default M.
    wrench : ndarray (6,), optional
        Wrench added to the load, in the axes of M, whose displacement is said; default
        the load.
    load_at : ndarray (3,), optional
        Point of the body, in M, at which that wrench acts; default the point that moves.
    load_kind : {"dead", "follower", "conservative"}
        Its behaviour while the body moves.
    allowed : float, optional
        Allowed displacement of M's origin, which limits the load.
    """
    here, elastic = result.at(at), result.elastic
    name = connection or ("load" if result.is_loaded else "B")
    point = here.T_M_N[:3, 3]
    acts_at = point if load_at is None else load_at
    found = deflection_found(result, name, wrench, acts_at, point, Notes())
    # Where the posture resists, how far the load moves the point, beside the equilibrium.
    moved, shares, notes = None, None, list(result.notes)
    if found is not None and is_resisted(here, name, found):
        moved, shares = _displacement(result, found), shares_of(found.shares, elastic)
        if found.by != "preload":
            moved, more = _beside_equilibrium(result, moved, found, load_kind)
            told = {note.code for note in notes}
            notes += [note for note in more if note.code not in told]
    verdict = verdict_at(result, name, definiteness_of(here, name))
    return Answer.about_mechanism(
        "analyse",
        elastic,
        notes,
        verdict=verdict,
        about=[said("mechanism"), *circumstances(result)],
        weight=result.weighed,
        load=load_of(result),
        displacement=moved,
        shares=shares,
        extremes=tuple(extremes_of(result, here, name)),
        statements=strength_statements(result, allowed),
        tables=tuple(tables_of(result, shares)),
    )


def circumstances(result: PostureStiffness, at_rest: bool = False) -> Iterator[Statement]:
    """The pose of the body, and the wrench that holds it there, if none was given.

    With `at_rest` the stiffness includes the loads, and W is a wrench besides them.
    """
    units, size = result.units, result.posture.length
    turned = rounded(se3.roll_pitch_yaw(result.pose), 1.0)
    yield said(
        "pose",
        place=Quantity(rounded(result.pose[:3, 3], size), units.length),
        turned=Quantity(turned, units.angle),
    )
    if result.wrench is None:
        return
    W = result.shown_wrench(result.wrench)
    if at_rest and not W.any():
        loads = result.elastic.parted_terms()[1]
        yield said(("no-load", "loads-included")[bool(loads)])
    elif W.any():
        if at_rest or not result._load_is_given:
            yield said(("holding", "holding-besides")[at_rest])
    elif not result.is_loaded and result.wrench_is_known:
        yield said("nothing-to-hold")
    if not result.wrench_is_known:
        yield said("partly-known")


def definiteness_of(here: StiffnessInFrame, connection: str) -> str | None:
    """Definiteness of the symmetric part of a stiffness; None where it has none."""
    pair = matrix_pair(here, connection)
    if pair.K is None:
        return None
    try:
        return spectrum(pair.K, length_of_pair(pair).value, pair.C)[2]
    except UndefinedError:
        return None


def verdict_at(
    result: PostureStiffness, connection: str, definiteness: str | None
) -> Verdict:
    """The verdict on the matrix of a connection, from its definiteness and the notes."""
    K = result.at().matrices[connection]
    is_symmetric = not asymmetries(result.at(), "stiffness")[connection]
    facts = facts_of(
        (note.code for note in result.notes),
        None if K is None else definiteness or UNRESOLVED,
        connection,
        is_tangent=K is None or is_tangent(result, connection),
        is_symmetric=is_symmetric,
    )
    rule = decide(facts)
    return Verdict(rule.level, rule.code, connection, not is_symmetric)


def is_resisted(here: StiffnessInFrame, connection: str, found: FoundDeflection) -> bool:
    """Whether the body resists a wrench, so that the wrench moves it by a
    definite amount.
    """
    C = here.compliances[connection]
    is_positive = C is not None and numerics.is_never_negative(C)
    return bool(is_positive and found.whole.energy >= 0.0)


def load_of(result: PostureStiffness) -> Load | None:
    """The wrench on the body, and what acts before it."""
    if result.wrench is None:
        return None
    W, R, load = (
        result.shown_wrench(result.wrench).copy(),
        result.pose[:3, :3],
        result.load,
    )
    W[:3] -= se3.cross(np.array(load.at), W[3:])
    found = room_load(result.elastic, load.kind, load.at, W, R)
    return replace(found, given=result._load_is_given, before=result.weighed.before)


def room_load(
    elastic: ElasticMechanism, kind: str, at: Sequence[float], W: Array, R: Array
) -> Load:
    """A load from its moment about, and force at, a point of the body, along axes R."""
    weight = gravity_loads(elastic)
    return Load(
        True,
        kind,
        vector(np.array(at)),
        vector(R @ W[3:]),
        vector(R @ W[:3]),
        weight.acceleration,  # type: ignore[arg-type]
        sum(weight.bodies.values()),
        None,
    )


def vector(values: Array) -> Vector:
    """Three numbers as plain data."""
    x, y, z = values.tolist()
    return x, y, z


def _displacement(result: PostureStiffness, found: FoundDeflection) -> Displacement:
    whole, R = found.whole, result.pose[:3, :3]
    first = Motion(vector(R @ whole.displacement), vector(R @ whole.twist[:3]))
    return Displacement(found.by, found.connection, vector(whole.point), first)


def _beside_equilibrium(
    result: PostureStiffness, moved: Displacement, found: FoundDeflection, kind: Behaviour
) -> tuple[Displacement, list[Note]]:
    """The displacement between two equilibria, see `rests`, beside its first order,
    and notes on the latter.
    """
    if result.wrench is None or not any((*found.whole.wrench, *found.whole.twist)):
        return moved, []
    # A posture without a load needs no search.
    from cartstiff.core.statics.held import displacement_between

    added = None if moved.by == "load" else found.added
    try:
        before, state = rests(result, added, LoadKind(kind, vector(found.acts_at)))
    except CartstiffError as error:
        return moved, [
            Note("no-equilibrium", f"no equilibrium under the load was found: {error}")
        ]
    if state.stable is False or before is None:
        return moved, list(state.notes)
    start = before.pose
    point = np.append(moved.point, 1.0)
    shift = ((state.pose - start) @ point)[:3]
    turn = displacement_between(start, state.pose)[:3]
    far = numerics.norm(shift)
    miss = numerics.norm(shift - result.pose[:3, :3] @ found.whole.displacement)
    compared = replace(
        moved,
        equilibrium=Motion(vector(shift), vector(turn)),
        difference=miss / far if far > 0.0 else None,
    )
    return compared, [] if compared.is_first_order else list(state.notes)


def rests(
    result: PostureStiffness, added: Array | None, acting: LoadKind
) -> tuple[MechanismPosture | None, Equilibrium]:
    """The posture before a load, and the equilibrium under it.

    The load moves the body from its rest at the posture without it, links straight; an
    added wrench (6,), in the axes of M, from the posture, at which the springs balance
    the load.

    Raises
    ------
    CartstiffError
        As `cartstiff.equilibrium`.
    """
    # A posture without a load needs no search.
    from cartstiff.core.statics.equilibrium import equilibrium

    if added is None:
        start = np.array(result.q)
        start[sorted(result.mechanism.virtual)] = 0.0
        state = equilibrium(result.elastic_as_given, start, _acting(result))
        return None if state.before is None else state.before.posture, state
    held = [_acting(result)] if result.is_loaded else []
    more = acting.acting(added, result.pose)
    return result.posture, equilibrium(result.elastic, result.q, *held, more)


def _acting(result: PostureStiffness) -> Potential:
    """The load of a posture as an energy."""
    W, at = np.asarray(result.wrench), np.array(result.load.at)
    given = np.concatenate([W[:3] - se3.cross(at, W[3:]), W[3:]])
    return result.load.acting(given, result.pose)


def parts_of_links(elastic: ElasticMechanism) -> dict[str, str]:
    """Compliant link of each virtual joint, by its name."""
    return {
        elastic.names[j]: potential.link
        for potential in elastic.potentials
        if potential.link
        for j in potential.members
    }


def shares_of(
    found: Mapping[str, Any] | None, elastic: ElasticMechanism
) -> Shares | None:
    """Shares by joint, link or leg, the largest first; a link's virtual joints
    are one part.

    None where a share does not exist.
    """
    if found is None or not found["shares"]:
        return None
    links, summed = parts_of_links(elastic), dict[str, float]()
    for part in found["shares"]:
        share = part["share"]
        if share is None or share != share:
            return None
        own = part["name"]
        name = f"the link {links[own]}" if own in links else own
        summed[name] = summed.get(name, 0.0) + float(share)
    of: Literal["displacement", "energy"] = (
        "displacement" if found["kind"] == "joints" else "energy"
    )
    # Equal shares of a symmetric machine stay in the machine's order.
    parts = sorted(summed.items(), key=lambda part: -round(abs(part[1]), _SAME_SHARE))
    return Shares(
        of, tuple(Share(*part) for part in parts), float(found["load_share"] or 0.0)
    )


def extremes_of(
    result: PostureStiffness,
    here: StiffnessInFrame,
    connection: str,
) -> Iterator[Extreme]:
    """Softest and stiffest directions of each freedom, where every load is resisted."""
    R, exist = here.pose[:3, :3], _freedoms_of(result, here, connection)
    for how, freedom in product(_OTHERS, _FREEDOMS):
        # With the others held: they are, by themselves, where the body does not have
        # them.
        if freedom not in exist or (how == "held" and len(exist) < 2):
            continue
        try:
            shape = block_ellipsoid(here, connection, "compliance", freedom, how)
        except UndefinedError:
            continue
        if shape is None:
            continue
        for end, find in _ENDS.items():
            if (extreme := find(shape.eigenvalues, R @ shape.axes)) is not None:
                yield Extreme(end, freedom, how, *extreme)


_ENDS: dict[Literal["softest", "stiffest"], Callable[..., Any]] = {
    "softest": softest,
    "stiffest": stiffest,
}


def _freedoms_of(
    result: PostureStiffness, here: StiffnessInFrame, connection: str
) -> list[Freedom]:
    """The freedoms that the body truly has: a note says where it hardly has one."""
    C = here.compliances[connection]
    if C is None:
        return []
    if here.matrices[connection] is not None:
        return [*_FREEDOMS]
    rotation, translation = np.abs(np.diag(C)).reshape(2, 3).max(axis=1).tolist()
    sizes = {"translation": translation, "rotation": rotation * result.length**2}
    least = numerics.LOST_ERROR**2 * max(sizes.values())
    return [freedom for freedom in _FREEDOMS if sizes[freedom] > least]


def tables_of(result: PostureStiffness, shares: Shares | None) -> Iterator[Table]:
    """Legs of a platform, or joints and links: what limits them and what
    they contribute; springs that couple joints.
    """
    yield from drive_tables(result, shares)
    if coupled := result.coupled_springs_as_dict().get("coupled_springs"):
        heads = "= name | sum : 6 | at rest = rest : 6 | force : 6"
        yield table("coupled springs", heads, coupled)
    row = _Rows.of(result, shares)
    mechanism, is_pose = result.mechanism, result.posture.coordinates_are_pose
    place = [*result.pose[:3, 3], *se3.roll_pitch_yaw(result.pose)]
    if is_pose and np.allclose(result.q, place, rtol=0.0, atol=numerics.REPORTED_ERROR):
        return  # they are the pose of the body
    links = parts_of_links(result.elastic)
    rows = tuple(
        row.at(c.name, x, c.is_length)
        for c, x in zip(mechanism.coordinates, without_roundoff(result), strict=True)
        if c.name not in links
    )
    known = {own for own, *_ in rows}
    if not is_pose:  # shares of legs are in their own table
        rows += tuple(
            row.at(name, None, None)
            for name in {**row.shares, **row.forces}
            if name not in known
        )
    one = ("joint", "coordinate")[is_pose]
    heads = f"{one} : ? | position : 4? | lower : ? | upper : ?"
    yield table(f"{one}s", f"{heads} | {_MORE}", rows)


_MORE = "stiffness : ? | share : ? | force : ? | limit : ? | used : ?"


def drive_tables(result: PostureStiffness, shares: Shares | None) -> Iterator[Table]:
    """Legs of a platform, or drives of a closed chain: limits, margins and forces."""
    row, drives = _Rows.of(result, shares), result.drives
    if not drives:
        return
    rows = tuple(
        (
            *row.at(drive.name, drive.position, drive.is_length),
            row.cell(drive.margin, result.units.coordinate(drive.is_length)),
        )
        for drive in drives
    )
    name, heads = "drives", "drive : ? | position : 4? | lower : ? | upper : ?"
    if result.leg_lengths is not None:
        name, heads = "legs", "leg : ? | length : 6e? | shortest : ? | longest : ?"
    yield table(name, f"{heads} | {_MORE} | to the limit : ?", rows)


@dataclass(frozen=True)
class _Rows:
    """Rows of joints and legs by their names."""

    units: Units
    stiffness: Mapping[str, float]
    shares: Mapping[str, float]
    bounds: Mapping[str, tuple[float, float]]
    forces: Mapping[str, DriveForce]

    @classmethod
    def of(cls, result: PostureStiffness, shares: Shares | None) -> _Rows:
        elastic, limits = result.elastic, Limits(result.mechanism)
        stiffness = dict(zip(elastic.spring_names, elastic.stiffnesses, strict=False))
        if elastic.springs is not None and elastic.springs.laws:
            hessian = elastic.springs.evaluate(result.posture).hessian
            stiffness |= {elastic.names[j]: hessian[j, j] for j in elastic.springs.laws}
        ends = zip(limits.lower.tolist(), limits.upper.tolist(), strict=True)
        return cls(
            elastic.units,
            stiffness,
            {} if shares is None else {part.name: part.share for part in shares.parts},
            dict(zip(limits.names, ends, strict=True)),
            {f.name: f for f in result.forces if any(one.force for one in result.forces)},
        )

    def at(
        self, name: str, value: float | None, is_length: bool | None
    ) -> tuple[str | Quantity | None, ...]:
        """Name, position or length, its limits, stiffness and share; force with its limit
        and the part of that it uses.
        """
        unit = self.units.coordinate(bool(is_length))
        low, high = self.bounds.get(name, (None, None))
        k = self.stiffness.get(name)
        spring: str | Quantity | None = "rigid"
        if k is None or k < np.inf:
            spring = self.cell(k or None, self.units.spring(bool(is_length)))
        return (
            name,
            self.cell(value, unit),
            self.cell(low, unit),
            self.cell(high, unit),
            spring,
            self.cell(self.shares.get(name), "1"),
            *self._force(name),
        )

    def _force(self, name: str) -> tuple[Quantity | None, ...]:
        if (one := self.forces.get(name)) is None:
            return None, None, None
        unit, limit = self.units.effort(one.is_length), one.most
        if one.force < 0.0:
            limit = one.least
        used = self.cell(one.used, "1")
        return self.cell(one.force, unit), self.cell(limit, unit), used

    @staticmethod
    def cell(value: float | None, unit: str) -> Quantity | None:
        """A quantity, or None where there is no number."""
        is_known = value is not None and np.isfinite(value)
        return Quantity(float(value), unit) if is_known else None  # type: ignore[arg-type]


def without_roundoff(result: PostureStiffness) -> list[float]:
    """Coordinates with round-off set to zero, which is larger for those of a
    closed chain.
    """
    if result.posture.closure is None:
        share = numerics.PRINTED_AS_ZERO
    else:
        share = numerics.STALLED_RESIDUAL
    sizes = [
        result.posture.length if c.is_length else 1.0
        for c in result.mechanism.coordinates
    ]
    q: list[float] = np.where(
        np.abs(result.q) <= share * np.array(sizes), 0.0, result.q
    ).tolist()
    return q


def sizes(posture: MechanismPosture) -> tuple[float, float]:
    """Sizes of turns (rad) and lengths, of which `numerics.PRINTED_AS_ZERO` is round-off.

    Closures are satisfied to more digits than single coordinates.
    """
    share = (1.0, 1e-2)[posture.closure is None]
    return share, share * posture.length
