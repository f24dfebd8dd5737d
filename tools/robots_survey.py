"""What cartstiff says of many robots without a word from the user.

    python tools/robots_survey.py [FOLDER ...] [NAME:=VALUE ...]

Without folders the URDFs of example-robot-data; else every .urdf, .xacro and MJCF .xml below
them, with arguments for xacro files that ask for them; a folder of an installed package may be
given by the package's name. Each file is loaded and analysed with nothing named; its pose is
compared with MuJoCo's reading of the same MJCF, or with yourdfpy's of the same URDF (of a xacro
file: of what is made of it; without yourdfpy Pinocchio's). A line a robot: name, maker (the folder
below FOLDER), frame, posture [deg, mm], stiffness in the softest direction [N/mm], verdict; at the
end how many load, are refused or are wrong, how many poses were compared, and how many arms show a
6x6 matrix: what stands on the floor with six to twelve joints that give the body six motions.
Files that MuJoCo refuses as well, and parts of robots that only others include, stand apart. Exit
code 1 if anything is wrong, or if fewer than 95 % of the arms show one.
"""

from __future__ import annotations

import io
import sys
from collections import Counter
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pinocchio as pin

import cartstiff
from cartstiff import CartstiffError, ElasticMechanism
from cartstiff.core.mechanisms.chain import Chain

# Poses of two programs that read the same decimal numbers.
SAME, SHARE = 1e-9, 0.95
# Longer chains are backs, tails and necks.
MOST = 12


def files() -> list[Path]:
    """All URDFs of example-robot-data."""
    import example_robot_data

    root = Path(example_robot_data.getModelPath("ur_description"))
    return sorted(root.rglob("*.urdf"))


def folder_of(name: str) -> Path:
    """A folder, or that of an installed package."""
    if Path(name).is_dir():
        return Path(name)
    found = find_spec(name)
    if found is None or found.origin is None:
        raise SystemExit(f"neither a folder nor an installed package: {name}")
    return Path(found.origin).parent


def files_below(folders: list[str]) -> list[Path]:
    """Robot descriptions of all kinds below some folders."""
    found = [path for folder in folders for path in folder_of(folder).rglob("*")]
    found = [path for path in found if path.suffix in (".urdf", ".xacro", ".xml")]
    return sorted(
        path
        for path in found
        if path.suffix != ".xml" or "<mujoco" in path.read_text(encoding="utf-8", errors="replace")
    )


def is_part(path: Path) -> bool:
    """Whether a file is not meant to be read by itself.

    A xacro file that only defines macros; an MJCF file that MuJoCo does not compile or that has
    no joints in it.
    """
    text = path.read_text(encoding="utf-8", errors="replace")
    if path.suffix == ".xacro":
        return "<link" not in text.split("<xacro:macro")[0] and (
            "<xacro:macro" in text
            or not any(f"<xacro:{w}" in text for w in ("include",))
            or "<robot" not in text
        )
    if path.suffix != ".xml":
        return False
    import mujoco

    try:
        return int(mujoco.MjModel.from_xml_path(str(path)).njnt) == 0
    except ValueError:
        return True


def pose_by_mujoco(path: Path, arm: ElasticMechanism, q: np.ndarray) -> np.ndarray | None:
    """Pose of the arm's body by MuJoCo; None for joints or frames of other kinds."""
    import mujoco

    try:
        model = mujoco.MjModel.from_xml_path(str(path))
    except ValueError:  # such as masses that it does not move
        return None
    data = mujoco.MjData(model)
    if model.nkey:
        mujoco.mj_resetDataKeyframe(model, data, 0)
        names = [model.key(i).name for i in range(model.nkey)]
        mujoco.mj_resetDataKeyframe(model, data, names.index("home") if "home" in names else 0)
    one = (int(mujoco.mjtJoint.mjJNT_SLIDE), int(mujoco.mjtJoint.mjJNT_HINGE))
    for name, value in zip(arm.names, q, strict=True):
        joint = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_JOINT, name)
        if joint < 0 or int(model.jnt_type[joint]) not in one:
            return None
        data.qpos[model.jnt_qposadr[joint]] = value
    mujoco.mj_kinematics(model, data)
    frame, T = arm.mechanism.frame, np.eye(4)
    body = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, frame)
    site = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_SITE, frame)
    if site >= 0:
        T[:3, :3], T[:3, 3] = data.site_xmat[site].reshape(3, 3), data.site_xpos[site]
    elif body >= 0:
        T[:3, :3], T[:3, 3] = data.xmat[body].reshape(3, 3), data.xpos[body]
    else:
        return None
    return T


def pose_by_yourdfpy(text: str, arm: ElasticMechanism, q: np.ndarray) -> np.ndarray | None:
    """Pose of the arm's link by yourdfpy, which reads the file by itself."""
    from yourdfpy import URDF

    robot = URDF.load(io.BytesIO(text.encode()), build_scene_graph=True, load_meshes=False)
    known = set(robot.actuated_joint_names)
    if not set(arm.names) <= known or arm.mechanism.frame not in robot.link_map:
        return None
    at = dict.fromkeys(robot.actuated_joint_names, 0.0)
    robot.update_cfg(at | dict(zip(arm.names, map(float, q), strict=True)))
    return np.array(robot.get_transform(arm.mechanism.frame, robot.base_link))


