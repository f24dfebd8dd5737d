"""Every quantity of the table, by each way to it: one value, and one verdict on its existence.

The ways: the analysis of one posture, stacks of many postures, and recorded numbers; what the page
computes in JavaScript is held to the same table in tests/rooms/page. An entry of
the table without a way to it here fails the first test.
"""

from functools import partial

import numpy as np
import pytest
from tests.doors import LoadKind, compliance_ellipsoid
from tests.support.read import asked, frequencies, of_many, readable
from tests.support.read import read as read_recorded

import cartstiff
from cartstiff import InputError, analyse_posture, modes
from cartstiff.extend import QUANTITIES, Platform
from cartstiff.vibration import Damping

LENGTH, DIRECTION, RATIO = 0.3, (0.2, -0.5, 0.7), 0.03
LOAD = (0.4, -0.2, 0.3, 5.0, -7.0, 6.0)
#: Of two ways to a number, for each unit of the condition number of what it is read from.
PER_CONDITION = 1e-12


def _at(tree, path):
    for key in path.split("."):
        tree = None if tree is None else tree[int(key) if key.isdigit() else key]
    return tree


def _axis(kind, others):
    return lambda r, a: next(d for d in a["directions"] if d["name"] == "given")[kind][others]


class PathOfAnalysis:
    """The number at a path of the analysis."""

    def __init__(self, path):
        self.path = path

    def __call__(self, r, a):
        return _at(a, self.path)


def _unstable(r, a):
    values = _at(a, "indices.eigenvalues")
    return None if values is None else sum(x < 0.0 for x in values)


def _deflection(key, r, a):
    vector = _at(a, f"deflection.{key}")
    return None if vector is None else np.linalg.norm(vector[:3])


def _connection_change(r, a):
    known = [row["change"] for row in (a["connections"] or {"rows": ()})["rows"]]
    return max((x for x in known if x is not None), default=None)


def _singular_values(r, a, length):
    """Of the length-scaled Jacobian, by the eigenvalues of its square."""
    J = r.jacobian
    if r.posture.coordinates_are_pose:
        lengths = np.ones(J.shape[1], bool)
    else:
        lengths = np.array([c.is_length for c in r.elastic.mechanism.coordinates])
    scaled = J * np.where(lengths, length, 1.0) * np.repeat([length, 1.0], 3)[:, None]
    return np.sqrt(np.linalg.eigvalsh(scaled @ scaled.T).clip(0.0))


def _ratio(r, a):
    values = _singular_values(r, a, LENGTH)
    return values[0] / values[-1]


def _wrench(part, r, a):
    return None if r.wrench is None else np.linalg.norm(r.wrench[part])


#: The way of one posture to each quantity, from its stiffness and its analysis.
SINGLE = {
    **{
        f"{prefix}{freedom}_{others}_{end}": PathOfAnalysis(
            f"ellipsoids.{kind}.{freedom}.{others}.eigenvalues.{i}"
        )
        for prefix, kind in (("", "stiffness"), ("compliance_", "compliance"))
        for freedom in ("translation", "rotation")
        for others in ("free", "held")
        for end, i in (("min", 0), ("max", 2))
    },
    **{f"{kind}_{o}": _axis(kind, o) for kind in ("along", "about") for o in ("free", "held")},
    "deflection": partial(_deflection, "displacement"),
    "deflection_angle": partial(_deflection, "twist"),
    "condition": PathOfAnalysis("indices.condition_number"),
    "isotropy": PathOfAnalysis("indices.isotropy"),
    "minimum": PathOfAnalysis("indices.minimum_stiffness"),
    "translation_condition": PathOfAnalysis("indices.translational_condition"),
    "rotation_condition": PathOfAnalysis("indices.rotational_condition"),
    "determinant": PathOfAnalysis("indices.determinant"),
    "unstable_directions": _unstable,
    "natural_length": lambda r, a: a["natural"],
    "asymmetry": PathOfAnalysis("asymmetry.size"),
    "connection_change": _connection_change,
    "singular_value_ratio": _ratio,
    "manipulability": lambda r, a: np.prod(_singular_values(r, a, 1.0)),
    "moment": partial(_wrench, slice(0, 3)),
    "force": partial(_wrench, slice(3, 6)),
    "energy": lambda r, a: r.energy,
}
#: Those that come from the masses, and that the fewest lines of this file can say anew.
OF_MODES = {f"{name}_{i}" for name in ("frequency", "damping") for i in range(1, 7)}
#: Rounding of what is zero, or no number of a singular posture, in natural sizes.
DOUBTFUL = {"determinant", "singular_value_ratio", "manipulability", "asymmetry"}

