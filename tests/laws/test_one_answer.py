"""One posture, one answer: `analyse`, maps, the page, and differences of the equilibrium.

Random arms, platforms and closed chains, springs over fifteen decades, postures at distances of
1e-1 to 1e-12 from a singular one, and each kind of load. Where something cannot be had, a note
says so. The differences know the forces only: no Hessian, no reduction and no connection.

One thing is not asked: nearer than 1e-2 to a type-2 singularity an equilibrium under the small
load of a difference may be refused, as that load moves the mechanism far. The note of `analyse`
there (near-type-2-singularity) and the refusal say so, with the ratio of singular values at the
posture and where the search ended, or of stiffnesses beyond what doubles resolve. All else of such
a posture, maps and page included, is compared.
"""

import re

import numpy as np
import pinocchio as pin
import pytest
from tests.doors import Chain, Closure, numerics, plain_tree
from tests.support import (
    add_frame,
    hexagons,
    loads_of,
    log_reference,
    promised,
    random_pose,
    spread_springs,
    translation,
)
from tests.support.pages import page_answer, source_of
from tests.support.read import asked, of_many

import cartstiff
from cartstiff import (
    ConvergenceError,
    DeadForce,
    DeadWrench,
    ElasticMechanism,
    InputError,
    JointSprings,
    LineSprings,
    analyse_many,
    analyse_posture,
    equilibrium,
)

DISTANCES = (1e-1, 1e-2, 1e-4, 1e-6, 1e-8, 1e-9, 1e-11, 1e-12)
LOADS = ("none", "dead force", "dead moment", "follower", "conservative", "spring")
MECHANISMS = ("5R", "6R", "7R", "platform", "closed chain")
# The same formula in another order, in the digits that it has.
SAME = 1e-8
# How equilibria are refused near a type-2 singularity, where a load moves the mechanism far.
# The words tell the ratio of singular values, or of stiffnesses.
REFUSED = re.compile(r"hold the mechanism in .*: smallest over largest singular value (\S+);")
# Differences over 1e-4 of what is linear; a soft motion comes to rest to some 1e-10.
DIFFERENCES = 1e-5


def _arm(rng, joints, distance, decades):
    """An arm whose last three axes meet, the middle one turned by `distance` from alignment."""
    model, last = pin.Model(), 0
    for i in range(joints):
        axis = rng.normal(size=3) if i < joints - 3 else np.eye(3)[[2, 1, 2][i - joints + 3]]
        place = np.eye(4) if i > joints - 3 else random_pose(rng, 0.4)
        joint = pin.JointModelRevoluteUnaligned(axis / np.linalg.norm(axis))
        last = model.addJoint(last, joint, pin.SE3(place), f"j{i}")
    add_frame(model, "tip", last, translation(0.1, 0.05, 0.2))
    q = rng.uniform(-1.5, 1.5, joints)
    q[-2] = distance
    open_rest = JointSprings(spread_springs(rng, joints, decades), np.full(joints, np.nan))
    return ElasticMechanism("arm", Chain(plain_tree(model), "tip"), q, open_rest)


def _closed_chain(rng, distance, decades):
    """A five-bar linkage with springs at its motors; its outer links nearly form one line."""
    model, first, outer = pin.Model(), rng.uniform(0.3, 0.5, 2), rng.uniform(0.3, 0.5, 2)
    left, along = rng.uniform(0.5, 1.5), rng.uniform(-0.5, 0.5)
    directions = (along, along + np.pi - distance)
    tip = first[0] * _unit(left) + outer[0] * _unit(along)
    right = rng.uniform(1.5, 2.5)
    bases = (np.zeros(2), tip - first[1] * _unit(right) - outer[1] * _unit(directions[1]))
    q, ends = [], []
    for s, (base, angle) in enumerate(zip(bases, (left, right), strict=True)):
        motor = model.addJoint(0, pin.JointModelRZ(), pin.SE3(translation(*base, 0.0)), f"motor{s}")
        elbow = model.addJoint(
            motor, pin.JointModelRZ(), pin.SE3(translation(first[s], 0.0, 0.0)), f"elbow{s}"
        )
        add_frame(model, f"end{s}", elbow, translation(outer[s], 0.0, 0.0))
        q += [angle, directions[s] - angle]
        ends.append(f"end{s}")
    closures = [Closure(*ends, "point")]
    chain = Chain(plain_tree(model), "end0", closures=closures, actuated=[0, 2])
    k = np.zeros(4)
    k[[0, 2]] = spread_springs(rng, 2, decades)
    return ElasticMechanism("five-bar", chain, np.array(q), JointSprings(k, np.full(4, np.nan)))


