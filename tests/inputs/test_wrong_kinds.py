"""Objects of another kind than a function takes, and points out of reach: refused in one line."""

import inspect
from operator import attrgetter

import numpy as np
import pytest
from tests.surface import names

import cartstiff
from cartstiff import InputError
from cartstiff.core.errors import UnknownArgumentError
from cartstiff.extend import file_schema

PLATFORM = cartstiff.load("stewart-gough")
AXES = {"x": (0.0, 1.0, 2)}
GRID = cartstiff.maps.Grid(AXES, PLATFORM.names, PLATFORM.q)
WRONG = (None, 3, "x", [], {"a": 1}, object())


@pytest.mark.parametrize("wrong", WRONG, ids=lambda value: type(value).__name__)
@pytest.mark.parametrize(
    "call",
    [
        lambda w: cartstiff.Held(w),
        lambda w: cartstiff.analyse(PLATFORM).K.to_connection(w),
        lambda w: cartstiff.maps.CartesianGrid(w, PLATFORM, PLATFORM.q),
        lambda w: cartstiff.maps.CartesianGrid(AXES, w, PLATFORM.q),
        lambda w: cartstiff.maps.Grid(w, PLATFORM.names, PLATFORM.q),
        lambda w: cartstiff.maps.RandomPostures(-1 if w == 3 else w, 1, PLATFORM.q, PLATFORM.q),
        lambda w: cartstiff.maps.Axis(0.0, 1.0, -1 if w == 3 else w),
        lambda w: cartstiff.analyse_posture(w),
        lambda w: cartstiff.sensitivities(w),
        lambda w: cartstiff.accuracy(w),
        lambda w: cartstiff.modes(w),
        lambda w: cartstiff.optimise_path(PLATFORM, w),
        lambda w: cartstiff.maps.draw_map(w, "condition"),
        lambda w: cartstiff.maps.open_map(w),
        lambda w: cartstiff.maps.compute_map(PLATFORM, GRID, ["condition"], w),
        lambda w: cartstiff.commanded(PLATFORM, w),
        lambda w: cartstiff.ElasticMechanism("name", w, np.zeros(6)),
    ],
)
def test_another_kind_of_object_is_refused(call, wrong):
    with pytest.raises(InputError) as refusal:
        call(wrong)
    assert "\n" not in str(refusal.value)


ARM = cartstiff.load("ur5")
ANALYSIS = cartstiff.analyse(ARM)
#: Calls that are answered, each as cheap as it can be.
CALLS = {
    "analyse": (ARM,),
    "analyse_many": (ARM, [ARM.q]),
    "equilibrium": (ARM,),
    "modes": (ANALYSIS,),
    "commanded": (ARM, {"elbow_joint": 0.1}),
    "after_command": (ARM, {"elbow_joint": 0.1}),
    "at_pose": (PLATFORM, PLATFORM.q),
    "compensate": (ARM, [ANALYSIS.pose], [np.zeros(6)]),
    "inverse_kinematics": (ARM, ANALYSIS.pose),
    "load": ("stewart-gough",),
    "payload": (1.0, [0.0, 0.0, -9.81]),
    "extend.taylor_check": (lambda x: float(x @ x), np.zeros(2), 2 * np.eye(2), [1.0, 0.0]),
    "analyse_posture": (ANALYSIS,),
    "geometry.from_bilinear_map": (lambda x, y: x[0] * y,),
    "geometry.from_symbols": (np.zeros((6, 6, 6)),),
    "geometry.levi_civita": (np.eye(6),),
    "maps.Grid": (AXES, PLATFORM.names, PLATFORM.q),
}
KINDS = (*WRONG, float("nan"), b"x", np.zeros((2, 3)), np.array(["a"]), lambda *_: 1)


@pytest.mark.parametrize("name", CALLS)
def test_each_argument_of_another_kind_is_refused_or_answered(name):
    """No error of Python leaves a public function, whatever stands in place of one argument."""
    function, arguments = attrgetter(name)(cartstiff), CALLS[name]
    function(*arguments)
    refused = 0
    for index, parameter in enumerate(inspect.signature(function).parameters.values()):
        for wrong in KINDS:
            positional, named = list(arguments), {}
            if index < len(arguments):
                positional[index] = wrong
            elif parameter.kind not in (parameter.VAR_KEYWORD, parameter.VAR_POSITIONAL):
                named = {parameter.name: wrong}
            try:
                function(*positional, **named)
            except cartstiff.CartstiffError:
                refused += 1
    assert refused >= len(arguments)


