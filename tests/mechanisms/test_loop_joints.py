"""Loops cut at hinges, universal joints and balls: planar formulas, counts of motions, own rows."""

import numpy as np
import pinocchio as pin
import pytest
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation
from tests.laws.test_many_engine import assert_same
from tests.mechanisms.machines import joint, masses, note, write_file, write_urdf
from tests.support import absolute_error

import cartstiff
from cartstiff import InputError

Y = (0, 1, 0)
#: Crank, coupler and rocker of a four-bar that is no parallelogram, and the way between pivots.
CRANK, COUPLER, ROCKER, SPAN = 0.2, 0.5, 0.4, 0.6
HINGE = {
    "frames": ["coupler", "rocker"],
    "type": "hinge",
    "points": [[COUPLER, 0, 0], [ROCKER, 0, 0]],
    "axes": [Y, [0, 2, 0]],
}


def four_bar(folder, closure=None, **more):
    write_urdf(
        folder,
        joint("motor", "base", "crank", axis=Y),
        joint("elbow", "crank", "coupler", at=(CRANK, 0, 0), axis=Y),
        joint("pivot", "base", "rocker", at=(SPAN, 0, 0), axis=Y),
    )
    keys = {
        "model": "machine.urdf",
        "frame": "rocker",
        "closures": [closure or HINGE],
        "actuated": ["motor"],
        "q": {"motor": -1.0, "elbow": 1.0, "pivot": -1.5},
    }
    return cartstiff.load(write_file(folder, "four_bar", kind="closed-chain", **(keys | more)))


def angles(motor):
    """Pivot, and turn of the rocker against the coupler, by the law of cosines (about y)."""
    x, z = CRANK * np.cos(motor), -CRANK * np.sin(motor)
    dx, dz = x - SPAN, z
    way = np.hypot(dx, dz)
    side = np.arccos((way**2 + ROCKER**2 - COUPLER**2) / (2 * way * ROCKER))
    pivot = -(np.arctan2(dz, dx) - side)
    end = np.array([SPAN + ROCKER * np.cos(pivot), -ROCKER * np.sin(pivot)])
    coupler = -np.arctan2(end[1] - z, end[0] - x)
    return float(pivot), float(pivot - coupler)


def wrapped(angle):
    return float((angle + np.pi) % (2 * np.pi) - np.pi)


@pytest.mark.parametrize("motor", [-1.0, -0.6, -1.7])
def test_four_bar_by_the_law_of_cosines(tmp_path, motor):
    k, own, step = 640.0, 55.0, 1e-5
    springs = {"motor": {"stiffness": k}, "closure1.x": {"stiffness": own}}
    elastic = four_bar(tmp_path, springs=springs)
    assert elastic.names == ("motor", "elbow", "pivot", "closure1.x")
    result = cartstiff.analyse(elastic, {"motor": motor})
    pivot, turn = angles(motor)
    found = dict(zip(elastic.names, result.q, strict=True))
    assert wrapped(found["pivot"] - pivot) == pytest.approx(0.0, abs=1e-9)
    assert wrapped(found["closure1.x"] - turn) == pytest.approx(0.0, abs=1e-9)
    # A moment m about y on the rocker turns it by m (d pivot)^2 / (k + own (d turn)^2).
    rates = (np.array(angles(motor + step)) - np.array(angles(motor - step))) / (2 * step)
    C = result.compliances["B"]
    assert C is not None
    expected = rates[0] ** 2 / (k + own * rates[1] ** 2)
    assert C[1, 1] == pytest.approx(expected, rel=1e-7)


def test_a_planar_loop_of_hinges_says_that_it_holds_too_much(tmp_path):
    hinged, tied = (
        four_bar(tmp_path, closure, springs={"motor": {"stiffness": 640.0}})
        for closure in (HINGE, {k: v for k, v in HINGE.items() if k != "axes"} | {"type": "ball"})
    )
    repeated = note(hinged, "repeated-closures")
    # Five conditions, of which the two in the plane hold something.
    assert repeated.values == {"conditions": 5, "repeated": 3}
    assert "repeated-closures" not in [n.code for n in tied.notes]
    a, b = (cartstiff.analyse(elastic).compliances["B"] for elastic in (hinged, tied))
    assert absolute_error(a, b) <= 1e-12


