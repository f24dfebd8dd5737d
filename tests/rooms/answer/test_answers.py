"""One answer, whoever renders it: text, JSON, report, page and exported page.

Mechanisms and set-ups are generated; displacements are computed here by virtual work and by the
rest under the load.
"""

from __future__ import annotations

import json
import math
from typing import Any

import numpy as np
import pytest
from tests.doors import Note
from tests.inner import (
    RULES,
    STABILITY,
    VERDICTS,
    WEIGHTS,
    BrowserProgram,
    answer_at,
    answer_sentences,
    browser_program,
    decide,
    direction_words,
    doubts_of,
)
from tests.laws.test_set_ups import SetUp, later, posture
from tests.rooms.page.test_browser_program import asked_of
from tests.support.commands import answer, run
from tests.support.generated import Arm, close
from tests.support.pages import message_of, page_text, source_of, tab_of
from tests.support.report_words import states_what_is_said
from tests.view.test_export import held

import cartstiff

SEEDS = [3, *later(0, *range(4, 24))]


@pytest.fixture(params=["world", "body"])
def axes(request):
    return request.param


@pytest.mark.parametrize("seed", SEEDS)
def test_both_displacements_are_those_of_virtual_work(seed, axes, tmp_path):
    one = SetUp(Arm.generated(seed), tmp_path, axes, None)
    q = posture(one.arm, "elsewhere")
    found = answer("analyse", one.file(), ["--q", ",".join(map(repr, q.tolist()))], one.words(q))
    said, R = found["answer"]["displacement"], one.arm.pose(q)[:3, :3]
    linear = R @ (one.arm.compliance(q) @ one.force(q))[3:]
    close(said["first_order"]["translation"], linear)
    moved = (one.arm.pose(one.under_load(q)) - one.arm.pose(q))[:3, 3]
    close(said["equilibrium"]["translation"], moved, 1e-6)
    miss = np.linalg.norm(moved - linear) / np.linalg.norm(moved)
    assert said["difference"] == pytest.approx(miss, rel=1e-3, abs=1e-7)
    shares = found["answer"]["shares"]
    assert sum(p["share"] for p in shares["parts"]) + shares["rest"] == pytest.approx(1.0)


@pytest.mark.parametrize("seed", SEEDS)
def test_text_json_report_pages_and_python_say_the_same(seed, axes, tmp_path):
    one = SetUp(Arm.generated(seed), tmp_path, axes, None)
    q = posture(one.arm, "elsewhere")
    options = ["--q", ",".join(map(repr, q.tolist())), *one.words(q)]
    elastic = cartstiff.load(one.file())
    result = cartstiff.analyse(elastic, q, **one.load(q))
    ours = answer_at(result)
    printed, text = answer("analyse", one.file(), options), run("analyse", one.file(), options)
    assert printed["answer"] == json.loads(json.dumps(ours.to_dict()))
    lines = [line.strip() for line in text.splitlines()]
    for sentence in answer_sentences(ours):
        assert sentence in lines
    shown = page_numbers(elastic, one, q)
    same_as_page(ours, shown, q)
    # The page as a file, where its formulas cover the posture.
    if isinstance(made := browser_program(elastic, cartstiff.analyse(elastic)), BrowserProgram):
        (alone,) = asked_of(made, [asking(one, q).state], "program.numbers(state)")
        if alone is not None:
            same_as_page(ours, alone, q)
    run("report", one.file(), options, f"-o {tmp_path / 'r.html'}")
    report = (tmp_path / "r.html").read_text("utf-8")
    states_what_is_said(report, result, printed["answer"])


def asking(one: SetUp, q: np.ndarray) -> Any:
    """A page's question for the numbers of a set-up."""
    state = {
        "q": q.tolist(),
        "load": one.wrench(q).tolist(),
        "load_axes": one.axes,
        "load_at": one.arm.at.tolist(),
    }
    return message_of(json.dumps({"id": 1, "do": "numbers", "state": state}))


def page_numbers(elastic: Any, one: SetUp, q: np.ndarray) -> dict[str, Any]:
    found: dict[str, Any] = tab_of(source_of(elastic)).answer(asking(one, q)).data["numbers"]
    return found


def same_as_page(ours: Any, shown: dict[str, Any], q: np.ndarray) -> None:
    assert shown["verdict"]["level"] == ours.verdict.level
    assert shown["verdict"]["title"] == VERDICTS[ours.verdict.code]
    said = [note.code for note in ours.doubts]
    assert [code for code in shown["doubts"] if code != ours.verdict.code] == said
    assert shown["moved"]["in_room"] == pytest.approx(
        ours.displacement.first_order.translation, rel=1e-9
    )
    soft = ours.extreme("softest")
    assert shown["softest"]["stiffness"] == pytest.approx(soft.stiffness, rel=1e-9)
    shown_shares = shown["moved"]["shares"]
    assert shown_shares["of"] == ours.shares.of
    shares = {part["name"]: part["share"] for part in shown_shares["parts"]}
    assert shares == pytest.approx({p.name: p.share for p in ours.shares.parts}, abs=1e-12)
    assert shown_shares["rest"] == pytest.approx(ours.shares.rest, abs=1e-12)


