"""Arms that have lost rank, in stacks: the engine's states and numbers, and without the engine."""

from __future__ import annotations

import json
from itertools import pairwise

import numpy as np
import pytest
from tests.doors import Array
from tests.laws.test_many_engine import OUTPUTS, arm, assert_same
from tests.mechanisms.machines import joint, write_urdf
from tests.support.read import asked, of_many

import cartstiff
from cartstiff import ElasticMechanism, analyse_many, analyse_posture

WRENCH = np.array([1.0, 2.0, -3.0, 40.0, 50.0, -6.0])
_FREEDOMS = {"rotation": slice(0, 3), "translation": slice(3, 6)}
COUNT = 107  # as many as are worth recording, and seven


def singular(n: int, zeros: tuple[int, ...] = (4,), seed: int = 0) -> Array:
    """Some joints at zero, in all postures but the last seven."""
    q = np.random.default_rng(seed).uniform(-2.0, 2.0, (COUNT, n))
    q[:-7, zeros] = 0.0
    return q


def check(elastic: ElasticMechanism, q: Array, by_engine: int, **load: object) -> dict[str, int]:
    (found,) = assert_same(elastic, q, "portable", outputs=OUTPUTS, **load)
    assert found.fallback == by_engine
    return found.counts()


@pytest.mark.parametrize(
    "load",
    [
        {},
        {"wrench": np.outer(np.linspace(-1.0, 1.0, COUNT), WRENCH)},
        {"wrench": WRENCH, "load_axes": "world", "load_kind": "conservative", "load_at": (0, 0, 1)},
    ],
    ids=["none", "each", "world"],
)
def test_wrist_stretched(load):
    elastic = cartstiff.load("ur5").with_gravity([0.0, 0.0, -9.81])
    assert check(elastic, singular(6), 0, **load) == {"regular": 7, "serial-singularity": 100}


def test_two_ranks_at_once():
    found = check(cartstiff.load("ur5"), singular(6, (2, 4)), 0, wrench=WRENCH)
    assert found == {"regular": 7, "serial-singularity": 100}


def test_springs_that_turn_the_self_motion():
    """Where no wrench is asked for, what the springs exert is not carried."""
    elastic = cartstiff.load("ur5").with_springs(rest=[0.1] * 6)
    q = singular(6)
    found = analyse_many(elastic, q, outputs=("stiffness_B", "wrench"), path="portable")
    assert found.counts() == {"regular": 7, "unbalanced": 100}
    assert found.fallback == 0
    assert_same(elastic, q, "portable", outputs=OUTPUTS)


def test_nearer_and_nearer():
    """Across the limit of rank; what is near it is the engine's."""
    q = singular(6)
    q[:-7, 4] = np.logspace(-14, -6, 100)
    elastic = cartstiff.load("ur5")
    assert_same(elastic, q, "portable", outputs=("pose", "compliance_A"), wrench=WRENCH)


def test_loads_that_buckle():
    """A self-motion that would snap away is the engine's."""
    elastic = cartstiff.load("ur5").with_springs([1e-3, 1e3, 1.0, 1.0, 1.0, 1.0])
    q = singular(6)
    outputs = ("stiffness_B", "compliance_B")
    (found,) = assert_same(elastic, q, "portable", outputs=outputs, wrench=WRENCH)
    assert found.counts()["buckled"] > 0


def test_more_and_fewer_than_six_joints():
    panda = cartstiff.load("panda")
    assert check(panda, singular(7, tuple(range(1, 7))), 0) == {
        "regular": 7,
        "serial-singularity": 100,
    }
    elastic = arm("RRPRR")
    q = np.zeros((COUNT, 5))
    q[:, 0] = np.linspace(-1.0, 1.0, COUNT)
    assert check(elastic, q, 0, wrench=WRENCH) == {"fewer-than-six-freedoms": COUNT}


def test_machine_code_and_few_postures():
    elastic = cartstiff.load("ur5")
    q = singular(6)
    few = analyse_many(elastic, q[:20], outputs=("compliance_B",), path="compiled")
    many = analyse_many(elastic, q, outputs=("compliance_B",), path="compiled")
    assert (few.fallback, many.fallback) == (20, 0)
    scale = np.abs(few["compliance_B"]).max()
    np.testing.assert_allclose(
        many["compliance_B"][:20], few["compliance_B"], rtol=0, atol=1e-13 * scale
    )


def test_an_arm_that_is_singular_in_every_posture_is_decided_without_an_inverse(tmp_path):
    """Seven joints with parallel axes: rows of J are zero before any posture is known."""
    links = ["base", *(f"l{i}" for i in range(7))]
    joints = [
        joint(f"j{i}", a, b, at=(0.1 + 0.02 * i, 0.01 * i, 0.03))
        for i, (a, b) in enumerate(pairwise(links))
    ]
    planar = cartstiff.load(write_urdf(tmp_path, *joints), frame="l6").with_springs(1e3)
    q = np.random.default_rng(3).uniform(-1, 1, (COUNT, 7))
    (found,) = assert_same(planar, q, "portable", outputs=OUTPUTS)
    assert not found.is_regular.any()


