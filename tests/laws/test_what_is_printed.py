"""What reports print means what it says, against values found otherwise."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from tests.doors import PolynomialLaw, Scaled
from tests.support import refused
from tests.support.commands import command as cartstiff_command
from tests.support.printed import sentences_of, text_of

import cartstiff
from cartstiff import (
    DeadForce,
    JointSprings,
    UndefinedError,
    analyse_posture,
    equilibrium,
)
from cartstiff.analysis import compare_connections
from cartstiff.geometry import se3


def test_stored_energy_is_that_of_the_springs_alone():
    platform = cartstiff.load("cubic")
    state = equilibrium(platform, Scaled(DeadForce([0.0, 0.0, -400.0]), 0.5))
    found = state.stiffness
    legs = state.elastic.springs
    lengths = state.posture.lines.lengths
    stored = 0.5 * float(np.sum(legs.stiffness * (lengths - legs.rest_length) ** 2))
    assert found.stored_energy == pytest.approx(stored, rel=1e-12)
    assert found.energy == pytest.approx(stored + 200.0 * state.pose[2, 3], rel=1e-12)
    assert found.to_dict()["stored_energy"] == found.stored_energy
    text = text_of(state)
    assert f"energy stored in the springs {stored:.6g} N m" in text
    assert f"potential of gravity and loads {200.0 * state.pose[2, 3]:.6g} N m" in text


def test_the_load_of_a_deficient_mechanism_is_the_one_put_on():
    """A planar linkage under a force out of its plane, which the structure carries."""
    force = np.array([10.0, -50.0, -30.0])
    state = equilibrium(cartstiff.load("five-bar"), DeadForce(force))
    expected = np.concatenate([np.zeros(3), state.pose[:3, :3].T @ force])
    assert state.elastic_stiffness.wrench == pytest.approx(expected, abs=1e-9)
    assert "springs and structure carry it together" in text_of(state)
    # Off the frame's origin, and with springs' forces alone, which leave it open.
    point = np.array([0.0, 0.02, 0.01])
    state = equilibrium(cartstiff.load("five-bar"), DeadForce(force, point))
    local = state.pose[:3, :3].T @ force
    expected = np.concatenate([np.cross(point, local), local])
    assert state.elastic_stiffness.wrench == pytest.approx(expected, abs=1e-9)
    held = equilibrium(cartstiff.load("five-bar"), held={"x": 0.002})
    assert "what the structure carries is not known" in text_of(held)


def test_a_misfit_is_called_a_misfit():
    arm = cartstiff.load("ur5")
    target = np.diag([1e3, 2e3, 3e3, 4e5, 5e5, 6e5])
    found = analyse_posture(cartstiff.analyse(arm), target=target)
    fit = found["synthesis"]["target"]["diagonal_fit"]
    text = text_of(found, arm.units)
    assert f"independent springs miss it by {100 * fit['residual']:.2g} % at best" in text
    assert "as close as" not in text


def test_centres_say_from_where():
    result = cartstiff.analyse(cartstiff.load("cubic"), wrench=[0, 0, 0, 10.0, 20.0, -50.0])
    T = se3.pose(translation=(0.01, -0.02, 0.03))
    here, there = analyse_posture(result), analyse_posture(result, at=T)
    for name, point in here["centres"].items():
        expected = np.array(point) - T[:3, 3]
        assert np.allclose(there["centres"][name], expected, atol=1e-9)
    assert "Centres, from the origin of the body frame" in text_of(here, result.units)
    assert "Centres, from this point" in text_of(there, result.units)


def test_rounding_is_not_printed():
    """A force along two axes alone; the third component comes back as 4e-12 N."""
    load = {"wrench": [0, 75.0, 0, 300.0, 0, -100], "load_axes": "world"}
    text = text_of(cartstiff.analyse(cartstiff.load("ur5"), **load))
    assert "\nLoad: dead, force (300, 0, -100) N, moment (0, 75, 0) N m along the axes of" in text
    text = text_of(cartstiff.analyse(cartstiff.load("ur5").with_potential(DeadForce([0, 0, -20]))))
    assert "no wrench is needed to hold the body here" in text


def _numbers(text):
    """All numbers of a text that are not shown as 0."""
    return [float(x) for x in re.findall(r"(?<![\w.])-?\d+(?:\.\d+)?e-\d+(?![\w.])", text)]


@pytest.mark.parametrize("name", ["cubic", "cable-robot", "orthoglide", "6-rus", "grasp"])
def test_no_rounding_among_pitches_couplings_modes_and_coordinates(name):
    result = cartstiff.analyse(cartstiff.load(name))
    section = analyse_posture(result, mass=2.0, inertia=np.eye(3) * 0.1)
    text = text_of(section, result.elastic.units)
    kept = [row for row in text.splitlines() if "residual" not in row and "of its block" not in row]
    assert [x for x in _numbers("\n".join(kept)) if 0.0 < abs(x) < 1e-11] == []
    state = equilibrium(cartstiff.load(name), DeadForce([0.0, 0.0, -2.0]))
    posture = text_of(state.stiffness, at_rest=True).partition("Stiffness")[0]
    assert [x for x in _numbers(posture) if 0.0 < abs(x) < 1e-12] == []


def test_a_motion_that_closures_forbid_has_no_compliance():
    """The delta's cousin with prismatic drives: its platform does not turn."""
    C = cartstiff.analyse(cartstiff.load("orthoglide")).compliances["B"]
    assert not C[:3].any()
    assert np.allclose(np.diag(C)[3:], 1e-7, rtol=1e-9)


