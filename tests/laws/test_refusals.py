"""What cannot be used is refused in one line that says what, where, expected and got."""

import json
from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from tests.doors import (
    Chain,
    Closure,
    Give,
    PolynomialLaw,
    TabulatedLaw,
    Units,
    checked_vector,
    convert_length,
    flat,
    line_geometry,
    named_values,
    one_line,
    plain_tree,
    product_of_exponentials,
    write_whole,
)
from tests.support import (
    add_frame,
    general_legs,
    legs_as_platform,
    loaded_arm,
    paper_platform,
    platform_mechanism,
    refused,
    translation,
)

from cartstiff import (
    CartstiffError,
    ConvergenceError,
    DeadForce,
    DeadWrench,
    ElasticMechanism,
    FollowerWrench,
    InputError,
    JointFunction,
    JointSprings,
    LineSprings,
    PoseFunction,
    StiffnessTensor,
    UndefinedError,
    analyse,
    load,
    payload,
)
from cartstiff.core.errors import MissingDependencyError, UnknownNameError
from cartstiff.extend import Platform
from cartstiff.geometry import from_pose_function, from_symbols, levi_civita, paper

NAN = float("nan")


# -- the family ---------------------------------------------------------------------------------


def test_family():
    for error in (InputError, UndefinedError, ConvergenceError, MissingDependencyError):
        assert issubclass(error, CartstiffError)
    assert issubclass(InputError, ValueError)
    assert issubclass(UnknownNameError, InputError)
    assert issubclass(MissingDependencyError, ImportError)


def test_input_error():
    error = InputError(
        "stiffness is negative", where="file.yaml:3", expected="zero or more", got=-2
    )
    assert str(error) == "file.yaml:3: stiffness is negative; expected zero or more, got -2"
    parts = (error.what, error.where, error.expected, error.got)
    assert parts == ("stiffness is negative", "file.yaml:3", "zero or more", "-2")
    moved = error.at("--file")
    assert moved.where == "--file: file.yaml:3"
    assert str(moved).startswith("--file: file.yaml:3: stiffness")
    assert str(InputError("wrong").at("here")) == "here: wrong"
    assert InputError("wrong").got is None


def test_messages_stay_on_one_line():
    error = InputError("bad\nthing", got="a\tb\x00\x1b[31m" + "x" * 1000)
    assert "\n" not in str(error)
    assert str(error).isprintable()
    assert len(str(error)) <= 600
    assert one_line("a  b\n c") == "a b c"
    assert one_line("x" * 500).endswith("...")
    assert len(one_line("x" * 500)) == 120
    assert one_line([1, 2]) == "[1, 2]"


def test_unknown_names():
    error = UnknownNameError("joint", "elbo", ["elbow", "wrist"], where="--q")
    assert str(error) == (
        "--q: unknown joint; expected one of 2 names (closest: elbow), got 'elbo'"
    )
    assert error.valid == ("elbow", "wrist")
    assert error.name == "elbo"
    assert "one of elbow, wrist" in str(UnknownNameError("joint", "zzz", ["elbow", "wrist"]))
    assert "none exist here" in str(UnknownNameError("joint", "a", []))
    many = UnknownNameError("joint", "zzz", [f"name{i}" for i in range(40)])
    assert "name11, ..." in str(many)
    assert "name12" not in str(many)


def test_other_members():
    error = UndefinedError("gone", code="singular", values={"rank": 5})
    assert (error.code, error.values) == ("singular", {"rank": 5})
    assert UndefinedError("gone", code="x").values == {}
    error = ConvergenceError("lost", iterations=7, residual=1.25e-3)
    assert str(error) == "lost (7 iterations, residual 0.00125)"
    assert (error.iterations, error.residual) == (7, 1.25e-3)
    error = MissingDependencyError("zarr", "keeping a map", "maps")
    assert str(error).endswith("pip install 'cartstiff[maps]'")
    error = MissingDependencyError("meshcat", "the viewer")
    assert str(error).endswith("pip install meshcat")
    assert error.package == "meshcat"


