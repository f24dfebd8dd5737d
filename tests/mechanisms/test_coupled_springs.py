"""Springs on sums of joint positions: MuJoCo's fixed tendons, energies, and least energy."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest
from tests.support import relative_error
from tests.support.commands import answer, outcome, refuses, run

import cartstiff
from cartstiff import (
    DeadWrench,
    InputError,
    JointFunction,
    analyse,
    commanded,
    compensate,
    equilibrium,
    load,
)
from cartstiff.extend import in_units

STEP = 1e-6
DIFFERENCES = 1e-7
Q = np.array([0.3, 0.4, 0.2, 0.05])
#: Left and right motor of a differential, and a tendon over a hinge and a slide.
FACTORS = np.array([[0.0, 1.0, 1.0, 0.0], [0.0, 1.0, -1.0, 0.0], [0.4, 0.0, 0.0, 1.5]])
STIFFNESS = np.array([900.0, 700.0, 3e4])
REST = np.array([0.62, 0.17, 0.19])
BODY = """<mujoco><compiler angle="radian"/><option gravity="0 0 -9.81"/><worldbody>
<body name="a" pos="0 0 .3"><joint name="elbow" axis="0 1 0" stiffness="2000" springref="0.31"/>
<geom type="capsule" size=".04" fromto="0 0 0 .3 0 0"/>
<body name="b" pos=".3 0 0"><joint name="pitch" axis="0 1 0"/>
<geom type="capsule" size=".03" fromto="0 0 0 .1 .02 0"/>
<body name="c"><joint name="roll" axis="1 0 0"/>
<geom type="capsule" size=".02" fromto="0 0 0 .1 0 .03"/>
<body name="d"><joint name="reach" type="slide" axis="1 0 0" range="0 0.2"/>
<geom type="capsule" size=".02" fromto="0 0 0 .1 0 0"/><site name="tool" pos=".15 .04 0"/>
</body></body></body></body></worldbody>{tendons}</mujoco>"""
TENDONS = """<tendon>
<fixed name="left" stiffness="900" springlength="0.62"><joint joint="pitch" coef="1"/>
<joint joint="roll" coef="1"/></fixed>
<fixed name="right" stiffness="700" springlength="0.17"><joint joint="pitch" coef="1"/>
<joint joint="roll" coef="-1"/></fixed>
<fixed name="cable" stiffness="30000" springlength="0.19"><joint joint="elbow" coef="0.4"/>
<joint joint="reach" coef="1.5"/></fixed></tendon>"""
FILE = """kind: {kind}
gravity: [0, 0, {g}]
model: wrist.xml
frame: tool
q: {{elbow: 0.3, pitch: 0.4, roll: 0.2, reach: 0.05}}
{more}"""
COUPLED = """coupled_springs:
  - {{name: left, joints: {{pitch: 1, roll: 1}}, stiffness: 900{0}}}
  - {{name: right, joints: {{pitch: 1, roll: -1}}, stiffness: 700{1}}}
  - {{name: cable, joints: {{elbow: 0.4, reach: 1.5}}, stiffness: 30000{2}}}