def test_weights_over_the_origin_have_no_potential():
    """A platform in the origin of F: height and potential are rounding there."""
    cubic = cartstiff.load("cubic").with_payload(2.0).with_gravity()
    result = cartstiff.analyse(cubic, np.array([0.0, 0.0, 3e-17, 0.0, 0.0, 0.0]))
    assert result.energy != result.stored_energy
    assert "potential of gravity" not in text_of(result)
    raised = cartstiff.analyse(cubic, np.array([0.0, 0.0, 3e-6, 0.0, 0.0, 0.0]))
    assert "potential of gravity and loads 5.886e-05 N m" in text_of(raised)


def test_a_share_of_nothing_is_no_number():
    table = compare_connections({"B": np.zeros((6, 6)), "A": np.eye(6)})
    assert table.rows[0].change is None
    assert table.matters
    assert "K^B is zero, others are not" in table.verdict


def test_frequencies_are_in_hertz():
    mass = 2.0
    result = cartstiff.analyse(cartstiff.load("cubic"))
    found = analyse_posture(result, mass=mass, inertia=np.eye(3) * 1e-2)["modes"]
    K, M = result.matrices["B"], np.diag([1e-2] * 3 + [mass] * 3)
    squares = np.sort(np.linalg.eigvals(np.linalg.solve(M, K)).real)
    assert found["eigenvalues"] == pytest.approx(squares, rel=1e-9)
    assert found["frequencies"] == pytest.approx(np.sqrt(squares) / (2 * np.pi), rel=1e-9)
    assert analyse_posture(result)["modes"]["frequencies"] is None


@pytest.mark.parametrize("name", ["delta", "3-rrr", "6-ups", "panda"])
def test_a_mechanism_without_its_springs_has_zeros_and_no_rounding(name):
    """Its passive joints let it go; what is left is what the flexible parts hold."""
    elastic = cartstiff.load(name)
    result = cartstiff.analyse(elastic.with_springs(0.0))
    section = analyse_posture(result)
    length = result.posture.length
    K = np.array(section["stiffness"]) * np.outer(*[np.repeat([1.0, length], 3)] * 2)
    assert result.compliances["B"] is None
    for freedom, block in (("rotation", slice(0, 3)), ("translation", slice(3, 6))):
        size = np.abs(K[block, block]).max()
        assert size == 0.0 or size > 1e-12 * np.abs(K).max()
        for others in ("held", "free"):
            values = np.abs(section["ellipsoids"]["stiffness"][freedom][others]["eigenvalues"])
            scaled = values * (1.0 if freedom == "rotation" else length**2)
            assert np.all((scaled == 0.0) | (scaled > 1e-12 * np.abs(K).max()))
    assert section["indices"]["minimum_stiffness"] == 0.0
    assert "compliance does" not in text_of(result)


def test_lines_in_a_tilted_plane_hold_nothing_out_of_it(tmp_path):
    R = se3.exp([0.3, -0.7, 0.4, 0, 0, 0])[:3, :3]
    square = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]) @ R.T
    file = tmp_path / "lines.yaml"
    lines = {"base": (2.0 * square).tolist(), "platform": square.tolist()}
    legs = {"stiffness": 1e4, "preload": 0.0}
    file.write_text(json.dumps({"kind": "springs", **lines, "legs": legs}), encoding="utf-8")
    result = cartstiff.analyse(cartstiff.load(file))
    values = analyse_posture(result)["ellipsoids"]["stiffness"]
    assert values["rotation"]["held"]["eigenvalues"] == [0.0, 0.0, 0.0]
    assert values["translation"]["held"]["eigenvalues"] == pytest.approx([0, 2e4, 2e4], abs=1e-9)
    assert values["translation"]["held"]["eigenvalues"][0] == 0.0


