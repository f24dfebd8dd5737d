"""Joint zeros, tool and base beside the springs: an arm of a UR10's size moved by Pinocchio."""

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from tests.doors import candidates, unknowns_of
from tests.identify.campaigns import measurements, plan, simulated, write_table
from tests.support import refused
from tests.support.commands import run
from tests.support.printed import text_of

import cartstiff
from cartstiff import DeadWrench
from cartstiff.extend import in_units
from cartstiff.identify import identify, read_measurements

JOINTS = (
    "shoulder_pan_joint",
    "shoulder_lift_joint",
    "elbow_joint",
    "wrist_1_joint",
    "wrist_2_joint",
    "wrist_3_joint",
)
SPRINGS = np.array([4.2e4, 3.0e4, 2.4e4, 9.0e3, 7.0e3, 5.0e3])
ZEROS = np.array([0.8, 0.5, -0.6, 1.1, -0.9, 0.7]) * 1e-3
# UR10: d and a of the maker's table [m], masses of its links [kg], drawn by hand as placements.
PLACES = (
    ((0, 0, 0), (0, 0, 0.1273)),
    ((0, np.pi / 2, 0), (0, 0.220941, 0)),
    ((0, 0, 0), (0, -0.1719, 0.612)),
    ((0, np.pi / 2, 0), (0, 0, 0.5723)),
    ((0, 0, 0), (0, 0.1149, 0)),
    ((0, 0, 0), (0, 0, 0.1157)),
)
AXES = "zyyyzy"
MASSES = (7.778, 12.93, 3.87, 1.96, 1.96, 0.202)
TOOL = (0.03, 0.0922, 0.05)


def _description():
    """The arm's URDF."""
    parts = ['<robot name="ten"><link name="base"/>']
    for i, (name, (rpy, xyz), axis, mass) in enumerate(
        zip(JOINTS, PLACES, AXES, MASSES, strict=True)
    ):
        com = 0.2 if mass > 3 else 0.02
        parts.append(
            f'<link name="l{i}"><inertial><mass value="{mass}"/><origin xyz="0 0.02 {com}"/>'
            '<inertia ixx="0.02" iyy="0.02" izz="0.02" ixy="0" ixz="0" iyz="0"/></inertial></link>'
            f'<joint name="{name}" type="revolute"><parent link="{f"l{i - 1}" if i else "base"}"/>'
            f'<child link="l{i}"/><origin rpy="{" ".join(map(repr, map(float, rpy)))}" '
            f'xyz="{" ".join(map(str, xyz))}"/>'
            f'<axis xyz="0 {int(axis == "y")} {int(axis == "z")}"/>'
            '<limit lower="-6.3" upper="6.3" effort="1" velocity="1"/></joint>'
        )
    parts.append(
        '<link name="tip"/><joint name="f" type="fixed"><parent link="l5"/><child link="tip"/>'
        f'<origin xyz="{" ".join(map(str, TOOL))}"/></joint></robot>'
    )
    return "".join(parts)


def _model():
    return pin.buildModelFromXML(_description())


def _urdf(path):
    """The arm as a mechanism file, with springs of one stiffness."""
    path.with_suffix(".urdf").write_text(_description(), "utf-8")
    springs = "".join(f"  {n}: {{stiffness: 2.0e4}}\n" for n in JOINTS)
    path.write_text(
        f"kind: serial\nmodel: {path.stem}.urdf\nframe: tip\ngravity: [0, 0, -9.81]\n"
        f"springs:\n{springs}",
        "utf-8",
    )
    return path


def _settled(model, data, q, mass):
    """Pose of the tip where springs, weight and a hung mass balance, by fixed-point iteration."""
    moved, frame = q.copy(), model.getFrameId("tip")
    for _ in range(12):
        J = pin.computeFrameJacobian(model, data, moved, frame, pin.LOCAL_WORLD_ALIGNED)
        torque = J[:3].T @ np.array([0, 0, -9.81 * mass])
        torque = torque - pin.computeGeneralizedGravity(model, data, moved)
        moved = q + torque / SPRINGS
    pin.framesForwardKinematics(model, data, moved)
    return data.oMf[frame].homogeneous.copy()


