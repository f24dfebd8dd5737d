"""The numbers of a posture that the page shows, and its state in words."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from typing import Any

import numpy as np

from cartstiff.answer.analysis.asymmetry import asymmetries
from cartstiff.answer.analysis.ellipsoids import Freedom, MatrixPair, softest
from cartstiff.answer.analysis.indices import spectrum
from cartstiff.answer.analysis.matrices import move_stiffness
from cartstiff.answer.analysis.metrics import length_of_pair
from cartstiff.answer.analysis.posture import (
    FoundDeflection,
    deflection_found,
    motion_of,
)
from cartstiff.answer.analysis.principal import block_ellipsoid, matrix_pair
from cartstiff.answer.analysis.sections import Notes
from cartstiff.answer.commanded import drives
from cartstiff.answer.data import Shares
from cartstiff.answer.doubts import doubts_of
from cartstiff.answer.posture import shares_of, verdict_at
from cartstiff.answer.vibration.modes import modes
from cartstiff.answer.vibration.response import frequency_response
from cartstiff.core import numerics
from cartstiff.core.arrays import Array, plain
from cartstiff.core.errors import UndefinedError
from cartstiff.core.geometry import se3
from cartstiff.core.geometry.connections import Connection
from cartstiff.core.matrix_names import MATRICES
from cartstiff.core.mechanisms.contract import Coordinate, Mechanism
from cartstiff.core.mechanisms.elastic import ElasticMechanism
from cartstiff.core.mechanisms.gravity_loads import gravity_loads
from cartstiff.core.mechanisms.limits import limits_of
from cartstiff.core.stiffness.compute import PostureStiffness
from cartstiff.core.stiffness.motions import scaled_values
from cartstiff.core.stiffness.posture import StiffnessInFrame
from cartstiff.shown.page.messages import ViewState
from cartstiff.shown.report.sentences import ADVICE, VERDICTS, direction_words

# Half-ranges of coordinates without limits: angles of a platform, angles of a joint, and
# lengths as a share of the mechanism's size.
_TILT = np.pi / 6
_TURN = np.pi
_SHARE = 0.25


def describe_mechanism(elastic: ElasticMechanism, q: Array) -> dict[str, Any]:
    """Names, units, ranges and springs.

    Parameters
    ----------
    elastic : ElasticMechanism
        The mechanism.
    q : ndarray (n,)
        The posture around which coordinates without limits are ranged.
    """
    mechanism, units = elastic.mechanism, elastic.units
    # Sliders: their ranges, and how far a sweep goes.
    ranges = slider_ranges(elastic, q)
    springs = elastic.springs
    coordinates = [
        {
            "name": c.name,
            "is_length": c.is_length,
            "unit": units.coordinate(c.is_length),
            "lower": lower,
            "upper": upper,
            "swept": swept_range(lower, upper, c.is_length),
            "limited": bool(np.isfinite(c.lower) and np.isfinite(c.upper)),
        }
        for c, (lower, upper) in zip(mechanism.coordinates, ranges, strict=True)
    ]
    # Springs, with what is known of the origin of their numbers.
    stiffness = elastic.stiffnesses
    spring_units = [units.spring(slides) for slides in elastic.slides]
    driven = () if springs is None else drives(elastic)
    assumed = elastic.assumed_springs
    doubts = dict.fromkeys(assumed, "assumed")
    doubts |= dict.fromkeys(elastic.illustrative - assumed, "illustrative")
    # All that does not change with the posture.
    return {
        "name": elastic.name,
        "kind": mechanism.kind,
        "called": _kind_words(elastic),
        "frame": mechanism.frame,
        "frames": elastic.frames_of_body,
        "units": units.to_dict(),
        "coordinates": coordinates,
        "joints": _joints(elastic),
        "axes": _axes(elastic),
        "sliders": elastic.commanded,
        "springs": [
            {
                "name": name,
                "stiffness": plain(k),
                "unit": unit,
                "driven": name in driven,
                "nonlinear": springs is not None and i in springs.laws,
                "doubt": doubts.get(name),
            }
            for i, (name, k, unit) in enumerate(
                zip(elastic.spring_names, stiffness, spring_units, strict=False)
            )
        ],
        "takes_load": springs is not None,
        "may_be_loaded": elastic.may_be_loaded,
        "source": elastic.source,
        "is_illustrative": elastic.is_illustrative,
        "weighed": gravity_loads(elastic).text,
        "upright": is_upright(elastic),
        "gravity": None if elastic.gravity is None else elastic.gravity.tolist(),
        "size": float(mechanism.at(q).length),
        "platform": mechanism.coordinates_are_pose,
        "connections": [
            {
                "name": name,
                "title": matrix.name,
                "meaning": matrix.sentence,
                "load": matrix.load,
            }
            for name, matrix in MATRICES.items()
        ],
    }


_KINDS = {
    "serial": "serial arm",
    "stewart-gough": "platform on six legs",
    "springs": "body on springs",
    "parallel": "parallel mechanism",
    "closed-chain": "closed chain",
}


def _kind_words(elastic: ElasticMechanism) -> str:
    """What kind of mechanism it is, in words."""
    springs, kind = elastic.springs, elastic.mechanism.kind
    if springs is not None and springs.unilateral:
        return "cable robot"
    return _KINDS.get(kind, kind)


def _joints(elastic: ElasticMechanism) -> list[int]:
    """The coordinate that moves each joint of the tree."""
    mechanism = elastic.mechanism
    mimic = mechanism.mimic
    if mimic is None:
        return list(range(len(mechanism.screws())))
    return np.abs(mimic).argmax(axis=1).tolist()


def _axes(elastic: ElasticMechanism) -> list[list[float]]:
    """The line along or about which each joint of the tree moves,
    in the joint's own frame.
    """
    screws = elastic.mechanism.screws()
    return [(s[:3] if s[:3].any() else s[3:]).tolist() for s in screws]


def slider_ranges(elastic: ElasticMechanism, q: Array) -> list[tuple[float, float]]:
    """Ends of every slider: limits, where a leg reaches one, else a range about q."""
    mechanism = elastic.mechanism
    posture, is_platform = mechanism.at(q), mechanism.coordinates_are_pose
    size = posture.length
    if posture.lines is not None:
        size = float(np.mean(posture.lines.lengths))
    pairs = zip(mechanism.coordinates, q, strict=True)
    ranges = [_range(c, float(x), size, is_platform) for c, x in pairs]
    if is_platform and len(limits_of(mechanism)):
        ranges = [
            _within_strokes(mechanism, q, i, size, own) for i, own in enumerate(ranges)
        ]
    return ranges


# Postures on the way to the end of a stroke, and how often the way between two is divided
# again.
_SAMPLES, _DIVISIONS = 201, 3


def _within_strokes(
    platform: Mechanism, q: Array, i: int, size: float, own: tuple[float, float]
) -> tuple[float, float]:
    """Ends of coordinate i of a platform's pose q (6,): where the first leg
    reaches a limit.

    The other coordinates stay; a limit that is exceeded at q does not count. `own` is the
    range without limits, used where none is reached within twice `size` or a quarter of a
    turn.
    """
    # Limits that the posture itself breaks do not count.
    limits, pose = limits_of(platform), platform.at(q).pose
    limits = limits.leaving_out(limits.side(limits.values(q, pose), size))
    reach = 2.0 * size if platform.coordinates[i].is_length else 0.5 * np.pi
    ends = list(own)
    # To each side: the first limit on a coarse row, then finer between its neighbours.
    for side, sign in enumerate((-1.0, 1.0)):
        near, far, is_reached = 0.0, sign * reach, False
        for _ in range(_DIVISIONS):
            steps = np.linspace(near, far, _SAMPLES)
            Q = q + steps[:, None] * (np.arange(6) == i)
            T = se3.from_roll_pitch_yaw(Q[:, :3], Q[:, 3:]) @ platform.frame_offset
            beyond = limits.exceeded(limits.values(Q, T))
            if not beyond.any():
                break
            is_reached, first = True, max(1, int(beyond.argmax()))
            near, far = float(steps[first - 1]), float(steps[first])
        if is_reached:
            ends[side] = float(q[i]) + near
    return (ends[0], ends[1]) if ends[0] < ends[1] else own


def swept_range(lower: float, upper: float, is_length: bool) -> tuple[float, float]:
    """Ends of a sweep: those of the slider, of an angle one turn at most,
    about 0 where it can.
    """
    if is_length or upper - lower <= 2.0 * _TURN:
        return lower, upper
    start = min(max(lower, -_TURN), upper - 2.0 * _TURN)
    return start, start + 2.0 * _TURN


def _range(
    coordinate: Coordinate, x: float, size: float, is_platform: bool
) -> tuple[float, float]:
    half = _SHARE * size if coordinate.is_length else _TILT if is_platform else _TURN
    centre = x if coordinate.is_length or is_platform else 0.0
    lower = coordinate.lower if np.isfinite(coordinate.lower) else min(centre - half, x)
    upper = coordinate.upper if np.isfinite(coordinate.upper) else max(centre + half, x)
    return float(lower), float(upper)


_FREEDOMS: tuple[Freedom, Freedom] = ("translation", "rotation")


def shown_numbers(result: PostureStiffness, state: ViewState) -> dict[str, Any]:
    """Everything that the page shows as numbers at one posture.

    Parameters
    ----------
    result : PostureStiffness
        The posture.
    state : ViewState
        The state of the tab.

    Returns
    -------
    dict
        Keys "result", "has_compliance", "position", "frame", "stiffness", "compliance",
        "wrench", "principal", "softest", "indices", "symmetric", "singularity",
        "legs", "moved", "modes", "verdict", "doubts"; None for numbers that do not exist.
    """
    # All matrices in the frame that the reader has chosen.
    T = reference_frame(result, state)
    here = result.at(T)
    pair = matrix_pair(here, state.connection)
    shown = here.matrices if state.quantity == "stiffness" else here.compliances
    principal = _principal(here, state)
    numbers = _indices(pair)
    # The chosen quantity takes the place of its None below; the other one is not sent.
    answer: dict[str, Any] = {
        "result": _part(result, state.quantity),
        "has_compliance": pair.K is not None or result.reduction.compliance is not None,
        "position": result.pose[:3, 3].tolist(),
        "frame": None if T is None else T.tolist(),
        "stiffness": None,
        "compliance": None,
        "wrench": _listed(here.wrench),
        "principal": principal,
        "softest": softest_in_room(here, result.elastic_as_given),
        "indices": numbers,
        "symmetric": asymmetries(here, state.quantity),
        "singularity": distance_to_singularity(result),
        "legs": legs(result),
        "moved": moved_part(result, state),
        "modes": modes_part(result) if state.mode is not None else None,
        "verdict": verdict_words(result, state.connection, numbers),
        "doubts": [
            note.code for note in doubts_of(result.elastic_as_given, result.notes)
        ],
    }
    if T is not None:
        answer[state.quantity] = {n: _listed(M) for n, M in shown.items() if n != "+"}
    return answer


def own_matrices(
    result: PostureStiffness, state: ViewState, connections: Sequence[Connection]
) -> dict[str, Any]:
    """The shown quantity of the user's connections, at the reference point;
    None where it does not exist.
    """
    T = reference_frame(result, state)
    matrices = dict[str, Any]()
    for own in connections:
        matrix: Array | None = None
        with suppress(UndefinedError):
            matrix = result.tensor(own).matrix
        if matrix is not None and T is not None:
            matrix = move_stiffness(matrix, T)
        if matrix is not None and state.quantity == "compliance":
            inverse = numerics.invert(matrix)
            matrix = None if inverse is None else inverse.matrix
        matrices[own.name] = _listed(matrix)
    return matrices


def verdict_words(
    result: PostureStiffness, connection: str, indices: Mapping[str, Any] | None
) -> dict[str, Any]:
    """The verdict on the matrix shown: level, sentence, and unless it is good its code,
    and what to try.
    """
    definiteness = None if indices is None else indices["definiteness"]
    found = verdict_at(result, connection, definiteness)
    code = None if found.level == "good" else found.code
    advice = None
    if code is not None:
        is_preload = result.is_loaded and not result._load_is_given
        own = f"preload {code}" if is_preload else code
        advice = ADVICE.get(own, ADVICE.get(code))
    title = VERDICTS[found.code]
    return {"level": found.level, "title": title, "code": code, "advice": advice}


def reference_frame(result: PostureStiffness, state: ViewState) -> Array | None:
    """``T_M_N`` of the point and axes that the numbers are for; None if N is M itself."""
    if state.axes == "body" and not any(state.point):
        return None
    rotation = np.eye(3) if state.axes == "body" else result.pose[:3, :3].T
    return se3.pose(rotation, state.point)


def _part(result: PostureStiffness, quantity: str) -> dict[str, Any]:
    """The part of the object of `analyse` that is shown and depends on the posture."""
    table = result.matrices if quantity == "stiffness" else result.compliances
    return {
        "q": result.q.tolist(),
        "pose": result.pose.tolist(),
        "wrench": None if result.wrench is None else result.wrench.tolist(),
        "energy": plain(result.energy),
        quantity: {name: _listed(matrix) for name, matrix in table.items()},
        "load": result.load_as_dict(),
        "notes": [note.to_dict() for note in result.notes],
    }


def modes_part(result: PostureStiffness) -> dict[str, Any]:
    """Return the part of ``cartstiff modes --json`` that the page shows,
    or why there is none.
    """
    try:
        answer = modes(result).to_dict()
    except UndefinedError as error:
        return {"missing": str(error)}
    names = answer["mechanism"]["joints"]
    if result.posture.coordinates_are_pose:
        names = ["rx", "ry", "rz", "x", "y", "z"]
    keys = (
        "frequencies",
        "participation",
        "nodal_axes",
        "effective_masses",
        "repeated",
        "notes",
    )
    return {"names": names, **{key: answer[key] for key in keys}}


def response_curves(
    result: PostureStiffness, state: ViewState, ratio: float
) -> dict[str, Any]:
    """Size of the receptance at the reference point along x, y, z of the body,
    over all modes.

    Parameters
    ----------
    result : PostureStiffness
        The posture.
    state : ViewState
        For its reference point.
    ratio : float
        Damping ratio of every mode, beside the mechanism's own dampers.

    Raises
    ------
    UndefinedError
        If there are no modes, or none that vibrates.
    """
    swings = modes(result)
    hertz = swings.frequencies[
        np.isfinite(swings.frequencies) & (swings.frequencies > 0.0)
    ]
    if not hertz.size:
        raise UndefinedError(
            "no mode vibrates: there is no response over frequency", code="no-mass"
        )
    own = hertz[: 6 if len(hertz) > 6 else None]
    # Dense at the peaks.
    near = np.concatenate(
        [f * (1 + x * np.array([-1, 1])) for f in own for x in (0, 0.01, 0.03)]
    )
    wide = np.geomspace(0.3 * own[0], 1.6 * own[-1], 240)
    found_at = frequency_response(swings, np.union1d(wide, near), ratio, at=state.point)
    sizes = {name: np.abs(curve) for name, curve in found_at.curves().items()}
    return {
        "frequencies": found_at.frequencies.tolist(),
        "modes": own.tolist(),
        "unit": found_at.unit,
        "curves": {n: [plain(float(x)) for x in size] for n, size in sizes.items()},
    }


def _principal(here: StiffnessInFrame, state: ViewState) -> dict[str, Any] | None:
    """Principal values of the shown matrix, the other freedoms free or held,
    with their axes.
    """
    shown = {}
    for freedom in _FREEDOMS:
        try:
            e = block_ellipsoid(
                here, state.connection, state.quantity, freedom, state.others
            )
        except UndefinedError:
            return None
        if e is None:
            return None
        shown[str(freedom)] = {
            "values": e.eigenvalues.tolist(),
            "axes": e.axes.T.tolist(),
            "definiteness": e.definiteness,
        }
    return shown


def softest_in_room(
    here: StiffnessInFrame, elastic: ElasticMechanism
) -> dict[str, Any] | None:
    """Least stiffness against a force, the body free to turn, and its direction in F,
    if it is one, also in words.

    None where a force is not resisted along every direction.
    """
    try:
        free = block_ellipsoid(here, "load", "compliance", "translation", "free")
    except UndefinedError:
        return None
    found = (
        None if free is None else softest(free.eigenvalues, here.pose[:3, :3] @ free.axes)
    )
    if found is None:
        return None
    words = None if found[1] is None else _which(elastic, found[1], is_line=True)
    return {"stiffness": found[0], "direction": found[1], "which": words}


def _indices(pair: MatrixPair) -> dict[str, Any] | None:
    """The indices that are shown; `cartstiff.answer.analysis.indices` has all of them."""
    if pair.K is None:
        return None
    length = length_of_pair(pair)
    try:
        values, _, definiteness = spectrum(pair.K, length.value, pair.C)
    except UndefinedError:
        return None
    return {
        "length": length.value,
        "length_origin": length.origin,
        "length_reason": length.reason,
        "definiteness": definiteness,
        "eigenvalues": values.tolist(),
        "condition_number": plain(numerics.condition_of(values)),
        "translational_condition": plain(pair.condition("translation")),
        "rotational_condition": plain(pair.condition("rotation")),
    }


def distance_to_singularity(result: PostureStiffness) -> list[dict[str, Any]]:
    """Smallest over largest singular value of the length-scaled Jacobians, per kind.

    "serial" for the motions of the body, "type-2" for what the actuators hold.
    """
    posture = result.posture
    ratios, motions = list[dict[str, Any]](), None
    if not posture.coordinates_are_pose:
        if posture.closure is None:
            values = scaled_values(posture, result.jacobian, result.length)
            freedoms = len(posture.q)
        else:
            values, freedoms, motions = result.motions_of_closed
        ratios.append(_ratio("serial", values, min(6, freedoms)))
    if posture.actuation is not None:
        rates = posture.actuation * posture.coordinate_lengths
        if motions is not None:
            rates = rates @ motions
        # Fewer actuators than motions (compliant links): springs hold the rest.
        if rates.shape[0] >= rates.shape[1]:
            near = (
                n.values for n in result.notes if n.code.endswith("type-2-singularity")
            )
            known = next(near, {}).get("singular_values")
            values = numerics.singular_values(rates) if known is None else np.array(known)
            ratios.append(_ratio("type-2", values, rates.shape[1]))
    for entry in ratios:
        entry["length"] = result.length
    return ratios


def _ratio(kind: str, values: Array, wanted: int) -> dict[str, Any]:
    complete = len(values) >= wanted > 0
    smallest = float(values[wanted - 1]) if complete else 0.0
    largest = float(values[0]) if len(values) else 0.0
    return {
        "kind": kind,
        "ratio": smallest / largest if largest > 0 else 0.0,
        "smallest": smallest,
        "largest": largest,
    }


def legs(result: PostureStiffness) -> list[dict[str, Any]] | None:
    """Lengths, limits and tensions of a platform's lines."""
    lengths, tensions = result.leg_lengths, result.tensions
    if lengths is None:
        return None
    limits = list(result.mechanism.bounds.values())
    nothing: list[None] = [None] * len(lengths)
    lower, upper = plain(np.transpose(limits)) if limits else (nothing, nothing)
    pulls = nothing if tensions is None else plain(tensions)
    return [
        {"length": length, "tension": tension, "lower": low, "upper": high}
        for length, tension, low, high in zip(
            lengths.tolist(), pulls, lower, upper, strict=True
        )
    ]