def test_quantities_of_maps_where_there_is_no_stiffness():
    """What `analyse` calls null is undefined; compliances are those of ``J k^-1 J^T`` by NumPy."""
    elastic = cartstiff.load("ur5")
    settings = asked("load", 0.3, (0.0, 0.0, 1.0), (0.0, 0.0, 0.0, 3.0, 0.0, 4.0))
    of_stiffness = [
        "condition",
        "minimum",
        "isotropy",
        "determinant",
        "unstable_directions",
        "natural_length",
        "translation_condition",
        "rotation_condition",
        "along_held",
        "about_held",
        *(f"{f}_{o}_{e}" for f in _FREEDOMS for o in ("held", "free") for e in ("min", "max")),
    ]
    of_compliance = [
        f"compliance_{f}_{o}_{e}"
        for f in _FREEDOMS
        for o in ("free", "held")
        for e in ("min", "max")
    ]
    names = [*of_stiffness, *of_compliance, "along_free", "deflection"]
    q = singular(6)[:-7]
    values, found = of_many(elastic, q, names, settings)
    assert found.counts() == {"serial-singularity": len(q)}
    assert found.fallback == 0
    answer = analyse_posture(cartstiff.analyse(elastic, q[0]), length=0.3)
    assert answer["indices"] is answer["stiffness"] is None
    for name in of_stiffness:
        assert np.isnan(values[name]).all(), name
    for i in (0, 50, 99):
        J = cartstiff.analyse(elastic, q[i]).jacobian
        C = (J / elastic.springs.stiffness) @ J.T
        assert values["along_free"][i] == pytest.approx(1.0 / C[5, 5], rel=1e-12)
        moved = np.linalg.norm((C @ settings.deflect)[3:])
        assert values["deflection"][i] == pytest.approx(moved, rel=1e-12)
        for freedom, own in _FREEDOMS.items():
            other = np.delete(np.arange(6), own)
            left = (
                C[own, own]
                - C[own][:, other] @ np.linalg.inv(C[np.ix_(other, other)]) @ (C[other][:, own])
            )
            for others, block in (("free", C[own, own]), ("held", left)):
                low, _, high = np.linalg.eigvalsh(block)
                size = 1e-12 * np.abs(C[own, own]).max()
                for end, value in (("min", low), ("max", high)):
                    got = values[f"compliance_{freedom}_{others}_{end}"][i]
                    assert got == pytest.approx(value, rel=1e-9, abs=size)


@pytest.mark.parametrize("tilt", [0.0, 1e-17, 1e-14, 1e-12, 1e-11])
def test_a_body_that_translates_does_not_turn(tmp_path, tilt):
    """Parallelograms by mimic joints: C is that of two motions, J = diag; nothing else is printed.

    With the body's rotation held it moves as with it free; axes parallel to ten digits are.
    """
    path = tmp_path / "parallelograms.urdf"
    limit = '<limit lower="-3" upper="3" effort="1" velocity="1"/>'
    path.write_text(f"""<robot name="par"><link name="base"/><link name="a"/><link name="b"/>
    <link name="c"/><link name="tool0"/>
    <joint name="j1" type="revolute"><parent link="base"/><child link="a"/><axis xyz="0 1 0"/>
      {limit}</joint>
    <joint name="l1" type="continuous"><parent link="a"/><child link="b"/>
      <origin xyz="0 0 1.0"/><axis xyz="{tilt} 1 0"/><mimic joint="j1" multiplier="-1"/></joint>
    <joint name="j2" type="revolute"><parent link="b"/><child link="c"/><axis xyz="0 1 0"/>
      {limit}</joint>
    <joint name="l2" type="continuous"><parent link="c"/><child link="tool0"/>
      <origin xyz="0.8 0 0"/><axis xyz="0 1 {tilt}"/><mimic joint="j2" multiplier="-1"/></joint>
    </robot>""")
    elastic = cartstiff.load(path, stiffness=1e4)
    answer = analyse_posture(cartstiff.analyse(elastic, [0.0, 0.0]))
    principal = answer["ellipsoids"]["compliance"]
    moving = [0.0, 0.8**2 / 1e4, 1.0 / 1e4]
    for others in ("held", "free"):
        found = principal["translation"][others]["eigenvalues"]
        assert found == pytest.approx(moving, rel=1e-12)
        assert principal["rotation"][others]["eigenvalues"] == [0.0, 0.0, 0.0]
    along = [d["along"]["free"] for d in answer["directions"]]
    assert along == [pytest.approx(1e4), None, pytest.approx(1e4 / 0.8**2)]
    assert [d["about"]["free"] for d in answer["directions"]] == [None] * 3
    names = ("compliance_translation_held_max", "compliance_rotation_free_max")
    values, _ = of_many(elastic, np.zeros((3, 2)), names, asked("load"))
    assert values[names[0]] == pytest.approx([1e-4] * 3, rel=1e-12)
    assert np.array_equal(values[names[1]], [0.0] * 3)


def test_lines_that_all_meet_an_axis_leave_it_free(tmp_path):
    """The turn about the axis is round-off of levers that cancel: no stiffness, no compliance."""
    around = 2 * np.pi * np.arange(12) / 6
    circle = np.stack([np.cos(around), np.sin(around), 0.3 * (np.arange(12) > 5)], axis=1)
    points = {"base": circle.tolist(), "platform": (circle * [0.2, 0.2, 1.0]).tolist()}
    file = {"kind": "springs", **points, "legs": {"stiffness": 1e5}, "pose": {"xyz": [0, 0, 0.15]}}
    path = tmp_path / "spokes.yaml"
    path.write_text(json.dumps(file))
    spokes = cartstiff.load(path)
    found = cartstiff.analyse(spokes)
    assert found.K[2].tolist() == [0.0] * 6
    assert found.compliances["B"] is None
    assert "type-2-singularity" in repr(analyse_many(spokes, spokes.q[None]))