KINDS = {"rigid": 6, "weld": 6, "hinge": 5, "universal": 4, "ball": 3, "point": 3}
AXES = {"hinge": [[1, 2, 0.5], [0.3, -1, 1]], "universal": [[1, 2, 0.5], [0.3, -1, 1]]}
POINTS = [[0.1, 0.02, 0.03], [-0.05, 0.04, 0.1]]


def two_arms(folder, kind, **more):
    """Two arms of six joints about random axes, joined at their ends."""
    rng = np.random.default_rng(4)
    parts, q = [], {}
    for side, base in (("a", (0, 0, 0)), ("b", (0.5, 0.1, 0))):
        for i in range(1, 7):
            axis = rng.normal(size=3)
            at = base if i == 1 else rng.uniform(-0.3, 0.3, 3)
            parent = "base" if i == 1 else f"{side}{i - 1}"
            parts.append(joint(f"{side}j{i}", parent, f"{side}{i}", at=at, axis=axis))
            q[f"{side}j{i}"] = float(rng.uniform(-0.5, 0.5))
    write_urdf(folder, *parts, name="arms")
    closure = {"frames": ["a6", "b6"], "type": kind, "points": POINTS}
    if kind in AXES:
        closure["axes"] = AXES[kind]
    return cartstiff.load(
        write_file(
            folder,
            "arms",
            kind="closed-chain",
            model="arms.urdf",
            frame="a6",
            closures=[closure],
            q=q,
            springs={name: {"stiffness": 100.0 + 10.0 * i} for i, name in enumerate(q)},
            **more,
        )
    )


def conditions(kind, model, q):
    """Rows by hand: the points coincide; axes are parallel (hinge), square, or all of them."""
    data = model.createData()
    pin.framesForwardKinematics(model, data, pin.integrate(model, pin.neutral(model), q))
    a, b = (data.oMf[model.getFrameId(name)] for name in ("a6", "b6"))
    gap = a.act(np.array(POINTS[0])) - b.act(np.array(POINTS[1]))
    if kind in ("ball", "point"):
        return gap
    if kind in AXES:
        u, v = (
            T.rotation @ (np.array(x) / np.linalg.norm(x))
            for T, x in zip((a, b), AXES[kind], strict=True)
        )
        return np.append(gap, np.cross(u, v) if kind == "hinge" else u @ v)
    return np.append(gap, pin.log3(a.rotation.T @ b.rotation))


@pytest.mark.parametrize("kind", KINDS)
def test_conditions_and_motions_of_each_kind(tmp_path, kind):
    elastic = two_arms(tmp_path, kind)
    model = pin.buildModelFromUrdf(str(tmp_path / "arms.urdf"))
    order = [elastic.names.index(name) for name in list(model.names)[1:]]
    at = elastic.mechanism.at(elastic.q)
    q = elastic.q[order]
    np.testing.assert_allclose(conditions(kind, model, q), 0.0, atol=1e-9)
    # Motions that keep the rows of the chain keep those by hand, and are as many.
    step = 1e-6
    rows = np.array(
        [
            (conditions(kind, model, q + step * e) - conditions(kind, model, q - step * e))
            for e in np.eye(12)
        ]
    ).T / (2 * step)
    assert np.linalg.matrix_rank(rows, tol=1e-6) == KINDS[kind]
    _, values, Vt = np.linalg.svd(at.closure.jacobian)
    motions = Vt[np.count_nonzero(values > 1e-9) :].T
    assert motions.shape[1] == 12 - KINDS[kind]
    np.testing.assert_allclose(rows @ motions[order], 0.0, atol=1e-7)
    assert np.linalg.matrix_rank(motions[order]) == 12 - KINDS[kind]


