"""A program is the core at plainly regular postures, says where it is not, and is C as well."""

from __future__ import annotations

import ctypes
import json
import pickle
import shutil
import subprocess
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from tests.support.generated import Arm

import cartstiff
from cartstiff.errors import InputError, UnknownNameError
from cartstiff.stiffness.balance import with_rest_balancing

LOAD = np.array([4.0, -3.0, 2.0, 20.0, 30.0, -40.0])
MINE = cartstiff.levi_civita(np.diag([1.0, 2.0, 3.0, 4.0, 5.0, 6.0]), "mine")
#: In other axes, at another point, of another kind.
ACTING: dict[str, Any] = {
    "load_axes": "world",
    "load_at": [0.05, -0.02, 0.1],
    "load_kind": "follower",
}


def later(*cases: Any) -> list[Any]:
    """Cases of `make thorough` and of this file when it is named."""
    each = [case if isinstance(case, tuple) else (case,) for case in cases]
    return [pytest.param(*case, marks=pytest.mark.thorough) for case in each]


def pull(arrays):
    """What the stiffness of translations makes of the force: a function of a user's own."""
    return arrays["stiffness_B"][3:, 3:] @ arrays["wrench"][3:]


def postures(elastic, count, spread, seed=3):
    rng = np.random.default_rng(seed)
    sizes = np.array([0.2 if c.is_length else 1.0 for c in elastic.mechanism.coordinates])
    moved = spread * sizes * rng.uniform(-1.0, 1.0, (count, len(sizes)))
    held = elastic.mechanism.closures and elastic.mechanism.held
    if held:
        moved[:, np.setdiff1d(np.arange(len(sizes)), list(held))] = 0.0
    return elastic.q + moved


def close(found, expected, share=1e-11):
    assert np.abs(found - expected).max() <= share * np.abs(expected).max()


@pytest.mark.parametrize("loaded", [False, True])
@pytest.mark.parametrize("name", ["ur5", "stewart-gough", *later("panda", "cable-robot")])
def test_a_program_is_the_core(name, loaded):
    elastic = cartstiff.load(name)
    acting = ACTING if loaded else {}
    program = cartstiff.record(
        elastic,
        ["B", "K", "compliance_load", "wrench", "pose", MINE, pull],
        loaded=loaded,
        **acting,
    )
    plain = 0
    for q in postures(elastic, 12, 0.05):
        wrench = {"wrench": LOAD} if loaded else {}
        answer = program(q, **wrench)
        core = cartstiff.analyse(elastic, q, **wrench, **acting)
        plain += answer.is_plain
        assert answer.state == "regular"
        close(answer.B, core.matrices["B"])
        close(answer["stiffness_K"], core.matrices["K"])
        close(answer["compliance_load"], core.tangent_compliance)
        close(answer.pose, core.pose)
        close(answer.stiffness_mine, core.tensor(MINE).matrix)
        close(answer.compliance_mine, np.linalg.inv(core.tensor(MINE).matrix), 1e-8)
        if loaded:
            close(answer.wrench, core.wrench)
            close(answer.pull, core.matrices["B"][3:, 3:] @ core.wrench[3:])
    assert plain >= 8


def test_postures_that_are_not_plain_are_the_core_s():
    arm = cartstiff.load("ur5")
    straight = arm.q.copy()
    straight[4] = 0.0  # the wrist's axes align
    program = cartstiff.record(arm, ["B", "compliance_B"])
    answer, core = program(straight), cartstiff.analyse(arm, straight)
    assert not answer.is_plain
    assert answer.state == "serial-singularity" == core.reduction.states[-1].code
    assert np.isnan(answer.B).all()
    close(answer.compliance_B, core.compliances["B"])
    assert "by analyse" in repr(answer)
    for distance in 10.0 ** np.arange(-14.0, -1.0):
        near = straight.copy()
        near[4] = distance
        states = cartstiff.analyse(arm, near).reduction.states
        assert not (states and program(near).is_plain)