def _unit(angle):
    return np.array([np.cos(angle), np.sin(angle)])


def _mechanism(name, rng, distance, decades):
    if name == "platform":
        return hexagons(distance, spread_springs(rng, 6, decades))
    if name == "closed chain":
        return _closed_chain(rng, distance, decades)
    return _arm(rng, int(name[0]), distance, decades)


def _load(kind, rng, elastic):
    """Wrench, what `analyse` is told of it, and what the equilibrium is: by pose and wrench."""
    stiffness = elastic.springs.stiffness
    size = 0.05 * stiffness[stiffness > 0.0].min()  # what the softest spring bears
    w = size * rng.normal(size=6)
    at = 0.1 * rng.normal(size=3)
    if kind == "dead force":
        w[:3] = 0.0
    if kind == "dead moment":
        w[3:] = 0.0
    name = kind if kind in ("follower", "conservative") else "dead"
    return w, {"load_kind": name, "load_at": at}


def _codes(result):
    return {n.code for n in result.notes}


def _motions(acting, result, reaches):
    """d(twist)/d(added wrench) by differences, and what notes say that coordinates are unsure by.

    The words of a refusal: actuators that hardly hold the mechanism.
    """
    pose = result.pose
    R, columns, back, unsure = pose[:3, :3], [], np.linalg.inv(pose), 0.0
    for i, h in enumerate(reaches):
        ends = []
        for t in (h, -h):
            unit = np.eye(6)[i] * t
            moment = DeadWrench([*(R @ unit[:3]), 0.0, 0.0, 0.0])
            added = DeadForce(R @ unit[3:]) if i > 2 else moment
            try:
                state = equilibrium(
                    result.elastic, result.q, *acting, added, limits=False, settle=False
                )
            except ConvergenceError as error:
                if not REFUSED.search(str(error)):
                    raise
                return str(error)
            ends.append(log_reference(back @ state.pose))
            for note in state.notes:
                if note.code in ("posture-unresolved", "neutral"):
                    unsure = max(unsure, note.values.get("largest", np.inf))
        columns.append((ends[0] - ends[1]) / (2 * h))
    return np.column_stack(columns), unsure


def _numbers_of_maps(elastic, q, w, settings):
    """Quantities and matrices of two equal postures, the second of them."""
    names = (
        "translation_free_min",
        "translation_free_max",
        "rotation_free_min",
        "translation_held_min",
        "compliance_translation_free_max",
        "along_free",
        "along_held",
        "about_held",
        "condition",
        "minimum",
        "deflection",
    )
    outputs = ("compliance_load", "stiffness_load", "compliance_A", "wrench")
    values, many = of_many(elastic, np.array([q, q]), names, settings, w, outputs)
    return {n: v[1] for n, v in values.items()}, {n: a[1] for n, a in many.arrays.items()}, many


def _unsymmetric_share(C, change):
    """Size of what of K^load is not symmetric, beside the rest of K^load."""
    scale = np.outer(*[np.repeat([0.3, 1.0], 3)] * 2)
    values, vectors = np.linalg.eigh(0.5 * (C + C.T) * scale)
    root = (vectors * np.sqrt(np.abs(values))) @ vectors.T
    return float(np.linalg.norm(root @ (0.5 * (change - change.T) / scale) @ root, 2))