def campaign(
    path,
    rows=40,
    seed=3,
    sd=5e-5,
    zeros=ZEROS,
    tool=(0, 0, 0),
    base=None,
    orientation=0.0,
    same=False,
    tilt=(0, 0, 0),
    **columns,
):
    """A table: commanded joints, a hung mass of 0 or 5 kg, the measured place of the tool."""
    model, rng = _model(), np.random.default_rng(seed)
    data = model.createData()
    q = rng.uniform(-2.2, 2.2, (1 if same else rows, 6))
    q = np.tile(q, (rows, 1)) if same else q
    mass = np.where(np.arange(rows) % 2, 5.0, 0.0)
    if same:
        mass = np.full(rows, 5.0)
    seen, turned = [], []
    for row, m in zip(q, mass, strict=True):
        T = (np.eye(4) if base is None else base) @ _settled(model, data, row + zeros, m)
        seen.append(T[:3, 3] + T[:3, :3] @ np.asarray(tool) + sd * rng.normal(size=3))
        noise = pin.exp3(orientation * rng.normal(size=3))
        turned.append(pin.rpy.matrixToRpy(T[:3, :3] @ pin.exp3(np.array(tilt, float)) @ noise))
    table = dict(zip(JOINTS, q.T, strict=True)) | {"mass": mass}
    table |= dict(zip("xyz", np.array(seen).T, strict=True))
    table |= {f"sd_{n}": np.full(rows, sd) for n in "xyz"}
    if orientation:
        table |= dict(zip(("roll", "pitch", "yaw"), np.array(turned).T, strict=True))
        table |= {f"sd_{n}": np.full(rows, orientation) for n in ("roll", "pitch", "yaw")}
    return write_table(path, table | columns)


@pytest.fixture(scope="module")
def arm(tmp_path_factory):
    return cartstiff.load(str(_urdf(tmp_path_factory.mktemp("ten") / "ten.yaml")))


def _found(arm, path, sought, **how):
    return identify(arm, read_measurements(path, arm), sought=sought, **how)


def _truth(result):
    """Estimate less truth over the standard deviation, by name."""
    springs = dict(zip(JOINTS, 1.0 / SPRINGS, strict=True))
    z = {
        e.name: (e.compliance - springs[e.name]) / e.deviation
        for e in result.estimates
        if e.deviation is not None
    }
    zeros = dict(zip(JOINTS, ZEROS, strict=True))
    for g in result.geometry:
        if g.identifiable and g.name.endswith(".zero"):
            z[g.name] = (g.value - zeros[g.name.removesuffix(".zero")]) / g.sd
    return z


def test_zeros_and_springs_come_back_together(arm, tmp_path):
    """Loaded and linear fits; without the zeros the springs are wrong, and a note says by what."""
    path = campaign(tmp_path / "a.csv", rows=24)
    result = _found(arm, path, ("joints", "zeros"), loaded=True)
    z = _truth(result)
    assert len(z) == 11  # the weight does not turn the first joint
    assert max(map(abs, z.values())) < 3.5
    assert result.inflation == 1.0
    narrow = {e.name: e.deviation * e.stiffness for e in result.estimates if e.stiffness}
    assert narrow["shoulder_lift_joint"] < 0.02
    assert narrow["elbow_joint"] < 0.06
    small = _found(arm, path, ("joints", "zeros"))
    assert max(map(abs, _truth(small).values())) < 4.0
    without = _found(arm, path, ())
    off = [
        abs(w.compliance - 1 / k) / e.deviation
        for w, e, k in zip(without.estimates, result.estimates, SPRINGS, strict=True)
        if e.deviation
    ]
    assert max(off) > 5.0
    assert without.inflation > 5.0
    notes = {n.code: n for n in without.notes}
    assert notes["zeros-taken-as-known"].values["error"] == 5e-4
    assert "zeros-taken-as-known" not in {n.code for n in result.notes}
    assert "shoulder_lift_joint.zero" in text_of(result)