def test_a_program_can_be_pickled_and_has_many_postures():
    robot = cartstiff.load("stewart-gough")
    program = pickle.loads(pickle.dumps(cartstiff.record(robot, ["B", MINE])))
    Q = postures(robot, 5, 0.02)
    many = program.many(Q)
    for i, q in enumerate(Q):
        close(many["stiffness_mine"][i], program(q).stiffness_mine)
        close(many.B[i], program(q).B)
    assert set(many.arrays) == {"stiffness_B", "stiffness_mine", "compliance_mine"}
    labelled = cartstiff.record(robot, ["B", pull]).many(Q).to_xarray()
    assert labelled["pull"].dims == ("posture", "pull_1")
    assert pickle.loads(pickle.dumps(program(Q[0]))).B.shape == (6, 6)


@pytest.mark.parametrize("name", ["ur5", "stewart-gough"])
def test_springs_may_be_inputs(name):
    elastic = cartstiff.load(name)
    elastic = with_rest_balancing(elastic, elastic.q)
    springs = elastic.springs
    k, rest = 1.3 * springs.stiffness, springs.rest + 1e-3
    other = replace(elastic, springs=springs.replaced(k, rest))
    program = cartstiff.record(elastic, ["B", "wrench"], inputs=("stiffness", "rest"))
    for q in postures(elastic, 4, 0.02):
        close(program(q).B, cartstiff.analyse(elastic, q).matrices["B"])
        core = cartstiff.analyse(other, q)
        answer = program(q, stiffness=k, rest=rest)
        close(answer.B, core.matrices["B"])
        close(answer.wrench, core.wrench, 1e-9)
        many = program.many([q], stiffness=k, rest=rest)
        close(many.B[0], core.matrices["B"])
    loaded = cartstiff.record(elastic, "B", loaded=True, inputs=["stiffness"])
    core = cartstiff.analyse(other, elastic.q, wrench=LOAD)
    close(loaded(elastic.q, LOAD, stiffness=k).B, core.matrices["B"])
    with pytest.raises(UnknownNameError, match="input"):
        loaded(elastic.q, LOAD, rest=rest)
    with pytest.raises(InputError, match="no inputs"):
        cartstiff.record(elastic, "B", loaded=True, inputs=["rest"])


def test_without_machine_code(monkeypatch):
    monkeypatch.setattr("cartstiff.batch.program.has_package", lambda _: False)
    arm = cartstiff.load("ur5")
    program = cartstiff.record(arm, "B")
    assert (program.path, program.reason) == ("python", "llvmlite is not installed")
    q = postures(arm, 1, 0.1)[0]
    close(program(q).B, cartstiff.analyse(arm, q).matrices["B"])


def test_refusals():
    arm = cartstiff.load("ur5")
    program = cartstiff.record(arm, "B")
    with pytest.raises(InputError, match="recorded without a load; expected loaded=True"):
        program(arm.q, LOAD)
    with pytest.raises(InputError, match="recorded under a load"):
        cartstiff.record(arm, "B", loaded=True)(arm.q)
    with pytest.raises(InputError, match="q"):
        program(arm.q[:3])
    with pytest.raises(InputError, match="q"):
        program(np.full(6, np.nan))
    with pytest.raises(UnknownNameError):
        cartstiff.record(arm, "stiffnes_B")
    with pytest.raises(UnknownNameError):
        cartstiff.record(arm, {"own": lambda a: a["stiffnes_B"]})
    with pytest.raises(InputError, match="a name, a connection, or a function"):
        cartstiff.record(arm, {"own": 3.0})
    with pytest.raises(InputError, match="its own name"):
        cartstiff.record(arm, {"wrench": lambda a: a["pose"][0]})
    with pytest.raises(UnknownNameError, match="language"):
        program.source("fortran")
    with pytest.raises(InputError, match="no source"):
        cartstiff.record(cartstiff.load("flexure-hexapod"), "B").source("c")


