"""Every key of the mechanism file acts: another value gives another result, or is refused.

The keys are those of `cartstiff.extend.file_schema()`; one without a case here fails.
"""

import copy
import json
from pathlib import Path

import numpy as np
import pytest
import yaml
from tests.mechanisms.machines import joint, masses, write_file, write_urdf

import cartstiff
from cartstiff import InputError
from cartstiff.extend import file_schema

#: Keys for people who read the file; their descriptions say so.
FOR_READERS = {"description", "source", "date", "rows"}
K6 = np.diag([3e3, 4e3, 5e3, 2e5, 3e5, 4e5])
BEAM = {"E": 7e10, "G": 2.6e10, "length": 0.2, "area": 6e-4, "Iy": 4.5e-8, "Iz": 2e-8, "J": 5e-8}
HEX = [[np.cos(a), np.sin(a), 0] for a in np.deg2rad([0, 10, 120, 130, 240, 250])]
TOP = [[np.cos(a) / 2, np.sin(a) / 2, 0] for a in np.deg2rad([310, 60, 70, 180, 190, 300])]
PLATFORM = {
    "kind": "stewart-gough",
    "base": HEX,
    "platform": TOP,
    "pose": {"xyz": [0, 0, 0.8], "rpy": [0.05, 0.02, 0.1]},
    "legs": {"stiffness": 1e5, "rest_length": 0.9},
}
BODY = {"mass": 4.0, "com": [0, 0, 0.1]}
FLEXURE = {"axial": 1e6, "shear": 1e5, "bending": 30.0, "torsion": 50.0, "offset": 0.01}
STRUT = {"axial": 1e5, "lower": FLEXURE, "upper": FLEXURE | {"bending": 90.0}}
STRUTS = {"fixed": 0.3, "moving": 0.2, "fixed_com": 0.1, "moving_com": 0.2, "radius": 0.01}
SPRINGS = PLATFORM | {"kind": "springs", "legs": {"stiffness": 1e5, "rest_length": 1.1}}
POSTURE = dict(zip((f"j{i}" for i in range(1, 7)), (0.3, -1.1, 1.4, -0.7, 0.9, 0.2), strict=True))
ARM = {
    "kind": "serial",
    "model": "arm.urdf",
    "frame": "hand",
    "q": POSTURE,
    "springs": {f"j{i}": {"stiffness": 1e4 * i, "rest": 0.1 * i} for i in range(1, 7)},
}
DH_ROWS = [{"d": 0.3, "alpha": 1.5}, {"a": 0.5}, {"a": 0.4, "theta": 0.4}]
DH = {"kind": "serial", "dh": {"convention": "standard", "joints": DH_ROWS}}
ELASTIC = ARM | {"springs": {f"j{i}": {"stiffness": 1e4 * i} for i in range(1, 7)}}
FOUND = {
    "compliances": [{"name": "j1", "value": 1e-4}, {"name": "j2", "value": 5e-5}],
    "covariance": [[1e-12, 0.0], [0.0, 1e-12]],
}
MEASURED = ELASTIC | {"identified": FOUND}
BENT = ELASTIC | {
    "springs": ELASTIC["springs"] | {"j1": {"polynomial": [1e4, 0, 1e6]}},
    "identified": {
        "compliances": [{"name": "j1", "value": 1e-4, "polynomial": ["j1", 1]}],
        "covariance": [[1e-12]],
    },
}


def found(name, value):
    """One compliance that was measured."""
    return {"compliances": [{"name": name, "value": value}], "covariance": [[1e-12]]}


BALL = {"xyz": [0.4, 0.1, 0.5], "rpy": [0, 0.1, 0]}
LEG = {
    "model": "arm.urdf",
    "frame": "hand",
    "springs": {f"j{i}": {"stiffness": 1e4 * i} for i in range(1, 7)},
    "q": POSTURE,
}
PAIR = {
    "kind": "parallel",
    "legs": [LEG, LEG | {"base": {"xyz": [0.1, 0, 0]}, "grip": {"xyz": [-0.05, 0, 0]}}],
    "pose": BALL,
}
FIVE_BAR = {
    "kind": "closed-chain",
    "model": "bars.urdf",
    "frame": "tip",
    "closures": [{"frames": ["tip", "right_tip"], "type": "point"}],
    "actuated": ["left", "right"],
    "q": {"left": 2.2, "left_elbow": -1.35, "right": 0.95, "right_elbow": 1.35},
    "springs": {"left": {"stiffness": 800}, "right": {"stiffness": 700}},
}
LINE = {"frames": ["world", "hand"], "points": [[0, 0, 1], [0, 0, 0]], "stiffness": 1e4}
TAUT = {"lines": [LINE | {"rest_length": 0.4}]}