def _same(got, expected, tolerance, what):
    if expected is None:
        assert not np.isfinite(got), what
        return
    assert got == pytest.approx(expected, rel=tolerance), what


@pytest.mark.parametrize("load", LOADS)
@pytest.mark.parametrize("name", MECHANISMS)
def test_one_answer(name, load):
    first = MECHANISMS.index(name) + LOADS.index(load)
    for i in range(first % 3, len(DISTANCES), 3):
        check_posture(name, load, DISTANCES[i], 9 if i % 2 else 2, first)


@pytest.mark.parametrize(
    ("name", "load", "distance", "decades", "seed"),
    [
        ("closed chain", "dead force", 1e-1, 6, 1046),  # unstable
        ("platform", "dead force", 1e-2, 2, 1051),  # unstable
        ("closed chain", "spring", 1e-2, 6, 1417),  # a saddle, whose fall is rounding
        ("platform", "none", 1e-1, 9, 1108),  # tensions of stiff legs are rounding
        ("platform", "none", 1e-2, 2, 1412),  # stiff legs round the force along a soft motion
        ("6R", "dead moment", 1e-6, 9, 1341),
        ("platform", "dead force", 1e-1, 9, 2160),  # unstable, beside stiff legs
        ("platform", "follower", 1e-6, 6, 2319),  # the load fixes tensions to nine digits
        ("closed chain", "conservative", 1e-10, 9, 500206),  # regular beside what is type 2
        ("7R", "conservative", 1e-6, 9, 510477),  # K alone: no pivot is small, the inverse large
        ("platform", "spring", 1e-7, 6, 656904),  # tensions leave soft motions eight digits
    ],
)
def test_one_answer_where_it_was_missed(name, load, distance, decades, seed):
    check_posture(name, load, distance, decades, seed)