# -- geometry -----------------------------------------------------------------------------------


def test_connections():
    refused(
        r"symbols has the wrong shape.*\(6, 6, 6\), got shape \(6, 6\)",
        from_symbols,
        np.zeros((6, 6)),
    )
    refused("symbols must be finite", from_symbols, np.full((6, 6, 6), np.inf))
    for bad in (np.eye(5), np.full((6, 6), NAN)):
        refused(r"metric (has the wrong shape|must be finite)", levi_civita, bad)
    lopsided = np.eye(6)
    lopsided[0, 1] = 0.1
    refused(r"metric is not symmetric, got asymmetry 0.1", levi_civita, lopsided)
    for bad in (np.diag([1, 1, 1, 1, 1, 0.0]), -np.eye(6)):
        refused("metric is not positive definite", levi_civita, bad)
    singular = np.diag([1.0, 1, 1, 1, 1, 0])
    caught = refused("no chart of SE", flat, singular, np.zeros((6, 6, 6)), kind=UndefinedError)
    assert caught.code == "singular"
    assert caught.values["singular_values"][-1] == 0


def test_charts():
    refused(
        r"screws have the wrong shape; expected \(6, 6\)",
        product_of_exponentials,
        np.eye(5),
        "five",
    )
    refused(
        "chart 'user' does not return a rigid motion",
        from_pose_function(lambda xi: 2 * np.eye(4)).basis,
        np.zeros(6),
    )
    refused(
        "singular at these coordinates",
        paper.to_wrench,
        [0, np.pi / 2, 0, 0, 0, 0],
        np.ones(6),
        kind=UndefinedError,
    )


# -- potentials ---------------------------------------------------------------------------------


class _At:
    def __init__(self, q):
        self.q = np.asarray(q, float)


def test_functions():
    two = _At([0.1, 0.2])
    ok = {
        "energy": lambda q: 0.0,
        "gradient": lambda q: np.zeros(2),
        "hessian": lambda q: np.eye(2),
    }
    refused(
        "gradient has the wrong count; expected 2 numbers, got 3",
        JointFunction(**{**ok, "gradient": lambda q: np.zeros(3)}).evaluate,
        two,
    )
    refused(
        r"Hessian has the wrong shape; expected shape \(2, 2\)",
        JointFunction(**{**ok, "hessian": lambda q: np.eye(3)}).evaluate,
        two,
    )
    refused(
        r"stiffness has the wrong shape; expected shape \(6, 6\)",
        PoseFunction(
            energy=lambda T: 0.0, wrench=lambda T: np.zeros(6), stiffness=lambda T: np.eye(3)
        ).on_pose,
        np.eye(4),
    )
    refused(
        "wrench has the wrong count",
        PoseFunction(
            energy=lambda T: 0.0, wrench=lambda T: np.zeros(5), stiffness=lambda T: np.eye(6)
        ).on_pose,
        np.eye(4),
    )


@pytest.mark.parametrize("coefficients", [(), (1.0, NAN), (np.inf,)])
def test_polynomial_law(coefficients):
    refused("polynomial spring needs finite coefficients", PolynomialLaw, coefficients)


def test_torques_out_of_reach():
    refused(
        "polynomial spring never reaches the torque, got -1",
        PolynomialLaw((0.0, 1.0)).deflection_for,
        -1.0,
    )
    saturated = TabulatedLaw((-1.0, 0.0, 1.0, 2.0, 3.0), (-5.0, 0.0, 5.0, 5.0, 5.0))
    refused("spring table never reaches the torque, got 6", saturated.deflection_for, 6.0)
    springs = JointSprings([0.0], [NAN], {0: saturated})
    refused("never reaches the torque", springs.with_forces, _At([0.0]), np.array([6.0]))


@pytest.mark.parametrize(
    ("x", "y"), [((0.0,), (0.0,)), ((), ()), ((0.0, 1.0), (0.0,)), ((0.0, 1.0), (0.0, NAN))]
)
def test_tables(x, y):
    refused("spring table needs two or more finite points", TabulatedLaw, x, y)


