"""Studies of designs: numbers posture by posture, optima by hand, failures, files that go on."""

import csv
import io
import itertools
import json
from dataclasses import replace

import jsonschema
import numpy as np
import pytest
from click.testing import CliRunner
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import minimize_scalar
from tests.inner import Design, Designs, Study, StudyEvaluator, postures, read_study
from tests.support import refused
from tests.support.commands import command, refuses

import cartstiff
from cartstiff import UndefinedError
from cartstiff.extend import evaluator, json_schema

HEXAGONS = """\
kind: stewart-gough
parameters: {half: 0.2, h: 0.5}
layout:
  base: {radius: 0.4, half_angle: =half}
  platform: {radius: 0.3, half_angle: =half}
  height: =h
legs: {stiffness: 1.0e6, limits: [[0.45, 0.6], [0.45, 0.6], [0.45, 0.6], [0.45, 0.6], [0.45, 0.6],
                                  [0.45, 0.6]]}
"""
WRENCH = [0.0, 2.0, 0.0, 30.0, 0.0, -50.0]
PUSH = [0.0, 0.0, 0.0, 10.0, 0.0, 0.0]
POSES = {"grid": {"x": [-0.1, 0.1, 3], "roll": [-0.1, 0.2, 2]}, "about_home": True}
STIFF = {"objectives": {"stiff": {"quantity": "translation_held_min"}}}


def study(**keys):
    """A study of the bundled hexapod."""
    return {"mechanism": "inclined-hexapod", "variables": {"sz": [0.2, 0.9]}, **STIFF, **keys}


def moved(elastic, x, roll=0.0):
    """The default pose, moved along and turned about x."""
    return elastic.q + np.array([x, 0, 0, roll, 0, 0])


def test_numbers_are_those_of_every_posture():
    asked = study(
        variables={"sz": {"values": [0.4, 0.7]}, "a": {"values": [0.2, 0.3]}},
        poses=POSES,
        cases={"idle": {}, "loaded": {"wrench": WRENCH, "deflect": PUSH}},
        objectives={
            "softest": {"quantity": "translation_held_min", "case": "idle"},
            "mean": {"quantity": "translation_held_min", "of": "mean", "case": "idle"},
            "middle": {"quantity": "rotation_held_max", "of": "median", "case": "idle"},
            "give": {"quantity": "deflection", "case": "loaded"},
            "least": {"quantity": "deflection", "of": "best", "case": "loaded"},
        },
        constraints={
            "share": {
                "quantity": "deflection",
                "of": "share",
                "below": 7.4e-6,
                "case": "loaded",
                "at_least": 0.6,
            },
            "size": {"value": "=2*a + sz", "at_most": 1.1},
        },
    )
    found = cartstiff.design(asked)
    assert len(found) == 4
    shares = set()
    for design in found.designs:
        elastic = cartstiff.load("inclined-hexapod", parameters=design.parameters)
        softest, stiffest, give = [], [], []
        for x in (-0.1, 0.0, 0.1):
            for roll in (-0.1, 0.2):
                q = moved(elastic, x, roll)
                K = cartstiff.analyse(elastic, q).matrices["B"]
                softest.append(np.linalg.eigvalsh(K[3:, 3:])[0])
                stiffest.append(np.linalg.eigvalsh(K[:3, :3])[2])
                loaded = cartstiff.analyse(elastic, q, wrench=WRENCH)
                give.append(np.linalg.norm(np.linalg.solve(loaded.tangent, PUSH)[3:]))
        expected = {
            "softest": min(softest),
            "mean": np.mean(softest),
            "middle": np.median(stiffest),
            "give": max(give),
            "least": min(give),
            "share": np.mean(np.array(give) <= 7.4e-6),
            "size": 2 * design.parameters["a"] + design.parameters["sz"],
        }
        assert design.values == pytest.approx(expected, rel=1e-9)
        shares.add(design.values["share"])
        kept = expected["share"] >= 0.6 and expected["size"] <= 1.1
        assert design.state == ("feasible" if kept else "infeasible")
    assert len(shares) > 1
    assert {d.state for d in found.designs} == {"feasible", "infeasible"}