def check_posture(name, load, distance, decades, seed):
    """All that can be said of one posture, by everybody who says it."""
    rng = np.random.default_rng([seed, decades, round(-np.log10(distance))])
    elastic = _mechanism(name, rng, distance, decades)
    q, bare = elastic.q, elastic
    w, how = _load(load, rng, elastic)
    acting, wrench = [], w
    if load in ("none", "spring"):
        wrench, how = None, {}
    if load == "spring":
        pose, at = cartstiff.analyse(elastic, q).pose, np.array([0.03, -0.02, 0.05])
        away = np.array([0.3, -0.2, 1.5])
        if name == "closed chain":
            away[2], at[2] = 0.0, 0.0
        point = pose[:3, :3] @ at + pose[:3, 3]
        length = np.linalg.norm(away)
        k = float(np.abs(w).max())
        line = LineSprings(
            anchors=np.array([point + away]),
            points=np.array([at]),
            stiffness=np.array([k]),
            rest_length=np.array([0.8 * length]),
        )
        elastic = elastic.with_potential(line)
    try:
        result = cartstiff.analyse(elastic, q, wrench=wrench, **how)
    except InputError as error:
        # At a type-2 singularity, as the posture says without a load, nothing holds one.
        is_unheld = "balance" in str(error) or "has no spring" in str(error)
        if not is_unheld or "type-2-singularity" not in _codes(cartstiff.analyse(bare, q)):
            raise
        return
    # 1. What is missing has a reason.
    K, C = result.tangent, result.tangent_compliance
    reasons = _codes(result) - {
        "kf-undefined",
        "near-serial-singularity",
        "near-type-2-singularity",
    }
    if K is None or C is None:
        assert reasons, "missing without a reason"
    # 2. Stiffness and compliance are inverses, as far as the notes say.
    if K is not None and C is not None:
        size = np.sqrt(np.abs(np.diag(K)))
        rest = (C * np.outer(size, size)) @ (K / np.outer(size, size)) - np.eye(6)
        known = max(promised(result, "stiffness"), promised(result, "compliance"))
        # An error of one is a share of its largest entries, which the other multiplies.
        scale = np.abs(C * np.outer(size, size)).max()
        assert np.abs(rest).max() <= max(1e-11, known) * scale, "K C = 1"
    # 3. Maps.
    at_origin = result
    if load not in ("none", "spring"):
        at_origin = cartstiff.analyse(elastic, q, wrench=result.wrench)
    lost = max(promised(at_origin, "compliance"), promised(result, "compliance"))
    direction = np.array([0.6, 0.0, 0.8])
    settings = asked("load", 0.3, tuple(direction), tuple(w))
    many_wrench = None if wrench is None else result.wrench
    numbers, arrays, many = _numbers_of_maps(elastic, q, many_wrench, settings)
    single = analyse_posture(
        at_origin, connection="load", length=0.3, direction=direction, wrench=w
    )
    if at_origin.tangent_compliance is None:
        assert not np.isfinite(arrays["compliance_load"]).any()
    else:
        expected = at_origin.tangent_compliance
        missed = np.abs(arrays["compliance_load"] - expected).max() / np.abs(expected).max()
        # A wrench near a type-2 singularity fixes tensions as far as the lines are known.
        least = SAME if "near-type-2-singularity" in _codes(result) else 1e-10
        assert missed <= max(least, 10.0 * lost)
    assert np.isfinite(arrays["stiffness_load"]).all() == (at_origin.tangent is not None)
    if not many.is_regular[1]:
        state = many.codes[many.state[1]]
        assert state in _codes(at_origin), state
    # A stiffness alone is a state where its note says that soft directions are lost.
    if at_origin.tangent is not None and many.is_regular[1]:
        alone = analyse_many(elastic, [q], wrench=many_wrench, outputs=("stiffness_load",))
        is_lost = max(lost, promised(at_origin, "stiffness")) > numerics.LOST_ERROR
        assert alone.counts() == {"ill-conditioned" if is_lost else "regular": 1}
    # Held values are those of K's own digits, the others of the compliance's.
    tolerance = max(SAME, 100.0 * lost)
    ellipsoids = single["ellipsoids"]
    free = ellipsoids["stiffness"]["translation"]["free"]
    if free is not None and at_origin.tangent_compliance is not None:
        turned = ellipsoids["stiffness"]["rotation"]["free"]
        turned = [None] if turned is None else turned["eigenvalues"]
        least, _, most = free["eigenvalues"]
        _same(numbers["translation_free_min"], least, tolerance, "free min")
        # Of the compliance the stiffest direction is known as far as the softest leaves digits.
        known = max(tolerance, 1e-13 * most / abs(least))
        _same(numbers["translation_free_max"], most, known, "free max")
        _same(numbers["rotation_free_min"], turned[0], tolerance, "free rotation")
        _same(numbers["along_free"], single["directions"][-1]["along"]["free"], tolerance, "along")
        held = ellipsoids["stiffness"]["translation"]["held"]
        held = [np.nan] * 3 if held is None else held["eigenvalues"]
        known = max(tolerance, 10.0 * promised(at_origin, "stiffness"))
        if "near-type-2-singularity" in _codes(result):  # of the largest, as the compliance above
            known = max(known, SAME * np.abs(held).max() / abs(held[0]))
        if np.isfinite(held).all() or np.isfinite(numbers["translation_held_min"]):
            _same(numbers["translation_held_min"], held[0], known, "held")
        for kind in ("along", "about"):
            _same(numbers[f"{kind}_held"], single["directions"][-1][kind]["held"], known, kind)
        indices = single["indices"]
        if indices is None:
            assert np.isnan([numbers["condition"], numbers["minimum"]]).all()
        else:
            condition = indices["condition_number"] or np.inf
            _same(numbers["condition"], condition, max(1e-6, known), "condition")
            if known < 1.0:  # else a note says that K does not hold it
                _same(numbers["minimum"], indices["minimum_stiffness"], tolerance, "minimum")
    soft = ellipsoids["compliance"]["translation"]["free"]
    if soft is not None and np.isfinite(numbers["compliance_translation_free_max"]):
        _same(numbers["compliance_translation_free_max"], soft["eigenvalues"][2], tolerance, "soft")
    if single["deflection"] is not None:
        moved = np.linalg.norm(single["deflection"]["displacement"])
        _same(numbers["deflection"], moved, tolerance, "deflection")
    # 4. The page.
    state = {"q": q.tolist(), "quantity": "compliance"}
    if wrench is not None:
        state |= {"load": list(w), **how, "load_at": list(how["load_at"])}
    shown = page_answer(source_of(elastic), "numbers", state)["numbers"]
    told = {n["code"] for n in shown["result"]["notes"]}
    assert told == _codes(result)
    if C is not None:
        assert np.array_equal(shown["result"]["load"]["compliance"], C)
        whole = analyse_posture(result, connection="load")
        # The page shows the symmetric part of C^load, the analysis the inverse of that of K^load:
        # the same but for the square of what is not symmetric.
        apart = _unsymmetric_share(C, result.change_by_load) ** 2
        principal = whole["ellipsoids"]["compliance"]
        for freedom in ("translation", "rotation"):
            there = principal[freedom]["free"]
            if shown["principal"] is not None and there is not None:
                values = np.array(there["eigenvalues"])
                off = np.abs(np.array(shown["principal"][freedom]["values"]) - values)
                assert off.max() <= max(1e-12, 2.0 * apart, 10.0 * lost) * np.abs(values).max(), (
                    freedom
                )
        if shown["indices"] is not None and whole["indices"] is not None:
            _same(
                shown["indices"]["condition_number"] or np.inf,
                whole["indices"]["condition_number"] or np.inf,
                SAME,
                "page",
            )
    # 5. Differences of the equilibrium. Near a type-2 singularity little is linear over more than a
    # share of its distance; there the square of what is added is taken out by half a step.
    if C is None or "type-2-singularity" in _codes(result):
        return
    is_type_2 = name in ("platform", "closed chain")
    told = any("type-2-singularity" in code for code in _codes(result))
    assert told or not is_type_2 or distance > 1e-3
    if wrench is not None:
        acting = loads_of(load, w, how["load_at"], result.pose[:3, :3], 0.1)
    # What a stiff spring gives is nothing beside what the soft one does under the same load.
    size = np.abs(C).max(axis=0)
    size = np.maximum(size, size.max() * (1.0 if decades > 2 else 1e-2))
    off, refused, unsure = np.inf, [], 0.0
    is_near = is_type_2 and distance < 1e-2
    for reach in (
        (2e-2, 2e-3, 5e-4) if is_near else (1e-4, 1e-5)
    ):  # the shorter one where it is needed
        reach = reach * (distance if is_type_2 else 1.0)
        shares = (1.0, 0.5) if is_near else (1.0,)
        found = [_motions(acting, result, share * reach / size) for share in shares]
        if refused := [words for words in found if isinstance(words, str)]:
            assert is_near, refused[0]
            noted = next(n for n in result.notes if "type-2-singularity" in n.code)
            assert numerics.ratio(noted.values["singular_values"]) < numerics.NEAR_SINGULARITY
            for words in refused:
                assert float(REFUSED.search(words).group(1)) < numerics.NEAR_SINGULARITY, words
            continue
        expected = found[0][0] if len(found) == 1 else (4.0 * found[1][0] - found[0][0]) / 3.0
        unsure = max(each for _, each in found) / reach
        off = float((np.abs(C - expected).max(axis=0) / size).max())
        rounded = 64.0 * numerics.EPSILON / reach  # of the coordinates
        if name == "closed chain" and is_near:  # of the motors, which move by this share
            rounded = max(rounded, min(numerics.LOST_ERROR, 0.5 * rounded / distance))
        if off <= max(DIFFERENCES, 10.0 * lost, 4.0 * unsure, rounded):
            return
    assert refused, f"differences: {off:.2g}, {unsure:.2g}"
