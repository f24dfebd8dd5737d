"""A program is the core at plainly regular postures, says where it is not, and is C as well."""

from __future__ import annotations

import ctypes
import json
import pickle
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from scipy.spatial.transform import Rotation
from tests.doors import with_rest_balancing
from tests.support import (
    absolute_error,
    refused,
    relative_error,
)
from tests.support.generated import Arm, FourBar

import cartstiff
from cartstiff import InputError
from cartstiff.core.errors import UnknownNameError
from cartstiff.extend import QUANTITIES

LOAD = np.array([4.0, -3.0, 2.0, 20.0, 30.0, -40.0])
MINE = cartstiff.geometry.levi_civita(np.diag([1.0, 2.0, 3.0, 4.0, 5.0, 6.0]), "mine")
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


def moved(arrays):
    """What the compliance makes of the wrench."""
    return arrays["compliance_B"] @ arrays["wrench"]


def postures(elastic, count, spread, seed=3):
    rng = np.random.default_rng(seed)
    sizes = np.array([0.2 if c.is_length else 1.0 for c in elastic.mechanism.coordinates])
    moved = spread * sizes * rng.uniform(-1.0, 1.0, (count, len(sizes)))
    held = elastic.mechanism.closures and elastic.mechanism.held
    if held:
        moved[:, np.setdiff1d(np.arange(len(sizes)), list(held))] = 0.0
    return elastic.q + moved


def close(found, expected, share=1e-11):
    assert relative_error(found, expected) <= share


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
        close(answer["B"], core.matrices["B"])
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
    assert np.isnan(answer["B"]).all()
    close(answer.compliance_B, core.compliances["B"])
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
        close(many.B[i], program(q)["B"])
    assert set(many.arrays) == {"stiffness_B", "stiffness_mine", "compliance_mine"}
    labelled = cartstiff.record(robot, ["B", pull]).many(Q).to_xarray()
    assert labelled["pull"].dims == ("posture", "pull_1")
    answer = pickle.loads(pickle.dumps(program(Q[0])))
    assert answer["B"].shape == (6, 6)
    # Whatever else is read is that of `analyse`, whose result has the same outputs.
    core = cartstiff.analyse(robot, Q[0])
    assert type(answer) is type(core)
    assert [note.code for note in answer.notes] == [note.code for note in core.notes]
    assert answer.to_dict().keys() == core.to_dict().keys()
    assert answer.state == core.state == "regular"
    assert (answer.is_plain, core.is_plain) == (True, False)
    close(answer["stiffness_K"], core["K"])
    close(core["compliance_load"], core.tangent_compliance)
    with pytest.raises(UnknownNameError, match="output"):
        core["stiffnes_K"]


@pytest.mark.parametrize("name", ["ur5", "stewart-gough"])
def test_springs_may_be_inputs(name):
    elastic = cartstiff.load(name)
    elastic = with_rest_balancing(elastic, elastic.q)
    springs = elastic.springs
    k, rest = 1.3 * springs.stiffness, springs.rest + 1e-3
    other = replace(elastic, springs=springs.replaced(k, rest))
    program = cartstiff.record(elastic, ["B", "wrench"], inputs=("stiffness", "rest"))
    for q in postures(elastic, 4, 0.02):
        close(program(q)["B"], cartstiff.analyse(elastic, q).matrices["B"])
        core = cartstiff.analyse(other, q)
        answer = program(q, stiffness=k, rest=rest)
        close(answer["B"], core.matrices["B"])
        close(answer.wrench, core.wrench, 1e-9)
        many = program.many([q], stiffness=k, rest=rest)
        close(many.B[0], core.matrices["B"])
    loaded = cartstiff.record(elastic, "B", loaded=True, inputs=["stiffness"])
    core = cartstiff.analyse(other, elastic.q, wrench=LOAD)
    close(loaded(elastic.q, LOAD, stiffness=k)["B"], core.matrices["B"])
    refused("input", loaded, elastic.q, LOAD, rest=rest, kind=UnknownNameError)
    refused("no inputs", cartstiff.record, elastic, "B", loaded=True, inputs=["rest"])


def test_numbers_of_struts_between_flexures_may_be_inputs():
    """The recorded arithmetic keeps its own: the core answers, and the program says why."""
    elastic = cartstiff.load("flexure-hexapod", gravity=[0.0, 0.0, -9.81])
    names = ["load_at", "payload", "stiffness"]
    program = cartstiff.record(elastic, ["B", "wrench"], loaded=True, inputs=names)
    assert (program.path, program.reason.split(" keep")[0]) == (
        "engine",
        "drives outside of the recorded arithmetic",
    )
    k, at = elastic.springs.stiffness * np.linspace(0.8, 1.2, 6), [0.01, 0.02, 0.03]
    springs = elastic.springs.replaced(k, elastic.springs.rest)
    other = replace(elastic, springs=springs).with_payload(2.0, np.array([0.0, 0.0, 0.05]))
    given = {"stiffness": k, "payload": [2.0, 0.0, 0.0, 0.05], "load_at": at}
    core = cartstiff.analyse(other, elastic.q, wrench=0.1 * LOAD, load_at=at)
    close(program(elastic.q, 0.1 * LOAD, **given)["B"], core["B"])
    close(program.many([elastic.q], 0.1 * LOAD, **given).wrench[0], core.wrench)


