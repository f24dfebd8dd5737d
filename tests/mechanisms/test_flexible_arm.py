"""A serial arm with one link that gives: its compliance adds to that of the joints."""

import numpy as np
import pinocchio as pin
import pytest
from tests.mechanisms.machines import codes, write_file
from tests.mechanisms.oracle import Held, displaced, missed
from tests.support import adjoint_reference, body_jacobian, frame_pose, relative_error, robot_file

from cartstiff import analyse, load

# Springs in series, sums of the same compliances.
SUM = 1e-10
DIFFERENCES = 1e-9

Q = {
    "shoulder_pan_joint": 0.3,
    "shoulder_lift_joint": -1.1,
    "elbow_joint": 1.4,
    "wrist_1_joint": -0.7,
    "wrist_2_joint": 0.9,
    "wrist_3_joint": 0.2,
}
K = dict(zip(Q, (3.0e4, 3.0e4, 2.0e4, 5.0e3, 5.0e3, 4.0e3), strict=True))
LINK = "upper_arm_link"
BEAM = {
    "E": 7.0e10,
    "G": 2.6e10,
    "length": 0.425,
    "area": 8e-4,
    "Iy": 2.0e-7,
    "Iz": 3.0e-7,
    "J": 4.0e-7,
}


def _ur5(folder, name="arm", **more):
    return load(
        write_file(
            folder,
            name,
            kind="serial",
            model="ur5",
            frame="tool0",
            q=Q,
            springs={n: {"stiffness": k} for n, k in K.items()},
            **more,
        )
    )


def _model():
    return pin.buildModelFromUrdf(robot_file("ur_description/urdf/ur5_robot.urdf"))


def _cantilever(load_case):
    """Tip (rotation, displacement) of the beam under a tip (moment, force): textbook formulas."""
    m, f = load_case[:3], load_case[3:]
    E, G, L = BEAM["E"], BEAM["G"], BEAM["length"]
    bend_z, bend_y = E * BEAM["Iz"], E * BEAM["Iy"]
    turn = [
        m[0] * L / (G * BEAM["J"]),
        m[1] * L / bend_y - f[2] * L**2 / (2 * bend_y),
        m[2] * L / bend_z + f[1] * L**2 / (2 * bend_z),
    ]
    move = [
        f[0] * L / (E * BEAM["area"]),
        f[1] * L**3 / (3 * bend_z) + m[2] * L**2 / (2 * bend_z),
        f[2] * L**3 / (3 * bend_y) - m[1] * L**2 / (2 * bend_y),
    ]
    return np.array([*turn, *move])


@pytest.mark.parametrize("offset", [None, {"xyz": [0.02, -0.01, 0.03], "rpy": [0.2, 0.1, -0.4]}])
def test_beam_in_the_upper_arm(tmp_path, offset):
    """C = J k^-1 J^T + Ad C_beam Ad^T, unloaded, wherever the beam starts in its link."""
    flexible = {LINK: {"beam": BEAM} | ({} if offset is None else {"offset": offset})}
    result = analyse(_ur5(tmp_path, flexible=flexible))
    model = _model()
    q = np.array([Q[n] for n in list(model.names)[1:]])
    rigid = analyse(_ur5(tmp_path, "rigid"))
    assert relative_error(result.pose, rigid.pose) <= SUM
    J = body_jacobian(model, q, "tool0")
    tool = frame_pose(model, q, "tool0")
    tip = frame_pose(model, q, LINK)
    if offset is not None:
        from scipy.spatial.transform import Rotation

        at = np.eye(4)
        at[:3, :3] = Rotation.from_euler("xyz", offset["rpy"]).as_matrix()
        at[:3, 3] = offset["xyz"]
        tip = tip @ at
    along = np.eye(4)
    along[0, 3] = BEAM["length"]
    carry = adjoint_reference(np.linalg.inv(tool) @ tip @ along)
    beam = np.stack([_cantilever(e) for e in np.eye(6)], axis=1)
    k = np.array([K[n] for n in list(model.names)[1:]])
    C = J @ np.diag(1 / k) @ J.T + carry @ beam @ carry.T
    assert relative_error(rigid.compliances["B"], J @ np.diag(1 / k) @ J.T) <= SUM
    for name in "ABK":
        assert relative_error(result.compliances[name], C) <= SUM
    # The joints alone are a chart, the joints and the beam are too many.
    assert rigid.matrices["F"] is not None
    assert result.matrices["F"] is None
    # Parts of the URDF that say nothing here; the beam does not end where the elbow is.
    assert set(codes(result)) <= {"ignored", "beam-elsewhere"}


def test_spring_matrix_and_beam_are_the_same(tmp_path):
    """A link's 6x6 spring, placed at the beam's end, is the beam."""
    beam = np.stack([_cantilever(e) for e in np.eye(6)], axis=1)
    matrix = np.linalg.inv(beam)
    matrix = 0.5 * (matrix + matrix.T)
    spring = {"stiffness": matrix, "offset": {"xyz": [BEAM["length"], 0, 0]}}
    a = analyse(_ur5(tmp_path, "a", flexible={LINK: {"beam": BEAM}}))
    b = analyse(_ur5(tmp_path, "b", flexible={LINK: spring}))
    assert relative_error(b.matrices["B"], a.matrices["B"]) <= SUM


def test_loaded_beam(tmp_path):
    """Held away from rest under gravity, the beam bent: differences of the reduced energy."""
    elastic = _ur5(tmp_path, flexible={LINK: {"beam": BEAM}})
    by = np.array([0.01, -0.012, 0.008, 0.004, -0.003, 0.005])
    elastic, q = displaced(elastic, by, 0.01, seed=7)
    result = analyse(elastic, q)
    assert np.abs(result.wrench).max() > 50.0
    virtual = [i for i, n in enumerate(elastic.names) if n.startswith(LINK)]
    assert len(virtual) == 6
    assert np.abs(result.q[virtual]).max() > 1e-4
    assert max(missed(result, Held(elastic, q), 0.003)[:2]) <= DIFFERENCES
