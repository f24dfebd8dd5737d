"""``cartstiff compare``: two mechanisms under one question, with ratios, and what has none."""

from __future__ import annotations

import itertools
import json
import re
from pathlib import Path

import numpy as np
import pytest
from tests.support.commands import answer, run
from tests.support.robots import example_robots

import cartstiff
from cartstiff import InputError
from cartstiff.extend import json_schema

jsonschema = pytest.importorskip("jsonschema")

_HEXAPOD = """kind: stewart-gough
units: {{length: {unit}, force: N}}
layout:
  base: {{radius: {r}, half_angle: 0.2}}
  platform: {{radius: {p}, half_angle: 0.3}}
  height: {h}
legs: {{stiffness: {k}, mass: 1.5}}
"""
_IN_M = _HEXAPOD.format(unit="m", r=0.3, p=0.2, h=0.4, k=1e6)
_IN_MM = _HEXAPOD.format(unit="mm", r=300, p=200, h=400, k=1e3)
_ARM = """kind: serial
model: arm.urdf
frame: tip
parameters: {k: 2000, far: 3000}
springs: {turn: {stiffness: =k}, lift: {stiffness: =far}}
"""
_URDF = """<robot name="arm"><link name="base"/><link name="upper"/><link name="tip"/>
<joint name="turn" type="revolute"><parent link="base"/><child link="upper"/><axis xyz="0 0 1"/>
  <limit lower="-3" upper="3" effort="9" velocity="1"/></joint>
<joint name="lift" type="revolute"><parent link="upper"/><child link="tip"/><axis xyz="0 1 0"/>
  <origin xyz="0.5 0 0"/><limit lower="-3" upper="3" effort="9" velocity="1"/></joint></robot>
"""


def by_quantity(found: dict) -> dict:
    return {n["quantity"]: n for n in found["numbers"]}


@pytest.fixture
def files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    texts = {"m.yaml": _IN_M, "mm.yaml": _IN_MM, "arm.yaml": _ARM, "arm.urdf": _URDF}
    for name, text in texts.items():
        Path(name).write_text(text)
    return tmp_path


def test_a_mechanism_beside_itself_has_ratios_of_one() -> None:
    found = answer("compare hexapod hexapod --load 5,0,0,0,30,-100 --world")
    assert [found["first"]["label"], found["second"]["label"]] == ["first", "second"]
    assert len(found["numbers"]) == 13
    assert all(n["ratio"] == pytest.approx(1.0, rel=1e-12) for n in found["numbers"])
    assert found["distance"] == 0.0
    assert found["softest_angle"] == pytest.approx(0.0, abs=1e-7)
    assert all(p["first"] == p["second"] for p in found["shares"]["parts"])


def test_numbers_of_an_arm_are_those_of_its_jacobian(files: Path) -> None:
    """C = J diag(1/k) J^T at q = 0: turn moves the tip 0 along x, lift nothing, as it is at M."""
    found = answer("compare arm.yaml --with k=500 --load 0,0,0,0,-2,0")
    moved = by_quantity(found)["displacement under the load"]
    # A force F along y at 0.5 m turns the first joint by 0.5 F / k; the load then adds nothing.
    assert moved["first"] == pytest.approx(0.5**2 * 2 / 2000, rel=1e-9)
    assert moved["second"] == pytest.approx(0.5**2 * 2 / 500, rel=1e-9)
    assert moved["ratio"] == pytest.approx(4.0, rel=1e-9)
    y = by_quantity(found)["stiffness along y of the room"]
    assert (y["first"], y["second"]) == pytest.approx((2000 / 0.25, 500 / 0.25), rel=1e-9)
    x = by_quantity(found)["stiffness along x of the room"]
    assert (x["first"], x["second"], x["ratio"], x["because"]) == (None, None, None, "both")
    assert [found[which]["label"] for which in ("first", "second")] == ["k=2000", "k=500"]
    text = run("compare arm.yaml --with k=500 --load 0,0,0,0,-2,0")
    assert "moves 4 times as far as k=2000 (to first order): 1 mm, not 250 µm" in text
    assert "stiffness along x of the room" in text.partition("Not compared")[2]


def test_what_is_set_holds_for_both_and_with_for_the_second_alone(files: Path) -> None:
    found = answer("compare arm.yaml --set far=1000 --with k=500")
    labels = [found[which]["label"] for which in ("first", "second")]
    assert labels == ["k=2000", "k=500"]
    notes = {
        n["message"].split(":")[0]: n["values"]
        for n in found["notes"]
        if n["code"] == "parameters-set"
    }
    assert notes == {"k=2000": {"far": 1000}, "k=500": {"far": 1000, "k": 500}}