@pytest.mark.parametrize(("name", "output"), [("ur5", "tensions"), ("stewart-gough", "torques")])
def test_an_output_that_a_mechanism_has_not(name, output):
    """As of `analyse_many`: not a number, and nothing without legs."""
    elastic = cartstiff.load(name)
    program = cartstiff.record(elastic, ["pose", output])
    many = cartstiff.analyse_many(elastic, [elastic.q], outputs=[output])
    found = [program(elastic.q)[output], program.many([elastic.q])[output][0]]
    if output == "torques":  # the core's as well
        found.append(cartstiff.analyse(elastic)[output])
    for one in found:
        assert one.shape == many[output][0].shape
        assert np.isnan(one).all()


@pytest.mark.usefixtures("without_machine_code")
def test_what_no_motor_holds_is_assembled_as_by_the_core(tmp_path):
    """Coordinates that are given stay."""
    springs = {joint: {"stiffness": 500.0} for joint in ("motor", "elbow")}
    bars = cartstiff.load(FourBar.generated(3).written(tmp_path, springs=springs))
    answer = cartstiff.record(bars, "pose")(q := bars.q + np.array([0.1, 0.0, 0.0]))
    assert answer.is_plain
    close(answer.q, cartstiff.analyse(bars, q).q)


@pytest.mark.thorough
def test_many_assemble_with_the_tool_of_the_call():
    """Where nothing holds the fingers, the least change depends on where M is."""
    grasp, tool = cartstiff.load("grasp"), [0.2, -0.1, 0.1, 0.3, 0.1, -0.2]
    program = cartstiff.record(grasp, "pose", inputs=["tcp"])
    q = np.where(np.arange(len(grasp.q)) == 1, grasp.q + 0.05, grasp.q)
    close(program.many([q], tcp=tool).q[0], program(q, tcp=tool).q)


@pytest.mark.thorough
@pytest.mark.usefixtures("without_machine_code")
def test_quantities_of_few_motions_read_no_round_off():
    """Of a body that only translates, whose rotations give nothing."""
    robot = cartstiff.load("orthoglide")
    name = "compliance_translation_held_min"
    program = cartstiff.record(robot, name)
    for q in postures(robot, 2, 0.05):
        softest = np.linalg.eigvalsh(cartstiff.analyse(robot, q).compliances["B"][3:, 3:])
        found = [program(q)[name], program.many([q])[name][0]]
        assert program(q).is_plain
        close(found, softest[[0, 0]], 1e-9)


def test_torques_of_rigid_joints_are_the_core_s():
    arm = cartstiff.load("ur5").with_springs({"elbow_joint": np.inf})
    program = cartstiff.record(arm, "torques", loaded=True)
    core = cartstiff.analyse(arm, wrench=LOAD).torques
    assert abs(core[2]) > 1.0
    close(program(arm.q, LOAD).torques, core)


def test_outputs_of_a_user_s_own_exist_each_by_itself():
    """A planar machine has no stiffness, and so none under a connection; a function has its own."""
    elastic = cartstiff.load("4-rrr")
    program = cartstiff.record(elastic, [MINE, pull, moved])
    for q in postures(elastic, 3, 0.05):
        many = program.many([q])
        assert np.isfinite(many["moved"]).all()
        assert np.isfinite(program(q)["moved"]).all()
        assert np.isnan(many["stiffness_mine"]).all()


def test_no_code_is_made_in_a_call(monkeypatch):
    program = cartstiff.record(cartstiff.load("delta"), "B", loaded=True)
    monkeypatch.setattr("cartstiff.recorded.execution.CompiledKernel._compile", None)
    assert program(program.elastic.q, 0.1 * LOAD).is_plain


@pytest.fixture
def without_machine_code(monkeypatch):
    for module in ("program", "assembly"):
        monkeypatch.setattr(f"cartstiff.recorded.{module}.has_package", lambda _: False)


@pytest.mark.usefixtures("without_machine_code")
def test_without_machine_code():
    arm = cartstiff.load("ur5")
    program = cartstiff.record(arm, "B")
    assert (program.path, program.reason) == ("python", "llvmlite is not installed")
    q = postures(arm, 1, 0.1)[0]
    close(program(q)["B"], cartstiff.analyse(arm, q).matrices["B"])