@pytest.mark.parametrize("x", [(0.0, 0.0), (1.0, 0.0), (0.0, 2.0, 1.0)])
def test_tables_out_of_order(x):
    refused("must increase strictly", TabulatedLaw, x, tuple(range(len(x))))


def test_joint_springs():
    refused(
        "joint stiffnesses and rest positions differ in number", JointSprings, [1.0, 2.0], [0.0]
    )
    for bad in ([-1.0], [NAN]):
        refused("joint stiffness must be a number from zero", JointSprings, bad, [0.0])
    refused("a rigid joint stays where it is", JointSprings, [np.inf], [0.0])


def _lines(**changes):
    good = {
        "anchors": np.zeros((2, 3)),
        "points": np.ones((2, 3)),
        "stiffness": np.ones(2),
        "rest_length": np.ones(2),
    }
    return LineSprings(**{**good, **changes})


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("anchors", np.full((2, 3), NAN)),
        ("anchors", np.zeros((2, 2))),
        ("points", np.zeros((3, 3))),
        ("points", np.full((2, 3), np.inf)),
        ("stiffness", np.ones(3)),
        ("stiffness", np.array([1.0, NAN])),
        ("rest_length", np.ones(1)),
        ("rest_length", np.array([1.0, np.inf])),
    ],
)
def test_line_springs(name, value):
    refused(f"line springs: {name} must be finite numbers", _lines, **{name: value})


@pytest.mark.parametrize("name", ["preload", "least", "most", "unilateral", "driven"])
def test_line_springs_one_value_or_one_per_line(name):
    expected = rf"{name}: wrong count; expected one, or 2, one per line, got shape \(3,\)"
    refused(expected, _lines, **{name: np.ones(3)})
    np.testing.assert_array_equal(getattr(_lines(**{name: 1.0}), name), 1.0)


def test_line_springs_that_cannot_be():
    refused("line spring stiffness must be above zero", _lines, stiffness=np.array([1.0, -1.0]))
    for gap in (0.0, 1e-16):
        caught = refused(
            "line 2 has zero length",
            line_geometry,
            np.eye(4),
            np.ones((2, 3)),
            np.array([[0, 0, 1], [1, 1, 1 + gap]]),
            kind=UndefinedError,
        )
        assert caught.code == "zero-length-line"
        assert caught.values["line"] == 2


def test_loads_that_lines_cannot_balance():
    angles = np.deg2rad(np.arange(6) * 60.0)
    ring = np.stack([np.cos(angles), np.sin(angles), 0 * angles], 1)
    dependent = platform_mechanism(
        ring, 0.5 * ring, np.full(6, 100.0), np.full(6, 0.8), q=[0, 0, 1.0, 0, 0, 0]
    )
    caught = refused(
        "no tensions of the lines balance this load",
        analyse,
        dependent,
        wrench=[0, 0, 530.0, 0, 0, 0],
    )
    # Six lines through the axis carry no moment about it.
    assert caught.got == "an unbalanced moment of 530 and force of 0, in the file's units"
    legs = general_legs()
    cables = legs_as_platform(legs)
    cables = replace(cables, springs=replace(cables.springs, unilateral=True))
    refused("the cables cannot balance this load", analyse, cables, wrench=[0, 0, 0, 0, 0, -100.0])


@pytest.mark.parametrize("load", [DeadWrench, FollowerWrench])
def test_wrenches(load):
    for bad in (np.zeros(5), np.zeros((2, 3)), [0, 0, 0, 0, 0, NAN]):
        refused(r"wrench (has the wrong count|must be finite)", load, bad)
    refused("wrench is not numeric; expected 6 numbers", load, ["a"] * 6)