def test_doubled_springs_halve_the_displacement() -> None:
    arm = cartstiff.load("inclined-hexapod")
    push = {"wrench": [0, 0, 0, 3.0, 0, -1.0]}
    stiff = cartstiff.analyse(arm.with_springs(2e6), **push)
    found = cartstiff.compare(cartstiff.analyse(arm.with_springs(1e6), **push), stiff)
    for n in found.numbers:
        if n.unit != "1":
            power = -1 if "load" in n.quantity else 1
            # The tangent differs from the springs' stiffness by the load, 1 N against 1e6 N/m.
            assert n.ratio == pytest.approx(2.0**power, rel=1e-5), n


def test_large_displacements_of_both_are_those_of_the_equilibria() -> None:
    """To first order one of them is 2 per cent off or more: both are by the equilibrium then."""
    arm = cartstiff.load("five-bar")
    push = {"wrench": [0, 0, 0, 0, -400.0, 0], "load_axes": "world"}
    stiff = arm.with_springs(3.0 * np.array(arm.stiffnesses))
    found = cartstiff.compare(*(cartstiff.analyse(m, **push) for m in (arm, stiff)))
    assert found.displacement_by == "equilibrium"
    moved = found.numbers[0]
    for mechanism, value in ((arm, moved.first), (stiff, moved.second)):
        expected = np.linalg.norm(cartstiff.equilibrium(mechanism, **push).displacement[3:])
        assert value == pytest.approx(expected, rel=1e-6)
    small = {"wrench": [0, 0, 0, 0, -1.0, 0], "load_axes": "world"}
    found = cartstiff.compare(*(cartstiff.analyse(m, **small) for m in (arm, stiff)))
    assert found.displacement_by == "first order"
    assert found.numbers[0].ratio == pytest.approx(1 / 3, rel=1e-2)


def test_another_unit_of_length_changes_no_ratio(files: Path) -> None:
    words = "--load 20,0,10,30,0,-100 --load-at 0,0,0.1 --tcp 0,0.05,0.2,0.1,0,0"
    words += " --payload 3,0,0,0.1 --gravity 0,0,-9.81 --pose 0.01,0,0.41,0,0.1,0"
    found = answer(f"compare m.yaml mm.yaml {words}")
    assert len(found["numbers"]) == 13
    for n in found["numbers"]:
        assert n["ratio"] == pytest.approx(1.0, rel=1e-8), n
    assert found["distance"] == pytest.approx(0.0, abs=1e-12)
    assert found["units"]["length"] == "m"
    (note,) = (n for n in found["notes"] if n["code"] == "converted-units")
    assert note["values"] == {"from": "mm", "to": "m"}
    swapped = answer("compare mm.yaml m.yaml --load 0,0,0,0,0,-100 --tcp 0,0,200")
    assert swapped["units"]["length"] == "mm"
    assert all(n["ratio"] == pytest.approx(1.0, rel=1e-8) for n in swapped["numbers"][:1])
    Path("kn.yaml").write_text(_IN_M.replace("force: N", "force: kN"))
    line = run("compare m.yaml kn.yaml", code=2)
    assert line == (
        "cartstiff: kn.yaml: forces have another unit than those of the first mechanism; "
        "expected N, got kN\n"
    )


def test_what_only_one_can_do_is_named() -> None:
    found = answer("compare five-bar hexapod --load 0,0,0,0,10,0 --world")
    numbers = by_quantity(found)
    assert found["first"]["freedoms"] == 2
    assert found["second"]["freedoms"] == 6
    assert numbers["stiffness about x of the room"]["because"] == "first"
    assert numbers["stiffest translation"]["first"] is None
    assert numbers["stiffest translation"]["second"] > 0
    assert numbers["displacement under the load"]["ratio"] > 0
    (note,) = (n for n in found["notes"] if n["code"] == "different-freedoms")
    assert note["values"] == {"first": 2, "second": 6}
    text = run("compare five-bar hexapod --load 0,0,0,0,10,0 --world")
    rows = text.partition("Not compared\n")[2].partition("\n\n")[0]
    assert "stiffness about x of the room" in rows
    assert "does not exist with five-bar" in rows