def test_what_half_a_milliradian_does_is_what_the_note_says(arm, tmp_path):
    """The same rows with one zero off by 0.5 mrad: the springs move by no more than was said."""
    zeros = np.zeros(6)
    clean = _found(arm, campaign(tmp_path / "a.csv", zeros=zeros), (), fit="plain")
    said = next(n for n in clean.notes if n.code == "zeros-taken-as-known").values["stiffness"]
    there, worst = clean.chosen.unbounded, np.zeros(6)
    for j in range(1, 6):
        off = zeros.copy()
        off[j] = -5e-4
        moved = _found(arm, campaign(tmp_path / "b.csv", zeros=off), (), fit="plain").chosen
        worst = np.maximum(worst, np.abs(moved.unbounded - there))
    for e, change in zip(clean.estimates, worst, strict=True):
        if np.isfinite(said.get(e.name, np.inf)):
            assert abs(e.compliance - 1.0 / said[e.name]) == pytest.approx(change, rel=0.02)


def test_deviations_are_honest_over_many_campaigns(arm, tmp_path):
    """Sum of squares of estimates less truth over their deviations, six campaigns."""
    z = []
    for seed in range(6):
        path = campaign(tmp_path / "a.csv", rows=30, seed=100 + seed)
        z += list(_truth(_found(arm, path, ("joints", "zeros"))).values())
    assert 0.6 < np.mean(np.square(z)) < 1.45  # 66 numbers: 1 +- 0.17
    assert np.mean(np.abs(z) < 1.96) > 0.87


def test_tool_and_base_and_large_zeros(arm, tmp_path):
    """Ten milliradians, five millimetres, a base turned by three degrees: rows are corrected."""
    zeros = np.array([0.0, 8e-3, -1e-2, 6e-3, -9e-3, 0.0])
    base = pin.SE3(pin.exp3(np.array([0.05, -0.03, 0.04])), np.array([0.2, -0.1, 0.05]))
    path = campaign(
        tmp_path / "a.csv", zeros=zeros, tool=(0.005, -0.004, 0.003), base=base.homogeneous
    )
    some = [f"{name}.zero" for name in JOINTS[1:5]]
    result = _found(arm, path, ("joints", *some, "tool", "base"))
    found = {g.name: g for g in result.geometry}
    assert all(g.identifiable for g in found.values())
    truth = dict(zip(some, zeros[1:5], strict=True))
    truth |= {"tool.x": 0.005, "tool.y": -0.004, "tool.z": 0.003}
    truth |= dict(zip(("base.x", "base.y", "base.z"), base.translation, strict=True))
    truth |= dict(zip(("base.rx", "base.ry", "base.rz"), (0.05, -0.03, 0.04), strict=True))
    assert set(truth) == set(found)
    for name, value in truth.items():
        assert abs(found[name].value - value) < 4.0 * found[name].sd, name
        assert found[name].sd < 2e-4
    springs = {e.name: e for e in result.estimates}
    for name, k in zip(JOINTS[1:], SPRINGS[1:], strict=True):
        assert abs(springs[name].compliance - 1 / k) < 4.0 * springs[name].deviation


def test_what_the_rows_do_not_separate_is_named_and_not_given(arm, tmp_path):
    """First zero and base about its axis; last zero and tool across its axis; and one posture."""
    path = campaign(tmp_path / "a.csv")
    result = _found(arm, path, ("joints", "zeros", "tool", "base"))
    groups = [set(n.values["unknowns"]) for n in result.notes if n.code == "not-separable"]
    first, last = {"shoulder_pan_joint.zero", "base.rz"}, {"wrist_3_joint.zero", "tool.x", "tool.z"}
    assert first in groups
    assert last in groups
    assert len(groups) == 2
    lost = {g.name for g in result.geometry if g.value is None and g.interval is None}
    assert lost == first | last
    data = result.to_dict()
    assert {g["name"] for g in data["geometry"] if not g["identifiable"]} == lost
    assert {n for u in data["unseen"] for n in u["offsets"]} == lost
    one = campaign(tmp_path / "b.csv", same=True)
    result = _found(arm, one, ("joints", "zeros"))
    group = next(set(n.values["unknowns"]) for n in result.notes if n.code == "not-separable")
    assert {"elbow_joint", "elbow_joint.zero"} <= group
    assert all(e.verdict == "not-identifiable" for e in result.estimates)
    assert not any(g.identifiable for g in result.geometry)