HERE = cartstiff.ToolPath(ANALYSIS.pose[None])
POSTURES = cartstiff.maps.Trajectory([ARM.q])
ELSEWHERE = cartstiff.maps.CartesianGrid(AXES, PLATFORM, PLATFORM.q)


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: cartstiff.analyse_many(ARM, [ARM.q], one_by_one=1.5), "a whole number from 0"),
        (lambda: cartstiff.maps.RandomPostures(2.5, 0, ARM.q, ARM.q), "not whole"),
        (lambda: cartstiff.maps.CartesianGrid(AXES, ARM, ARM.q, branches=1.5), "branches"),
        (lambda: cartstiff.maps.map_of(ARM, ELSEWHERE, ["condition"]), "another mechanism"),
        (
            lambda: cartstiff.maps.map_of(
                ARM, POSTURES, ["along_free"], direction=[1, 0, 0], world="no"
            ),
            "world; expected True or False",
        ),
        (lambda: cartstiff.optimise_path(ARM, HERE, starts=-1), "starts"),
        (lambda: cartstiff.optimise_path(ARM, HERE, refine="no"), "refine; expected True"),
        (lambda: cartstiff.optimise_path(ARM, HERE, ranges={"elbow_joint": 1}), "elbow_joint"),
    ],
)
def test_numbers_and_flags_that_python_would_take_are_refused(call, words):
    with pytest.raises(InputError, match=words):
        call()


def test_a_potential_with_an_old_name_of_a_method_is_refused():
    with pytest.raises(InputError, match=r"Own: .* expected diagnostics, got remarks"):

        class Own(cartstiff.extend.Potential):
            def remarks(self, posture):
                return []


@pytest.mark.parametrize(
    ("call", "nearest"),
    [
        (lambda arm: cartstiff.analyse(arm, wrensh=[0, 0, 0, 0, 0, -100]), "wrench"),
        (lambda arm: cartstiff.analyse(arm, load_king="dead"), "load_kind"),
        (lambda arm: cartstiff.equilibrium(arm, wrench=[0] * 6, limit=False), "limits"),
        (lambda arm: cartstiff.equilibrium(arm, hold={"z": 0.0}), "held"),
        (lambda arm: cartstiff.equilibrium(arm, q0=arm.q), r"equilibrium\(elastic, q, "),
        (
            lambda arm: cartstiff.load_curve(arm, wrench=[1.0] * 6, q0=arm.q),
            r"load_curve\(elastic, q, ",
        ),
        (
            lambda arm: cartstiff.compensate(arm, [arm.q], [0] * 6, axes="world"),
            r"compensate\(\.\.\., load_axes=",
        ),
        (
            lambda arm: cartstiff.analyse_posture(
                cartstiff.analyse(arm), wrench=[1.0] * 6, wrench_at=[0, 0, 0]
            ),
            r"analyse_posture\(\.\.\., load_at=",
        ),
    ],
)
def test_a_mistyped_keyword_is_answered_with_the_nearest(call, nearest):
    """Also for those that wait for Python's own error."""
    arm = cartstiff.load("ur5")
    for kind in (InputError, TypeError):
        with pytest.raises(kind, match=rf"unknown argument of \w+; .*(closest:|one of) {nearest}"):
            call(arm)
    with pytest.raises(TypeError, match="positional"):
        cartstiff.analyse(arm, None, None, None, None)


def test_keywords_that_are_passed_on_are_listed_for_type_checkers():
    """All but the axes of a map, which have the names of its joints."""
    unlisted = []
    for name in names():
        thing = attrgetter(name)(cartstiff)
        methods = vars(thing).items() if inspect.isclass(thing) else ()
        own = [(f"{name}.{word}", one) for word, one in methods if not word.startswith("_")]
        for place, one in [(name, thing)] * inspect.isfunction(thing) + own:
            if inspect.isfunction(one):
                unlisted += [
                    place
                    for parameter in inspect.signature(one).parameters.values()
                    if parameter.kind is parameter.VAR_KEYWORD
                    and not str(parameter.annotation).startswith("Unpack[")
                ]
    assert unlisted == ["maps.slice_map"]