"""
GIVEN = COUPLED.format(", rest: 0.62", ", rest: 0.17", ", rest: 0.19")
OPEN = COUPLED.format("", "", "")
FORCE = np.array([0.3, -0.2, 0.1, 8.0, 5.0, -60.0])


@pytest.fixture(autouse=True)
def elsewhere(tmp_path, monkeypatch):
    """MuJoCo leaves a log of its warnings where it runs."""
    monkeypatch.chdir(tmp_path)


def wrist(tmp_path, more="", kind="serial", tendons="", g=-9.81):
    (tmp_path / "wrist.xml").write_text(BODY.format(tendons=tendons), "utf-8")
    path = tmp_path / "wrist.yaml"
    path.write_text(FILE.format(kind=kind, more=more, g=g), "utf-8")
    return path


class Reference:
    """MuJoCo's model with the three fixed tendons."""

    def __init__(self, rest=REST):
        self.model = mujoco.MjModel.from_xml_string(BODY.format(tendons=TENDONS))
        self.model.tendon_lengthspring[:] = rest[:, None]
        self.data = mujoco.MjData(self.model)

    def unbalanced(self, q, force=None):
        """Joint forces (4,) that are not balanced under a force (6,) in the room at the tool."""
        data = self.data
        data.qpos[:] = q
        data.qvel[:] = 0.0
        mujoco.mj_forward(self.model, data)
        total = data.qfrc_passive - data.qfrc_bias
        if force is not None:
            J = self.jacobian()
            total = total + J.T @ force
        return total.copy()

    def jacobian(self):
        """Jacobian (6, 4) of the tool in the axes of the room: turns, then displacements."""
        rows = np.zeros((2, 3, 4))
        mujoco.mj_jacSite(self.model, self.data, rows[1], rows[0], 0)
        return rows.reshape(6, 4)

    def compliance(self, q, force):
        """Compliance (6, 6) in the room's axes under a force that stays there."""
        slopes = [
            (self.unbalanced(q - d, force) - self.unbalanced(q + d, force)) / (2 * STEP)
            for d in STEP * np.eye(4)
        ]
        self.unbalanced(q)
        J = self.jacobian()
        return J @ np.linalg.solve(np.array(slopes).T, J.T)


def in_room(C, pose):
    """A compliance (6, 6) in the body's axes, in those of the room."""
    R = np.kron(np.eye(2), pose[:3, :3])
    return R @ C @ R.T


@pytest.mark.parametrize(
    ("kind", "tendons", "more"),
    [("serial", TENDONS, ""), ("serial", "", GIVEN), ("closed-chain", "", GIVEN)],
)
def test_fixed_tendons_are_those_of_mujoco(tmp_path, kind, tendons, more):
    elastic = load(wrist(tmp_path, more, kind, tendons))
    state = equilibrium(elastic, None, DeadWrench(FORCE))
    mujoco_says = Reference()
    left = mujoco_says.unbalanced(state.q, FORCE)
    assert np.abs(left).max() < 1e-8 * np.abs(STIFFNESS * (FACTORS @ state.q - REST)).max()
    C = in_room(state.stiffness.compliances["B"], state.stiffness.pose)
    expected = mujoco_says.compliance(state.q, FORCE)
    assert relative_error(C, expected) < DIFFERENCES
    assert elastic.stiffnesses == [2000.0, 0.0, 0.0, 0.0]  # none is assumed besides


def test_rest_positions_are_chosen_to_balance_a_load_and_the_weight(tmp_path):
    elastic = load(wrist(tmp_path, "springs: {elbow: {stiffness: 2000}}\n" + OPEN))
    for wrench in (None, FORCE):
        result = analyse(elastic, wrench=wrench, load_axes="body" if wrench is None else "world")
        (springs,) = result.elastic.coupled_springs
        elbow = result.elastic.springs.rest[0]
        mujoco_says = Reference(springs.rest)
        mujoco_says.model.qpos_spring[0] = elbow
        left = mujoco_says.unbalanced(Q, wrench)
        assert np.abs(left).max() < 1e-9
        if wrench is not None:
            C = in_room(result.tangent_compliance, result.pose)
            expected = mujoco_says.compliance(Q, FORCE)
            assert relative_error(C, expected) < DIFFERENCES


def test_springs_that_share_a_load_take_the_parts_of_least_energy(tmp_path):
    """Springs free of force, then loaded: each has its stiffness times a common deflection."""
    own = "springs: {elbow: {stiffness: 2000}, pitch: {stiffness: 300}, reach: {stiffness: 5e4}}\n"
    elastic = load(wrist(tmp_path, own + OPEN, g=0))
    result = analyse(elastic, wrench=FORCE, load_axes="world")
    (springs,) = result.elastic.coupled_springs
    K = np.diag([2000.0, 300.0, 0.0, 5e4]) + FACTORS.T @ (STIFFNESS[:, None] * FACTORS)
    deflection = np.linalg.solve(K, result.jacobian.T @ result.wrench)
    found = springs.stiffness * (springs.factors @ Q - springs.rest)
    assert found == pytest.approx(STIFFNESS * (FACTORS @ deflection), rel=1e-9)