def test_a_deflection_without_turning_has_no_rounding():
    result = cartstiff.analyse(cartstiff.load("cubic"), wrench=[0, 0, 0, 0, 0, -300.0])
    push = analyse_posture(result, wrench=[0, 0, 0, 0, 0, -300.0])["deflection"]
    assert push["twist"][:3] == [0.0, 0.0, 0.0]
    assert push["displacement"][:2] == [0.0, 0.0]
    assert push["displacement"][2] < 0.0


# What checks itself says how large its rounding is.
_CHECKS = re.compile(r"residual|largest difference")
_ROUNDING = re.compile(r"\de-(?:1[3-9]|[2-9]\d|\d{3})\b")


@pytest.mark.parametrize(
    "command",
    [
        "frames orthoglide",  # 1.4e-17 m in each direction
        "frames 3-rrr",
        "assemble cubic",  # a whole row beside a pose that is zero
        "analyse orthoglide --analysis full",  # a body that does not turn: 7.6e-38 rad/(N m)
        "analyse fanuc-r2000ic --q 0,0,0,0,0,0 --analysis full",  # intervals of entries that are 0
        "analyse cubic --sensitivities --analysis none",  # 4e-12 beside 192
    ],
)
def test_no_rounding_is_printed_as_a_number(command):
    from click.testing import CliRunner
    from tests.support.commands import command as main

    done = CliRunner().invoke(main, command.split())
    assert done.exit_code == 0, done.output
    lines = [line for line in done.output.splitlines() if not _CHECKS.search(line)]
    assert not [line for line in lines if _ROUNDING.search(line)]


def test_directions_are_shown_without_their_rounding():
    """Axes that closures leave askew by 1e-10 are told as what they are; the JSON has them all."""
    found = cartstiff.analyse(cartstiff.load("hexaglide"))
    summary = analyse_posture(found)
    axes = np.array(summary["ellipsoids"]["stiffness"]["translation"]["free"]["axes"])
    small = np.abs(axes[(axes != 0.0) & (np.abs(axes) < 1e-9)])
    assert small.size
    text = text_of(summary, found.units)
    rows = [line for line in text.splitlines() if line.startswith("    axis ")]
    shown = [re.findall(r"[-\d][-.\de]*", line)[1:] for line in rows]
    assert all(len(row) == 6 for row in shown)
    assert all(abs(float(x)) >= 1e-9 or float(x) == 0.0 for line in shown for x in line)


def test_results_show_themselves_in_a_few_lines():
    found = cartstiff.analyse(cartstiff.load("stewart-gough"))
    for thing, told in (
        (found.matrices, "B: array (6, 6), largest entry "),
        (found.compliances, "F: array (6, 6), largest entry "),
        (found.reduction, "6 free motions to rank 6"),
    ):
        assert told in repr(thing)
        assert len(repr(thing)) < 400
    largest = np.abs(found.matrices["B"]).max()
    assert f"B: array (6, 6), largest entry {largest:.6g}" in repr(found.matrices)


def test_the_answer_comes_first() -> None:
    """Its displacement is C times the wrench; an indefinite matrix moves by no such number."""
    runner, load = CliRunner(), [0.0, 0.0, 0.0, 0.0, 0.0, -100.0]
    shown = runner.invoke(cartstiff_command, ["analyse", "ur5", "--load", "0,0,0,0,0,-100"]).output
    answer = shown.partition("Answer\n")[2].partition("\n\n")[0]
    result = cartstiff.analyse(cartstiff.load("ur5"), wrench=load)
    moved = np.linalg.norm((np.linalg.inv(result.tangent) @ load)[3:])
    assert f"The body frame moves {1e3 * moved:.4g} mm under the load, " in answer
    assert "(to first order, K^load)" in answer
    assert "Positive definite: every small motion is resisted (K^load)" in answer
    doubts = shown.partition("Doubts\n")[2].partition("\n\n")[0]
    assert "the springs are illustrative, not measured" in doubts
    titles = ("Load: ", "Answer\n", "Doubts\n", "Joints\n", "\nK^K = K^load", "Not shown: ")
    places = [shown.index(title) for title in titles]
    assert places == sorted(places)
    shown = runner.invoke(cartstiff_command, ["analyse", "stewart-gough"]).output
    answer = shown.partition("Answer\n")[2].partition("\n\n")[0]
    assert answer.strip().startswith("Indefinite: along some motion the load pushes further away")
    assert answer.splitlines()[0].endswith("(the symmetric part of K^load)")