def test_orientations_show_the_last_zero(arm, tmp_path):
    """Positions on an axis do not show its zero, orientations do."""
    path = campaign(tmp_path / "a.csv", orientation=1e-4)
    result = _found(arm, path, ("joints", "zeros"))
    z = _truth(result)
    assert len(z) == 11
    assert max(map(abs, z.values())) < 3.5
    turned = _found(arm, path, ("joints", "zeros", "tool"))
    names = {g.name for g in turned.geometry}
    assert {"tool.rx", "tool.ry", "tool.rz"} <= names
    group = next(set(n.values["unknowns"]) for n in turned.notes if n.code == "not-separable")
    assert {"wrist_3_joint.zero", "tool.ry"} <= group


def test_refusals(arm, tmp_path):
    """Differences, loops and unknown words."""
    rows = 6
    columns = {name: np.linspace(0.1, 1.0, rows) for name in JOINTS}
    columns |= {"fz": np.full(rows, 50.0), "dz": np.full(rows, 1e-3)}
    path = write_table(tmp_path / "d.csv", columns)
    refused("differences do not show tool", _found, arm, path, ("joints", "tool"))
    refused("closest: zeros", _found, arm, path, ("zero",))
    loop = cartstiff.load("five-bar")
    refused("open chains", identify, loop, read_measurements(path, arm), sought=("zeros",))


def test_command_line(tmp_path):
    """Words of one option, in any order, of a fit and of a plan."""
    folder = tmp_path / "x"
    folder.mkdir()
    file = _urdf(folder / "ten.yaml")
    path = campaign(folder / "a.csv")
    text = run("identify", file, path, "--unknown", "zeros,tool")
    assert "elbow_joint.zero" in text
    assert "tool.y" in text
    few = ("--plan", "9", "--mass", "5", "--sd")
    planned = run("identify", file, *few, "x=0.02mm", "--unknown", "joints,zeros")
    assert "Predicted standard deviations of zeros and offsets" in planned
    assert "shoulder_pan_joint.zero" in planned
    differences = ("dx=0.02mm", "--unknown", "joints,zeros")
    run("identify", file, *few, *differences, code=2, said="differences do not show")


@pytest.mark.parametrize("criterion", ["worst", "all"])
def test_a_plan_separates_springs_from_zeros_and_says_what_the_fit_will(arm, criterion):
    """Deviations of the fit of planned rows are the predicted ones; a plan for springs is worse."""
    sought, spread = ("joints", "zeros", "tool", "base"), dict.fromkeys("xyz", 5e-5)
    found = candidates(arm, spread, count=150, mass=10.0, seed=1)

    def realised(rows):
        rows = simulated(arm, rows, spread, seed=3, tell_deviations=True)
        return identify(arm, rows, sought=sought)

    chosen = plan(unknowns_of(arm, sought), found, 16, criterion=criterion)
    result = realised(chosen.rows)
    fitted = [np.inf if e.deviation is None else e.deviation for e in result.estimates]
    assert fitted / chosen.unknowns.nominal == pytest.approx(chosen.deviations[-1], rel=2e-3)
    assert chosen.lost == ("shoulder_pan_joint",)
    for g, predicted in zip(result.geometry, chosen.geometry, strict=True):
        assert (g.name, g.unit) == (predicted.name, predicted.unit)
        assert g.sd == (None if predicted.sd is None else pytest.approx(predicted.sd, rel=2e-3))
    springs = realised(plan(unknowns_of(arm), found, 16, criterion=criterion).rows)
    worse = np.array([e.deviation for e in springs.estimates[1:]]) / fitted[1:]
    assert worse.max() > 1.15
    assert np.prod(worse) > 1.1