CASES = {
    "unloaded arm": ("ur5", None, "B"),
    "loaded arm": ("ur5", LOAD, "load"),
    "loaded arm, K": ("ur5", LOAD, "K"),
    "loaded arm, F": ("ur5", LOAD, "F"),
    "redundant arm, asymmetric": ("panda", LOAD, "A"),
    "platform": ("stewart-simscape", LOAD, "load"),
}
MORE_CASES = {
    "platform at rest": ("cubic", None, "B"),
    "fewer than six freedoms": ("five-bar", None, "B"),
}


def _postures(elastic, count):
    """Random ones, and some at a singularity and near one."""
    rng = np.random.default_rng(5)
    wide = 2.0 if elastic.mechanism.kind == "serial" else 0.05 * np.repeat([1.0, 4.0], 3)
    q = elastic.q + wide * rng.uniform(-1.0, 1.0, (count, len(elastic.q)))
    if elastic.mechanism.kind == "serial":
        q[0] = 0.0
        q[1] = 1e-9
        q[2] = 1e-5 * rng.uniform(-1.0, 1.0, len(elastic.q))
    return q


def _asked(name):
    robot, wrench, connection = (CASES | MORE_CASES)[name]
    elastic = cartstiff.load(robot)
    load = LoadKind("dead", (0.0, 0.02, 0.05)) if connection == "load" else LoadKind()
    settings = asked(
        connection,
        LENGTH,
        DIRECTION,
        load=load,
        is_loaded=wrench is not None,
        deflect=None if wrench is not None else LOAD,
        damping=Damping(RATIO),
    )
    return elastic, wrench, load, settings


def test_every_quantity_has_a_way_to_it_here():
    of_drives = {"effort_margin", "largest_load"}  # test_capacity.py
    assert set(SINGLE) | OF_MODES | of_drives == set(QUANTITIES)
    assert {n for n, q in QUANTITIES.items() if not q.is_recorded} == {
        "connection_change",
        *(n for n in OF_MODES if n.startswith("damping")),
    }


@pytest.mark.parametrize("name", CASES)
def test_one_posture_stacks_and_recorded_numbers_agree(name):
    elastic, *_ = _asked(name)
    assert _compared(name, _postures(elastic, 24)) > 0.8


@pytest.mark.parametrize("name", [*CASES, *MORE_CASES])
def test_at_special_angles_they_agree_and_exist_together(name):
    """Joints at right angles and straight, exactly and nearly: many ways to be singular."""
    elastic, *_ = _asked(name)
    rng, count, n = np.random.default_rng(8), 30, len(elastic.q)
    if elastic.mechanism.kind != "serial":
        wide = 0.05 * np.repeat([1.0, 4.0], 3) if isinstance(elastic.mechanism, Platform) else 0.1
        q = elastic.q + wide * rng.uniform(-1.0, 1.0, (count, n))
        q[0] = elastic.q
        if isinstance(elastic.mechanism, Platform):
            q[1:4] = elastic.q
            q[1:4, 5] += np.array([0.5, -0.5, 1.0 - 1e-9]) * np.pi
        _compared(name, q)
        return
    q = elastic.q + rng.uniform(-2.0, 2.0, (count, n))
    for row in q:
        special = rng.choice(n, rng.integers(1, n + 1), replace=False)
        row[special] = rng.choice(np.pi * np.array([0.0, 0.5, -0.5, 1.0]), len(special))
        row[special] += rng.choice([0.0, 0.0, 1e-9, 1e-6, 1e-4])
    _compared(name, q)