def test_springs_are_illustrative_until_all_were_given() -> None:
    arm, delta = cartstiff.load("ur5"), cartstiff.load("delta")
    names = arm.spring_names
    assert arm.with_springs(dict.fromkeys(names[1:], 1e4)).is_illustrative
    assert not arm.with_springs(1e4).is_illustrative
    assert (
        not arm.with_springs({names[0]: 1e4})
        .with_springs(dict.fromkeys(names[1:], "3 N m/arcmin"))
        .is_illustrative
    )
    assert delta.with_springs(1e4).is_illustrative  # the rods' springs are the file's
    laws = {0: PolynomialLaw((1e4, 0.0, 1e3))}
    curved = JointSprings(np.zeros(6), arm.q, laws)  # these have no stiffness beside their law
    assert replace(arm, springs=curved).is_illustrative


def test_a_compliant_link_is_named_with_the_sum_of_its_shares() -> None:
    """The text names the link that the report names, not one of its virtual joints."""
    chain = cartstiff.load("3-rrr")
    result = cartstiff.analyse(chain, wrench=[0.0, 0.0, 0.0, 5.0, 0.0, 0.0])
    deflection = analyse_posture(result)["deflection"]
    virtual = [chain.names[j] for j in chain.mechanism.virtual]
    links = {name: name.rpartition(".")[0] for name in virtual}
    summed = dict[str, float]()
    for part in deflection["shares"]:
        name = part["name"]
        name = f"{links[name]} (link)" if name in links else name
        summed[name] = summed.get(name, 0.0) + part["share"]
    most = max(summed, key=lambda name: abs(summed[name]))
    words = next(words for words in sentences_of(result) if "comes from" in words)
    assert f"comes from {most}" in words
    assert words.startswith(f"{100 * summed[most]:.0f} %")
    assert not any(name in words for name in links)


@pytest.mark.parametrize(
    ("force", "words"),
    [([0.0, 0.0, -100.0], "each of leg1, leg2, leg3, leg4, leg5, leg6"), ([1, 0, 0], "")],
)
def test_legs_with_equal_shares_are_named_together(force: list[float], words: str) -> None:
    cubic = cartstiff.load("cubic")
    result = cartstiff.analyse(cubic, wrench=[0, 0, 0, *force])
    deflection = analyse_posture(result)["deflection"]
    shares = {part["name"]: part["share"] for part in deflection["shares"]}
    alike = [name for name, x in shares.items() if x > (1 - 1e-9) * max(shares.values())]
    said = next(words for words in sentences_of(result) if "comes from" in words)
    assert said.endswith(f" comes from each of {', '.join(alike)}" if len(alike) > 1 else alike[0])
    assert said.endswith(words)


def test_a_display_says_what_does_not_exist_and_never_raises(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Results compute what is shown when it is shown, in a debugger as in a notebook."""
    said = "line 1 has zero length: its direction does not exist"

    def fails(*_: object) -> None:
        raise UndefinedError(said, code="zero-length-line")

    mechanism = cartstiff.load("cubic")
    posture = cartstiff.analyse(mechanism)
    modes = cartstiff.assemble(cartstiff.load("five-bar")).modes
    monkeypatch.setattr(type(posture), "notes_on_posture", property(fails))
    monkeypatch.setattr(type(posture), "tangent", property(fails))
    monkeypatch.setattr(type(mechanism), "spring_names", property(fails))
    monkeypatch.setattr(type(modes[0]), "eigenvalue", property(fails))
    for shown in (posture, modes[0]):
        assert repr(shown) == f"{type(shown).__name__}: {said}"
    for shown in (posture, modes[0], mechanism):
        assert said in shown._repr_html_()


def test_line_springs_without_a_line_are_refused() -> None:
    refused(
        "no lines; expected at least one",
        cartstiff.LineSprings,
        anchors=np.zeros((0, 3)),
        points=np.zeros((0, 3)),
        stiffness=[],
        rest_length=[],
    )


def test_results_of_lines_without_a_length_are_displayed_or_refused(tmp_path: Path) -> None:
    """Base and platform of a platform coincide at its zero pose: no leg has a direction."""
    points = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0.5, 0, 0], [0, 0.5, 0]]
    file = tmp_path / "flat.yaml"
    file.write_text(
        f"kind: stewart-gough\nbase: {points}\nplatform: {points}\n"
        "pose: {xyz: [0, 0, 1], rpy: [0, 0, 0]}\nlegs: {stiffness: 1.0e6}\n"
    )
    flat, q = cartstiff.load(file), np.zeros(6)
    for ask in (cartstiff.analyse, cartstiff.modes):
        refused("line 1 has zero length", ask, flat, q, kind=UndefinedError)
    many = cartstiff.analyse_many(flat, [q, flat.q])
    assert "zero-length-line" in repr(many)
    for shown in (
        replace(flat, q=q),
        many,
        cartstiff.workspace(flat, q, directions=8, scan=2),
        cartstiff.assemble(flat, np.full(6, 1e-9)),
    ):
        assert len(repr(shown)) > 10
        assert getattr(shown, "_repr_html_", lambda: "none")()
