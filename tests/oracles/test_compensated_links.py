"""Commands of an arm with compliant links, against the rest that SciPy finds from its energy.

Geometry, weight and Jacobians are Pinocchio's; the springs and the balance are written here. None
of the searches of the library is used.
"""

import numpy as np
import pinocchio as pin
import pytest
from scipy.optimize import root
from tests.support.commands import answer, run
from tests.support.pages import postures_in

import cartstiff
from cartstiff import compensate

LINK = "{stiffness: [[4e4, 0, 0, 0, 9e3, 0], [0, 3e4, 0, 0, 0, 0], [0, 0, 5e4, 0, 0, 0], "
LINK += "[0, 0, 0, 2e6, 0, 0], [9e3, 0, 0, 0, 2e6, 0], [0, 0, 0, 0, 0, 2e6]]}"
K = np.diag([4e4, 3e4, 5e4, 2e6, 2e6, 2e6])
K[0, 4] = K[4, 0] = 9e3
JOINTS = {"shoulder_pan": 3e4, "shoulder_lift": 3e4, "elbow": 2e4}
JOINTS |= {"wrist_1": 5e3, "wrist_2": 5e3, "wrist_3": 4e3}
ROWS = np.array([[0.3, -1.1, 1.4, -0.7, 0.9, 0.2], [-0.4, -0.8, 1.1, 0.3, 1.2, -0.5]])
# (moment, force) in the axes of F; large: the links turn by a degree.
WRENCH = np.array([20.0, -10.0, 5.0, 300.0, -200.0, -600.0])


@pytest.fixture
def file(tmp_path):
    springs = ", ".join(f"{n}_joint: {{stiffness: {k}}}" for n, k in JOINTS.items())
    path = tmp_path / "soft.yaml"
    path.write_text(
        f"kind: serial\nmodel: ur5\nframe: tool0\ngravity: [0, 0, -9.81]\nsprings: {{{springs}}}\n"
        f"flexible: {{upper_arm_link: {LINK}, forearm_link: {LINK}}}\n"
    )
    return path


def rest(arm, commands, wrench, start):
    """Pose of the body at rest: g = springs + links + weight - J^T w = 0, solved by SciPy."""
    model = arm.mechanism.tree.model.copy()
    model.gravity.linear = np.array([0.0, 0.0, -9.81])
    data, frame = model.createData(), arm.mechanism.tree.frames["tool0"]
    k, at = np.zeros(model.nq), np.zeros(model.nq)
    names = [f"{name}_joint" for name in JOINTS if f"{name}_joint" in arm.names]
    own = [arm.names.index(name) for name in names]
    k[own], at[own] = [JOINTS[name.removesuffix("_joint")] for name in names], commands
    H = np.diag(k)
    for link in ("upper_arm_link", "forearm_link"):
        # translation, rotation of the far side; the stiffness above is rotation first
        own = [arm.names.index(f"{link}.{c}") for c in ("px", "py", "pz", "rx", "ry", "rz")]
        order = [3, 4, 5, 0, 1, 2]
        H[np.ix_(own, own)] = K[np.ix_(order, order)]

    def pose(q):
        pin.forwardKinematics(model, data, q)
        return data.oMi[frame.joint] * pin.SE3(frame.T_j_f)

    def force(q):
        J, p = pin.computeJointJacobians(model, data, q), pose(q).translation
        moved = J[:3] + np.cross(J[3:].T, p).T  # of the body's origin, J being about that of F
        carried = moved.T @ wrench[3:] + J[3:].T @ wrench[:3]
        return H @ (q - at) + pin.computeGeneralizedGravity(model, data, q) - carried

    found = root(force, start, tol=1e-14)
    assert np.abs(found.fun).max() < 1e-6
    return pose(found.x).homogeneous


