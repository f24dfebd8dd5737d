"""Links that give under a load, in stacks: bent as the engine bends them, then its postures."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from tests.doors import Array, LoadKind
from tests.laws.test_many_closed_chains import starts, weighed
from tests.laws.test_many_engine import OUTPUTS, assert_same
from tests.support import absolute_error
from tests.support.read import asked, of_many
from tests.support.read import read as recorded

import cartstiff
from cartstiff import ElasticMechanism, analyse_many
from cartstiff.maps import RandomPostures

WRENCH = np.array([1.0, -2.0, 3.0, 20.0, 30.0, -40.0])
EACH = np.random.default_rng(3).normal(size=(4, 6)) * [1, 1, 1, 20, 20, 20]
#: An arm of beams, one of which is exchanged.
ARM = Path(__file__).resolve().parents[2] / "examples" / "flexible_arm.yaml"
SHEAR = (
    "{beam: {E: 7.0e10, G: 2.6e10, length: 0.425, area: 2.0e-3, Iy: 2.0e-6, Iz: 1.0e-6, "
    "J: 3.0e-6, shear_area_y: 1.0e-3, shear_area_z: 1.2e-3}}"
)
MATRIX = np.diag([5.0e5, 4.0e5, 4.0e5, 3.0e8, 2.0e7, 2.0e7])
MATRIX[1, 5] = MATRIX[5, 1] = 3.0e5


@pytest.fixture(scope="module")
def arms(tmp_path_factory) -> dict[str, ElasticMechanism]:
    """A UR5 whose upper arm is a beam and whose forearm is one too, or a 6x6 spring."""
    folder, found = tmp_path_factory.mktemp("arms"), {}
    for name, link in (("beams", SHEAR), ("matrix", f"{{stiffness: {MATRIX.tolist()}}}")):
        path = folder / f"{name}.yaml"
        path.write_text(re.sub(r"forearm_link: .*", f"forearm_link: {link}", ARM.read_text()))
        found[name] = cartstiff.load(path)
    return found


def postures(elastic: ElasticMechanism, count: int = 4) -> Array:
    """Home, with the joints elsewhere and links that are not bent."""
    if elastic.mechanism.closures:
        return starts(elastic, 0.03, count)
    q = np.tile(elastic.q, (count, 1))
    moved = [j for j in range(q.shape[1]) if j not in elastic.mechanism.virtual]
    q[:, moved] += np.random.default_rng(2).uniform(-0.4, 0.4, (count, len(moved)))
    return q


WORLD = {"wrench": WRENCH, "load_axes": "world", "load_at": (0.01, 0.0, 0.02)}
CASES = {
    "forearms": ("delta", False, {"wrench": WRENCH}),
    "forearms with weight, a load each": ("delta", True, {"wrench": 0.5 * EACH}),
    "forearms under a load in F": ("delta", True, WORLD),
    "bars in a plane": ("3-rrr", False, {"wrench": WRENCH}),
    "arm of beams": ("beams", False, {"wrench": EACH, "load_kind": "follower"}),
    "arm of beams with weight": ("beams", True, WORLD),
    "arm with a matrix": ("matrix", True, {"wrench": WRENCH, "load_at": (0.0, 0.1, 0.0)}),
    "arm with a matrix, loads in F": ("matrix", False, {"wrench": EACH, "load_axes": "world"}),
}


def test_what_takes_many_steps_to_rest_is_the_engines():
    """Its steps are others on the way: under loads that bend links far they may end elsewhere."""
    elastic = weighed(cartstiff.load("delta"))
    q = postures(elastic, 10)
    loads = 4.0 * np.random.default_rng(3).normal(size=(10, 6)) * [1, 1, 1, 10, 10, 10]
    found, engine = (
        analyse_many(elastic, q, path=path, wrench=loads) for path in ("portable", "engine")
    )
    assert {"regular", "not-assembled"} <= {engine.codes[s] for s in engine.state}
    assert [found.codes[s] for s in found.state] == [engine.codes[s] for s in engine.state]
    # Where the recorded steps close no posture, no links are left to bend.
    far = elastic.q + np.random.default_rng(0).uniform(-0.2, 0.2, (2, len(elastic.q)))
    far[:, sorted({*elastic.mechanism.held} - {*elastic.mechanism.virtual})] += [3.0, -3.0, 3.0]
    found, engine = (
        analyse_many(elastic, far, path=path, wrench=loads[:2]) for path in ("portable", "engine")
    )
    assert [found.codes[s] for s in found.state] == [engine.codes[s] for s in engine.state]


@pytest.mark.parametrize("case", CASES)
def test_links_are_bent_as_by_the_engine(case, arms):
    name, has_weight, load = CASES[case]
    elastic = arms[name] if name in arms else cartstiff.load(name)
    if has_weight:
        elastic = weighed(elastic).with_payload(2.0, (0.0, 0.02, 0.05))
    q = postures(elastic)
    (found,) = assert_same(elastic, q, "portable", outputs=OUTPUTS, **load)
    engine = analyse_many(elastic, q, path="engine", **load)
    assert found.fallback == 0
    assert absolute_error(found.q, engine.q) <= 1e-13
    assert np.abs(found.q - q)[:, sorted(elastic.mechanism.virtual)].max() > 1e-6


def test_machine_code(arms):
    elastic = arms["beams"]
    q = postures(elastic, 11)
    assert_same(elastic, q, "compiled", outputs=("B", "compliance_A"), **WORLD)
    one, two = (analyse_many(elastic, q, path="compiled", threads=t, wrench=WRENCH) for t in (1, 2))
    np.testing.assert_array_equal(one["B"], two["B"])
    assert one.fallback == 0


def test_loads_beyond_what_the_series_reach(arms):
    """Links that turn by half a radian, and more than they carry: the engine's states."""
    elastic = arms["beams"]
    q = postures(elastic)
    loads = np.outer([1.0, 60.0, 400.0, 3000.0], WRENCH)
    engine = analyse_many(elastic, q, path="engine", wrench=loads)
    found = analyse_many(elastic, q, path="portable", wrench=loads)
    states = [[r.codes[s] for s in r.state] for r in (engine, found)]
    assert states[0] == states[1]
    known = engine.is_regular
    assert known.sum() > 1
    size = np.abs(engine["B"][known]).max()
    assert absolute_error(found["B"][known], engine["B"][known]) <= 1e-9 * size