def _deflection(
    result: PostureStiffness, state: ViewState, notes: Notes
) -> FoundDeflection | None:
    """The deflection of the reference point under the load, as the analysis has it."""
    point = np.array(state.point)
    return deflection_found(result, "load", None, np.zeros(3), point, notes)


def displacement_under_load(result: PostureStiffness, state: ViewState) -> float | None:
    """How far the load moves the reference point; None if it is not resisted."""
    found = _deflection(result, state, Notes())
    if found is None or not result._resists:
        return None
    return numerics.norm(found.whole.displacement)


def moved_part(result: PostureStiffness, state: ViewState) -> dict[str, Any] | None:
    """How far the load moves the reference point, to first order, and what contributes.

    "motion" is that of the coordinates of the derivatives.
    """
    notes = Notes()
    found = _deflection(result, state, notes)
    if found is None:
        return None
    whole, shares = found.whole, shares_of(found.shares, result.elastic_as_given)
    in_room = (result.pose[:3, :3] @ whole.displacement).tolist()
    motion = motion_of(result, found)
    return {
        "displacement": whole.displacement.tolist(),
        "in_room": in_room,
        "of_frame": whole.twist[3:].tolist(),
        "rotation": whole.twist[:3].tolist(),
        "which": _which(result.elastic_as_given, in_room),
        "energy": plain(whole.energy),
        "acts_at": found.acts_at.tolist(),
        "resisted": result._resists,
        "shares": None if shares is None else plain_shares(shares),
        "motion": None if motion is None else motion.tolist(),
        "notes": [note["message"] for note in notes.entries],
    }