@pytest.mark.skipif(not example_robots(), reason="example-robot-data is not installed")
def test_loads_in_the_axes_of_two_tools_are_not_the_same() -> None:
    found = answer("compare ur5 panda --load 0,0,0,0,0,-100")
    (note,) = (n for n in found["notes"] if n["code"] == "different-loads")
    z = [np.array(found[which]["pose"])[:3, 2] for which in ("first", "second")]
    expected = np.arccos(np.clip(np.dot(*z), -1, 1))
    assert note["values"]["angle"] == pytest.approx(expected, abs=1e-7)
    assert "load of ur5: " in run("compare ur5 panda --load 0,0,0,0,0,-100")
    found = answer("compare ur5 panda --load 0,0,0,0,0,-100 --world")
    assert "different-loads" not in {n["code"] for n in found["notes"]}
    assert found["first"]["load"] == pytest.approx([0, 0, 0, 0, 0, -100], abs=1e-12)
    assert "\n  load: force (0, 0, -100) N" in run(
        "compare ur5 panda --load 0,0,0,0,0,-100 --world"
    )


def test_numbers_are_those_of_analyse() -> None:
    load = "--load 0,0,20,0,30,-100"
    found = by_quantity(answer(f"compare inclined-hexapod hexapod {load}"))
    for name, which in (("inclined-hexapod", "first"), ("hexapod", "second")):
        analysis = answer(f"analyse {name} {load}")["analysis"]
        moved = np.linalg.norm(analysis["deflection"]["displacement"])
        assert found["displacement under the load"][which] == pytest.approx(moved, rel=1e-12)
        for freedom in ("translation", "rotation"):
            free = analysis["ellipsoids"]["stiffness"][freedom]["free"]["eigenvalues"]
            ends = [found[f"{end} {freedom}"][which] for end in ("softest", "stiffest")]
            assert ends == pytest.approx([free[0], free[2]], rel=1e-9)
        least = analysis["indices"]["condition_at_best_length"]
        assert found["least condition number"][which] == pytest.approx(least, rel=1e-12)


_NAMES = ["stewart-gough", "delta", "five-bar", "cable-robot", "3-rrr", "6-pus", "grasp", "tricept"]


@pytest.mark.parametrize(("a", "b"), [*itertools.pairwise([*_NAMES, "flexure-hexapod"])])
def test_every_kind_beside_every_other_has_the_form(a: str, b: str, tmp_path: Path) -> None:
    """Text, JSON and picture of mechanisms that have little in common."""
    drawn, kept = tmp_path / "both.svg", tmp_path / "both.json"
    text = run(f"compare {a} {b} --load 0,0,0,0,0,-20 --world -o {drawn} -o {kept}")
    found = json.loads(kept.read_text())
    jsonschema.validate(found, json_schema("compare"))
    for n in found["numbers"]:
        if n["ratio"] is None:
            assert n["because"] is not None
            assert n["quantity"] in text.partition("Not compared")[2]
        else:
            assert n["ratio"] == n["second"] / n["first"]
            assert f"{n['ratio']:.4g}" in text
    picture = drawn.read_text()
    assert "<svg" in picture


def test_the_picture_shows_the_ratios() -> None:
    a, b = (cartstiff.load("inclined-hexapod", parameters={"sz": x}) for x in (0.5, 0.6))
    found = cartstiff.compare(cartstiff.analyse(a), cartstiff.analyse(b), labels=("low", "high"))
    figure = found.plot()
    texts = [t.get_text() for axis in figure.axes for t in axis.texts]
    drawn = [n for n in found.numbers if n.unit != "1"]
    assert texts == [f" × {n.ratio:.3g}" for n in drawn]
    widths = [bar.get_width() for axis in figure.axes for bar in axis.patches]
    stiffness = [n for n in drawn if n.unit == "N/m"]
    firsts = [1e-3 * n.first for n in stiffness]
    assert widths[: len(firsts)] == pytest.approx(firsts)
    assert [t.get_text() for t in figure.legends[0].get_texts()] == ["low", "high"]
    assert "illustrative" in figure.texts[0].get_text()
    assert re.search(r"x 1\.\d+", repr(found))


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("hexapod", "nothing to compare with; expected a second mechanism, or --with"),
        ("hexapod --with k=5", "the mechanism has no parameters"),
        ("inclined-hexapod --with k=5", "unknown parameter; expected one of a, sz"),
        ("hexapod ur6", "unknown mechanism"),
        ("hexapod cubic --actuate leg1=0.1", "--actuate: has no meaning for"),
        ("hexapod cubic --with", "requires an argument"),
        ("hexapod cubic -o both.html", "unknown file ending"),
        ("hexapod cubic --q 1,2", "--q: wrong count"),
    ],
)
def test_refusals(words: str, said: str) -> None:
    assert said in run(f"compare {words}", code=2)


def test_units_must_agree_in_python(files: Path) -> None:
    a, b = (cartstiff.analyse(cartstiff.load(name)) for name in ("m.yaml", "mm.yaml"))
    with pytest.raises(InputError, match="different units; expected m and N in both, got mm and N"):
        cartstiff.compare(a, b)