SECTIONS = file_schema()["$defs"]


def _keywords_of_maps():
    with pytest.raises(UnknownArgumentError) as refusal:
        cartstiff.maps.map_of(PLATFORM, GRID, ["condition"], typo=1)
    return refusal.value.valid


@pytest.mark.parametrize(
    ("function", "takes"),
    [
        (cartstiff.maps.map_of, {*_keywords_of_maps(), "chunk", "command"}),
        (cartstiff.hexapod, {*SECTIONS["PlatformFile"]["properties"]}),
        (cartstiff.parallel, {*SECTIONS["ParallelFile"]["properties"]}),
    ],
)
def test_the_list_has_what_the_function_passes_on(function, takes):
    """Its own parameters and those of the list are all; keys of `layout` are spread out."""
    inner = inspect.unwrap(function)
    own = inspect.signature(inner).parameters
    (keys,) = (p.annotation for p in own.values() if p.kind is p.VAR_KEYWORD)
    listed = inner.__globals__[keys.removeprefix("Unpack[").removesuffix("]")].__annotations__
    parts = {"height", "turn", "symmetry", "cubic"} & own.keys()
    plain = {name for name, p in own.items() if p.kind is not p.VAR_KEYWORD} - parts
    assert plain | listed.keys() == takes - {"kind", "layout"}


#: Words that public functions share, in the order in which they have them.
SHARED = (
    *("elastic", "command", "q", "wrench", "load_kind", "load_at", "load_axes"),
    *("held", "tolerances", "starts", "seed", "level", "progress"),
)


def public_functions():
    """Names of the parameters of every function of the package."""
    values = {name: attrgetter(name)(cartstiff) for name in names()}
    return {
        name: list(inspect.signature(value).parameters)
        for name, value in values.items()
        if inspect.isfunction(value)
    }


@pytest.mark.parametrize(("name", "takes"), public_functions().items())
def test_functions_have_the_same_words_in_the_same_order(name, takes):
    shared = [word for word in takes if word in SHARED]
    assert shared == sorted(shared, key=SHARED.index)
    assert not {"q0", "axes", "wrench_at", "start", "mechanism", "robot"} & set(takes)
    load = [word for word in takes if word in ("wrench", "load_kind", "load_at", "load_axes")]
    whole = ["wrench", "load_kind", "load_at", "load_axes"]
    # A wrench alone is an addition or a sign of it; a path's loads have their own words.
    assert load in ([], whole, ["wrench"], ["wrench", "load_at"], whole[1:], whole[1:3], whole[2:])


def test_equilibrium_takes_q_and_wrench_as_analyse_does():
    """Under a small load it moves by compliance times wrench, from the posture that was given."""
    arm = cartstiff.load("ur5")
    q, W = arm.q + 0.1, np.array([0.0, 0.0, 0.0, 0.0, 0.0, -0.02])
    start = cartstiff.analyse(arm, q)
    moved = np.array(start.compliance) @ W
    load = cartstiff.DeadForce(start.pose[:3, :3] @ W[3:])
    for state in (
        cartstiff.equilibrium(arm, q, wrench=W),
        cartstiff.equilibrium(arm, wrench=W, q=q),
        cartstiff.equilibrium(arm, q, load),
    ):
        np.testing.assert_allclose(state.start.pose, start.pose, atol=1e-12)
        T = np.linalg.inv(start.pose) @ state.pose
        twist = [T[2, 1], T[0, 2], T[1, 0], *T[:3, 3]]
        np.testing.assert_allclose(twist, moved, rtol=1e-3, atol=1e-11)
    curve = cartstiff.load_curve(arm, q, load)
    np.testing.assert_allclose(curve.q[-1], state.q, atol=1e-9)
    # A load in the place of q is a load, and the start the file's posture.
    default = cartstiff.equilibrium(arm, load).start.q
    np.testing.assert_array_equal(default, arm.q)