def plain_shares(shares: Shares) -> dict[str, Any]:
    """Shares in the order in which they are said, and the rest."""
    parts = [{"name": part.name, "share": part.share} for part in shares.parts]
    return {"of": shares.of, "parts": parts, "rest": shares.rest}


def is_upright(elastic: ElasticMechanism) -> bool:
    """Whether z is vertical: gravity, if any is known, is along it."""
    return elastic.gravity is None or not any(elastic.gravity[:2])


def _which(
    elastic: ElasticMechanism, direction: Sequence[float], is_line: bool = False
) -> str | None:
    """A direction of the room in words; None for none."""
    if not any(direction):
        return None
    x, y, z = direction
    return direction_words((x, y, z), is_line, is_upright(elastic))


def series_row(result: PostureStiffness, state: ViewState) -> dict[str, Any]:
    """One posture of a sweep or a trajectory: what ``static/curves.js`` plots,
    each a list or None.

    "translation", "rotation": principal values; "condition" of the stiffness and of its
    blocks; "singularity": the least ratio of singular values; "deflection", "turn" under
    the load; "energy"; "leg_force", the largest. "unstable" says that the load is not
    resisted.
    """
    # Principal values and conditions of the chosen matrix.
    here = result.at(reference_frame(result, state))
    try:
        principal = _principal(here, state)
    except UndefinedError:
        principal = None
    indices = _indices(matrix_pair(here, state.connection))
    names = "condition_number", "translational_condition", "rotational_condition"
    conditions = [] if indices is None else [indices[name] for name in names]
    # How near a singularity is, and how far the load moves the body; an unstable posture
    # moves without bound.
    ratios = [entry["ratio"] for entry in distance_to_singularity(result)]
    moved = _deflection(result, state, Notes())
    unstable = moved is not None and not result._resists
    if unstable:
        moved = None
    forces = [leg["tension"] for leg in legs(result) or () if leg["tension"] is not None]
    # A curve that does not exist here has None, which leaves a gap.
    deflection: list[float] | None = None
    turn: list[float] | None = None
    if moved is not None:
        deflection = [numerics.norm(moved.whole.displacement)]
        turn = [numerics.norm(moved.whole.twist[:3])]
    energy = plain(result.energy)
    return {
        "q": result.q.tolist(),
        "position": result.pose[:3, 3].tolist(),
        "translation": None if principal is None else principal["translation"]["values"],
        "rotation": None if principal is None else principal["rotation"]["values"],
        "condition": conditions if any(x is not None for x in conditions) else None,
        "singularity": [min(ratios)] if ratios else None,
        "deflection": deflection,
        "turn": turn,
        "energy": None if energy is None else [energy],
        "leg_force": [max(map(abs, forces))] if forces else None,
        "unstable": unstable,
    }


def _listed(matrix: Array | None) -> list[Any] | None:
    return None if matrix is None else matrix.tolist()