def pose_by_pinocchio(text: str, arm: ElasticMechanism, q: np.ndarray) -> np.ndarray | None:
    """Pose of the arm's frame; None where joints are expanded, which have no like in the file."""
    try:
        model = pin.buildModelFromXML(text, mimic=True)
    except ValueError:  # a joint follows one that comes later in the tree: both are Pinocchio's own
        model = pin.buildModelFromXML(text)
    at = pin.neutral(model)
    for name, value in zip(arm.names, q, strict=True):
        if not model.existJointName(name):
            return None
        joint = model.joints[model.getJointId(name)]
        both = joint.nq == 2
        at[joint.idx_q : joint.idx_q + joint.nq] = (np.cos(value), np.sin(value)) if both else value
    data = model.createData()
    pin.framesForwardKinematics(model, data, at)
    kinds = [f.type for f in model.frames if f.name == arm.mechanism.frame]
    kind = pin.FrameType.BODY if pin.FrameType.BODY in kinds else kinds[0]
    frame = model.getFrameId(arm.mechanism.frame, kind)
    return np.array(data.oMf[frame].homogeneous)


def other_pose(path: Path, arm: ElasticMechanism, q: np.ndarray) -> tuple[str, np.ndarray | None]:
    """Who was asked, and the pose that they give."""
    if path.suffix == ".xml":
        return "MuJoCo", pose_by_mujoco(path, arm, q)
    text = arm.mechanism.descriptions[0].text  # what a xacro file expands to
    text = path.read_text(encoding="utf-8") if text is None else text
    if find_spec("yourdfpy") is not None:
        try:
            found = pose_by_yourdfpy(text, arm, q)
        except Exception:  # what it cannot read is Pinocchio's to judge
            found = None
        if found is not None:
            return "yourdfpy", found
    return "Pinocchio", pose_by_pinocchio(text, arm, q)


def is_arm(arm: ElasticMechanism) -> bool:
    """Whether it stands on the floor, and six to `MOST` joints give its body all six motions."""
    chain = arm.mechanism
    if not 6 <= len(arm.names) <= MOST or not isinstance(chain, Chain) or chain.closures:
        return False
    if any(name.endswith(".rx") for name in arm.names):  # it flies
        return False
    q = np.random.default_rng(0).uniform(-1.0, 1.0, (5, len(arm.names)))
    return any(np.linalg.matrix_rank(chain.at(row).motion.jacobian, 1e-6) == 6 for row in q)


def loaded(path: Path, values: dict[str, str]) -> ElasticMechanism:
    """The robot; a xacro file gets the arguments that it asks for."""
    text = path.read_text(encoding="utf-8", errors="replace")
    own = {name: value for name, value in values.items() if f'name="{name}"' in text}
    return cartstiff.load(str(path), xacro_args=own if path.suffix == ".xacro" else None)


def described(arm: ElasticMechanism, result: cartstiff.PostureStiffness) -> str:
    """Frame, posture, and the softest direction's stiffness."""
    lengths = [c.is_length for c in arm.mechanism.coordinates]
    shown = np.where(lengths, 1e3 * result.q, np.degrees(result.q))
    posture = ",".join(f"{value:.0f}" for value in shown)
    C = result.compliances["B"]
    largest = 0.0 if C is None else float(np.linalg.eigvalsh(C[3:, 3:])[-1])
    stiffness = f"{1e-3 / largest:.4g}" if largest > 0.0 else "-"
    return f"{arm.mechanism.frame:24} {posture:36} {stiffness:>9}"


def maker(path: Path, folders: list[str]) -> str:
    """The folder below the one that was given, in which the robot lies."""
    for folder in map(folder_of, folders):
        if path.is_relative_to(folder) and path.parent != folder:
            return path.relative_to(folder).parts[0]
    return path.parent.name


def surveyed(path: Path, values: dict[str, str], count: Counter[str]) -> str:
    """What is said of one file; counted as well."""
    try:
        arm = loaded(path, values)
        result = cartstiff.analyse(arm)
    except CartstiffError as error:
        kind = "parts" if is_part(path) else "refused"
        count[kind] += 1
        return f"{'a part' if kind == 'parts' else 'refused'}: {error}"
    except Exception as error:
        count["wrong"] += 1
        return f"WRONG {type(error).__name__}: {error}"
    who, wanted = other_pose(path, arm, result.q)
    difference = 0.0 if wanted is None else float(np.abs(wanted - result.pose).max())
    wrong = difference > SAME
    count["wrong" if wrong else "loads"] += 1
    words = described(arm, result)
    if wanted is None:
        words += ", pose not compared"
    else:
        count[who] += 1
        words += f", {who} {difference:.0e}"
    if is_arm(arm):
        shows = result.matrices["B"] is not None
        count["arms"] += 1
        count["regular"] += shows
        chosen = any(note.code == "default-posture" for note in arm.notes)
        words += f", {'6x6' if shows else 'no 6x6'}{', posture chosen' if chosen else ''}"
    return f"{'WRONG ' if wrong else ''}{words}"


def main() -> int:
    """Print the survey."""
    count: Counter[str] = Counter()
    given = sys.argv[1:]
    values = dict(word.split(":=", 1) for word in given if ":=" in word)
    folders = [word for word in given if ":=" not in word]
    for path in files_below(folders) if folders else files():
        row = f"{path.name:36} {maker(path, folders)[:20]:20} {surveyed(path, values, count)}"
        print(row, flush=True)
    print(", ".join(f"{key} {count[key]}" for key in ("loads", "refused", "parts", "wrong")))
    compared = [f"{who} {count[who]}" for who in ("MuJoCo", "yourdfpy", "Pinocchio")]
    print(f"poses compared within {SAME:g}: {', '.join(compared)}")
    shown = f"{count['regular']} of {count['arms']}"
    print(f"arms of six to twelve joints that give six motions: {shown} show a 6x6")
    return int(count["wrong"] > 0 or count["regular"] < SHARE * count["arms"])


if __name__ == "__main__":
    sys.exit(main())