def _compared(name, q):
    """Compare all ways at postures; the share of them that recorded numbers answer, or None."""
    elastic, wrench, load, settings = _asked(name)
    of_jacobian = {"singular_value_ratio", "manipulability"}
    without = of_jacobian if elastic.mechanism.kind in ("closed-chain", "parallel") else set()
    names = tuple(n for n in SINGLE if n not in without)
    acting = {"wrench": wrench, "load_kind": load.kind, "load_at": load.at}
    found, _ = of_many(elastic, q, names, settings, wrench)
    given = None if wrench is None else np.array(wrench)
    recorded = tuple(n for n in names if QUANTITIES[n].is_recorded)
    recorded = readable(elastic, recorded, given)
    read = read_recorded(elastic, recorded, q, settings, given) if recorded else None
    with np.errstate(all="ignore"):
        for i, posture in enumerate(q):
            try:
                result = cartstiff.analyse(elastic, posture, **acting)
            except InputError:  # no springs balance the load there
                assert all(np.isnan(values[i]) for values in found.values())
                continue
            deflect = LOAD if wrench is None else None
            analysis = analyse_posture(
                result,
                connection=settings.connection,
                length=LENGTH,
                direction=DIRECTION,
                wrench=deflect,
                load_at=None if deflect is None else (0.0, 0.0, 0.0),
            )
            own = analyse_posture(result, connection=settings.connection)["length"]
            analysis["natural"] = own["value"] if own["origin"] == "natural" else None
            condition = found["condition"][i] if np.isfinite(found["condition"][i]) else 1e12
            for key in names:
                one = SINGLE[key]
                if key in of_jacobian and result.jacobian is None:
                    assert np.isnan(found[key][i])
                    continue
                expected, value = one(result, analysis), found[key][i]
                exists = expected is not None and np.isfinite(expected)
                if key in DOUBTFUL and condition > 1e11:
                    continue
                assert np.isfinite(value) == exists, (key, i, value, expected)
                ways = [value]
                if read is not None and key in recorded and read.is_known[i]:
                    ways.append(read.values[key][i])
                for way in ways if exists else ():
                    size = 1.0 if key == "connection_change" else abs(expected)
                    close = max(PER_CONDITION * condition, 1e-9) * size + 1e-12
                    assert abs(way - expected) <= close, (key, i, way, expected)
    return None if read is None else read.is_known.mean()


@pytest.mark.parametrize("name", ["unloaded arm", "loaded arm", "platform"])
def test_modes_of_one_posture_of_stacks_and_of_recorded_numbers_agree(name):
    elastic, wrench, load, settings = _asked(name)
    if wrench is not None:  # a dead moment has no energy, and is not recorded
        wrench = (0.0, 0.0, 0.0, *wrench[3:])
    q = _postures(elastic, 24)[4:10]
    names = tuple(sorted(OF_MODES))
    acting = {"load_kind": load.kind, "load_at": load.at}
    given = None if wrench is None else np.array(wrench)
    found, _ = of_many(elastic, q, names, settings, wrench)  # one by one
    by_matrices = frequencies(elastic, q, given, acting)
    wanted = tuple(n for n in names if QUANTITIES[n].is_recorded)
    read = read_recorded(elastic, wanted, q, settings, given)
    assert read.is_known.any()
    for i, posture in enumerate(q):
        result = cartstiff.analyse(elastic, posture, wrench=wrench, **acting)
        swings = modes(result)
        own = swings.frequencies
        for j in range(6):
            key = f"frequency_{j + 1}"
            assert found[key][i] == pytest.approx(own[j], rel=1e-6, nan_ok=True)
            assert by_matrices[i, j] == pytest.approx(own[j], rel=1e-6, nan_ok=True)
            if read.is_known[i]:
                assert read.values[key][i] == pytest.approx(own[j], rel=1e-6)
            assert found[f"damping_{j + 1}"][i] == pytest.approx(RATIO, rel=1e-6, nan_ok=True)


def test_rounding_of_a_singular_posture_is_no_compliance():
    """The wrist of a straight arm cannot turn about x: held there, it is as soft as it was free."""
    C = cartstiff.analyse(cartstiff.load("ur5"), np.zeros(6)).compliances["B"]
    left = C[3:, 3:] - C[3:, :3] @ np.linalg.pinv(C[:3, :3], rcond=1e-12) @ C[:3, 3:]
    shape = compliance_ellipsoid(C, "translation", "held")
    np.testing.assert_allclose(shape.eigenvalues, np.linalg.eigvalsh(left), rtol=1e-9)