@pytest.mark.parametrize("kind", ["hinge", "universal", "rigid", "ball"])
def test_engine_and_recorded_programs_agree(tmp_path, kind):
    driven = [f"aj{i}" for i in range(1, 7)]
    if kind != "rigid":
        driven += ["bj1", "bj2", "bj3"][: 6 - KINDS[kind]]
    elastic = two_arms(tmp_path, kind, actuated=driven)
    q = np.tile(elastic.q, (5, 1))
    held = [elastic.names.index(name) for name in driven]
    q[:, held] += np.random.default_rng(1).uniform(-0.02, 0.02, (5, len(held)))
    assert_same(elastic, q, "portable", outputs=("pose", "compliance_B", "jacobian"))
    for given, at in zip(q, cartstiff.analyse_many(elastic, q, path="portable").q, strict=True):
        assert absolute_error(at, elastic.mechanism.closed(given).q) <= 1e-12


def test_planar_hinges_are_recorded(tmp_path):
    """A five-bar whose tip is a hinge: no posture is left to the engine."""
    write_list(tmp_path, type=["6d"])
    elastic = cartstiff.load(
        write_file(
            tmp_path,
            "five_bar",
            kind="closed-chain",
            model="robot.urdf",
            frame="loop_A",
            closures=[{"frames": ["loop_A", "loop_B"], "type": "hinge"}],
            actuated=["mot1", "mot2"],
            springs={name: {"stiffness": 800.0} for name in ("mot1", "mot2")},
        )
    )
    q = np.tile(elastic.q, (4, 1))
    q[:, [0, 2]] += [[0.0, 0.0], [0.05, -0.03], [-0.05, 0.02], [0.1, 0.1]]
    (found,) = assert_same(elastic, q, "portable", outputs=("pose", "compliance_B"))
    assert found.fallback == 0


@pytest.mark.parametrize(
    ("axes", "free"), [([Y, Y], 1), ([[1, 0, 0], [np.cos(0.7), 0, -np.sin(0.7)]], 0)]
)
def test_a_hinge_of_the_room(tmp_path, axes, free):
    """A frame tied to the world without points stays at q, and turns about an axis along F's."""
    write_urdf(
        tmp_path,
        joint("a", "base", "one", axis=Y),
        joint("b", "one", "two", at=(0.3, 0, 0), axis=Y),
        joint("c", "two", "end", at=(0.3, 0, 0), axis=Y),
    )
    axes = np.array(axes, float).tolist()
    tie = {"frames": ["end", "world"], "type": "hinge", "axes": axes}
    elastic = cartstiff.load(
        write_file(
            tmp_path,
            "arm",
            kind="closed-chain",
            model="machine.urdf",
            frame="two",
            q={"a": -0.5, "b": 1.2},
            closures=[tie],
            springs={"c": {"stiffness": 30.0}},
        )
    )
    at = elastic.mechanism.at(elastic.q)
    J = at.closure.jacobian
    values = np.linalg.svd(J)[1]
    assert len(elastic.q) - np.count_nonzero(values > 1e-9) == free
    assert absolute_error(elastic.q[:3], [-0.5, 1.2, 0.0]) < 1e-12


# -- in a URDF ------------------------------------------------------------------------------------


def sdf_joint(kind, axes):
    return (
        f'<gazebo><joint name="close" type="{kind}"><pose>0.4 0 0 0.1 0.2 0.3</pose>'
        f"<parent>coupler</parent><child>rocker</child>{axes}</joint></gazebo>"
    )