RPS = """\
kind: parallel
parameters: {b: 0.2}
legs: {chain: RPS, base: {radius: 0.3}, platform: {radius: =b}, stiffness: 1.0e+7,
       limits: [0.5, 0.64]}
pose: {xyz: [0, 0, 0.6]}
payload: {mass: 3, com: [0.01, 0, 0.05]}
"""
PUS = """\
kind: parallel
parameters: {rod: 0.5}
legs: {chain: PUS, base: {radius: 0.35, half_angle: 0.2}, platform: {radius: 0.15, half_angle: 0.2},
       rail: vertical, rod: =rod, stiffness: 2.0e+7}
pose: {xyz: [0, 0, 0.55]}
payload: {mass: 3, com: [0.02, 0.01, 0.03]}
"""


@pytest.mark.parametrize(
    ("text", "variables", "axes", "asked"),
    [
        (
            PUS,
            {"rod": {"values": [0.5, 0.47]}},
            {"x": [-0.03, 0.02, 2], "yaw": [0.0, 0.1, 2]},
            "condition",
        ),
        (
            RPS,
            {"b": {"values": [0.2, 0.22]}},
            {"z": [-0.02, 0.03, 2], "roll": [-0.1, 0.1, 2]},
            "compliance_translation_free_max",
        ),
    ],
)
def test_poses_of_a_body_on_legs_are_those_of_at_pose(text, variables, axes, asked, tmp_path):
    """Frequencies from compliances equal modes one by one; limits as `analyse` has them."""
    path = tmp_path / "machine.yaml"
    path.write_text(text, encoding="utf-8")
    found = cartstiff.design(
        {
            "mechanism": str(path),
            "variables": variables,
            "poses": {"grid": axes, "about_home": True, "outside": "leave-out"},
            "objectives": {
                "f": {"quantity": "frequency_1"},
                "g": {"quantity": asked},
                "there": {"quantity": "frequency_1", "of": "reached"},
            },
        }
    )
    columns = ["x", "y", "z", "roll", "pitch", "yaw"]
    for design in found.designs:
        elastic = cartstiff.load(path, parameters=design.parameters)
        lowest, inside = [], []
        for pair in itertools.product(*([low, high] for low, high, _ in axes.values())):
            pose = np.array([0, 0, 0.6 if text == RPS else 0.55, 0, 0, 0])
            pose[[columns.index(name) for name in axes]] += pair
            q = cartstiff.at_pose(elastic, pose)[0]
            notes = {note.code for note in cartstiff.analyse(elastic, q).notes}
            inside.append("beyond-limits" not in notes)
            if inside[-1]:
                lowest.append(cartstiff.modes(elastic, q).frequencies[0])
        assert design.values["f"] == pytest.approx(min(lowest), rel=1e-10)
        assert design.values["there"] == np.mean(inside)
    assert np.ptp([d.values["g"] for d in found.designs]) > 0.0


def test_poses_are_drawn_and_names_of_others_refused():
    asked = {"mechanism": "3-rps", "variables": {"k": [0, 1]}, **STIFF}
    refused("unknown parameter", cartstiff.design, asked)
    evaluation = StudyEvaluator(*read_study(study(poses={"random": {"count": 4, "ranges": {}}})))
    machine = cartstiff.load("6-pus")
    drawn = {"poses": {"random": {"count": 5, "ranges": {"x": [-0.01, 0.01]}}, "about_home": True}}
    evaluation.study = Study.model_validate(study(**drawn))
    sampling = evaluation._sampling(machine)
    q = sampling.postures((slice(0, 5),), machine)
    poses = np.array([cartstiff.analyse(machine, row).pose for row in q])
    assert np.ptp(poses[:, 0, 3]) > 0.0
    assert np.abs(poses[:, 0, 3]).max() <= 0.01
    assert poses[:, 2, 3] == pytest.approx(0.55)
    evaluation.study = Study.model_validate(
        study(poses={"random": {"count": 5, "ranges": {"x": [0, 1], "w": [0, 1]}}})
    )
    refused("unknown coordinate", evaluation._sampling, machine)