def test_forces():
    refused("force has the wrong count; expected 3 numbers, got 2", DeadForce, [1.0, 2.0])
    refused(
        "point of application must be finite", DeadForce, [1.0, 2.0, 3.0], point=[0.0, 0.0, np.inf]
    )
    for mass in (-1.0, NAN, np.inf):
        refused(r"payload mass (cannot be used|must be finite)", payload, mass, [0, 0, -9.81])
    refused("acceleration has the wrong count", payload, 1.0, [0, 0])


# -- mechanisms ---------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("values", "match"),
    [
        ("text", "q is not numeric; expected 3 numbers, got text"),
        ([1, "a", 2], "q is not numeric"),
        ([[1, 2], [3]], "q is not numeric"),
        ([1j, 0, 0], "q is not numeric"),
        ([1, 2], "q has the wrong count; expected 3 numbers, got 2"),
        ([], "wrong count"),
        (1.0, "wrong count"),
        (np.zeros((3, 1)), r"wrong count; expected 3 numbers, got shape \(3, 1\)"),
        ([1, NAN, 2], "q must be finite"),
        ([1, np.inf, 2], "q must be finite"),
        ([None, 1, 2], "q must be finite|not numeric"),
        ([10**400, 1, 2], "q must be finite|not numeric"),
    ],
)
def test_vectors(values, match):
    refused(match, checked_vector, values, 3, "q")


def test_vectors_for_mechanisms():
    arm = loaded_arm("RRR", 1).elastic
    refused("q has the wrong count; expected 3 numbers, got 2", analyse, arm, [0.0, 0.0])
    refused(
        "wrench has the wrong count; expected 6 numbers, got 3",
        analyse,
        arm,
        wrench=[0.0, 0.0, 0.0],
    )
    refused("wrench must be finite", analyse, arm, wrench=[NAN] * 6)
    refused("has the wrong count; expected 6 numbers, got 1", analyse, paper_platform(), [0.0])
    refused(r"q: unknown joint.*'j9'", analyse, arm, {"j9": 0.0}, kind=UnknownNameError)


def test_named_values():
    names = ("a", "b")
    refused(
        "stiffness: unknown joint; expected one of a, b",
        named_values,
        {"zzz": 1.0},
        names,
        0.0,
        "stiffness",
        kind=UnknownNameError,
    )
    refused("stiffness of b must be finite", named_values, {"b": NAN}, names, 0.0, "stiffness")
    refused("stiffness of a is not numeric", named_values, {"a": "soft"}, names, 0.0, "stiffness")
    refused("rest must be finite", named_values, NAN, names, 0.0, "rest")
    refused("rest has the wrong count", named_values, [1.0, 2.0, 3.0], names, 0.0, "rest")


@pytest.mark.parametrize(
    "number", [3, 3.0, np.float64(3), np.float32(3), np.int64(3), np.array(3.0)], ids=repr
)
def test_one_number_in_any_clothes(number):
    """A number is a number, whichever library it comes from."""
    assert named_values(number, ("a", "b"), 0.0, "stiffness").tolist() == [3.0, 3.0]
    assert named_values({"b": number}, ("a", "b"), 1.0, "stiffness").tolist() == [1.0, 3.0]


def test_springs_of_a_mechanism():
    arm = loaded_arm("RRR", 1).elastic
    refused("stiffness must not be negative", arm.with_springs, -1.0)
    refused("rest: unknown joint", arm.with_springs, rest={"zzz": 0.0}, kind=UnknownNameError)
    refused(
        "rest length is negative; expected zero or more, got -1",
        load("hexapod").with_springs,
        rest={"leg2": -1.0},
    )
    refused("RRR has no joint springs", replace(arm, springs=None).with_springs, 1.0)
    loose = replace(arm, springs=None, potentials=(JointFunction(lambda q: float(q @ q)),))
    refused(
        "the load of this mechanism follows from its potentials", analyse, loose, wrench=np.zeros(6)
    )


