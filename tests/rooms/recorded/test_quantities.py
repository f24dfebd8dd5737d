"""Every quantity of a map equals what the analysis says of that posture alone."""

from dataclasses import replace

import numpy as np
import pytest
from tests.doors import LoadKind, PostureMatrices, summarise
from tests.inner import (
    BUILT_IN,
    CHECKSUM,
    STATES,
    Settings,
    choose_quantities,
    evaluate,
    motions,
    packed,
    part_elsewhere,
    prepare_map,
    reduction,
    stiffnesses_of_motions,
    with_angles_times,
)
from tests.support import loaded_arm, paper_platform
from tests.support.commands import refuses

import cartstiff
from cartstiff import InputError, analyse_many, analyse_posture
from cartstiff.analysis import indices_of
from cartstiff.core.errors import UnknownNameError
from cartstiff.extend import QUANTITIES, Quantity
from cartstiff.maps import open_map

LENGTH = 0.3
DIRECTION = (0.2, -0.5, 0.7)
DEFLECT = (0.3, -0.1, 0.2, 4.0, -6.0, 5.0)
LOAD = np.array([0.4, -0.2, 0.3, 5.0, -7.0, 6.0])

#: Frequencies come from the postures: tests/vibration. What drives hold: test_capacity.py.
FROM_MATRICES = [
    name
    for name, quantity in QUANTITIES.items()
    if not name.startswith(("frequency_", "damping_", "limiting")) and quantity.asks != "effort"
]


def _machines():
    rng = np.random.default_rng(11)
    six, prismatic = loaded_arm("RRRRRR", 3), loaded_arm("RRPRRR", 4)
    platform = paper_platform()
    yield "six joints", six.elastic, six.q + rng.uniform(-0.2, 0.2, (6, 6)), LOAD
    yield "with a slide", prismatic.elastic, prismatic.q + rng.uniform(-0.1, 0.1, (4, 6)), LOAD
    yield "seven joints", *_seven(rng), LOAD
    yield "platform", platform, rng.uniform(-0.1, 0.1, (4, 6)), None


def _seven(rng):
    arm = loaded_arm("RRRRRRR", 5)
    return arm.elastic, arm.q + rng.uniform(-0.2, 0.2, (4, 7))


MACHINES = {name: rest for name, *rest in _machines()}


@pytest.mark.parametrize("name", MACHINES)
def test_words_in_the_room_are_the_turned_words_of_the_body(name):
    elastic, q, wrench = MACHINES[name]
    names = ("along_free", "about_held", "deflection", "deflection_angle")
    R = cartstiff.analyse(elastic, q[0], wrench=wrench).pose[:3, :3]
    found = []
    for turn, world in ((np.eye(3), True), (R.T, False)):
        W = np.concatenate([turn @ DEFLECT[:3], turn @ DEFLECT[3:]])
        settings = Settings("B", LENGTH, tuple(turn @ DIRECTION), tuple(W), world)
        chosen = choose_quantities(names, settings, elastic)
        outputs = tuple({o for quantity in chosen for o in quantity.outputs(settings)} | {"pose"})
        arrays = analyse_many(elastic, q[:1], wrench=wrench, outputs=outputs).arrays
        found.append(evaluate(chosen, arrays, settings))
    for key in names:
        assert found[0][key] == pytest.approx(found[1][key], rel=1e-9), key


#: Paths in the analysis of one posture, and the factor that a map's number has of it.
IN_THE_ANALYSIS = {
    "translation_free_min": "ellipsoids.stiffness.translation.free.eigenvalues.0",
    "translation_held_max": "ellipsoids.stiffness.translation.held.eigenvalues.2",
    "rotation_free_min": "ellipsoids.stiffness.rotation.free.eigenvalues.0",
    "compliance_translation_free_max": "ellipsoids.compliance.translation.free.eigenvalues.2",
    "condition": "indices.condition_number",
    "minimum": "indices.minimum_stiffness",
}
#: Of a number that goes through an inverse, for each unit of the condition number.
PER_CONDITION = 1e-13