@pytest.mark.parametrize(
    ("kind", "axes", "rows"),
    [
        ("revolute", "<axis><xyz>0 1 0</xyz></axis>", 5),
        ("universal", "<axis><xyz>1 0 0</xyz></axis><axis2><xyz>0 1 0</xyz></axis2>", 4),
        ("fixed", "", 6),
    ],
)
def test_joints_of_sdf_between_links(tmp_path, kind, axes, rows):
    """They close the loop as it is with all joints at zero."""
    chain = [
        joint("j1", "base", "one", at=(0, 0, 0.1), axis=(0.3, 1, 0.2)),
        joint("j2", "one", "two", at=(0.1, 0, 0.2), axis=(1, 0.2, 0)),
        joint("j3", "two", "coupler", at=(0.2, 0.1, 0), axis=(0, 0.1, 1)),
        joint("j4", "base", "three", at=(0.4, 0, 0), axis=(1, 1, 0)),
        joint("j5", "three", "four", at=(0.1, 0.3, 0), axis=(0, 1, 1)),
        joint("j6", "four", "five", at=(0.1, 0, 0.2), axis=(1, 0, 0)),
        joint("j7", "five", "rocker", at=(0, 0.2, 0), axis=(1, 0, 1)),
    ]
    path = write_urdf(tmp_path, *chain)
    path.write_text(path.read_text().replace("</robot>", f"{sdf_joint(kind, axes)}</robot>"))
    elastic = cartstiff.load(path, frame="coupler", stiffness={"j1": 10.0})
    assert not [n for n in elastic.notes if n.code == "adjusted-posture"]
    np.testing.assert_allclose(elastic.q[:7], 0.0, atol=1e-12)
    at = elastic.mechanism.at(elastic.q)
    rank = np.count_nonzero(np.linalg.svd(at.closure.jacobian)[1] > 1e-9)
    assert len(elastic.q) - rank == 7 - rows


@pytest.mark.parametrize(
    "axis",
    [
        '<axis><xyz expressed_in="__model__">0 1 0</xyz></axis>',
        "<axis><xyz>0 1 0</xyz><use_parent_model_frame>true</use_parent_model_frame></axis>",
        "<axis><xyz>0 1 0</xyz><dynamics><spring_stiffness>3</spring_stiffness></dynamics></axis>",
    ],
)
def test_joints_of_sdf_that_say_more_are_refused(tmp_path, axis):
    path = write_urdf(
        tmp_path,
        joint("motor", "base", "coupler", axis=Y),
        joint("pivot", "base", "rocker", at=(0.4, 0, 0), axis=Y),
    )
    text = path.read_text().replace("</robot>", f"{sdf_joint('revolute', axis)}</robot>")
    path.write_text(text)
    with pytest.raises(InputError, match=r"<joint> acts on joint .* cannot be expressed"):
        cartstiff.load(path, frame="coupler")


# -- lists of closures beside a URDF --------------------------------------------------------------


def write_list(folder, **keys):
    write_urdf(
        folder,
        joint("mot1", "base", "l1", at=(-0.1, 0, 0), rpy=(0, 0, 2.2)),
        joint("free1", "l1", "l2", at=(0.25, 0, 0), rpy=(0, 0, -1.6)),
        joint("end1", "l2", "loop_A", at=(0.3, 0, 0), kind="fixed"),
        joint("mot2", "base", "r1", at=(0.1, 0, 0), rpy=(0, 0, 0.95)),
        joint("free2", "r1", "r2", at=(0.25, 0, 0), rpy=(0, 0, 1.6)),
        joint("wrist", "r2", "loop_B", at=(0.3, 0, 0), kind="fixed"),
        name="robot",
    )
    content = {"closed_loop": [["loop_A", "loop_B"]], "name_mot": ["mot1", "mot2"], **keys}
    path = folder / "robot.yaml"
    path.write_text("".join(f"{key}: {value}\n" for key, value in content.items()))
    return path


@pytest.mark.parametrize(
    "keys",
    [
        {"type": ["3D"]},
        {"type": ["6d"], "joint_name": ["wrist"], "joint_type": ["SPHERICAL"]},
        {"type": ["3d"], "joint_name": ["end1", "wrist"], "joint_type": ["UJOINT_XY", "FIXED"]},
    ],
)
def test_closure_list_of_example_parallel_robots(tmp_path, keys):
    """Points or balls: the five-bar of a file of this project."""
    listed = cartstiff.load(write_list(tmp_path, **keys), frame="l2", stiffness=800.0)
    own = cartstiff.load(
        write_file(
            tmp_path,
            "own",
            kind="closed-chain",
            model="robot.urdf",
            frame="l2",
            closures=[{"frames": ["loop_A", "loop_B"], "type": "point"}],
            actuated=["mot1", "mot2"],
            springs={name: {"stiffness": 800.0} for name in ("mot1", "mot2")},
        )
    )
    q = {"mot1": 0.1, "mot2": -0.05}
    a, b = (cartstiff.analyse(elastic, q).compliances["B"] for elastic in (listed, own))
    assert absolute_error(a, b) <= 1e-12