def test_frames():
    arm = loaded_arm("RRR", 1).elastic
    chain = arm.mechanism
    caught = refused(
        r"unknown frame.*closest: tip", Chain, chain.tree, "tipp", kind=UnknownNameError
    )
    assert "tip" in caught.valid
    refused("unknown frame", chain.at(arm.q).relative, "world", "nowhere", kind=UnknownNameError)
    refused(
        "unknown frame",
        Chain,
        chain.tree,
        "tip",
        closures=[Closure("tip", "nowhere", "point")],
        kind=UnknownNameError,
    )
    refused("frame offset is not a rigid motion", Chain, chain.tree, "tip", offset=2 * np.eye(4))
    platform = paper_platform()
    refused(
        "unknown frame; expected one of body, world",
        platform.mechanism.at(platform.q).relative,
        "world",
        "tool",
        kind=UnknownNameError,
    )


def test_joints_that_cannot_be_served():
    model = pin.Model()
    model.addJoint(0, pin.JointModelEllipsoid(0.1, 0.2, 0.3), pin.SE3.Identity(), "egg")
    refused(r"joint 'egg' has a type that is not supported.*Ellipsoid", plain_tree, model)
    assert plain_tree(model, keep=[]).n == 0
    ball = pin.Model()
    ball.addJoint(0, pin.JointModelSpherical(), pin.SE3.Identity(), "ball")
    refused("joint 'ball' cannot be locked at one number", plain_tree, ball, locked={1: 0.3})


def test_flexible_links():
    model = pin.Model()
    joint = model.addJoint(0, pin.JointModelRZ(), pin.SE3.Identity(), "hinge")
    for name in ("link", "cover"):
        model.addBodyFrame(name, joint, pin.SE3.Identity(), 0)
    refused(
        r"unknown link.*'lnk'",
        plain_tree,
        model,
        flexible={"lnk": Give(np.eye(4))},
        kind=UnknownNameError,
    )
    # Two links beside each other: a joint that no frame places may hang on either.
    model.addJoint(joint, pin.JointModelRZ(), pin.SE3.Identity(), "wrist")
    refused(
        "several compliant links are fixed together",
        plain_tree,
        model,
        flexible={"link": Give(np.eye(4)), "cover": Give(np.eye(4))},
    )


def test_closures_that_cannot_be_met():
    """Two short links whose bases stand too far apart."""
    model = pin.Model()
    for name, x in (("left", 0.0), ("right", 5.0)):
        joint = model.addJoint(0, pin.JointModelRZ(), pin.SE3(translation(x, 0, 0)), name)
        add_frame(model, f"{name}_end", joint, translation(0.3, 0, 0))
    closure = Closure("left_end", "right_end", "point")
    chain = Chain(plain_tree(model), "left_end", closures=[closure], actuated=[0])
    for start in ([0.5, 2.5], [0.0, np.pi]):
        caught = refused("closures cannot be assembled", chain.closed, start, kind=ConvergenceError)
        assert caught.residual > 1.0
        assert caught.iterations >= 1
    elastic = ElasticMechanism("far", chain, np.zeros(2), JointSprings([1.0, 1.0], [0.0, 0.0]))
    refused("closures cannot be assembled", analyse, elastic, kind=ConvergenceError)


def test_platforms():
    for base, points in (
        (np.zeros((6, 3)), np.zeros((5, 3))),
        (np.zeros((6, 2)), np.zeros((6, 2))),
        (np.zeros(3), np.zeros(3)),
    ):
        refused("base and platform points differ in number", Platform, base, points)


def test_forward_kinematics():
    legs = general_legs()
    platform = legs_as_platform(legs).mechanism
    for bad in (np.ones(5), np.full(6, NAN), np.full(6, -1.0), np.zeros(6)):
        refused(
            r"leg lengths (must be|has the wrong count)", platform.forward_kinematics, bad, legs.q
        )
    five = Platform(legs.base[:5], legs.platform[:5])
    refused("forward kinematics needs six legs, got 5", five.forward_kinematics, np.ones(5), legs.q)
    refused(
        r"no pose with these leg lengths|type-2",
        platform.forward_kinematics,
        np.array([0.01, 9, 0.01, 9, 0.01, 9]),
        legs.q,
        kind=(ConvergenceError, UndefinedError),
    )


