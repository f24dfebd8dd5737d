"""The planar 3-RRR with links that give, against two assemblies that share nothing with it."""

import numpy as np
import pytest
from ruamel.yaml import YAML
from scipy.spatial.transform import Rotation
from tests.mechanisms.machines import joint, write_file, write_urdf
from tests.mechanisms.oracle import ROBOTS, natural_error
from tests.support import adjoint_reference, relative_error, tip_compliance

from cartstiff import analyse, load

# Required: linear algebra of condition 1e4 from a file with twelve digits.
ASSEMBLY = 1e-10
LINK = 0.3


def _file():
    return YAML(typ="safe").load((ROBOTS / "3-rrr.yaml").read_text(encoding="utf-8"))


def _place(xyz=(0, 0, 0), angle=0.0):
    T = np.eye(4)
    T[:3, :3] = Rotation.from_rotvec([0, 0, angle]).as_matrix()
    T[:3, 3] = xyz
    return T


class Leg:
    """Base, crank, coupler and end of a leg of the file, placed in the world."""

    def __init__(self, entry):
        q = entry["q"]
        self.crank = _place(entry["base"]["xyz"], q["motor"])
        self.crank_tip = self.crank @ _place((LINK, 0, 0))
        self.coupler = self.crank_tip @ _place(angle=q["elbow"])
        self.coupler_tip = self.coupler @ _place((LINK, 0, 0))
        self.end = self.coupler_tip @ _place(angle=q["wrist"])
        self.grip = _place(entry["grip"]["xyz"])
        self.body = self.end @ np.linalg.inv(self.grip)
        self.motor = entry["springs"]["motor"]["stiffness"]
        self.beams = [entry["flexible"][n]["beam"] for n in ("crank", "coupler")]


def _leg_stiffness(leg, body):
    """Serial compliance of motor and beams; the hinges transmit no moment about their axes."""

    def seen(T):
        return adjoint_reference(np.linalg.inv(body) @ T)

    about_z = np.eye(6)[2]
    motor = seen(leg.crank) @ about_z
    C = np.outer(motor, motor) / leg.motor
    for tip, beam in zip((leg.crank_tip, leg.coupler_tip), leg.beams, strict=True):
        C += seen(tip) @ tip_compliance(beam) @ seen(tip).T
    hinges = np.stack([seen(leg.coupler) @ about_z, seen(leg.end) @ about_z], axis=1)
    bordered = np.block([[C, hinges], [hinges.T, np.zeros((2, 2))]])
    # Scaled, as compliances are small against lever arms.
    unit = np.sqrt(np.abs(C).max())
    s = np.array([1 / unit] * 6 + [unit] * 2)
    return (np.linalg.inv(bordered * np.outer(s, s)) * np.outer(s, s))[:6, :6]


@pytest.fixture(scope="module")
def result():
    return analyse(load("3-rrr"))


def test_leg_by_leg(result):
    legs = [Leg(entry) for entry in _file()["legs"]]
    for leg in legs:
        assert np.abs(leg.body - legs[0].body).max() <= ASSEMBLY
    assert relative_error(result.pose, legs[0].body) <= ASSEMBLY
    K = sum(_leg_stiffness(leg, legs[0].body) for leg in legs)
    for name in "ABK":
        assert natural_error(result.matrices[name], K, result.posture.length) <= ASSEMBLY


def test_stiff_links_leave_the_motors(result):
    """With links a million times stiffer only motors give: the plane keeps J^-T k J^-1."""
    legs = [Leg(entry) for entry in _file()["legs"]]
    body = legs[0].body
    rows = []
    for leg in legs:
        # Coupler force of unit size through the elbow and the wrist: no moment at either hinge.
        elbow, wrist, motor = (T[:3, 3] for T in (leg.coupler, leg.end, leg.crank))
        u = (wrist - elbow) / LINK
        lever = np.cross(elbow - motor, u)[2]
        arm = np.cross(wrist - body[:3, 3], u)[2]
        rows.append(np.array([arm, u[0], u[1]]) / lever)
    g = np.array(rows)  # motor rate per planar motion
    R = np.eye(3)
    R[1:, 1:] = body[:2, :2]
    expected = R.T @ (g.T * legs[0].motor @ g) @ R
    plane = np.ix_([2, 3, 4], [2, 3, 4])
    C = np.linalg.inv(result.matrices["B"])[plane]
    flexible = np.linalg.inv(C)
    # Springs in series: softer with the beams than without, in every direction.
    assert np.linalg.eigvalsh(expected - flexible).min() > 0
    stiff = _stiffened(1e6)
    assert relative_error(stiff, expected) < 1e-4


def _stiffened(factor):
    legs = [Leg(entry) for entry in _file()["legs"]]
    for leg in legs:
        leg.beams = [{**b, "E": factor * b["E"], "G": factor * b["G"]} for b in leg.beams]
    K = sum(_leg_stiffness(leg, legs[0].body) for leg in legs)
    plane = np.ix_([2, 3, 4], [2, 3, 4])
    return np.linalg.inv(np.linalg.inv(K)[plane])


@pytest.mark.parametrize(("at", "said"), [((0.3, 0, 0), False), ((0, 0, 0.3), True)])
def test_a_beam_that_does_not_lie_along_its_link_is_named(tmp_path, at, said):
    """A beam runs along x: where the next joint stands along z, a rigid piece is named."""
    write_urdf(
        tmp_path,
        joint("j1", "base", "upper", axis=(0, 0, 1)),
        joint("j2", "upper", "tip", at=at, axis=(0, 1, 0)),
        name="arm",
    )
    beam = {
        "E": 7e10,
        "G": 2.6e10,
        "length": 0.3,
        "area": 6e-4,
        "Iy": 4.5e-8,
        "Iz": 2e-8,
        "J": 5e-8,
        "segments": 2,
    }
    path = write_file(
        tmp_path,
        "arm",
        kind="serial",
        model="arm.urdf",
        frame="tip",
        springs={"j1": {"stiffness": 1e4}, "j2": {"stiffness": 1e4}},
        flexible={"upper": {"beam": beam}},
    )
    found = [n for n in load(path).notes if n.code == "beam-elsewhere"]
    assert bool(found) is said
    if said:
        assert found[0].values["begins"] == pytest.approx([0, 0, 0.3])
        assert "'upper'" in found[0].message