def test_any_optimiser_finds_the_isotropic_inclination():
    """By hand: K = k diag(3 (1 - s^2), 3 (1 - s^2), 6 s^2), whose least is largest at s^2 = 1/3.

    With a bound at 0.8 the least is 3 k (1 - s^2) there.
    """
    evaluate = evaluator(study(constraints={"steep": {"value": "=sz", "at_least": 0.8}}))

    def cost(x):
        return -evaluate({"sz": float(x)}).values["stiff"]

    free = minimize_scalar(cost, bounds=(0.2, 0.9), method="bounded", options={"xatol": 1e-6})
    assert free.x == pytest.approx(3**-0.5, abs=1e-5)
    assert -free.fun == pytest.approx(2e6, rel=1e-4)
    bound = minimize_scalar(
        lambda x: cost(x) if evaluate({"sz": float(x)}).state == "feasible" else 0.0,
        bounds=(0.2, 0.9),
        method="bounded",
        options={"xatol": 1e-6},
    )
    assert bound.x == pytest.approx(0.8, abs=1e-3)
    assert -bound.fun == pytest.approx(3e6 * (1 - 0.64), rel=5e-3)


@pytest.mark.parametrize("of", ["worst", "mean", "median"])
def test_gradients_are_those_of_differences_of_whole_designs(of):
    """At the poses that decide, with a load in the room's axes and arithmetic."""
    evaluate = evaluator(
        study(
            variables={"sz": [0.3, 0.8], "a": [0.2, 0.5], "half": [0.1, 0.4]},
            poses={"grid": {"x": [-0.02, 0.03, 2], "roll": [-0.1, 0.2, 2]}, "about_home": True},
            cases={
                "idle": {"length": 0.3},
                "loaded": {"wrench": WRENCH, "direction": [1, 2, 2], "world": True},
            },
            objectives={
                "softest": {"quantity": "translation_free_min", "of": of, "case": "idle"},
                "along": {"quantity": "along_held", "of": of, "case": "loaded"},
                "condition": {"quantity": "condition", "of": of, "case": "idle"},
                "wide": {"value": "=2*a + sz**2", "goal": "smallest"},
            },
        )
    )
    at = {"sz": 0.55, "a": 0.3, "half": 0.2}
    found = evaluate.gradient(at)
    for variable, x in at.items():

        def values(h, variable=variable, x=x):
            return np.array([*evaluate({**at, variable: x + h}).values.values()])

        near, far = ((values(h) - values(-h)) / (2 * h) for h in (1e-4, 2e-4))
        wanted, sizes = (4 * near - far) / 3, np.abs(values(0.0))
        got = np.array([row[variable] for row in found.values()])
        np.testing.assert_array_less(np.abs(got - wanted), 1e-7 * (np.abs(wanted) + sizes))
    shares = {"far": {"quantity": "translation_free_min", "of": "share", "above": 1.0}}
    refuses("no derivative", evaluator(study(objectives=shares)).gradient, {"sz": 0.5})
    divided = {"part": {"value": "=1 / (sz - 0.5)", "goal": "smallest"}}
    refuses("fails", evaluator(study(objectives=divided)).gradient, {"sz": 0.5})
    # A variable that is left out has the file's value, as in a design.
    file_a = evaluate.home.parameters["a"]
    some = {"sz": 0.55, "half": 0.2}
    assert evaluate.gradient(some) == evaluate.gradient(some | {"a": file_a})


def test_gradients_of_quantities_whose_case_has_settings_of_others():
    objectives = {name: {"quantity": name} for name in ("along_held", "translation_held_min")}
    cases = {"one": {"direction": [0, 0, 1], "length": 0.3}}
    both = evaluator(study(cases=cases, objectives=objectives)).gradient({"sz": 0.3})
    # Of six such legs k sz^2 each along z, and half of the rest across it.
    assert both["along_held"]["sz"] == pytest.approx(12e6 * 0.3, rel=1e-6)
    assert both["translation_held_min"]["sz"] == pytest.approx(12e6 * 0.3, rel=1e-6)


def test_low_discrepancy_points_fill_the_ranges():
    ranges = {"sz": {"low": 0.1, "high": 0.9}, "a": {"low": 0.01, "high": 1.0, "log": True}}
    for kind in ("sobol", "latin-hypercube"):
        found = cartstiff.design(study(variables=ranges, method={"kind": kind, "designs": 16}))
        assert len(found) == 16
        shares = (found.table("sz") - 0.1) / 0.8
        decades = np.log10(found.table("a")) / 2 + 1
        for column in (shares, decades):  # one point in each sixteenth, as both promise
            assert sorted((column * 16).astype(int).tolist()) == list(range(16))