@pytest.mark.parametrize("axes", ["body", "world"])
def test_a_map_reads_them(arms, axes):
    """Quantities are read from bent links by machine code as from matrices."""
    elastic, count = arms["matrix"], 40
    q = RandomPostures.within_limits(elastic, count, 3).postures((slice(0, count),), elastic)
    names = ("translation_free_min", "deflection", "energy")
    load = LoadKind("dead", (0.0, 0.1, 0.0))
    settings = asked("B", 0.5, load=load, deflect=tuple(WRENCH), is_loaded=True)
    expected, _ = of_many(elastic, q, names, settings, WRENCH, axes=axes)
    found = recorded(elastic, names, q, settings, WRENCH, axes, "compiled")
    assert found.is_known.all()
    for name in names:
        np.testing.assert_allclose(found.values[name], expected[name], rtol=1e-9, err_msg=name)


@pytest.mark.parametrize("axes", ["body", "world"])
def test_what_is_read_is_read_of_bent_links(arms, axes):
    """Limits of a map look at these coordinates."""
    elastic = arms["matrix"]
    q = postures(elastic)
    read = recorded(elastic, ("energy", "determinant"), q, None, WRENCH, axes)
    assert read.is_known.all()
    bent = analyse_many(elastic, q, wrench=WRENCH, load_axes=axes, path="engine").q
    assert absolute_error(read.q, bent) <= 1e-13


def test_what_rounding_leaves_along_a_soft_self_motion_is_balance():
    """Five of these were called unbalanced, for torques of 2e-12 beside forces of 1000 N."""
    elastic = cartstiff.load("3-rrr")
    rng, sizes = np.random.default_rng(0), elastic.mechanism.at(elastic.q).coordinate_lengths
    q = elastic.q + rng.uniform(-0.3, 0.3, (200, elastic.q.size)) * sizes
    q[:, sorted(elastic.mechanism.virtual)] = 0.0
    for at in q[[17, 36, 40, 42, 55]]:
        result = cartstiff.analyse(elastic, at, wrench=30.0 * WRENCH)
        assert not result.reduction.states
        assert result.matrices["B"] is not None


def test_a_joint_without_a_spring_that_nothing_holds(arms):
    """The elbow falls under the load: whatever the engine says of that."""
    elastic = arms["matrix"].with_springs({"elbow_joint": 0.0})
    q = postures(elastic)
    found, engine = (
        analyse_many(elastic, q, path=path, wrench=WRENCH) for path in ("auto", "engine")
    )
    assert found.fallback == len(q)
    assert found.counts() == engine.counts()
    assert not engine.is_regular.any()


def test_random_postures_leave_links_unbent(arms):
    elastic = arms["beams"]
    name = "upper_arm_link.px"
    drawn = RandomPostures.within_limits(elastic, 5, ranges={name: (1e-5, 2e-5)})
    q, j = drawn.postures((slice(0, 5),)), elastic.names.index(name)
    assert np.all(q[:, j] >= 1e-5)
    assert not q[:, sorted(elastic.mechanism.virtual - {j})].any()
    joints = [i for i in range(q.shape[1]) if i not in elastic.mechanism.virtual]
    assert np.ptp(q[:, joints], axis=0).min() > 0.1
