"""What the page answers without a server: the emitted JavaScript against the library, in node."""

from __future__ import annotations

import dataclasses
import json
import math
import shutil
import subprocess
from functools import cache
from pathlib import Path
from typing import Any

import msgpack
import numpy as np
import pytest
from tests.doors import LoadKind, plain
from tests.inner import (
    HELPERS,
    BrowserProgram,
    Follower,
    PortableKernel,
    Session,
    Settings,
    Source,
    Tape,
    ViewState,
    absolute,
    browser_program,
    choose_quantities,
    client_data,
    copysign,
    cosine,
    evaluate,
    javascript,
    larger,
    moved_part,
    needed_outputs,
    page_script,
    pick,
    series_row,
    sine,
    square_root,
)
from tests.inputs.test_every_key import PLATFORM
from tests.mechanisms.machines import write_file

import cartstiff
from cartstiff import UndefinedError, analyse_many
from cartstiff.geometry import se3

MECHANISMS = (
    "ur5",
    "ur10",
    "panda",
    "xarm7",
    "cubic",
    "hexapod",
    "inclined-hexapod",
    "stewart-gough",
    "stewart-simscape",
    "five-bar",
    "3-rps",
    "6-ups",
    "delta",
    "4-rrr",
    "orthoglide",
)
#: A load bends their links: the server computes that.
BENT = ()
STATES = 25

node = shutil.which("node")
pytestmark = pytest.mark.skipif(node is None, reason="no node to run JavaScript")


def run(script: str) -> Any:
    """What a script leaves in `found`."""
    text = script + "\nprocess.stdout.write(JSON.stringify(found));"
    done = subprocess.run([str(node), "-"], input=text, capture_output=True, text=True, check=True)
    return json.loads(done.stdout)


@cache
def program_of(name: str) -> tuple[Any, BrowserProgram]:
    elastic = cartstiff.load(name)
    found = browser_program(elastic, cartstiff.analyse(elastic))
    assert isinstance(found, BrowserProgram)
    return elastic, found