def test_the_equilibrium_is_said_where_the_first_order_misses_it() -> None:
    """A five-bar moves by a third more than its compliance says."""
    found = answer("analyse five-bar --load 0,0,0,0,-500,0")["answer"]["displacement"]
    linear, moved = (
        math.hypot(*found[key]["translation"]) for key in ("first_order", "equilibrium")
    )
    assert found["difference"] > 0.02
    elastic = cartstiff.load("five-bar")
    state = cartstiff.equilibrium(elastic, wrench=[0, 0, 0, 0, -500, 0])
    assert moved == pytest.approx(np.linalg.norm(state.displacement[3:]), rel=1e-9)
    said = answer("equilibrium five-bar --load 0,0,0,0,-500,0")["answer"]
    assert said["displacement"]["equilibrium"] == found["equilibrium"]
    assert said["verdict"]["code"] == "stable"
    text = run("analyse five-bar --load 0,0,0,0,-500,0")
    rest = run("equilibrium five-bar --load 0,0,0,0,-500,0")
    assert f"moves {1e3 * moved:.4g} mm under the load" in rest
    assert f"moves {1e3 * moved:.4g} mm" in text
    assert f"(by the equilibrium; {1e3 * linear:.4g} mm to first order, K^load)" in text


def test_every_rule_has_a_sentence_and_the_last_of_a_matrix_are_its_signs() -> None:
    codes = {rule.code for rule in RULES} | {code for _, code in STABILITY.values()}
    assert codes == set(VERDICTS)
    assert len(set(WEIGHTS)) == len(WEIGHTS)
    signs = {f"K {kind}" for kind in ("positive", "positive semidefinite", "indefinite")}
    assert signs <= {need for rule in RULES for need in rule.needs}


@pytest.mark.parametrize(
    ("direction", "words"),
    [
        ((0, 0, 2), "vertical"),
        ((0.07, 0, 1), "almost vertical, 4 deg off z"),
        ((0, -1, 0), "horizontal, along y"),
        ((1, 0.5, 0), "horizontal, 27 deg off x"),
        ((1, 0.02, 0.1), "almost horizontal, 6 deg off the xy plane, 1 deg off x"),
        ((1, 0, 1), "45 deg off z towards x"),
    ],
)
def test_directions_have_words(direction, words):
    assert direction_words(direction) == words
    assert direction_words(tuple(-x for x in direction)) == words


def test_a_motion_has_a_sense():
    assert direction_words((0, 0, -1), is_line=False) == "vertical downwards"
    assert direction_words((0, -1, 0), is_line=False) == "horizontal, along -y"
    assert direction_words((0, 0, -1), is_line=False, is_upright=False) == "along -z"


def test_a_page_says_the_sentences_of_the_command(tmp_path):
    """Live, in its full analysis, and in the file that is exported."""
    load, elastic = [0.0, 0.0, 0.0, 0.0, -500.0, 0.0], cartstiff.load("five-bar")
    lines = [line.strip() for line in run("analyse five-bar --load 0,0,0,0,-500,0").splitlines()]
    session = tab_of(source_of(elastic))
    state = {"load": load}
    live, analysis = (
        session.answer(message_of(json.dumps({"id": 1, "do": do, "state": state}))).data
        for do in ("answer", "analysis")
    )
    file = held(page_text(source_of(elastic, load=np.array(load))))[0]["said"]
    ours = answer_at(cartstiff.analyse(elastic, wrench=load))
    for found in (live, file):
        assert found["answer"] == json.loads(json.dumps(ours.to_dict()))
        assert found["sentences"] == answer_sentences(ours)
        moved = found["settled"].removeprefix("By the equilibrium it ")
        assert any(line.startswith(f"The body frame {moved} (by the equilibrium") for line in lines)
    assert all(sentence in lines for sentence in live["sentences"])
    assert analysis["text"].startswith("\n".join(live["sentences"]))


@pytest.mark.parametrize(
    ("facts", "level", "code"),
    [
        ({"no matrix", "unbalanced", "fewer-than-six-freedoms"}, "bad", "unbalanced"),
        ({"no matrix", "indefinite", "fewer-than-six-freedoms"}, "bad", "indefinite"),
        ({"no matrix", "fewer-than-six-freedoms"}, "warning", "fewer-than-six-freedoms"),
        ({"no matrix", "F", "kf-undefined"}, "warning", "kf-undefined"),
        ({"no matrix"}, "bad", "no-stiffness"),
        ({"K positive", "near-serial-singularity"}, "warning", "near-serial-singularity"),
        ({"K positive", "indefinite"}, "bad", "indefinite"),
        ({"K indefinite", "not tangent"}, "warning", "not tangent indefinite"),
        ({"K indefinite", "asymmetric"}, "bad", "asymmetric indefinite"),
        ({"K indefinite", "type-2-singularity"}, "bad", "indefinite"),
        ({"K unresolved", "slack"}, "warning", "unresolved"),
        ({"K positive", "kf-undefined"}, "good", "positive"),
    ],
)
def test_the_first_rule_whose_facts_hold_decides(facts, level, code):
    rule = decide(frozenset(facts))
    assert (rule.level, rule.code) == (level, code)


def test_the_page_s_script_gets_the_rules_and_the_order_of_doubts():
    elastic = cartstiff.load("cubic")
    made = browser_program(elastic, cartstiff.analyse(elastic))
    words = made.data["words"]
    assert [(set(r["needs"]), r["level"], r["code"], r["title"]) for r in words["rules"]] == [
        (set(rule.needs), rule.level, rule.code, VERDICTS[rule.code]) for rule in RULES
    ]
    assert words["weights"] == list(WEIGHTS)


def test_doubts_are_in_the_order_of_their_weight_and_said_once():
    elastic = cartstiff.load("ur5")
    notes = [Note(code, code) for code in ("slack", "kf-undefined", "beyond-limits", "slack")]
    found = [note.code for note in doubts_of(elastic, notes)]
    assert found == ["springs-illustrative", "beyond-limits", "slack"]


def test_the_signs_of_a_matrix_are_those_that_its_keys_describe():
    from typing import get_args

    from tests.inner import SIGNS, Definiteness

    assert get_args(Definiteness) == SIGNS