@pytest.mark.parametrize("axes", ["body", "world"])
@pytest.mark.parametrize("kind", ["dead", "follower", "conservative"])
@pytest.mark.parametrize("name", MACHINES)
@pytest.mark.parametrize("way", ["portable", "engine"])
def test_under_each_kind_of_load_a_map_says_what_the_analysis_says(name, kind, axes, way):
    elastic, q, wrench = MACHINES[name]
    rng = np.random.default_rng(abs(hash_of(name + kind + axes)))
    at, W = rng.uniform(-0.3, 0.3, 3), None
    if wrench is not None:
        W = rng.normal(size=6) * np.repeat([1.0, 20.0], 3)
    load = {"wrench": W, "load_kind": kind, "load_at": at}
    load |= {} if W is None else {"load_axes": axes}
    settings = Settings(
        "load",
        LENGTH,
        DIRECTION,
        None if W is not None else DEFLECT,
        False,
        LoadKind(kind, at),
        is_loaded=W is not None,
    )
    names = [n for n in FROM_MATRICES if n not in ("manipulability", "singular_value_ratio")]
    chosen = choose_quantities(names, settings, elastic)
    outputs = tuple({o for quantity in chosen for o in quantity.outputs(settings)} | {"pose"})
    arrays = analyse_many(elastic, q, **load, outputs=outputs, path=way).arrays
    found = evaluate(chosen, arrays, settings)
    for i in range(len(q)):
        result = cartstiff.analyse(elastic, q[i], **load)
        direct = analyse_posture(
            result, length=LENGTH, direction=DIRECTION, wrench=None if W is not None else DEFLECT
        )
        assert direct["connection"] == "load"
        expected = {key: _at(direct, path) for key, path in IN_THE_ANALYSIS.items()}
        given = next(d for d in direct["directions"] if d["name"] == "given")
        for others in ("free", "held"):
            expected[f"along_{others}"] = given["along"][others]
            expected[f"about_{others}"] = given["about"][others]
        twist = direct["deflection"]["twist"]
        expected |= {
            "deflection": np.linalg.norm(twist[3:]),
            "deflection_angle": np.linalg.norm(twist[:3]),
        }
        # An independent way to the same: the tangent and its inverse by plain linear algebra.
        K = result.tangent
        C = np.linalg.inv(K)
        moved = C @ (result.wrench if W is not None else np.array(DEFLECT))
        assert found["deflection"][i] == pytest.approx(np.linalg.norm(moved[3:]), rel=1e-9)
        tolerance = max(1e-9, PER_CONDITION * abs(found["condition"][i]))
        for key, value in expected.items():
            assert found[key][i] == pytest.approx(value, rel=tolerance, nan_ok=True), key


def hash_of(text):
    """A number for a text, the same in every process."""
    return sum(ord(c) * 31**i for i, c in enumerate(text)) % 2**32


def _at(tree, path):
    for key in path.split("."):
        tree = tree[int(key)] if isinstance(tree, list) else tree[key]
    return np.nan if tree is None else tree


def test_what_does_not_exist_is_nan():
    elastic, q, wrench = MACHINES["seven joints"]
    settings = Settings("F", LENGTH, DIRECTION, DEFLECT)
    names = ["translation_free_min", "along_free", "condition", "isotropy", "determinant"]
    chosen = choose_quantities(names, settings, elastic)
    outputs = tuple({o for quantity in chosen for o in quantity.outputs(settings)})
    arrays = analyse_many(elastic, q, wrench=wrench, outputs=outputs).arrays
    for name, values in evaluate(chosen, arrays, settings).items():
        assert np.isnan(values).all(), name


def _evaluate(names, K, C=None, **settings):
    """Quantities of given matrices."""
    count = len(K)
    with np.errstate(all="ignore"):
        C = np.linalg.inv(K) if C is None else C
    arrays = {"pose": np.tile(np.eye(4), (count, 1, 1))}
    for c in "ABKF":
        arrays |= {f"stiffness_{c}": K, f"compliance_{c}": C}
    s = Settings(**settings)
    return evaluate([QUANTITIES[name] for name in names], arrays, s)


def test_indefinite_matrices_keep_their_signs():
    rng = np.random.default_rng(2)
    U = np.linalg.qr(rng.normal(size=(6, 6)))[0]
    K = U @ np.diag([-4.0, -1.0, 2.0, 3.0, 5.0, 9.0]) @ U.T
    found = _evaluate(["unstable_directions", "minimum", "isotropy", "condition"], K[None])
    assert found["unstable_directions"] == [2]
    assert found["minimum"] == pytest.approx([-4.0])
    assert np.isnan(found["isotropy"]).all()
    assert found["condition"] == pytest.approx([9.0])


def test_a_motion_that_costs_nothing_has_no_stiffness():
    """A free translation beside a stiffness that has no inverse: zero, as in the analysis."""
    K = np.diag([1.0, 2.0, 3.0, 0.0, 5.0, 6.0])
    C = np.full((1, 6, 6), np.nan)
    names = [
        "translation_free_min",
        "translation_free_max",
        "translation_held_min",
        "condition",
        "isotropy",
        "along_free",
        "rotation_free_min",
    ]
    found = _evaluate(names, K[None], C, direction=(0.0, 1.0, 0.0))
    shown = summarise(PostureMatrices({"B": K}, np.zeros(6)))["ellipsoids"]["stiffness"]
    assert shown["translation"]["free"]["eigenvalues"] == pytest.approx([0.0, 5.0, 6.0], abs=0)
    assert found["translation_free_min"] == [0.0]
    assert found["translation_free_max"] == pytest.approx([6.0])
    assert found["translation_held_min"] == pytest.approx([0.0], abs=1e-12)
    assert np.isinf(found["condition"]).all()
    assert found["isotropy"] == [0.0]
    assert found["along_free"] == pytest.approx([5.0])
    assert found["rotation_free_min"] == pytest.approx([1.0])