def states(name: str, count: int = STATES) -> list[ViewState]:
    """Postures within a turn, loads of every kind, springs, points, axes, connections."""
    elastic, made = program_of(name)
    draw = np.random.default_rng(7)
    session = Session(Source(elastic))
    n, sizes = len(elastic.q), elastic.springs.stiffness
    wide = 1.0 if elastic.mechanism.kind == "serial" else 0.05 * np.array([1, 1, 1, 4, 4, 4])
    if made.data["closing"]:
        drives, size = list(elastic.mechanism.actuated), elastic.mechanism.at(elastic.q).length
        wide = np.zeros(n)
        wide[drives] = [
            0.3 * size if c.is_length else 0.3
            for c in (elastic.mechanism.coordinates[j] for j in drives)
        ]
    force = 1e-3 * float(np.mean(sizes)) if elastic.mechanism.kind == "serial" else 10.0
    force = 0.1 if name == "delta" else force  # its links bend
    found = []
    for k in range(count):
        load = draw.normal(size=6) * force if k % 3 and name not in BENT else None
        found.append(
            ViewState(
                q=(elastic.q + wide * draw.uniform(-1, 1, n)).tolist(),
                connection=("load", "A", "B", "K", "F", "+")[k % 6],
                quantity=("stiffness", "compliance")[k % 2],
                others=("free", "held")[k // 2 % 2],
                axes=("body", "world")[k // 2 % 2],
                point=tuple(draw.normal(size=3) * 0.1) if k % 4 else (0.0, 0.0, 0.0),
                load=None if load is None else tuple(load.tolist()),
                load_axes=("body", "world")[k % 5 % 2],
                load_kind=("dead", "follower", "conservative")[k // 3 % 3],
                load_at=(0.01, -0.02, 0.03) if k % 7 == 1 and load is not None else None,
                stiffness=(sizes * draw.uniform(0.5, 2, len(sizes))).tolist()
                if k % 5 == 2
                else None,
            )
        )
    assert session.elastic is elastic
    return found


#: Of what is the difference of large numbers, and of what is small beside its neighbours.
TOLERANCES = {"stiffness": 1e-12, "compliance": 1e-12, "pose": 1e-12, "wrench": 1e-11}
OTHERS = 1e-9
#: Bases of a subspace, which the API alone computes.
BASES = ("structural_wrenches", "reachable_motions", "reachable_stiffness")


def same(found: Any, expected: Any, path: tuple[str, ...] = ()) -> None:
    """Plain data alike; numbers in a list relative to the largest of them."""
    if isinstance(expected, dict):
        expected = {key: value for key, value in expected.items() if key not in BASES}
        assert set(found) == set(expected), path
        for key, value in expected.items():
            same(found[key], value, (*path, key))
    elif is_numbers(expected):
        a, b = np.array(found, float), np.array(expected, float)
        if path[-1] == "directions":  # a direction and its opposite are one
            a, b = np.abs(a), np.abs(b)
        assert a.shape == b.shape, path
        name = next((part for part in path if part in TOLERANCES), "")
        size = max(float(np.abs(b).max()), 1.0 if path[-1] in ("share", "rest", "angles") else 1e-9)
        assert np.abs(a - b).max() <= TOLERANCES.get(name, OTHERS) * size, (path, found, expected)
    elif isinstance(expected, list):
        assert len(found) == len(expected), (path, found, expected)
        for i, value in enumerate(expected):
            same(found[i], value, path)
    else:
        assert found == expected, (path, found, expected)


def by_projectors(principal: dict[str, Any] | None) -> None:
    """Axes of equal principal values are any basis of a plane or of the space: its projector."""
    for shape in (principal or {}).values():
        values, axes = np.array(shape["values"]), np.array(shape["axes"])
        alike = np.abs(values[:, None] - values) <= OTHERS * np.abs(values).max()
        if alike.sum() > 3:
            projectors = np.einsum("ij,ja,jb->iab", alike.astype(float), axes, axes)
            shape["axes"] = projectors.tolist()


def as_shown(matrix: Any) -> np.ndarray:
    """To the digits that a page shows at most: nine of the largest entry."""
    largest = np.abs(matrix).max()
    return np.round(np.array(matrix) / 10.0 ** np.floor(np.log10(largest)), 8) + 0.0


def is_numbers(values: Any) -> bool:
    """Whether these are numbers, or lists of lists of equal length of them."""
    if isinstance(values, (bool, str, dict)) or values is None or values == []:
        return False
    if not isinstance(values, list):
        return True
    return all(is_numbers(x) for x in values) and len({np.shape(x) for x in values}) == 1


@cache
def without_a_document() -> str:
    """The modules that compute and draw; nothing in them needs a page."""
    return page_script("offline.js")


def asked(name: str, wanted: list[ViewState], what: str) -> list[Any]:
    return asked_of(program_of(name)[1], wanted, what)


def asked_of(made: BrowserProgram, wanted: list[ViewState], what: str) -> list[Any]:
    """What JavaScript answers to states; None where the posture is not plain."""
    inputs = json.dumps([s.model_dump() for s in wanted])
    return run(
        f"{made.script}\n{without_a_document()}\n"
        f"const program = new Program({json.dumps(made.data)}, globalThis.cartstiffProgram);\n"
        f"const found = {inputs}.map((state) => {{ try {{ return {what}; }} "
        "catch (error) { if (![NOT_PLAIN, NOT_CLOSED].includes(error.message)) throw error; "
        "return null; } });"
    )


@pytest.mark.parametrize("name", MECHANISMS)
def test_a_page_without_a_server_says_what_the_library_says(name):
    elastic, _ = program_of(name)
    session = Session(Source(elastic))
    wanted = states(name)
    answered = 0
    for state, found in zip(wanted, asked(name, wanted, "program.numbers(state)"), strict=True):
        if found is None:
            continue
        answered += 1
        with np.errstate(all="ignore"):
            expected = session.numbers(session.result(state), state)
        expected = json.loads(json.dumps(expected))
        for numbers in (found, expected):
            by_projectors(numbers["principal"])
        same(found, expected)
        shown = found["result"][state.quantity] | {"load": found["result"]["load"][state.quantity]}
        there = expected["result"][state.quantity]
        there = there | {"load": expected["result"]["load"][state.quantity]}
        for connection, matrix in shown.items():
            if matrix is not None:
                assert np.array_equal(as_shown(matrix), as_shown(there[connection]))
    assert answered > 0.8 * STATES


def drawn_by_library(session: Session, state: ViewState) -> tuple[Any, dict[str, Any]]:
    """Legend of a state's picture, and what is seen: commands by kind, path and property."""
    result = session.result(state)
    legend = session.picture.draw(result, state, moved_part(result, state))
    said = {}
    for (kind, path, name), packed in session.picture.by_path().items():
        read = json.loads if packed.startswith(b"{") else msgpack.unpackb
        said[kind, path.removeprefix("/meshcat/cartstiff/"), name] = read(packed)
    return json.loads(json.dumps(legend)), said


def is_hidden(said: dict[str, Any], path: str) -> bool:
    """Whether a place, or one above it, is switched off."""
    names = path.split("/")
    above = ["/".join(names[: i + 1]) for i in range(len(names))]
    return any(
        not said.get(("set_property", p, "visible"), {"value": True})["value"] for p in above
    )


@pytest.mark.parametrize("name", ["ur5", "panda", "hexapod", "five-bar", "delta"])
def test_a_page_without_a_server_draws_what_the_library_draws(name):
    """Every place, size, label, colour and scale, after whatever was drawn before."""
    elastic, made = program_of(name)
    session = Session(Source(elastic))
    base = session.result(session.start)
    data, _ = client_data(session, session.start, base, made)
    wanted = [
        state.model_copy(
            update={
                "scale": ("root", "linear", "log")[k % 3],
                "labels": k % 5 > 0,
                "translation": k % 7 > 0,
                "rotation": k % 4 > 0,
                "wrench": k % 6 > 0,
                "ghost": None if k % 3 else elastic.q.tolist(),
            }
        )
        for k, state in enumerate(states(name))
    ]
    found = run(
        f"{made.script}\n{without_a_document()}\nconst given = {json.dumps(plain(data))};"
        """const program = new Program(given.program, globalThis.cartstiffProgram);
        const pen = new Drawing(program, given.assets, given.scene);
        const found = """
        f"{json.dumps([state.model_dump() for state in wanted])}.map((state) => {{"
        """ try {
                const m = program.solve(state);
                return pen.draw(m, state, program.numbers(state, m));
            }
            catch (error) { if (![NOT_PLAIN, NOT_CLOSED].includes(error.message)) throw error; }
            return null; });"""
    )
    seen, count = dict[Any, Any](), 0
    for state, drawn in zip(wanted, found, strict=True):
        if drawn is None:
            continue
        legend, said = drawn_by_library(session, state)
        for command in drawn["commands"]:
            path, kind = command["path"].removeprefix("/meshcat/cartstiff/"), command["type"]
            kind = "set_object" if kind == "label" else kind
            seen[kind, path, command.get("property", "")] = command
        # Axes of equal principal values are any: these ellipsoids have no places to compare.
        equal = tuple(
            f"{freedom} ellipsoid/"
            for freedom, facts in legend["ellipsoids"].items()
            if facts is not None and np.ptp(facts.get("eigenvalues", [0.0, 1.0])[:2]) == 0.0
        )
        for key, command in seen.items():
            kind, path, _ = key
            if is_hidden(said, path) or key[2] == "visible":
                continue
            assert not is_hidden(seen, path), path
            assert command.get("text") == said[key].get("text"), path
            for value in ("matrix", "value"):
                if value in command and not path.startswith(equal):
                    assert command[value] == pytest.approx(said[key][value], rel=1e-6, abs=1e-8)
                    count += 1
        for freedom, facts in drawn["legend"].pop("ellipsoids").items():
            told = legend["ellipsoids"][freedom]
            assert (facts is None) == (told is None)
            if facts is not None:
                scales = facts.get("scale", {}), told.get("scale", {})
                assert scales[0].get("kind") == scales[1].get("kind")
                for name in ("value_per_length", "length_per_decade", "zero_at"):
                    own, other = (one.get(name) or 0.0 for one in scales)
                    assert own == pytest.approx(other, rel=1e-6)
                assert [facts[k] for k in ("shown", "reason")] == [told["shown"], told["reason"]]
        tension = drawn["legend"]["tension"]
        assert tension is None or tension["limits"] == legend["tension"]["limits"]
        for part in ("force", "moment"):
            length = drawn["legend"]["wrench"].get(part, 0.0)
            assert length == pytest.approx((legend["wrench"] or {}).get(part, 0.0), rel=1e-6)
    assert count > 100


@pytest.mark.parametrize("name", MECHANISMS)
def test_matrices_of_the_page_have_twelve_digits_or_it_says_how_many(name):
    """Compliances by the page's own elimination, each against the library's largest entry.

    A stiffness under its load may be nearly singular where the one of the springs is not: then no
    two ways of adding it up give twelve digits of its inverse.
    """
    elastic, _ = program_of(name)
    session = Session(Source(elastic))
    wanted = states(name, 200 if name == "stewart-gough" else STATES)
    code = """(({ K, C }) => ({ K, C, sure: Object.fromEntries(
        Object.entries(C).map(([name, one]) => [name,
            one && program.data.platform ? sureOfInverse(one) : 0])) }))(program.solve(state))"""
    for state, found in zip(wanted, asked(name, wanted, code), strict=True):
        if found is None:
            continue
        with np.errstate(all="ignore"):
            result = session.result(state)
        for connection in "ABKF":
            for mine, theirs, known in (
                (found["K"][connection], result.matrices[connection], 1e-12),
                (
                    found["C"][connection],
                    result.compliances[connection],
                    max(1e-12, found["sure"][connection]),
                ),
            ):
                if mine is None:
                    assert theirs is None
                    continue
                assert np.abs(np.array(mine) - theirs).max() <= known * np.abs(theirs).max()


@pytest.mark.parametrize(
    ("name", "start", "coordinate", "singular"),
    [
        ("ur5", (0.3, -1.1, 1.3, -0.7, 0.9, 0.2), 2, 0.0),
        ("ur5", (0.3, -1.1, 1.3, -0.7, 0.9, 0.2), 4, 0.0),
        ("cubic", None, 5, math.pi / 2),
        ("stewart-simscape", None, 5, math.pi / 2),
    ],
)
def test_near_singular_states_are_refused_by_both(name, start, coordinate, singular):
    """The page where the library has no matrix or tells of lost digits, and a decade before."""
    elastic, _ = program_of(name)
    session = Session(Source(elastic))
    q = np.array([0.0, 0.0, elastic.q[2], 0.0, 0.0, 0.0] if start is None else start)
    wanted = []
    for distance in 10.0 ** -np.arange(0.5, 13.0, 0.5):
        q[coordinate] = singular - distance
        wanted.append(ViewState(q=q.tolist()))
    answered = [one is not None for one in asked(name, wanted, "program.solve(state).K.B")]
    plain = []
    for state in wanted:
        result = session.result(state)
        codes = [note.code for note in result.notes]
        has_both = result.matrices["B"] is not None and result.compliances["B"] is not None
        plain.append(has_both and not {"ill-conditioned", "singular-stiffness"}.intersection(codes))
    assert answered[0]
    assert not answered[-1]
    assert all(there for here, there in zip(answered, plain, strict=True) if here)
    assert all(here for here, nearer in zip(answered, plain[2:], strict=False) if nearer)


def test_singular_postures_are_not_answered():
    arm, _ = program_of("ur5")
    straight = [0.3, -1.1, 0.0, -0.7, 0.9, 0.2]
    near = [0.3, -1.1, 1e-7, -0.7, 0.9, 0.2]
    assert cartstiff.analyse(arm, straight).matrices["B"] is None
    assert "ill-conditioned" in [note.code for note in cartstiff.analyse(arm, near).notes]
    usual = ViewState(q=arm.q.tolist())
    wanted = [
        usual,
        ViewState(q=straight),
        ViewState(q=near),
        usual.model_copy(update={"stiffness": [1e-3, *[1e9] * 5]}),
    ]
    found = asked("ur5", wanted, "program.result(state)")
    assert [one is None for one in found[:3]] == [False, True, True]
    whole = json.loads(json.dumps(cartstiff.analyse(arm).to_dict()))
    del whole["stored_energy"]
    same(found[0], whole)
    with pytest.raises(UndefinedError):
        cartstiff.analyse(arm, straight, strict=True)


def test_a_hand_is_followed_to_the_pose_and_to_the_limits():
    arm, _ = program_of("ur5")
    goal = cartstiff.analyse(arm, arm.q + 0.2).pose
    far = goal.copy()
    far[:3, 3] *= 4.0
    poses = json.dumps([goal.tolist(), far.tolist()])
    code = f"{poses}.map((T) => follow(program, state.q, T))"
    near, away = asked("ur5", [ViewState(q=arm.q.tolist())], code)[0]
    assert near["reached"]
    assert np.allclose(cartstiff.analyse(arm, near["q"]).pose, goal, atol=1e-5)
    assert not away["reached"]
    library = Follower(arm).follow(arm.q, far)
    assert away["distance"] <= library.distance + 0.05
    platform, _ = program_of("stewart-simscape")
    start = np.array(platform.q)
    T = cartstiff.analyse(platform).pose
    T_up = se3.pose(translation=[0, 0, 0.02 * platform.mechanism.length]) @ T
    code = f"follow(program, state.q, {json.dumps(T_up.tolist())})"
    lifted = asked("stewart-simscape", [ViewState(q=start.tolist())], code)[0]
    assert np.allclose(cartstiff.analyse(platform, lifted["q"]).pose, T_up, atol=1e-9)


@pytest.mark.parametrize("name", ["five-bar", "3-rps", "6-ups", "delta", "4-rrr"])
def test_a_closed_chain_is_assembled_led_and_swept_as_by_the_library(name):
    """Whole answers, a hand, and a sweep over the range of the first drive."""
    elastic, made = program_of(name)
    session, mechanism = Session(Source(elastic)), elastic.mechanism
    drives = list(mechanism.actuated)
    size = mechanism.at(elastic.q).length
    q = elastic.q.copy()
    q[drives] += 0.4 * np.where(np.array(made.data["are_lengths"])[drives], size, 1.0)
    if len(drives) > made.data["closing"]["freedoms"]:
        q = np.array(mechanism.closed(q).q)  # they cannot all go where they like
    far = ViewState(q=q.tolist())
    (found,) = asked(name, [far], "program.result(state)")
    whole = json.loads(json.dumps(cartstiff.analyse(elastic, q).to_dict()))
    for key in ("stored_energy", "legs"):
        whole.pop(key, None)
    same(found, whole)
    assert np.abs(mechanism.closed(found["q"]).q - found["q"]).max() < 1e-12
    goal = json.dumps(cartstiff.analyse(elastic, q).pose.tolist())
    start = ViewState(q=elastic.q.tolist())
    (followed,) = asked(name, [start], f"follow(program, state.q, {goal})")
    assert followed["reached"]
    assert np.allclose(mechanism.at(followed["q"]).pose, json.loads(goal), atol=1e-4 * size)
    assert mechanism.at(followed["q"]).residual is not None
    assert np.abs(mechanism.at(followed["q"]).residual).max() < 1e-10
    i = drives[0]
    steps = np.linspace(-0.3, 0.3, 7) * (size if mechanism.coordinates[i].is_length else 1.0)
    code = (
        "({rows: ComputingSource.prototype.rows, row: ComputingSource.prototype.row, program})"
        f".rows({i}, {(elastic.q[i] + steps).tolist()}, state)"
    )
    (rows,) = asked(name, [start], code)
    for x, row in zip(elastic.q[i] + steps, rows, strict=True):
        wanted = elastic.q.copy()
        wanted[i] = x
        if "reason" in row:
            assert "does not close" in row["reason"] or "do not close" in row["reason"], row
            continue
        with np.errstate(all="ignore"):
            there = series_row(session.result(ViewState(q=wanted.tolist())), start)
        assert row["q"][i] == pytest.approx(x, abs=1e-12)
        for key in ("translation", "rotation", "singularity", "energy"):
            same(row[key], json.loads(json.dumps(there[key])), (key,))
    assert sum("reason" not in row for row in rows) >= (1 if name == "4-rrr" else 5)


@pytest.mark.parametrize("name", ["stewart-simscape", "hexapod"])
def test_a_file_gives_the_legs_of_any_posture(name):
    """Lengths, forces and margins under a load, as `cartstiff analyse --json`."""
    elastic, _ = program_of(name)
    q = elastic.q + 0.02 * np.array([1.0, -1.0, 2.0, 0.5, 0.7, -0.3])
    load = (0.4, -0.2, 0.3, 5.0, -7.0, 6.0)
    (found,) = asked(name, [ViewState(q=q.tolist(), load=load)], "program.result(state)")
    result = cartstiff.analyse(elastic, q, wrench=load)
    wanted = json.loads(json.dumps(result.to_dict()))["legs"]
    assert [leg["name"] for leg in found["legs"]] == [f"leg{i}" for i in range(1, 7)]
    for leg, one in zip(found["legs"], wanted, strict=True):
        assert leg.keys() == one.keys()
        for key in ("position", "force", "margin"):
            assert leg[key] == (one[key] and pytest.approx(one[key], rel=1e-9)), key


@pytest.mark.parametrize("name", ["cubic", "stewart-simscape"])
def test_legs_of_given_lengths_and_twists_lead_to_the_library_s_pose(name):
    elastic, _ = program_of(name)
    platform, q = elastic.mechanism, np.array(elastic.q)
    draw = np.random.default_rng(5)
    lengths = platform.leg_lengths(q) * (1.0 + 0.03 * draw.uniform(-1, 1, 6))
    start = [ViewState(q=q.tolist())]
    (found,) = asked(name, start, f"stretched(program, state.q, {json.dumps(lengths.tolist())})")
    assert np.allclose(platform.leg_lengths(np.array(found)), lengths, rtol=1e-12)
    assert np.allclose(found, platform.forward_kinematics(lengths, q), atol=1e-9)
    twist = np.array([0.3, -0.2, 0.4, 0.0, 0.0, 0.0])
    code = f"program.place(program.along(program.place(state.q), {twist.tolist()})).pose"
    (turned,) = asked(name, start, code)
    assert np.allclose(turned, cartstiff.analyse(elastic).pose @ se3.exp(twist), atol=1e-12)


def test_every_operation_is_that_of_numpy():
    tape = Tape()
    x, y = tape.vector("x", 2)
    k = tape.input("k", 0)
    values = [
        x + y,
        x - y,
        x * y,
        x / y,
        -x,
        square_root(absolute(x)),
        absolute(y),
        sine(x),
        cosine(y),
        larger(x, y),
        copysign(x, y),
        copysign(y, -x),
        pick(x, y, k, 2.5e-300),
        x * 3.0 + k,
        1.0 / x,
        pick(x, math.nan, 1.0, k),
    ]
    program = tape.program(
        {"a": np.array(values[:5], object), "b": np.array(values[5:], object)}, ["k"]
    )
    draw = np.random.default_rng(3)
    rows = np.concatenate([draw.normal(size=(20, 2)), [[0.0, -0.0], [-0.0, 1.0], [1e300, 1e-300]]])
    out = {"a": np.empty((len(rows), 5)), "b": np.empty((len(rows), 11))}
    inputs = {"x": rows, "k": np.array([[7.0]])}
    PortableKernel(program).run(inputs, out, len(rows))
    source, places = javascript(program)
    assert places == {"a": (0, 5), "b": (5, 16)}
    given = json.dumps(rows.tolist())
    bits = run(
        f"{HELPERS} const f = {source}; const found = {given}.map((x) => {{ const o = new "
        "Float64Array(16); f({x, k: [7]}, o); return Array.from(new BigUint64Array(o.buffer), "
        "String); });"
    )
    found = np.array(bits, dtype=np.uint64).view(float)
    expected = np.concatenate([out["a"], out["b"]], axis=1)
    exact = [i for i in range(16) if i not in (7, 8)]  # all but sine and cosine
    assert np.array_equal(found[:20, exact], expected[:20, exact])
    assert np.array_equal(np.signbit(found[:, 10:12]), np.signbit(expected[:, 10:12]))
    assert np.allclose(found, expected, rtol=1e-13, equal_nan=True)


#: Quantities of the table that the page shows, and where they are in its numbers.
SHOWN = {
    f"{prefix}{freedom}_{others}_{end}": (quantity, others, freedom, i)
    for prefix, quantity in (("", "stiffness"), ("compliance_", "compliance"))
    for freedom in ("translation", "rotation")
    for others in ("free", "held")
    for end, i in (("min", 0), ("max", 2))
}
OF_INDICES = {
    "condition": lambda x: x["condition_number"],
    "minimum": lambda x: x["eigenvalues"][0],
    "unstable_directions": lambda x: sum(value < 0.0 for value in x["eigenvalues"]),
    "translation_condition": lambda x: x["translational_condition"],
    "rotation_condition": lambda x: x["rotational_condition"],
    "natural_length": lambda x: x["length"] if x["length_origin"] == "natural" else None,
}


@pytest.mark.parametrize("name", ["ur5", "panda", "stewart-simscape"])
def test_what_the_page_computes_is_the_table_of_quantities(name):
    """Each number of the table that JavaScript finds, against stacks, under a load that turns."""
    elastic, _ = program_of(name)
    load = (0.4, -0.2, 0.3, 5.0, -7.0, 6.0)
    wanted = [
        replace_state(state, quantity, others, load)
        for state in states(name, 8)
        for quantity in ("stiffness", "compliance")
        for others in ("free", "held")
    ]
    found = asked(name, wanted, "program.numbers(state)")
    for first in range(0, len(wanted), 4):
        four = found[first : first + 4]
        if None in four:
            continue
        of = {(s.quantity, s.others): x for s, x in zip(wanted[first:], four, strict=False)}
        indices = four[0]["indices"]
        settings = Settings(
            "load", indices["length"], load=LoadKind("dead", (0.0, 0.0, 0.0)), is_loaded=True
        )
        names = (*SHOWN, *OF_INDICES, "deflection", "deflection_angle")
        chosen = choose_quantities(names, settings, elastic)
        arrays = analyse_many(
            elastic, [wanted[first].q], wrench=load, outputs=needed_outputs(chosen, settings)
        ).arrays
        values = {key: value[0] for key, value in evaluate(chosen, arrays, settings).items()}
        moved = four[0]["moved"]
        shown = {k: of[q, o]["principal"][f]["values"][i] for k, (q, o, f, i) in SHOWN.items()}
        shown |= {key: read(indices) for key, read in OF_INDICES.items()}
        shown |= {
            "deflection": math.hypot(*moved["displacement"]),
            "deflection_angle": math.hypot(*moved["rotation"]),
        }
        for key, one in shown.items():
            assert (one is not None) == bool(np.isfinite(values[key])), key
            close = max(1e-9, 1e-12 * values["condition"])
            assert one is None or one == pytest.approx(values[key], rel=close), key


def replace_state(
    state: ViewState, quantity: str, others: str, load: tuple[float, ...]
) -> ViewState:
    """The posture of a state, its springs and frame those of the mechanism."""
    return ViewState(
        q=state.q, connection="load", quantity=quantity, others=others, load=load, load_kind="dead"
    )


@pytest.mark.parametrize("name", ["ur5", "panda", "five-bar", "3-prs", "hexapod", "6-ups"])
def test_forces_of_drives_and_task_axes_are_those_of_the_command(name):
    """At another posture than the page's, by statics and by the compliance of the components."""
    elastic, made = program_of(name)
    wrench = (1.0, -2.0, 0.5, 3.0, -5.0, -10.0)
    q = np.array(elastic.q)
    q[:1] += 0.02
    state = ViewState(q=q.tolist(), load=wrench, load_axes="body")
    (found,) = asked_of(made, [state], "program.result(state)")
    expected = cartstiff.analyse(elastic, found["q"], wrench=wrench).to_dict()
    assert ("task_axes" in found) == ("task_axes" in expected) == (name in ("five-bar", "3-prs"))
    for one, other in zip(found["forces"], expected["forces"], strict=True):
        assert one == other | {
            key: pytest.approx(other[key], rel=1e-9)
            for key in ("force", "margin", "used")
            if other[key] is not None
        }
    for key in ("motions", "stiffness", "tangent"):
        if "task_axes" in found:
            ours, theirs = (np.array(one["task_axes"][key]) for one in (found, expected))
            np.testing.assert_allclose(ours, theirs, rtol=1e-9, atol=1e-9 * np.abs(theirs).max())


def with_efforts(name: str, most: float) -> Any:
    """A mechanism whose drives exert so much at most, in either direction."""
    elastic = cartstiff.load(name)
    drives = (elastic.names[j] for j in elastic.mechanism.actuated)
    return dataclasses.replace(elastic, efforts=dict.fromkeys(drives, (-most, most)))


def limited_platform(folder: Path, rest: float | None) -> Any:
    """A body on six legs that carry -10 to 20 kN."""
    legs = {"stiffness": 1e5, "force": [-1e4, 2e4]}
    legs |= {} if rest is None else {"rest_length": rest}
    return cartstiff.load(write_file(folder, **(PLATFORM | {"legs": legs})))


#: Mechanisms whose limits of forces the loads below pass, see `SIZES`.
STRAINED = {
    "ur5 with its weight": lambda _: cartstiff.load("ur5").with_gravity(),
    "panda": lambda _: cartstiff.load("panda"),
    "xarm7, wound up": lambda _: cartstiff.load("xarm7"),
    "five-bar": lambda _: with_efforts("five-bar", 1.0),
    "4-rrr": lambda _: with_efforts("4-rrr", 1.0),
    "delta": lambda _: with_efforts("delta", 0.01),
    "platform, no rest lengths": lambda folder: limited_platform(folder, None),
    "platform, rest lengths": lambda folder: limited_platform(folder, 0.9),
}
SIZES = {"delta": 0.02, "panda": 20.0, "ur5 with its weight": 60.0, "xarm7, wound up": 2e3}


@pytest.mark.parametrize("name", STRAINED)
def test_forces_beyond_their_limits_are_told_as_by_the_library(name, tmp_path):
    """Also where the weight acts, where drives are more than motions, and where links bend."""
    elastic = STRAINED[name](tmp_path)
    made = browser_program(elastic, cartstiff.analyse(elastic))
    assert isinstance(made, BrowserProgram), made
    platform = elastic.mechanism.coordinates_are_pose
    size = SIZES.get(name, 1e4 if platform else 5.0)
    wrench = size * np.array([0.1, -0.2, 0.05, 3.0, -5.0, -10.0])
    at = [ViewState(q=elastic.q.tolist(), load=load) for load in (None, tuple(wrench))]
    answered = asked_of(made, at, "program.result(state)")
    count = 0
    for found, load in zip(answered, (None, wrench), strict=True):
        expected = json.loads(json.dumps(cartstiff.analyse(elastic, wrench=load).to_dict()))
        same(found["forces"], expected["forces"])
        same(found["notes"], expected["notes"])
        count += any(note["code"] == "force-limits" for note in found["notes"])
    assert count
    assert "legs" in made.data["base"] or not platform