def test_a_zero_about_an_axis_through_the_tool_does_not_take_the_tools_place():
    """The fit of noisy rows determines what their plan says: micrometres of tool are no lever."""
    ur5, spread = cartstiff.load("ur5"), dict.fromkeys("xyz", 2e-5)
    sought = ("joints", "zeros", "tool", "base")
    found = candidates(ur5, spread, count=60, mass=5.0, seed=1)
    chosen = plan(unknowns_of(ur5, sought), found, 14)
    rows = simulated(ur5, chosen.rows, spread, seed=3, tell_deviations=True)
    result = identify(ur5, rows, sought=sought)
    for g, predicted in zip(result.geometry, chosen.geometry, strict=True):
        assert g.name == predicted.name
        assert g.sd == (None if predicted.sd is None else pytest.approx(predicted.sd, rel=0.02))
    assert result.placed["wrist_3_joint.zero"] == 0.0


def test_intervals_of_session_positions_count_the_linear_models_error(arm, tmp_path):
    """Two frames of a tracker, equilibria by Pinocchio: 182 of 200 intervals held before, now 191.

    (Over seeds 0 to 39.) They are the linear fit's own, wider by what the equilibrium changes.
    """
    model, rows, sd = _model(), 24, 2e-5
    data = model.createData()
    held = wider = said = 0
    for seed in range(4):
        rng = np.random.default_rng(seed)
        q = rng.uniform(-2.2, 2.2, (rows, 6))
        mass = np.where(np.arange(rows) % 2, 5.0, 0.0)
        session = [f"s{i * 2 // rows}" for i in range(rows)]
        frames = {
            f"s{k}": pin.SE3(pin.exp3(rng.normal(size=3)), rng.normal(size=3)) for k in range(2)
        }
        seen = [
            frames[s] * _settled(model, data, a, m)[:3, 3] + sd * rng.normal(size=3)
            for a, m, s in zip(q, mass, session, strict=True)
        ]
        table = dict(zip(JOINTS, q.T, strict=True)) | {"mass": mass, "session": session}
        table |= dict(zip("xyz", np.array(seen).T, strict=True))
        table |= {f"sd_{n}": np.full(rows, sd) for n in "xyz"}
        result = _found(arm, write_table(tmp_path / "a.csv", table), ())
        t = 1.959964
        for e, k in zip(result.estimates, SPRINGS, strict=True):
            if e.interval is not None:
                held += e.interval[0] <= 1 / k <= e.interval[1]
                p = result.unknowns.names.index(e.name)
                high = result.chosen.unbounded[p] + t * e.deviation
                assert e.interval[1] >= high * (1.0 - 1e-6)
                wider += e.interval[1] > high * (1.0 + 1e-6)
        said += any("intervals are wider" in n.message for n in result.notes)
    assert held >= 18
    assert wider == 5 * said > 0


@pytest.mark.parametrize("units", [None, {"length": "mm"}])
def test_a_base_far_away_and_a_turned_tool(tmp_path, units):
    """A frame turned by a radian: every offset comes back, in metres and in millimetres.

    The tool's turn is lost if the steps on the way to it are added instead of composed.
    """
    arm = _arm_in(tmp_path, units)
    length = 1.0 if units is None else 1000.0
    rng, names = np.random.default_rng(5), ("x", "y", "z", "rx", "ry", "rz")
    held, inner = dict.fromkeys(("tool", "base"), 0), ZEROS * [0, 1, 1, 1, 1, 0]
    for seed in range(3):
        shift, turn = rng.normal(size=3), rng.normal(size=3)
        base = pin.SE3(pin.exp3(turn), shift).homogeneous
        tool, tilt = (0.003, -0.002, 0.004), np.array([0.004, -0.003, 0.002])
        how = {"zeros": inner, "base": base, "tool": tool, "tilt": tilt, "orientation": 1e-4}
        path = campaign(tmp_path / "a.csv", seed=seed, **how)
        some = [f"{name}.zero" for name in JOINTS[1:5]]
        found = {g.name: g for g in _found(arm, path, ("joints", *some, "tool", "base")).geometry}
        for word, truth in (("tool", (*tool, *tilt)), ("base", (*shift, *turn))):
            sizes = np.repeat([length, 1.0], 3)
            for part, value in zip(names, truth * sizes, strict=True):
                g = found[f"{word}.{part}"]
                assert abs(g.value - value) < 5.0 * g.sd
                held[word] += abs(g.value - value) < 2.0 * g.sd
    assert min(held.values()) >= 13  # of 18
    refused("--unknown base finds another frame", _found, arm, path, ())