def test_refusals():
    arm = cartstiff.load("ur5")
    program = cartstiff.record(arm, "B")
    refused("recorded without a load; expected loaded=True", program, arm.q, LOAD)
    refused("recorded under a load", cartstiff.record(arm, "B", loaded=True), arm.q)
    refused("q", program, arm.q[:3])
    refused("q", program, np.full(6, np.nan))
    with pytest.raises(UnknownNameError):
        cartstiff.record(arm, "stiffnes_B")
    with pytest.raises(UnknownNameError):
        cartstiff.record(arm, {"own": lambda a: a["stiffnes_B"]})
    refused("a name, a connection, or a function", cartstiff.record, arm, {"own": 3.0})
    refused("its own name", cartstiff.record, arm, {"wrench": lambda a: a["pose"][0]})
    alike = [lambda a: a["pose"][0], lambda a: a["pose"][1]]
    refused(r"two outputs have the same name.*<lambda>", cartstiff.record, arm, alike)
    assert cartstiff.record(arm, ["B", "stiffness_B"]).names == ("stiffness_B",)
    for name in ("B", "q", "W", "", 3):  # an answer or a data set has another under this name
        refused("its own name", cartstiff.record, arm, {name: lambda a: a["pose"][0]})
    refused("keeps its name; expected B", cartstiff.record, arm, {"K": "B"})
    refused("loaded; expected True or False", cartstiff.record, arm, "B", loaded="no")
    for q in (arm.q + 0j, arm.q > 0.0, [str(x) for x in arm.q]):
        refused("q is not numeric", program, q)
    along = cartstiff.record(arm, {"x": lambda a: a["pose"][0, 3]})
    refused("q is not numeric", along.gradient, "x", "abc")
    refused("letters, digits and _", program.source, "c", "my-arm")
    refused("language", program.source, "fortran", kind=UnknownNameError)
    refused("no source", cartstiff.record(cartstiff.load("flexure-hexapod"), "B").source, "c")
    refused("exist at no posture", cartstiff.record(cartstiff.load("five-bar"), "B").source, "c")


def function_in_c(source: str, folder: Path, *words: str) -> Any:
    """The function `stiffness` of arrays, compiled without a warning."""
    compiler = shutil.which("cc")
    if compiler is None:
        pytest.skip("no C compiler")
    file, library = folder / "stiffness.c", folder / "stiffness.so"
    file.write_text(source)
    words = ("-std=c99", "-Wall", "-Wextra", "-Werror", *words, "-shared", "-fPIC", "-lm")
    subprocess.run([compiler, str(file), "-o", str(library), *words], check=True)
    function, doubles = ctypes.CDLL(str(library)).stiffness, ctypes.POINTER(ctypes.c_double)
    return lambda *arrays: function(*(a.ctypes.data_as(doubles) for a in arrays))


def test_a_stiffness_that_is_zero_about_an_axis_is_plain():
    """About the line through two fingers the diagonal is round-off, here exactly zero."""
    elastic, known = cartstiff.load("grasp"), {}
    program = cartstiff.record(elastic, ["B", "wrench"])
    exec(program.source("python", "stiffness"), known)
    for q in postures(elastic, 1000, 0.05)[[148, 601, 694]]:
        is_plain, record = known["stiffness"](q.tolist())
        assert abs(record[7]) < 1e-15
        assert is_plain
        close(np.reshape(record[:36], (6, 6)), cartstiff.analyse(elastic, q).matrices["B"])


def by_source(program, language: str, folder: Path) -> Any:
    """The source's answer at postures under a load, if there is one: whether each is plain, the
    record and the coordinates.
    """
    source = program.source(language, "stiffness")
    count = sum(
        program(program.elastic.q, *[LOAD] * program.is_loaded)[n].size for n in program.names
    )
    if language == "c":
        function, known = (
            function_in_c(source, folder, "-O2" if len(source) < 200_000 else "-O0"),
            [],
        )
    elif language == "python":
        exec(source, known := {})
    elif language == "jax":
        jax = pytest.importorskip("jax")
        jax.config.update("jax_enable_x64", True)
        exec(source, known := {})
        function = jax.jit(known["stiffness"])

    def one(q, *load):
        here, out = q.copy(), np.zeros(count)
        if language == "c":
            return not function(here, *load, out), out, here
        if language == "python":
            is_plain, record = known["stiffness"](own := q.tolist(), *(w.tolist() for w in load))
            return is_plain, record, own
        is_plain, found = function(q, *load)
        record = np.concatenate([np.ravel(found[output]) for output in program.names])
        return is_plain, record, found.get("q", q)

    def in_node(Q, *load):
        if (node := shutil.which("node")) is None:
            pytest.skip("no node")
        given = ",".join(["q", *(str(w.tolist()) for w in load)])
        calls = f"{np.asarray(Q).tolist()}.map(q=>[stiffness({given}),q])"
        text = f"{source};console.log(JSON.stringify({calls}))"
        printed = subprocess.run(
            [node, "-"], input=text, capture_output=True, check=True, text=True
        )
        return [(out is not None, out, q) for out, q in json.loads(printed.stdout)]

    if language == "javascript":
        return in_node
    return lambda Q, *load: [one(q, *load) for q in Q]


LANGUAGES = ["c", "jax", "python", "javascript"]