def test_every_door_knows_coupled_springs(tmp_path):
    path = wrist(tmp_path, GIVEN)
    elastic = load(path)
    start = equilibrium(elastic)
    known = analyse(elastic, start.q)
    batch = cartstiff.analyse_many(elastic, np.array([start.q, start.q]), outputs=("compliance_B",))
    assert batch["compliance_B"][1] == pytest.approx(known.compliances["B"], rel=1e-12, abs=1e-18)
    by_command = answer("analyse", path, "--q", ",".join(map(repr, start.q.tolist())), "--json")
    C = np.array(by_command["compliance"]["B"])
    assert pytest.approx(known.compliances["B"], rel=1e-9, abs=1e-15) == C
    # Eigenvalues of MuJoCo's mass matrix and stiffness at rest.
    mujoco_says = Reference()
    assert np.abs(mujoco_says.unbalanced(start.q)).max() < 1e-7
    M = np.zeros((4, 4))
    for row, unit in zip(M, np.eye(4), strict=True):
        mujoco.mj_mulM(mujoco_says.model, mujoco_says.data, row, unit)
    slopes = [
        (mujoco_says.unbalanced(start.q - d) - mujoco_says.unbalanced(start.q + d)) / (2 * STEP)
        for d in STEP * np.eye(4)
    ]
    squares = np.sort(np.linalg.eigvals(np.linalg.solve(M, np.array(slopes).T)).real)
    rates = 2 * np.pi * np.array(cartstiff.modes(elastic, start.q).frequencies)
    assert np.sort(rates**2) == pytest.approx(squares, rel=1e-5)
    other = analyse(in_units(elastic, "mm"), start.q * [1, 1, 1, 1000])
    scale = np.repeat([1.0, 1000.0], 3)
    expected = known.compliances["B"] * np.outer(scale, scale) / 1000
    assert other.compliances["B"] == pytest.approx(expected, rel=1e-9, abs=1e-18)


def test_measurements_of_a_machine_with_coupled_springs(tmp_path):
    """`identify` holds them as they are, and finds the spring beside them."""
    elastic = load(wrist(tmp_path, "springs: {elbow: {stiffness: 2000}}\n" + OPEN, g=0))
    true = elastic.with_springs({"elbow": 1234.0})
    rows = ["q_elbow,q_pitch,q_roll,q_reach,fx [N],fy [N],fz [N],dx [m],dy [m],dz [m]"]
    rng = np.random.default_rng(3)
    for _ in range(6):
        q = Q + 0.3 * rng.normal(size=4) * [1, 1, 1, 0.1]
        F = 20 * rng.normal(size=3)
        result = analyse(true, q)
        d = (in_room(result.compliances["B"], result.pose) @ np.r_[0, 0, 0, F])[3:]
        rows.append(",".join(map(repr, [*q.tolist(), *F.tolist(), *d.tolist()])))
    table = tmp_path / "rows.csv"
    table.write_text("\n".join(rows), "utf-8")
    found = answer("identify", tmp_path / "wrist.yaml", table, "--json")
    (elbow,) = [entry for entry in found["parameters"] if entry["name"] == "elbow"]
    assert elbow["stiffness"] == pytest.approx(1234.0, rel=1e-4)