def _arm_in(folder, units):
    arm = cartstiff.load(str(_urdf(folder / "ten.yaml")))
    return arm if units is None else in_units(arm, units["length"])


def _written(path, source, *more):
    """The mechanism of a file that the command writes."""
    out = path.with_name("found.yaml")
    run("identify", path, source, "--unknown", "joints,zeros,tool,base", *more, "-o", out)
    return cartstiff.load(str(out))


def test_the_file_written_stands_where_the_rows_were_measured(tmp_path):
    """Zeros, tool and base of the file: by its equilibria the rows are predicted to their noise.

    Among them are those that the rows do not separate: the first zero and the base about its axis.
    """
    base = pin.SE3(pin.exp3(np.array([0.01, -0.02, 0.015])), np.array([0.2, -0.1, 0.05]))
    tilt, inside = np.array([4e-3, -3e-3, 2e-3]), (0.02, 0.01, 0.04)
    true = {"zeros": 8.0 * ZEROS, "tool": np.array(inside) + 4e-3, "base": base.homogeneous}
    source = campaign(tmp_path / "a.csv", orientation=1e-4, tilt=tilt, **true)
    text = source.read_text("utf-8").replace(
        "mass,x,y,z,sd_x,sd_y,sd_z",
        "mass,x [m],y [m],z [m]," + ",".join(f"sd_{n} [m]" for n in "xyz"),
    )
    source.write_text(text, "utf-8")
    place = f"--point={','.join(map(str, inside))}"
    arm = _written(_urdf(tmp_path / "ten.yaml"), source, place, "--load-at=0,0,0")
    rows = read_measurements(source, arm, point=inside)
    missed, turned = [], []
    for n in range(0, len(rows), 4):
        x = rows.q[n]
        for _ in range(8):
            state = arm.mechanism.at(x)
            pull = state.pose[:3, :3].T @ arm.gravity * rows.mass[n]
            torque = state.motion.jacobian[3:].T @ pull
            torque = torque - state.gravity(arm.gravity).gradient
            x = rows.q[n] + torque / arm.springs.stiffness
        T = arm.mechanism.at(x).pose
        seen = [rows.values[name][n] for name in "xyz"]
        missed.append(T[:3, 3] + T[:3, :3] @ inside - seen)
        R = pin.rpy.rpyToMatrix(*(rows.values[name][n] for name in ("roll", "pitch", "yaw")))
        turned.append(pin.log3(R.T @ T[:3, :3]))
    assert np.sqrt(np.mean(np.square(missed))) < 7e-5  # of 5e-5
    assert np.sqrt(np.mean(np.square(turned))) < 2e-4
    bare = cartstiff.load(str(tmp_path / "ten.yaml"))
    wrong = bare.mechanism.at(rows.q[0]).pose[:3, 3] - T[:3, 3]
    assert np.linalg.norm(wrong) > 0.01