def test_a_soft_motion_beside_stiff_ones_is_not_known():
    """Held along it, K leaves no digit: neither one posture nor a map prints the rounding."""
    U = np.linalg.qr(np.random.default_rng(4).normal(size=(3, 3)))[0]
    K, C = np.eye(6), np.eye(6)
    values = np.array([3e17, 5e3, 0.7])
    K[3:, 3:], C[3:, 3:] = (U * values) @ U.T, (U / values) @ U.T
    soft = np.concatenate([np.zeros(3), U[:, 2]])
    assert abs(soft @ K @ soft - 0.7) > 1.0
    assert np.isnan(stiffnesses_of_motions(soft[None], K[None], np.array([False]))).all()
    found = _evaluate(["along_held", "minimum"], K[None], C[None], direction=tuple(U[:, 2]))
    assert np.isnan(found["along_held"]).all()
    assert found["minimum"] == pytest.approx([0.7])


def test_only_a_compliance():
    """Where no stiffness exists, a direction that does not give has no stiffness either."""
    nothing = np.full((1, 6, 6), np.nan)
    C = np.diag([0.1, 0.0, 0.0, 0.0, 0.2, 0.5])[None]
    for direction, expected in (((0, 0, 1), 2.0), ((0, 1, 0), 5.0), ((1, 0, 0), np.nan)):
        found = _evaluate(["along_free", "translation_free_min"], nothing, C, direction=direction)
        assert found["along_free"] == pytest.approx([expected], nan_ok=True)
        assert np.isnan(found["translation_free_min"]).all()
    held = _evaluate(["compliance_translation_held_max"], nothing, C)
    assert held["compliance_translation_held_max"] == pytest.approx([0.5])


def test_nan_rows_leave_the_others_alone():
    K = np.stack([np.diag([1.0, 2, 3, 4, 5, 6]), np.full((6, 6), np.nan), 2 * np.eye(6)])
    found = _evaluate(["condition", "translation_held_max", "determinant"], K)
    for name, expected in (
        ("condition", [6, np.nan, 1]),
        ("translation_held_max", [6, np.nan, 2]),
        ("determinant", [720, np.nan, 64]),
    ):
        assert found[name] == pytest.approx(expected, nan_ok=True)
    assert with_angles_times(K[:1], np.array([0.5]))[0, 0, 0] == pytest.approx(0.25)


def test_refusals():
    elastic = MACHINES["six joints"][0]
    with pytest.raises(UnknownNameError, match="unknown quantity"):
        choose_quantities(["stiff"], Settings(), elastic)
    with pytest.raises(UnknownNameError, match="unknown quantity"):
        choose_quantities(["indices.best_length"], Settings(), elastic)
    refuses("needs a direction", choose_quantities, ["along_free"], Settings(), elastic)
    refuses("needs a wrench", choose_quantities, ["deflection"], Settings(), elastic)
    refuses("twice", choose_quantities, ["condition", "condition"], Settings(), elastic)
    with pytest.raises(UnknownNameError, match="connection"):
        choose_quantities(["condition"], Settings("C"), elastic)
    with pytest.raises(InputError, match="no quantity"):
        choose_quantities([], Settings(), elastic)
    for name in ("five-bar", "cable-robot"):
        refuses("closures", choose_quantities, ["manipulability"], Settings(), cartstiff.load(name))


def test_every_state_has_a_number():
    """The codes in the source of the reduction are among the names that maps know."""
    import ast
    from pathlib import Path

    files = [Path(module.__file__) for module in (reduction, motions)]
    trees = [ast.parse(file.read_text(encoding="utf-8")) for file in files]
    calls = [n for tree in trees for n in ast.walk(tree) if isinstance(n, ast.Call)]
    codes = {
        n.args[0].value
        for n in calls
        if getattr(n.func, "id", "") == "Note" and isinstance(n.args[0], ast.Constant)
    }
    assert len(codes) >= 6
    assert codes | {"fewer-than-six-freedoms", "serial-singularity"} <= set(STATES)
    assert len(STATES) < 255