def _step(d, alpha, angle):
    """A turn about z, then the next axis at a distance and twist along x."""
    turn, twist = (Rotation.from_euler(a, x).as_matrix() for a, x in (("z", angle), ("x", alpha)))
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = turn @ twist, turn @ d
    return T


def test_bennetts_linkage_under_gravity(tmp_path):
    """One motion in space: C = J J^T / V'' of an energy along it; the hinge is no link."""
    a, alpha, beta = 0.4, np.radians(60.0), np.radians(35.0)
    b = a * np.sin(beta) / np.sin(alpha)
    along = {"a": np.array([a, 0, 0]), "b": np.array([b, 0, 0])}
    axes = [Rotation.from_euler("x", t).as_matrix()[:, 2] for t in (alpha, beta)]
    bars = (
        joint("j1", "base", "k1"),
        joint("j2", "k1", "k2", at=along["b"], rpy=(beta, 0, 0)),
        joint("j4", "base", "k3", at=along["a"], rpy=(alpha, 0, 0)),
    )
    path = write_urdf(tmp_path, *bars)
    weights = {"k1": 3.0, "k2": 2.0, "k3": 1.5}
    path.write_text(masses(path.read_text(), **weights))
    k, g = 30.0, np.array([1.0, -2.0, -9.81])
    elastic = cartstiff.load(
        write_file(
            tmp_path,
            kind="closed-chain",
            model="machine.urdf",
            frame="k2",
            q={"j1": 0.9, "j2": 2.0, "j4": 1.0},
            springs={"j1": {"stiffness": k}},
            gravity=g,
            closures=[
                {
                    "frames": ["k2", "k3"],
                    "type": "hinge",
                    "points": [along["a"], along["b"]],
                    "axes": axes,
                }
            ],
        )
    )
    result = cartstiff.analyse(elastic)

    def links(q):
        first = _step(along["b"], beta, q[0]) @ _step(np.zeros(3), 0.0, q[1])
        second = _step(along["a"], alpha, 0.0) @ _step(np.zeros(3), 0.0, q[2])
        return first, second

    def gap(q):
        A, B = links(q)
        apart = A[:3, :3] @ along["a"] + A[:3, 3] - B[:3, :3] @ along["b"] - B[:3, 3]
        return np.append(apart, A[:3, :3] @ axes[0] - B[:3, :3] @ axes[1])

    def at(s):
        start = [elastic.q[elastic.names.index(name)] for name in ("j2", "j4")]
        found = least_squares(lambda x: gap([s, *x]), start, xtol=3e-16, ftol=3e-16, gtol=3e-16).x
        assert np.abs(gap([s, *found])).max() < 1e-12
        A, B = links([s, *found])
        parts = {"k1": _step(np.zeros(3), 0.0, s), "k2": A, "k3": B}
        centre = [0.05, 0.02, 0.01, 1.0]
        return A, -sum(m * g @ (parts[n] @ centre)[:3] for n, m in weights.items())

    s, h = elastic.q[0], 1e-3
    (T, V), ahead, behind = at(s), at(s + h), at(s - h)
    bend = k + (ahead[1] - 2 * V + behind[1]) / h**2
    X = np.linalg.inv(T) @ (ahead[0] - behind[0]) / (2 * h)
    J = np.array([X[2, 1], X[0, 2], X[1, 0], *X[:3, 3]])
    assert result.compliances["B"] == pytest.approx(np.outer(J, J) / bend, rel=1e-5, abs=1e-9)
    assert not [n for n in result.notes if n.code == "massless"]