def test_coupled_springs_that_cannot_be_used_are_refused(tmp_path):
    one = "coupled_springs: [{{joints: {{{0}}}, stiffness: {1}}}]\n"
    for more, words in (
        (one.format("ellbow: 1, roll: 1", 5), "ellbow"),
        (one.format("pitch: 0, roll: 1", 5), "factor"),
        (one.format("pitch: 1, roll: 1", 0), "above zero"),
        (one.format("", 5), "at least 1"),
    ):
        code, _, said = outcome("analyse", wrist(tmp_path, more))
        assert code == 2
        assert words in said
    path = wrist(tmp_path, one.format("pitch: 1, roll: 1", 5) + "passive: [reach]\n")
    code, _, said = outcome("analyse", path, "--load", "0,0,0,0,0,-10")
    assert code == 2
    assert "keeps its own rest" in said or "has no spring" in said
    elastic = load(wrist(tmp_path, GIVEN))
    refuses("single joints", compensate, elastic, [elastic.q], [FORCE])
    refuses("nothing drives it", commanded, elastic, {"pitch": 0.01})


def test_an_energy_that_couples_joints_is_named_where_it_cannot_balance(tmp_path):
    """A differential as a function of the joints keeps its own rest; `equilibrium` deflects it."""
    elastic = load(wrist(tmp_path, GIVEN, g=0))
    (springs,) = elastic.coupled_springs
    energy = JointFunction(
        lambda q: float(0.5 * STIFFNESS @ (FACTORS @ q - REST) ** 2),
        lambda q: FACTORS.T @ (STIFFNESS * (FACTORS @ q - REST)),
        lambda q: FACTORS.T @ (STIFFNESS[:, None] * FACTORS),
    )
    own = replace(elastic, potentials=(energy,))
    with pytest.raises(InputError, match=r"JointFunction.*keeps its own rest.*equilibrium"):
        analyse(own, wrench=FORCE)
    expected = equilibrium(elastic, None, DeadWrench(FORCE))
    assert equilibrium(own, None, DeadWrench(FORCE)).q == pytest.approx(expected.q, abs=1e-12)
    assert type(springs).__name__ == "CoupledJointSprings"


CLAMPED = """<robot name="gantry"><link name="g"/><link name="left"/><link name="car"/>
<link name="right"/><link name="end"/>
<joint name="j1" type="fixed"><parent link="g"/><child link="left"/></joint>
<joint name="j2" type="fixed"><parent link="left"/><child link="car"/>
<origin xyz="0.5 0 0"/></joint>
<joint name="j3" type="fixed"><parent link="car"/><child link="right"/></joint>
<joint name="j4" type="fixed"><parent link="right"/><child link="end"/>
<origin xyz="0.9 0 0"/></joint></robot>"""
BEAM = "E: 7.0e10, G: 2.6e10, area: 2.4e-3, Iy: 3.1e-6, Iz: 1.2e-6, J: 1.5e-6"


def test_a_load_on_a_beam_between_clamps_deflects_it(tmp_path):
    """P a^3 b^3 / (3 E I L^3): no joint has a spring, and the beams carry the load."""
    (tmp_path / "gantry.urdf").write_text(CLAMPED, "utf-8")
    path = tmp_path / "gantry.yaml"
    path.write_text(
        "kind: closed-chain\nmodel: gantry.urdf\nframe: car\nflexible:\n"
        f"  left: {{beam: {{{BEAM}, length: 0.5}}}}\n  right: {{beam: {{{BEAM}, length: 0.9}}}}\n"
        "closures:\n  - {frames: [end, world], points: [[0,0,0],[1.4,0,0]], type: weld}\n",
        "utf-8",
    )
    expected = 120 * 0.5**3 * 0.9**3 / (3 * 7e10 * 3.1e-6 * 1.4**3)
    found = answer("analyse", path, "--load", "0,0,0,0,0,-120", "--world", "--json")
    assert found["pose"][2][3] == pytest.approx(-expected, rel=1e-5)
    assert "6.121 µm under the load" in run("analyse", path, "--load", "0,0,0,0,0,-120", "--world")
    # A start that is no equilibrium is deflected to the load that is given, if it is none.
    moved = answer("analyse", path, "--q", "left.near_ry=0.001", "--load", "0,0,0,0,0,0", "--json")
    assert np.abs(moved["q"]).max() < 1e-12