def test_weights_act_on_the_arm_of_the_file_written_as_in_the_fit(tmp_path):
    """The payload stays on its link, gravity and a line's point in F stay where they are to it."""
    file = _urdf(tmp_path / "ten.yaml")
    more = (
        "q: {shoulder_lift_joint: -1, elbow_joint: 1.2}\n"
        "payload: {mass: 4, com: [0.1, 0, 0.2]}\nlines:\n"
        "- {frames: [world, l2], points: [[0, 0.2, 1], [0, 0, 0.1]], stiffness: 900, preload: 50}\n"
    )
    file.write_text(file.read_text("utf-8") + more, "utf-8")
    turn = pin.exp3(np.array([0.6, 0.0, 0.5]))
    base = pin.SE3(turn, np.array([1.0, 2.0, 0.5])).homogeneous
    tilt = np.array([0.02, 0.01, -0.03])
    source = campaign(
        tmp_path / "a.csv", base=base, tool=(0.02, 0, 0.01), tilt=tilt, orientation=1e-4
    )
    out = tmp_path / "found.yaml"
    run("identify", file, source, "--unknown", "tool,base,wrist_1_joint", "-o", out)
    found, own = cartstiff.load(str(out)), cartstiff.load(str(file))
    assert found.gravity == pytest.approx(turn @ own.gravity, abs=0.05)
    torques = []
    for arm in (found, own):
        state = arm.mechanism.at(np.full(6, 0.4))
        terms = (state.gravity(arm.gravity), *(p.evaluate(state) for p in arm.potentials))
        torques.append([term.gradient for term in terms])
    assert np.array(torques[0]) == pytest.approx(np.array(torques[1]), abs=1e-6)


def test_a_tool_of_a_platform_has_no_place_in_its_file(tmp_path):
    """It is refused before the fit."""
    legs = cartstiff.load("stewart-gough")
    q = np.random.default_rng(0).uniform(-0.1, 0.1, (12, 6)) + legs.q
    table = dict(zip([f"q_{n}" for n in legs.names], q.T, strict=True))
    table |= dict(
        zip("xyz", np.array([legs.mechanism.at(x).pose[:3, 3] for x in q]).T, strict=True)
    )
    path = write_table(tmp_path / "p.csv", table | {"fz": np.full(12, 500.0)})
    words = ("--unknown", "joints,tool", "-o", tmp_path / "p.yaml")
    run("identify", "stewart-gough", path, *words, code=2, said="no place in a file of kind")


def test_a_session_has_no_name_of_an_offset_that_is_sought(arm, tmp_path):
    """Their numbers would be one key of the answer."""
    source = campaign(tmp_path / "a.csv", session=np.full(40, "tool"))
    refused(
        r"column session: has the name of an offset .* got tool",
        _found,
        arm,
        source,
        ("joints", "tool"),
    )


def test_rotations_of_sessions_are_exact_on_a_soft_arm():
    """Exact rows of two frames: the sag turns the first guess of a frame by 15 mrad."""
    stiffness = [4e3, 4e3, 3e3, 1e3, 1e3, 1e3]
    soft, rng = cartstiff.load("ur5", stiffness=stiffness), np.random.default_rng(3)
    frames = {s: pin.SE3(pin.exp3(rng.normal(size=3)), rng.normal(size=3)) for s in "ab"}
    q = rng.uniform(-1.5, 1.5, (20, 6)) + np.array([0, -1, 1, 0, 0.8, 0])
    W = np.zeros((20, 6))
    W[:, 3:] = [[*rng.normal(size=2) * 60.0, -120.0] for _ in q]
    tips = [
        cartstiff.equilibrium(soft, a, DeadWrench(w)).pose[:3, 3] for a, w in zip(q, W, strict=True)
    ]
    names = ["ab"[i % 2] for i in range(20)]
    seen = np.array([frames[s] * x for s, x in zip(names, tips, strict=True)])
    rows = measurements(q, W, dict(zip("xyz", seen.T, strict=True)), sd=np.nan, session=names)
    result = identify(cartstiff.load("ur5"), rows, loaded=True)
    found = [e.stiffness for e in result.estimates[:5]]
    assert found == pytest.approx(stiffness[:5], rel=1e-6)
    assert not len(result.robust.suspects)
    rows = replace(
        rows, values=rows.values | {"z": np.where(np.arange(20) == 3, np.nan, seen[:, 2])}
    )
    refused(
        r"row 4: a position in a session's own frame is not whole",
        identify,
        cartstiff.load("ur5"),
        rows,
    )