RING = {"radius": 1.0, "half_angle": 0.1}
PAIRS = {"base": RING, "platform": {"radius": 0.6, "half_angle": 0.2}, "height": 0.8}
LAID = {"kind": "stewart-gough", "layout": PAIRS, "legs": {"stiffness": 1e5, "rest_length": 0.9}}
THIRDS = {
    "base": {"radius": 1.0, "angles": [-0.1, 0.1]},
    "platform": {"radius": 0.6, "angles": [-0.9, 0.9]},
    "height": 0.8,
    "symmetry": 3,
}
CUBE = {"cubic": {"edge": 1.0, "centre": 0.3}, "base": {"height": 0.0}}
RINGS = {
    "base": {"radius": 0.3, "half_angle": 0.25},
    "platform": {"radius": 0.12, "half_angle": 0.8},
}
RODS = {"chain": "PUS", **RINGS, "rod": 0.6, "stiffness": 1e6}
NAMED = {"kind": "parallel", "legs": RODS, "pose": {"xyz": [0, 0, 0.5]}}
CRANKS = NAMED | {"legs": RODS | {"chain": "RUS", "crank": 0.1, "axis": "radial"}}
TRIPOD = {"chain": "UPS", "base": {"radius": 0.3}, "platform": {"radius": 0.1}, "stiffness": 1e6}

KINDS = {
    "SerialFile": ARM,
    "PlatformFile": PLATFORM,
    "SpringsFile": SPRINGS,
    "ParallelFile": PAIR,
    "ClosedChainFile": FIVE_BAR,
}


# Model.key: (file, path of the key in it, another value, further keys of both files).
def _cases():
    """The table `every_key.yaml`: file, way to the key, value, and what else the file holds."""
    table = yaml.safe_load(Path(__file__).with_name("every_key.yaml").read_text(encoding="utf-8"))
    return {
        name: (
            globals()[case["file"]],
            tuple(int(step) if step.isdigit() else step for step in case["key"].split(".")),
            case["value"],
            case.get("beside", {}),
        )
        for name, case in table.items()
    }


CASES = _cases() | {
    "LegModel.q": (PAIR | {"pose": None, "legs": [LEG]}, ("legs", 0, "q", "j3"), 1.0, {}),
    **{
        f"{name}.{key}": (file, (key,), [[1.1 * x for x in point] for point in file[key]], {})
        for name, file in (("PlatformFile", PLATFORM), ("SpringsFile", SPRINGS))
        for key in ("base", "platform")
    },
}


#: Sections of mechanism files by their keys, as any editor has them.
SECTIONS = {name: model["properties"] for name, model in file_schema()["$defs"].items()}
KEYS = sorted(f"{name}.{key}" for name, keys in SECTIONS.items() for key in keys)


def write_robots(folder):
    arm = [
        joint("j1", "base", "shoulder", at=(0, 0, 0.2), axis=(0, 0, 1)),
        joint("j2", "shoulder", "upper", axis=(0, 1, 0)),
        joint("j3", "upper", "fore", at=(0.4, 0, 0), axis=(0, 1, 0)),
        joint("j4", "fore", "w1", at=(0.35, 0, 0), axis=(0, 1, 0)),
        joint("j5", "w1", "w2", at=(0, 0.1, 0), axis=(0, 0, 1)),
        joint("j6", "w2", "hand", at=(0.1, 0, 0), axis=(1, 0, 0)),
    ]
    for name, mass in (("arm", 2.0), ("other", 2.0)):
        path = write_urdf(folder, *arm, name=name)
        text = masses(path.read_text(encoding="utf-8"), upper=mass, fore=mass)
        path.write_text(text.replace("0.35", "0.36") if name == "other" else text)
    bars = [
        joint("left", "base", "left_bar", at=(-0.1, 0, 0)),
        joint("left_elbow", "left_bar", "left_rod", at=(0.25, 0, 0)),
        joint("left_end", "left_rod", "tip", at=(0.3, 0, 0), kind="fixed"),
        joint("right", "base", "right_bar", at=(0.1, 0, 0)),
        joint("right_elbow", "right_bar", "right_rod", at=(0.25, 0, 0)),
        joint("right_end", "right_rod", "right_tip", at=(0.3, 0, 0), kind="fixed"),
    ]
    path = write_urdf(folder, *bars, name="bars")
    path.write_text(masses(path.read_text(encoding="utf-8"), left_rod=1, right_rod=1.5))