def test_manipulability_depends_on_no_length_that_is_chosen():
    found = {}
    for length in (0.1, 1.0, 7.0):
        settings = Settings(length=length)
        for name, (elastic, *_) in MACHINES.items():
            (quantity,) = choose_quantities(["manipulability"], settings, elastic)
            arrays = {"jacobian": cartstiff.analyse(elastic).jacobian[None]}
            (value,) = evaluate((quantity,), arrays, settings)["manipulability"]
            found.setdefault(name, set()).add((float(value), quantity.unit))
    assert all(len(values) == 1 for values in found.values())


@pytest.mark.parametrize("name", ["stewart-simscape", "6-pus"])
def test_what_is_read_of_bodies_with_mass_needs_no_frequencies(name, tmp_path):
    """The compliance alone is in the arrays, without the wrench."""
    elastic = cartstiff.load(name)
    q = elastic.q[None]
    found = cartstiff.maps.compute_map(
        elastic, cartstiff.maps.Trajectory(q), ["condition"], tmp_path / "m.zarr"
    )
    length = found.attrs["characteristic_length"]
    expected = indices_of(cartstiff.analyse(elastic, q[0]).matrices["B"], length).condition_number
    assert float(found["condition"][0]) == pytest.approx(expected, rel=1e-9)


def _own(formula, name="condition"):
    return Quantity(name, "of one's own", "1", formula, ("free",), better="smaller")


def _softest(source):
    soft, _, stiff = source.principal("stiffness", "translation", "free")
    return np.where(stiff > 2.0 * soft, soft, 1.0)  # cannot be recorded


def test_ones_own_quantities_are_the_same_by_every_way(monkeypatch, tmp_path):
    """Machine code kept the formula of a name that a user had given another meaning."""
    elastic = cartstiff.load("ur5")
    grid = cartstiff.maps.Grid({"elbow_joint": (0.5, 1.5, 5)}, elastic.names, elastic.q)
    asked = elastic, grid, ["condition"]
    monkeypatch.setitem(QUANTITIES, "condition", _own(_softest))
    job, file = prepare_map(*asked, tmp_path / "m.zarr", chunk=2)
    ways = job, replace(job, path="compiled")
    found, compiled = (way.compute((slice(0, 5),))["condition"] for way in ways)
    np.testing.assert_allclose(compiled, found, rtol=1e-9)
    data = packed(job)
    monkeypatch.setitem(QUANTITIES, "condition", BUILT_IN["condition"])
    for part in range(3):  # on a worker, which does not know it
        part_elsewhere(data, (), str(file.address), file.attributes[CHECKSUM], part)
    np.testing.assert_array_equal(open_map(file.address)["condition"], found)
    with pytest.raises(InputError, match="own quantities differs"):
        prepare_map(*asked, file.address, chunk=2)
    monkeypatch.setitem(QUANTITIES, "condition", _own(lambda source: 2.0 * _softest(source)))
    with pytest.raises(InputError, match="own quantities differs"):
        prepare_map(*asked, file.address, chunk=2)


def test_a_quantity_is_one_number_for_each_posture(monkeypatch):
    elastic = cartstiff.load("ur5")
    grid = cartstiff.maps.Grid({"elbow_joint": (0.5, 1.5, 5)}, elastic.names, elastic.q)
    monkeypatch.setitem(QUANTITIES, "all", _own(lambda s: s.spectrum(), "all"))
    with pytest.raises(InputError, match=r"all is not one number .*\(N,\), got \(6, 5\)"):
        cartstiff.maps.map_of(elastic, grid, ["all"]).compute()


@pytest.mark.parametrize("size", [1e-200, 1.0, 1e200])
def test_a_direction_may_be_of_any_length(size):
    elastic = cartstiff.load("ur5")
    grid = cartstiff.maps.Grid({"elbow_joint": (0.5, 1.0, 2)}, elastic.names, elastic.q)
    found = cartstiff.maps.map_of(
        elastic, grid, ["along_free"], direction=[size, 0, size]
    ).compute()
    C = np.linalg.inv(cartstiff.analyse(elastic, [*elastic.q[:2], 0.5, *elastic.q[3:]]).tangent)
    u = np.array([1, 0, 1]) / np.sqrt(2)
    assert float(found["along_free"][0]) == pytest.approx(1 / (u @ C[3:, 3:] @ u), rel=1e-9)


def test_a_wrench_beyond_all_bounds_is_refused():
    elastic = cartstiff.load("ur5")
    grid = cartstiff.maps.Grid({"elbow_joint": (0.5, 1.0, 2)}, elastic.names, elastic.q)
    with pytest.raises(InputError, match="wrench of the deflection is too large"):
        cartstiff.maps.map_of(elastic, grid, ["deflection"], deflect=[0, 0, 0, 0, 0, 1e308])