@pytest.mark.parametrize(
    ("name", "outputs", "loaded"),
    [
        ("ur5", ["B", "compliance_load", "pose"], True),
        ("stewart-gough", ["K", "compliance_B", "wrench"], False),
        ("6-pus", ["compliance_B", "pose"], False),
        *later(("panda", ["compliance_B"], False)),
    ],
)
def test_c_is_the_program(name, outputs, loaded, tmp_path):
    compiler = shutil.which("cc")
    if compiler is None:
        pytest.skip("no C compiler")
    elastic = cartstiff.load(name)
    inputs = ("stiffness",) if name == "panda" else ()
    program = cartstiff.record(elastic, outputs, loaded=loaded, inputs=inputs)
    more = [1.1 * elastic.springs.stiffness] if inputs else []
    numbers = dict(zip(inputs, more, strict=True))
    source = program.source("c", "stiffness")
    assert f"  0: {elastic.names_with_units[0]}" in source
    file, library = tmp_path / "stiffness.c", tmp_path / "stiffness.so"
    file.write_text(source)
    words = ["-std=c99", "-Wall", "-Wextra", "-Werror", "-O2", "-shared", "-fPIC", "-lm"]
    subprocess.run([compiler, str(file), "-o", str(library), *words], check=True)
    function = ctypes.CDLL(str(library)).stiffness
    doubles = ctypes.POINTER(ctypes.c_double)
    out = np.zeros(sum(program(elastic.q, *[LOAD] * loaded)[n].size for n in program.names))
    plain = 0
    for q in postures(elastic, 1000, 0.05):
        here = q.copy()
        arrays = [here, *[LOAD] * loaded, *more, out]
        refused = function(*(array.ctypes.data_as(doubles) for array in arrays))
        answer = program(q, *[LOAD] * loaded, **numbers)
        assert bool(refused) is not answer.is_plain
        if answer.is_plain:
            plain += 1
            found = np.concatenate([answer[n].ravel() for n in program.names])
            sizes = [np.full(answer[n].size, np.abs(answer[n]).max()) for n in program.names]
            assert (np.abs(out - found) <= 1e-13 * np.concatenate(sizes)).all()
            assert np.abs(here - answer.q).max() <= 1e-13
    assert plain > 500


@pytest.mark.parametrize("language", ["python", "javascript"])
def test_other_languages_are_the_program(language):
    arm = cartstiff.load("ur5")
    program = cartstiff.record(arm, ["B", "wrench"], loaded=True)
    source, q = program.source(language, "stiffness"), postures(arm, 1, 0.1)[0]
    answer = program(q, LOAD)
    expected = np.concatenate([answer.B.ravel(), answer.wrench])
    straight = arm.q.copy()
    straight[4] = 0.0
    if language == "python":
        known: dict[str, Any] = {}
        exec(source, known)
        is_plain, found = known["stiffness"](q.tolist(), LOAD.tolist())
        assert is_plain
        assert not known["stiffness"](straight.tolist(), LOAD.tolist())[0]
    else:
        if (node := shutil.which("node")) is None:
            pytest.skip("no node")
        calls = f"[{q.tolist()},{straight.tolist()}].map(q=>stiffness(q,{LOAD.tolist()}))"
        text = f"{source};console.log(JSON.stringify({calls}))"
        printed = subprocess.run(
            [node, "-"], input=text, capture_output=True, check=True, text=True
        )
        found, refused = json.loads(printed.stdout)
        assert refused is None
    close(np.array(found), expected, 1e-13)


@pytest.mark.parametrize("seed", [3, 4, *later(*range(5, 20))])
def test_generated_arms(seed, tmp_path):
    """Two to seven joints, some of which slide, with weight and payload, under any load."""
    elastic = cartstiff.load(Arm.generated(seed).written(tmp_path))
    outputs = ["compliance_load", "compliance_A", "wrench", "pose", "energy"]
    program = cartstiff.record(elastic, outputs, loaded=True, **ACTING)
    for q in postures(elastic, 4, 0.3):
        answer = program(q, LOAD)
        core = cartstiff.analyse(elastic, q, wrench=LOAD, **ACTING)
        state = core.reduction.states[-1].code if core.reduction.states else "regular"
        assert answer.state == state
        close(answer.compliance_load, core.tangent_compliance)
        close(answer.compliance_A, core.compliances["A"])
        close(answer.pose, core.pose, 1e-13)
        close(answer.wrench, core.wrench)
        assert answer.energy == pytest.approx(core.energy, rel=1e-11)