def answer(folder, content):
    """Everything that comes out, or the refusal."""
    content = {key: value for key, value in content.items() if value is not None}
    try:
        name = content.pop("name", None)
        file = write_file(folder, "file", **content)
        if name is not None:
            file.write_text(f"name: {name}\n{file.read_text(encoding='utf-8')}")
        elastic = cartstiff.load(file)
        posture = cartstiff.analyse(elastic)
        result = posture.to_dict()
    except InputError as error:
        return f"refused: {error}"
    limits = [(c.lower, c.upper) for c in elastic.mechanism.coordinates]
    lengths = getattr(elastic.mechanism, "limits", None)
    own = [limits, None if lengths is None else np.array(lengths).tolist()]
    own += [None if elastic.identified is None else elastic.identified.to_dict()]
    own += [None if elastic.damping is None else elastic.damping.tolist(), vibrating(elastic)]
    own += [[one.stress for one in posture.wrenches]]
    return json.dumps([result, own, np.array(elastic.springs.stiffness).tolist()], default=str)


def vibrating(elastic):
    """Modes, or why there are none: what masses act on without gravity."""
    try:
        return cartstiff.modes(elastic).to_dict()
    except cartstiff.UndefinedError as error:
        return str(error)


def changed(content, path, value):
    content = copy.deepcopy(content)
    place = content
    for step in path[:-1]:
        place = place.setdefault(step, {}) if isinstance(place, dict) else place[step]
    place[path[-1]] = value
    return content


@pytest.fixture(scope="module")
def robots(tmp_path_factory):
    """A folder with the robots, and what was answered there to a file."""
    folder = tmp_path_factory.mktemp("robots")
    write_robots(folder)
    return folder, {}


@pytest.mark.parametrize("key", KEYS)
def test_every_key_acts(key, robots):
    model, _, name = key.partition(".")
    if name in FOR_READERS:
        assert "for readers" in SECTIONS[model][name]["description"]
        return
    file, path, value, more = CASES[key]
    folder, known = robots
    before = file | more
    words = json.dumps(before, sort_keys=True, default=str)
    if words not in known:
        known[words] = answer(folder, before)
    was = known[words]
    if key != "PayloadModel.mass":  # a payload without a mass is refused
        assert not was.startswith("refused"), was
    now = answer(folder, changed(before, path, value))
    assert now != was
    if now.startswith("refused") and name != "kind":
        assert "unknown key" not in now


def test_no_case_is_left_over():
    assert set(CASES) <= set(KEYS)


def test_base_of_a_serial_arm(tmp_path):
    """An arm on the ceiling: as on the floor, seen in turned axes, under turned gravity."""
    write_robots(tmp_path)
    g = np.array([0.3, -0.2, -9.81])
    T = np.diag([1.0, -1.0, -1.0, 1.0])  # half a turn about x
    T[:3, 3] = 0.5, 0.4, 2.0
    base = {"xyz": T[:3, 3].tolist(), "rpy": [np.pi, 0, 0]}
    hanging = cartstiff.load(write_file(tmp_path, **ARM, base=base, gravity=g.tolist()))
    turned = (T[:3, :3] @ g).tolist()
    standing = cartstiff.load(write_file(tmp_path, **ARM, gravity=turned))
    for q in (hanging.q, hanging.q + 0.1):
        a, b = cartstiff.analyse(hanging, q), cartstiff.analyse(standing, q)
        assert np.abs(a.pose - T @ b.pose).max() < 1e-12
        assert np.abs(a.B.matrix - b.B.matrix).max() < 1e-9 * np.abs(b.B.matrix).max()
        assert np.abs(a.wrench - b.wrench).max() < 1e-9 * np.abs(b.wrench).max()
    world, _ = hanging.mechanism.at(hanging.q).relative("world", "base")
    assert np.abs(world - T).max() < 1e-12