def test_forward_kinematics_gives_up():
    """Lengths no platform can have at once, away from any singularity."""
    legs = general_legs()
    platform = legs_as_platform(legs).mechanism
    failed = []
    for seed in range(12):
        lengths = np.random.default_rng(seed).uniform(0.3, 3.0, 6)
        try:
            platform.forward_kinematics(lengths, legs.q)
        except ConvergenceError as error:
            failed.append(error)
        except UndefinedError:
            pass
    assert failed
    for error in failed:
        assert str(error).startswith("no pose with these leg lengths found from the start (60")
        assert error.residual > 1e-6


# -- stiffness ----------------------------------------------------------------------------------


def _tensor(**changes):
    connection = from_symbols(np.zeros((6, 6, 6)), "mine")
    good = {"matrix": np.eye(6), "connection": connection, "wrench": np.zeros(6)}
    return StiffnessTensor(**{**good, **changes})


@pytest.mark.parametrize(
    ("name", "value"), [("matrix", np.eye(5)), ("wrench", np.zeros(5)), ("pose", np.eye(3))]
)
def test_tensor_shapes(name, value):
    refused(f"{name} has the wrong (shape|count); expected", _tensor, **{name: value})


def test_tensor_changes():
    tensor = _tensor()
    refused(r"unknown connection; expected A, B, K, .*got 'Z'", tensor.to_connection, "Z")
    refused("T_M_N is not a rigid motion", tensor.to_frame, 2 * np.eye(4))
    refused("unknown order; expected angular-linear", tensor.to_order, "linear")
    refused(r"unknown length unit.*got parsec", tensor.to_units, "parsec")
    refused(r"unknown force unit.*got dyn", tensor.to_units, "m", "dyn")
    refused("unknown length unit", convert_length, Units("cubit"), Units())


@pytest.mark.parametrize(
    "matrix", [np.diag([1, 1, 1, 1, 1, 0.0]), np.zeros((6, 6)), np.diag([0, 0, 0, 1, 1, 1.0])]
)
def test_compliance_of_a_singular_matrix(matrix):
    caught = refused("it has no inverse", _tensor(matrix=matrix).compliance, kind=UndefinedError)
    assert caught.code == "singular-stiffness"
    assert len(caught.values["singular_values"]) == 6


def test_rates_that_do_not_exist():
    """A redundant arm has no coordinate rates per twist to carry a Hessian with."""
    result = analyse(loaded_arm("RRRRRRR", 1).elastic)
    caught = refused("exactly six joint coordinates", result.flat_connection, kind=UndefinedError)
    assert caught.code == "kf-undefined"


def test_tensor_data():
    good = json.loads(_tensor().as_json())
    for broken in (
        {},
        {k: v for k, v in good.items() if k != "matrix"},
        {**good, "units": None},
        {**good, "connection": {"name": "unheard of", "symbols": None}},
        {**good, "matrix": [[1, 2], [3]]},
        {**good, "matrix": "text"},
        {**good, "order": "sideways"},
        {**good, "units": {"length": "parsec", "force": "N"}},
    ):
        refused(r"not the data of a stiffness tensor|unknown", StiffnessTensor.from_dict, broken)


def test_files(tmp_path):
    refused(
        r"unknown file ending; expected \.json, \.csv or \.npz", _tensor().save, tmp_path / "K.txt"
    )
    refused(
        r"file cannot be written.*No such file", _tensor().save, tmp_path / "nowhere" / "K.json"
    )
    (tmp_path / "taken").mkdir()
    (tmp_path / "taken" / "full").touch()
    refused("file cannot be written", write_whole, tmp_path / "taken", b"x")
    assert sorted(p.name for p in tmp_path.iterdir()) == ["taken"]  # nothing half-written


def test_results_as_json():
    result = analyse(paper_platform())
    data = json.loads(json.dumps(result.to_dict(), allow_nan=False))
    assert np.array_equal(data["stiffness"]["K"], result.matrices["K"])