def test_the_grid_and_the_csv_hold_every_design():
    found = cartstiff.design(
        study(variables={"sz": {"low": 0.2, "high": 0.6, "count": 3}, "a": {"values": [0.3, 0.1]}})
    )
    pairs = [(d.parameters["sz"], d.parameters["a"]) for d in found.designs]
    assert pairs == [(sz, a) for sz in (0.2, 0.4, 0.6) for a in (0.3, 0.1)]
    rows = list(csv.DictReader(io.StringIO(found.to_csv())))
    assert [float(row["stiff [N/m]"]) for row in rows] == found.table("stiff").tolist()
    assert [i for i, row in enumerate(rows) if row["front"] == "yes"] == list(found.front)


@settings(max_examples=40)
@given(
    st.lists(
        st.tuples(st.integers(0, 4), st.integers(0, 4), st.sampled_from(["feasible", "failed"])),
        min_size=1,
        max_size=25,
    )
)
def test_the_front_is_what_nobody_betters(rows):
    """By the definition, pair by pair; ties belong to it."""
    asked = Study.model_validate(
        study(
            objectives={
                "x": {"value": "=sz", "goal": "largest"},
                "y": {"value": "=sz", "goal": "smallest"},
            }
        )
    )
    designs = tuple(
        Design({"sz": 0.5}, {"x": float(a), "y": float(b)} if s == "feasible" else {}, s)
        for a, b, s in rows
    )
    better = {"x": "largest", "y": "smallest"}
    found = Designs(asked, cartstiff.load("hexapod"), designs, better, {"x": "", "y": ""})
    good = [i for i, row in enumerate(rows) if row[2] == "feasible"]
    expected = {
        i
        for i in good
        if not any(
            rows[j][0] >= rows[i][0] and rows[j][1] <= rows[i][1] and rows[j][:2] != rows[i][:2]
            for j in good
        )
    }
    assert set(found.front) == expected
    if not good:
        refused("no design is feasible", found.best, "x", kind=UndefinedError)


@pytest.fixture
def hexagons(tmp_path):
    """Platforms that are singular everywhere where base and platform are regular hexagons."""
    path = tmp_path / "hexagons.yaml"
    path.write_text(HEXAGONS, encoding="utf-8")
    return path


def test_designs_that_fail_say_why_and_cost_little(hexagons, monkeypatch):
    """Similar regular hexagons are singular in every pose; a height of zero is refused."""
    looked = []
    true = postures.fill
    monkeypatch.setattr(postures, "fill", lambda *given: looked.append(1) or true(*given))
    asked = {
        "mechanism": str(hexagons),
        "variables": {"half": {"values": [0.2, np.pi / 6]}},
        "poses": {"grid": {"x": [-0.01, 0.01, 20], "y": [-0.01, 0.01, 20]}, "about_home": True},
        "objectives": {"stiff": {"quantity": "translation_free_min"}},
    }
    good, bad = cartstiff.design(asked).designs
    assert good.state == "feasible"
    assert (bad.state, bad.values) == ("failed", {})
    assert "type-2-singularity at 8" in bad.reason
    assert "400 poses" in bad.reason
    assert len(looked) <= 8
    upright = cartstiff.design(study(variables={"sz": {"values": [0.5, 1.0]}}))
    assert [design.state for design in upright.designs] == ["feasible", "failed"]
    assert "key layout.height: division by zero" in upright.designs[1].reason


def test_poses_without_a_value_are_refused_or_left_out(hexagons):
    """Legs that are too long: shares by hand from the leg lengths."""
    asked = {
        "mechanism": str(hexagons),
        "variables": {"h": {"values": [0.5]}},
        "poses": {"grid": {"x": [0, 0.2, 9]}, "about_home": True},
        "objectives": {"stiff": {"quantity": "translation_held_min"}},
    }
    elastic = cartstiff.load(hexagons)
    steps = np.linspace(0, 0.2, 9)
    lengths = [elastic.mechanism.leg_lengths(moved(elastic, x)) for x in steps]
    inside = np.array([(x >= 0.45).all() and (x <= 0.6).all() for x in lengths])
    assert 0 < inside.sum() < 9
    (design,) = cartstiff.design(asked).designs
    assert design.reason == f"beyond-limits at {9 - inside.sum()} of 9 poses"
    asked["poses"]["outside"] = "leave-out"
    asked["objectives"]["there"] = {"quantity": "translation_held_min", "of": "reached"}
    asked["objectives"]["all"] = {"quantity": "translation_held_min", "of": "share", "above": 0}
    (design,) = cartstiff.design(asked).designs
    assert design.values["there"] == design.values["all"] == inside.mean()
    stiff = [
        np.linalg.eigvalsh(cartstiff.analyse(elastic, moved(elastic, x)).matrices["B"][3:, 3:])[0]
        for x in steps[inside]
    ]
    assert design.values["stiff"] == pytest.approx(min(stiff), rel=1e-10)