@pytest.mark.parametrize("against", ["load", "all"])
@pytest.mark.parametrize("by_pose", [False, True])
def test_commands_put_the_body_of_an_arm_with_compliant_links_on_its_path(file, against, by_pose):
    """Under load and weight it rests at the pose wanted; the program before misses it as said."""
    arm = cartstiff.load(file)
    wanted = [cartstiff.load("ur5").mechanism.at(q).pose for q in ROWS]
    path = compensate(
        arm,
        wanted if by_pose else ROWS,
        WRENCH,
        q=ROWS[0] if by_pose else None,
        load_axes="world",
        against=against,
    )
    assert path.springs == tuple(f"{name}_joint" for name in JOINTS)
    assert path.stable == (None, None)  # a dead moment has no potential
    for i, target in enumerate(wanted):
        start = arm.mechanism.undeflected(ROWS[i])
        np.testing.assert_allclose(rest(arm, path.commands[i], WRENCH, start), target, atol=1e-9)
        missed = rest(arm, path.naive[i], WRENCH, start)
        np.testing.assert_allclose(missed[:3, 3] - target[:3, 3], path.before[i, 3:], atol=1e-9)
        assert np.linalg.norm(path.before[i, 3:]) > 5e-3
        if against == "load":  # the program was taught under weight
            taught = rest(arm, path.naive[i], np.zeros(6), start)
            np.testing.assert_allclose(taught, target, atol=1e-9)
        elif not by_pose:
            np.testing.assert_allclose(path.naive[i], ROWS[i], atol=1e-12)
    assert np.abs(path.after).max() < 1e-9


def test_the_commands_of_joints_alone_are_written_and_read_again(file, tmp_path):
    """Six joints in, six commands out; the poses that they command and the page read six, too."""
    (table := tmp_path / "path.csv").write_text("\n".join(",".join(map(str, q)) for q in ROWS))
    load = "--load=" + ",".join(map(str, WRENCH))
    words = ("equilibrium", file, "--path", table, load, "--world")
    data = answer(*words)
    path = compensate(cartstiff.load(file), ROWS, WRENCH, load_axes="world")
    np.testing.assert_allclose(data["commands"], path.commands, atol=1e-12)
    assert data["springs"] == [f"{name}_joint" for name in JOINTS]
    arm = cartstiff.load(file)
    played = postures_in(table, arm.names, joints=arm.mechanism.joint_names)
    np.testing.assert_array_equal(played.q, ROWS)
    page = tmp_path / "page.html"
    run("export", file, "--trajectory", table, "-o", page)
    assert page.stat().st_size > 1000


def test_too_few_joints_reach_the_nearest_pose(file):
    """Four joints cannot give six components: the nearest pose is taken, and that is said."""
    locked = "locked: {wrist_2_joint: 0.9, wrist_3_joint: 0.2}"
    text = file.read_text().replace("gravity:", f"{locked}\ngravity:")
    for name in ("wrist_2", "wrist_3"):
        text = text.replace(f", {name}_joint: {{stiffness: {JOINTS[name]}}}", "")
    file.write_text(text)
    arm = cartstiff.load(file)
    path = compensate(arm, ROWS[:1, :4], WRENCH, load_axes="world")
    assert [n.values["point"] for n in path.notes if n.code == "pose-missed"] == [1]
    length = arm.mechanism.at(path.q[0]).length

    def error(commands):
        T = rest(arm, commands, WRENCH, path.q[0])
        turned = pin.log3(T[:3, :3] @ path.poses[0, :3, :3].T)
        return np.r_[turned, (T[:3, 3] - path.poses[0, :3, 3]) / length]

    at_rest, step = error(path.commands[0]), 1e-4
    np.testing.assert_allclose(at_rest * np.repeat([1.0, length], 3), path.after[0], atol=1e-9)
    each = step * np.eye(4)
    rates = [(error(path.commands[0] + h) - error(path.commands[0] - h)) / (2 * step) for h in each]
    slope = np.abs(np.array(rates) @ at_rest)
    assert slope.max() < 1e-3 * np.linalg.norm(rates) * np.linalg.norm(at_rest)


@pytest.mark.parametrize(
    ("name", "force", "is_reached"),
    [
        ("3-rrr", (1.0, -1.0, 0.0), True),
        ("3-rrr", (0, 0, -5.0), False),
        ("delta", (0, 0, -5.0), True),
    ],
)
def test_closed_chains_with_compliant_links(name, force, is_reached):
    """In the freedoms of the drives the load is undone, and across them that is said."""
    machine = cartstiff.load(name)
    path = compensate(machine, machine.q[None], [0, 0, 0, *force])
    assert np.abs(path.before).max() > 1e-6
    assert (np.abs(path.after).max() < 1e-10) == is_reached
    assert ("pose-missed" in [n.code for n in path.notes]) != is_reached