def test_zeros_of_a_serial_arm(tmp_path: Path) -> None:
    """A joint stands at 0.02 where its command is 0, also one that slides or is followed."""
    axis = "0 0 1"
    parts = [
        f'<joint name="{name}" type="{kind}"><parent link="l{i}"/><child link="l{i + 1}"/>'
        f'<origin xyz="0.1 0.2 0.3" rpy="0.4 0 0.3"/><axis xyz="{axis}"/>'
        f'<limit lower="-2" upper="2" effort="1" velocity="1"/>{more}</joint>'
        for i, (name, kind, more) in enumerate(
            (
                ("turn", "revolute", ""),
                ("slide", "prismatic", ""),
                ("follow", "revolute", '<mimic joint="turn" multiplier="-2" offset="0.1"/>'),
            )
        )
    ]
    links = "".join(f'<link name="l{i}"/>' for i in range(4))
    (tmp_path / "m.urdf").write_text(f'<robot name="m">{links}{"".join(parts)}</robot>', "utf-8")
    text = "kind: serial\nmodel: m.urdf\nframe: l3\nsprings: {turn: {stiffness: 1e4}, "
    (tmp_path / "a.yaml").write_text(text + "slide: {stiffness: 1e5}}\n", "utf-8")
    moved = text + "slide: {stiffness: 1e5}}\nzeros: {turn: 0.02, slide: -0.03}\n"
    (tmp_path / "b.yaml").write_text(moved, "utf-8")
    a, b = (cartstiff.load(str(tmp_path / name)) for name in ("a.yaml", "b.yaml"))
    q = np.array([0.5, 0.2])
    there, here = a.mechanism.at(q + np.array([0.02, -0.03])), b.mechanism.at(q)
    assert np.abs(there.pose - here.pose).max() < 1e-13
    assert np.abs(there.motion.jacobian - here.motion.jacobian).max() < 1e-13
    (tmp_path / "b.yaml").write_text(moved.replace("turn: 0.02", "follow: 0.02"), "utf-8")
    with pytest.raises(InputError, match="key zeros"):
        cartstiff.load(str(tmp_path / "b.yaml"))


def test_joints_beyond_the_frame_are_held_where_the_file_says(tmp_path: Path) -> None:
    """Their masses are carried there, and the note names their springs."""
    pytest.importorskip("example_robot_data")
    names = ["shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3"]
    springs = ", ".join(f"{n}_joint: {{stiffness: 1.0e4}}" for n in names)
    head = "kind: serial\nmodel: ur5\ngravity: [0, 0, -9.81]\n"
    whole = (
        f"{head}springs: {{{springs}}}\nzeros: {{wrist_2_joint: 0.2}}\n"
        "q: {elbow_joint: 1.0, wrist_2_joint: 0.7, wrist_1_joint: -0.4}\n"
    )
    held = (
        f"{head}frame: forearm_link\nlocked: {{wrist_2_joint: 0.9, wrist_1_joint: -0.4}}\n"
        "q: {elbow_joint: 1.0}\n"
    )
    (tmp_path / "whole.yaml").write_text(whole, "utf-8")
    (tmp_path / "held.yaml").write_text(held, "utf-8")
    arm = cartstiff.load(tmp_path / "whole.yaml", frame="forearm_link")
    assert "wrist_1_joint, wrist_2_joint, wrist_3_joint" in str(
        next(note.message for note in arm.notes if note.code == "idle-springs")
    )
    results = [cartstiff.analyse(m) for m in (arm, cartstiff.load(tmp_path / "held.yaml"))]
    assert results[0].q.tolist() == [0.0, 0.0, 1.0]
    first, second = (r.posture.gravity(np.array([0.0, 0.0, -9.81])) for r in results)
    assert np.abs(first.gradient).max() > 1.0
    assert np.abs(first.gradient - second.gradient).max() < 1e-12


def test_joints_beyond_a_legs_frame_are_held_where_the_file_says(tmp_path: Path) -> None:
    """A leg of joints as an arm: the note names the leg, its end and the springs."""
    pytest.importorskip("example_robot_data")
    head = "kind: parallel\ngravity: [0, 0, -9.81]\nlegs:\n"
    leg = "  - {model: ur5, frame: forearm_link, springs: {shoulder_pan_joint: {stiffness: 1.0e4}, "
    leg += "shoulder_lift_joint: {stiffness: 1.0e4}, elbow_joint: {stiffness: 1.0e4}"
    q = "q: {elbow_joint: 1.0"
    beyond = ", wrist_2_joint: {stiffness: 5.0}}, passive: [wrist_1_joint], "
    (tmp_path / "a.yaml").write_text(f"{head}{leg}{beyond}{q}, wrist_1_joint: -0.4}}}}\n", "utf-8")
    held = "}, locked: {wrist_1_joint: -0.4}, "
    (tmp_path / "b.yaml").write_text(f"{head}{leg}{held}{q}}}}}\n", "utf-8")
    named, locked = (cartstiff.load(tmp_path / name) for name in ("a.yaml", "b.yaml"))
    note = next(note for note in named.notes if note.code == "idle-springs")
    assert note.message.startswith("leg 1: 1 joint with a spring is not on the chain to 'forearm")
    a, b = (
        cartstiff.analyse(m).posture.gravity(np.array([0.0, 0.0, -9.81])) for m in (named, locked)
    )
    assert np.abs(a.gradient).max() > 1.0
    assert np.abs(a.gradient - b.gradient).max() < 1e-12