def test_the_command(tmp_path):
    (tmp_path / "study.yaml").write_text(
        "mechanism: inclined-hexapod\nvariables: {sz: [0.3, 0.8]}\n"
        "objectives: {a: {quantity: translation_held_min}, b: {quantity: rotation_held_max}}\n"
        "constraints: {c: {value: =sz, at_most: 0.7}}\n"
    )
    files = [word for end in ("csv", "svg") for word in ("-o", str(tmp_path / f"d.{end}"))]
    arguments = ["design", str(tmp_path / "study.yaml"), *files]
    shown = CliRunner().invoke(command, arguments, catch_exceptions=False).output
    assert "5 designs by grid, 1 pose(s) each" in shown
    assert "4 feasible, 1 infeasible, 0 failed" in shown
    picture = (tmp_path / "d.svg").read_text()
    assert "Pareto front" in picture
    assert "5 designs of inclined-hexapod" in picture
    run = CliRunner().invoke(command, [*arguments, "--json"], catch_exceptions=False)
    answer = json.loads(run.output)
    jsonschema.validate(answer, json_schema("design"))
    assert answer["counts"] == {"feasible": 4, "infeasible": 1, "failed": 0}
    assert answer["designs"][4]["reason"].startswith("c = 0.8")
    for name in "ab":
        values = [d["values"][name] for d in answer["designs"][:4]]
        assert answer["best"][name] == values.index(max(values))
    assert (tmp_path / "d.csv").read_text().count("\n") == 6


def test_one_program_serves_platforms_of_every_size():
    """Geometry given at run time: the same numbers as where it is folded into the program."""
    rng = np.random.default_rng(1)
    for load in (None, WRENCH):
        for name in ("hexapod", "stewart-gough"):
            elastic = cartstiff.load(name)
            q = elastic.q + 0.02 * rng.standard_normal((5, 6))
            asked = {
                "wrench": load,
                "outputs": ("A", "F", "K", "compliance_B", "jacobian"),
                "path": "portable",
            }
            plain = cartstiff.analyse_many(elastic, q, **asked)
            general = replace(elastic, mechanism=elastic.mechanism.as_one_of_many())
            found = cartstiff.analyse_many(general, q, **asked)
            for output, array in plain.arrays.items():
                scale = np.abs(array).max()
                assert np.abs(found.arrays[output] - array).max() < 1e-12 * scale


def test_postures_that_nobody_looks_at_are_undecided():
    ring = {"radius": 0.4, "half_angle": np.pi / 6}
    flat = cartstiff.hexapod(base=ring, platform=ring | {"radius": 0.3}, height=0.5, legs=1e6)
    q = flat.q + np.linspace(0, 0.01, 30)[:, None] * np.eye(6)[0]
    found = cartstiff.analyse_many(flat, q, outputs=("B", "compliance_B"), one_by_one=3)
    assert found.counts() == {"type-2-singularity": 3, "undecided": 27}
    assert np.isnan(found.B[found.state == found.codes.index("undecided")]).all()
    assert cartstiff.analyse_many(
        flat, q[:2], outputs=("compliance_B",), one_by_one=3
    ).counts() == {"type-2-singularity": 2}
    refused("one_by_one", cartstiff.analyse_many, flat, q, one_by_one=-1)


@pytest.mark.parametrize(
    ("more", "needed"),
    [({"world": True}, "direction and deflect"), ({"deflect_at": [0, 0, 1]}, "deflect")],
)
def test_axes_and_point_of_a_deflection_are_no_words_about_the_load(more, needed):
    """`world` beside a wrench alone left the load in the body's axes."""
    case = {"wrench": [0, 0, 0, 10, 0, -100], **more}
    study = {
        "mechanism": "inclined-hexapod",
        "variables": {"sz": {"values": [0.3]}},
        "cases": {"tip": case},
        "objectives": {"softest": {"quantity": "translation_held_min", "case": "tip"}},
    }
    (word,) = more
    refused(f"{word}: is about {needed}, and none is given", cartstiff.design, study)