@pytest.mark.parametrize("language", LANGUAGES)
@pytest.mark.parametrize(
    ("name", "outputs", "load", "spread"),
    [
        ("ur5", ["B", "compliance_load", "wrench"], 1.0, 0.1),
        ("five-bar", ["pose", "compliance_load"], 1.0, 1.5),
        *later(
            ("stewart-gough", ["K", "wrench"], 0.0, 0.05),
            ("five-bar", ["compliance_B", "pose"], 1.0, 0.2),
            ("6-pus", ["compliance_B", "pose"], 0.0, 0.05),
            ("panda", ["compliance_B"], 0.0, 0.05),
            ("grasp", ["B", "wrench"], 0.0, 0.05),
            ("6-ups", ["B", "wrench"], 1.0, 0.3),
            ("3-rrr", ["pose", "wrench"], 0.0, 0.3),
            ("3-rrr", ["B", "wrench"], 0.1, 0.05),
            ("delta", ["B", "wrench"], 0.1, 0.1),
            ("flexible_arm", ["B", "wrench"], 1.0, 0.3),
        ),
    ],
)
def test_every_source_is_the_program(name, outputs, load, spread, language, tmp_path):
    """Also where a chain closes, far from where it was drawn, and links bend under the load."""
    example = Path(__file__).resolve().parents[2] / "examples" / f"{name}.yaml"
    elastic = cartstiff.load(example if example.exists() else name)
    inputs = ("stiffness",) if name == "panda" else ()
    program = cartstiff.record(elastic, outputs, loaded=load > 0.0, inputs=inputs)
    given = [load * LOAD] * (load > 0.0) + [1.1 * elastic.springs.stiffness] * len(inputs)
    numbers = dict(zip(inputs, given, strict=False))
    many = language == "c" and spread <= 0.2 and name != "delta"
    Q = postures(elastic, 1000 if many else 12, spread)
    Q[:, sorted(getattr(elastic.mechanism, "virtual", ()))] = 0.0
    assert f"  0: {elastic.names_with_units[0]}" in program.source("c", "stiffness")
    if name == "ur5":
        Q[0] = elastic.q
        Q[0, 4] = 0.0  # the wrist's axes align
    found, plain = by_source(program, language, tmp_path)(Q, *given), 0
    share = 1e-13 if language == "c" and name != "grasp" else 1e-12  # its body spins at no cost
    for q, (is_plain, out, at) in zip(Q, found, strict=True):
        answer = program(q, *given[: load > 0.0], **numbers)
        assert bool(is_plain) is answer.is_plain
        if is_plain:
            plain += 1
            ends = np.cumsum([answer[n].size for n in program.names])[:-1]
            for output, part in zip(program.names, np.split(np.asarray(out), ends), strict=True):
                close(part, answer[output].ravel(), share)
            assert absolute_error(np.asarray(at), answer.q) <= share
    assert plain >= max(4, len(Q) // 2)


@pytest.mark.parametrize(
    ("name", "quantity"),
    [
        ("ur5", "translation_free_min"),
        *later(
            ("stewart-gough", "deflection"),
            ("panda", "deflection"),
            ("6-ups", "deflection"),
            ("delta", "deflection"),
        ),
    ],
)
def test_jax_is_the_program_and_has_its_derivatives(name, quantity):
    """Of a chain's motors, as the rest follows, and of what bends its links."""
    jax, load = pytest.importorskip("jax"), LOAD * (0.1 if name == "delta" else 1.0)
    elastic = cartstiff.load(name)
    program = cartstiff.record(elastic, ["compliance_load", quantity], loaded=True, **ACTING)
    moved = np.arange(len(elastic.q))
    if elastic.mechanism.closures:
        moved = sorted({*elastic.mechanism.held} - {*elastic.mechanism.virtual})
    known: dict[str, Any] = {}
    exec(program.source("jax", "stiffness"), known)
    function, Q = known["stiffness"], postures(elastic, 3, 0.05)
    Q[:, sorted(elastic.mechanism.virtual)] = 0.0
    jax.config.update("jax_enable_x64", True)
    one, many = jax.jit(function), jax.jit(jax.vmap(function, in_axes=(0, None)))

    def number(q):
        return function(q, load)[1][quantity]

    plain, together = many(Q, load)
    slope = jax.jit(jax.grad(number))
    assert plain.all()
    for i, q in enumerate(Q):
        answer, (is_plain, found) = program(q, load), one(q, load)
        assert is_plain
        for output in program.names:
            values = answer[output]
            close(np.asarray(found[output]), values, 1e-12)
            close(np.asarray(together[output][i]), values, 1e-12)
        steps = 1e-6 * np.eye(len(q))[moved]
        ends = [[float(program(q + s * d, load)[quantity]) for s in (1, -1)] for d in steps]
        quotients = np.array([(a - b) / 2e-6 for a, b in ends])
        close(np.asarray(slope(q))[moved], quotients, 1e-6)
    if name == "ur5":
        straight = elastic.q.copy()
        straight[4] = 0.0
        assert not one(straight, load)[0]
    jax.config.update("jax_enable_x64", False)
    refused("jax_enable_x64", function, Q[0], load, kind=RuntimeError)


def two_joints(folder: Path, **more: Any) -> cartstiff.ElasticMechanism:
    """A small arm, with more keys of its file."""
    joints = [{"a": 0.4, "alpha": 1.0}, {"a": 0.3, "d": 0.1}]
    data = {
        "kind": "serial",
        "dh": {"convention": "standard", "joints": joints},
        "q": {"j1": 0.3, "j2": -0.7},
        "springs": {"j1": {"stiffness": 800.0}, "j2": {"stiffness": 500.0}},
        **more,
    }
    (folder / "arm.yaml").write_text(yaml.safe_dump(data))
    return cartstiff.load(folder / "arm.yaml")


@pytest.mark.usefixtures("without_machine_code")
@pytest.mark.parametrize("language", ["python", *later("c", "jax", "javascript")])
def test_sources_bend_a_link_that_is_one_spring(language, tmp_path):
    """It has no segments of a beam."""
    link = {"stiffness": np.diag([9e2, 8e2, 7e2, 3e5, 2e5, 1e5]).tolist()}
    elastic = two_joints(tmp_path, flexible={"link1": link})
    program = cartstiff.record(elastic, ["pose", "compliance_load"], loaded=True)
    core = cartstiff.analyse(elastic, wrench=LOAD)
    ((is_plain, record, q),) = by_source(program, language, tmp_path)(elastic.q[None], LOAD)
    assert is_plain
    close(np.asarray(q), core.q)
    close(np.asarray(record), np.r_[core.pose.ravel(), core.tangent_compliance.ravel()])


def test_a_joint_without_a_spring_beside_links_that_give(tmp_path):
    """Whether it feels a load is seen posture by posture."""
    links = {"link1": {"stiffness": np.diag([9e2, 8e2, 7e2, 3e5, 2e5, 1e5]).tolist()}}
    springs = {"j2": {"stiffness": 500.0}}
    arm = two_joints(tmp_path, springs=springs, passive=["j1"], flexible=links)
    program = cartstiff.record(arm, "compliance_load", loaded=True)
    assert "feel the wrench" in program.reason
    assert program(arm.q, LOAD).state == "unbalanced"


@pytest.mark.usefixtures("without_machine_code")
@pytest.mark.parametrize("far", [0.0, 1e-6, -1e-6])
def test_a_cable_at_its_rest_length_has_two_stiffnesses(far, tmp_path):
    """As at the posture of a file that states neither: the core says what counts there."""
    cable = {"frames": ["world", "link2"], "points": [[0.1, 0.2, 1.0], [0.0, 0.1, 0.0]]}
    arm = two_joints(tmp_path, lines=[{**cable, "stiffness": 1e4, "unilateral": True}])
    answer, core = cartstiff.record(arm, "compliance_B")(arm.q + far), cartstiff.analyse(arm)
    assert answer.is_plain == bool(far)
    if not far:
        assert "direction-dependent" in [note.code for note in core.notes]
        close(answer.compliance_B, core.compliances["B"])


def generated(seed: int, folder: Path) -> cartstiff.ElasticMechanism:
    """An arm of two to seven joints with weight and payload, a platform on six lines, or a four-bar
    linkage.
    """
    if seed % 6 == 5:
        driven = {"actuated": ["motor"], "springs": {"motor": {"stiffness": 800.0}}}
        return cartstiff.load(FourBar.generated(seed).written(folder, **driven))
    if seed % 3:
        return cartstiff.load(Arm.generated(seed).written(folder))
    rng = np.random.default_rng(seed)
    turns = np.pi / 3.0 * (np.arange(6) + rng.uniform(-0.2, 0.2, 6))
    rings = np.column_stack([np.cos(turns), np.sin(turns), rng.uniform(-0.1, 0.1, 6)])
    body = 0.4 * np.roll(rings, 1, axis=0)
    body[1::2] = body[::2] + rng.uniform(0.05, 0.1, (3, 3))
    (folder / "platform.yaml").write_text(f"""
kind: stewart-gough
base: {(0.8 * rings).tolist()}
platform: {body.tolist()}
pose: {{xyz: [0.05, 0, 0.9], rpy: [0.1, 0, 0.2]}}
legs: {{stiffness: {rng.uniform(1e5, 1e6, 6).tolist()}}}
""")
    return cartstiff.load(folder / "platform.yaml")


def in_jax(source: str) -> Any:
    """The function `stiffness`; None without JAX."""
    try:
        import jax
    except ImportError:
        return None
    jax.config.update("jax_enable_x64", True)
    known: dict[str, Any] = {}
    exec(source, known)
    return jax.jit(known["stiffness"])


@pytest.mark.parametrize("seed", [3, 4, 5, *later(*range(6, 20))])
def test_generated_mechanisms_and_set_ups(seed, tmp_path):
    """Program, core, C and JAX agree under any load; where the core names a state it is said.

    The connection is a user's own; tool, payload and the load's point are those of the call.
    """
    elastic, rng = generated(seed, tmp_path), np.random.default_rng(seed)
    acting = {
        "load_axes": str(rng.choice(["body", "world"])),
        "load_kind": str(rng.choice(["dead", "follower", "conservative"])),
    }
    # Numbers of the call, and the mechanism that has them.
    at, other = rng.uniform(-0.2, 0.2, 3), elastic
    numbers = {"load_at": at}
    if seed % 3:
        numbers["tcp"] = rng.uniform(-0.3, 0.3, 6)
        moved = elastic.mechanism.with_tool(se3_tool(numbers["tcp"]))
        other = replace(other, mechanism=moved)
    if elastic.gravity is not None:
        numbers["payload"] = np.array([rng.uniform(0.5, 3.0), *rng.uniform(-0.1, 0.1, 3)])
        other = other.with_payload(numbers["payload"][0], numbers["payload"][1:])
    kinds = ["compliance_load", "compliance_A", "compliance_B"]
    outputs = [*kinds, "wrench", "pose", "energy", MINE]
    inputs = sorted(numbers)
    program = cartstiff.record(elastic, outputs, loaded=True, inputs=inputs, **acting)
    compiled = function_in_c(program.source("c", "stiffness"), tmp_path, "-O0")
    traced = in_jax(program.source("jax", "stiffness"))
    acting["load_at"], more = at.tolist(), [numbers[one] for one in inputs]
    usual = program(elastic.q, LOAD, **numbers)
    recorded = cartstiff.analyse(elastic, wrench=LOAD, **{**acting, "load_at": [0.0, 0.0, 0.0]})
    if (own := program(elastic.q, LOAD)).is_plain:  # what is not given is as recorded
        close(own.compliance_load, recorded.tangent_compliance, 1e-9)
    shapes = {n: usual[n].shape for n in program.names if f"{n} (" in program.source("c")}
    sizes = [int(np.prod(shape)) for shape in shapes.values()]
    Q = [*postures(elastic, 6, 0.3), elastic.q, np.zeros_like(elastic.q)]
    Q += [np.where(rng.uniform(size=len(q)) < 0.3, 1e-9, q) for q in Q[:4]]
    plain = 0
    for q in Q:
        answer, out = program(q, LOAD, **numbers), np.zeros(sum(sizes))
        left, state = compiled(q.copy(), LOAD, *more, out), answer.state
        try:
            core = cartstiff.analyse(other, q, wrench=LOAD, **acting)
        except InputError:  # the load cannot be carried here
            assert not answer.is_plain
        else:
            state = core.reduction.states[-1].code if core.reduction.states else "regular"
            assert answer.state == state or not core.reduction.states
        if not answer.is_plain:
            assert left
            assert traced is None or not traced(q, LOAD, *more)[0]
            continue
        plain += 1
        many = program.many([q], LOAD, **numbers)
        close(many.compliance_load[0], answer.compliance_load)
        assert many.to_xarray().attrs["load_at"] == acting["load_at"]
        assert answer.state in ("regular", "fewer-than-six-freedoms")
        tolerance = 1e-12 * max(1.0, *(np.linalg.cond(answer[name]) for name in kinds[2:]))
        if state != "regular":  # of fewer freedoms, whose compliance has no inverse
            tolerance = 1e-10
        tolerance = min(tolerance, 1e-8)  # sums in another order, at this condition
        expected = {f"compliance_{x}": core.compliances[x] for x in "AB"}
        expected |= {"compliance_load": core.tangent_compliance, "wrench": core.wrench}
        expected |= {"pose": core.pose, "energy": core.energy}
        if "stiffness_mine" in shapes:
            expected["stiffness_mine"] = core.tensor(MINE).matrix
        parts = np.split(out, np.cumsum(sizes)[:-1])
        for name, part in zip(shapes, parts, strict=True):
            if name in expected:
                close(answer[name], np.asarray(expected[name]), tolerance)
            assert not left
            close(part.reshape(shapes[name]), answer[name], tolerance)
            if traced is not None:
                is_plain, found = traced(q, LOAD, *more)
                assert is_plain
                close(np.asarray(found[name]), answer[name], tolerance)
    assert plain >= 3


@pytest.mark.parametrize("name", ["ur5", *later("panda", "stewart-gough", "delta")])
def test_every_quantity_is_an_output(name):
    """Beside what the matrices and the modes of the core say; what is not recorded is named."""
    elastic = cartstiff.load(name)
    names = [n for n in QUANTITIES if not n.startswith("damping")]
    if name == "stewart-gough":  # without masses
        names = [n for n in names if not n.startswith("frequency")]
    if elastic.mechanism.closures:
        names = [n for n in names if "jacobian" not in QUANTITIES[n].needs]
    if not elastic.efforts:  # nothing limits the forces of its drives
        names = [n for n in names if QUANTITIES[n].asks != "effort"]
    settings = {"direction": [0.0, 0.0, 2.0], "length": 0.4, "connection": "B"}
    program = cartstiff.record(elastic, ["K", *names], loaded=True, **settings)
    assert "connection_change" in program.from_matrices
    assert "condition" not in program.from_matrices
    Q, scale = postures(elastic, 4, 0.05), np.repeat([1.0 / 0.4, 1.0], 3)
    load = LOAD * [0, 0, 0, 1, 1, 1]  # a moment has no energy, and its modes no matrix here
    many, plain = program.many(Q, load), 0
    for i, q in enumerate(Q):
        answer, core = program(q, load), cartstiff.analyse(elastic, q, wrench=load)
        plain += answer.is_plain
        K, C = core.matrices["B"], core.compliances["B"]
        values = np.linalg.eigvalsh(K * np.outer(scale, scale))
        free, held = np.linalg.eigvalsh(C[3:, 3:]), np.linalg.eigvalsh(K[3:, 3:])
        hertz = cartstiff.modes(elastic, q, wrench=load).frequencies if name == "ur5" else []
        expected = {
            "translation_free_min": (1.0 / free).min(),
            "compliance_translation_free_max": free[-1],
            "translation_held_max": held[-1],
            "along_free": 1.0 / C[5, 5],
            "along_held": K[5, 5],
            "deflection": np.linalg.norm((C @ core.wrench)[3:]),
            "condition": np.abs(values).max() / np.abs(values).min(),
            "determinant": np.linalg.det(K),
            "force": np.linalg.norm(core.wrench[3:]),
            **{f"frequency_{k + 1}": f for k, f in enumerate(hertz)},
        }
        if values[0] > 0.0:
            expected["isotropy"] = np.exp(np.log(values).mean()) / values.mean()
        for one, value in expected.items():
            assert answer[one] == pytest.approx(value, rel=1e-9, nan_ok=True), one
        for one in names:
            assert many[one][i] == pytest.approx(
                float(answer[one]), rel=1e-9, abs=1e-15, nan_ok=True
            ), one
    assert plain >= 3 or name != "ur5"


def test_quantities_take_settings_and_label_their_data(tmp_path):
    arm = cartstiff.load("ur5")
    program = cartstiff.record(arm, ["along_free", "connection_change"], direction=[1.0, 0.0, 0.0])
    assert program.from_matrices == ("connection_change",)
    data = program.many(postures(arm, 3, 0.1)).to_xarray()
    assert data["along_free"].attrs["units"] == "N/m"
    assert data["connection_change"].attrs["better"] == "smaller"
    assert data.attrs["frame"] == "tool0"
    assert data.attrs["length_unit"] == "m"
    assert "load_kind" not in data.attrs
    acting = {"load_axes": "world", "load_kind": "follower", "load_at": [0.0, 0.0, 0.1]}
    loaded = cartstiff.record(arm, ["B", "deflection"], loaded=True, **acting)
    about = loaded.many(postures(arm, 3, 0.1), LOAD).to_xarray().attrs
    assert {name: about[name] for name in acting} == acting
    refused("no source: connection_change", program.source, "c")
    refused("no quantity is among the outputs", cartstiff.record, arm, "B", length=0.3)
    refused("no quantity needs it", cartstiff.record, arm, "condition", direction=[1.0, 0.0, 0.0])
    for setting in ({"length": 0.3}, {"connection": "K"}):
        refused("no quantity needs it", cartstiff.record, arm, "force", **setting)
    refused("needs a direction", cartstiff.record, arm, "along_free")
    refused("along_free", cartstiff.record, arm, "along_fre", kind=UnknownNameError)
    copy = pickle.loads(pickle.dumps(cartstiff.record(arm, "condition")))
    assert copy(arm.q).condition > 1.0


def test_an_answer_keeps_what_was_asked():
    """Whoever asks may use the same arrays again: the rest is found later."""
    arm = cartstiff.load("ur5")
    program = cartstiff.record(arm, "B", loaded=True, inputs=(name for name in ["stiffness"]))
    q, load, k = arm.q.copy(), LOAD.copy(), arm.springs.stiffness * 1.5
    answer, many = program(q, load, stiffness=k), program.many([q], load, stiffness=k)
    core = cartstiff.analyse(arm.with_springs(k), q, wrench=load)
    for array in (q, load, k):
        array *= 2.0
    close(answer.q, core.q)
    close(answer.compliances["K"], core.compliances["K"])
    close(many.loads, LOAD)
    # A spring that vanishes, or turns round, is another mechanism: no spring balances there.
    for other in (0.0, -1.0, np.inf, np.nan):
        refused("a positive number", program, q, LOAD, stiffness=np.r_[k[:5], other])


@pytest.mark.usefixtures("without_machine_code")
def test_a_data_set_has_every_output_under_its_own_name():
    arm = cartstiff.load("ur5")
    program = cartstiff.record(arm, {"B": "B", "K_B": lambda a: a["pose"][0]})
    data = program.many([arm.q]).to_xarray()
    assert data["K_B"].dims == ("posture", "K_B_1")
    assert data["stiffness_B"].shape == (1, 6, 6)


def test_many_are_each_under_its_own_load():
    robot = cartstiff.load("stewart-gough")
    program = cartstiff.record(robot, ["load", "wrench"], loaded=True, **ACTING)
    Q = postures(robot, 6, 0.02)
    loads = LOAD * np.linspace(0.0, 1.0, len(Q))[:, None]
    many = program.many(Q, loads)
    assert many.is_regular.all()
    for i, q in enumerate(Q):
        core = cartstiff.analyse(robot, q, wrench=loads[i], **ACTING)
        close(many.load[i], core.tangent)
        close(many.wrench[i], core.wrench)
    arm = cartstiff.load("ur5")
    straight = arm.q.copy()
    straight[4] = 0.0
    found = cartstiff.record(arm, ["B", "compliance_B"]).many([arm.q, straight, arm.q + 0.1])
    assert found.counts() == {"regular": 2, "serial-singularity": 1}
    assert np.isfinite(found.B[[0, 2]]).all()
    assert np.isnan(found.B[1]).all()


def se3_tool(numbers):
    """Pose of a tool: translation, then roll, pitch, yaw."""
    T = np.eye(4)
    T[:3, :3] = Rotation.from_euler("xyz", numbers[3:]).as_matrix()
    T[:3, 3] = numbers[:3]
    return T


@pytest.mark.usefixtures("without_machine_code")
def test_frequencies_are_those_with_the_payload():
    arm = cartstiff.load("ur5", gravity=[0.0, 0.0, -9.81])
    program = cartstiff.record(arm, ["B", "frequency_1"], inputs=["payload"])
    assert program.from_matrices == ("frequency_1",)
    heavy = arm.with_payload(5.0, [0.0, 0.0, 0.1])
    expected = cartstiff.modes(heavy, arm.q).frequencies[0]
    given = {"payload": [5.0, 0.0, 0.0, 0.1]}
    # The environment may hold a platform whose legs have a preload.
    held = {"load_kind": "conservative", "load_at": [0.0, 0.1, 0.2]}
    robot = cartstiff.load("stewart-simscape", gravity=[0.0, 0.0, -9.81])
    robot = replace(robot, springs=replace(robot.springs, preload=1e5 * np.arange(6)))
    hung = cartstiff.record(robot, "frequency_1", inputs=["payload"], **held)
    alone = cartstiff.modes(robot, robot.q, **held).frequencies[0]
    assert hung(robot.q).frequency_1 == pytest.approx(alone, rel=1e-9)
    assert alone != pytest.approx(cartstiff.modes(robot, robot.q).frequencies[0], rel=1e-3)
    # Springs are chosen to carry a load that is zero, as of the core.
    wound = arm.with_springs(rest=arm.q + 0.1)
    loaded = cartstiff.record(wound, "frequency_1", loaded=True, inputs=["payload"])
    zero = cartstiff.modes(wound, arm.q, wrench=np.zeros(6)).frequencies[0]
    assert loaded(arm.q, np.zeros(6)).frequency_1 == pytest.approx(zero, rel=1e-9)
    close(program(arm.q)["B"], cartstiff.analyse(arm).matrices["B"])  # as recorded
    close(program(arm.q, **given)["B"], cartstiff.analyse(heavy, arm.q).matrices["B"])
    assert program(arm.q, **given).frequency_1 == pytest.approx(expected, rel=1e-9)
    assert program.many([arm.q], **given)["frequency_1"][0] == pytest.approx(expected, rel=1e-9)
    moving = cartstiff.record(arm, "B", inputs=["tcp"])
    refused("tcp must be finite", moving, arm.q, tcp=[np.nan] * 6)
    hexapod = cartstiff.load("stewart-gough")
    refused("the tool of a chain", cartstiff.record, hexapod, "B", inputs=["tcp"])
    refused("a number from zero", program, arm.q, payload=[-1.0, 0.0, 0.0, 0.0])
    refused("payload", program, arm.q, payload=[1.0])
    refused(
        "a mechanism with gravity", cartstiff.record, cartstiff.load("ur5"), "B", inputs=["payload"]
    )
    refused("loaded=True", cartstiff.record, arm, "B", inputs=["load_at"])
    refused("input", cartstiff.record, arm, "B", inputs=["pay"], kind=UnknownNameError)


@pytest.mark.parametrize(
    ("name", "scales"), later(("flexible_arm", (1, 10, 30)), ("3-rrr", (0.1, 0.2)))
)
def test_c_bends_links_to_rest(name, scales, tmp_path):
    """As far as the core does, and says where they bend too far."""
    example = Path(__file__).resolve().parents[2] / "examples" / f"{name}.yaml"
    elastic = cartstiff.load(example if example.exists() else name)
    program = cartstiff.record(elastic, ["B", "pose"], loaded=True)
    function = function_in_c(program.source("c", "stiffness"), tmp_path, "-O0")
    out, moving = np.zeros(52), sorted(elastic.mechanism.virtual)
    for scale, q in zip(scales, postures(elastic, len(scales), 0.05), strict=True):
        q[moving] = 0.0
        here, load = q.copy(), scale * LOAD
        assert not function(here, load, out)
        assert np.abs(here[moving]).max() > 1e-6
        core = cartstiff.analyse(elastic, q, wrench=load)
        close(out[:36].reshape(6, 6), core.matrices["B"], 1e-9)
    assert function(elastic.q.copy(), 1e6 * LOAD, out)
