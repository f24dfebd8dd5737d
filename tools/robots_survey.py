"""What cartstiff says of many robots without a word from the user.

    python tools/robots_survey.py [FOLDER ...] [NAME:=VALUE ...]

Without folders the URDFs of example-robot-data; else every .urdf, .xacro and MJCF .xml below them,
with arguments for xacro files that ask for them. Each is loaded and analysed with nothing named;
its pose is compared with Pinocchio's reading of the same URDF (of a xacro file: of what it expands
to), or with MuJoCo's of the same MJCF. Prints a line a robot, and at the end how many load, are
refused or are wrong, and how many arms of six or more joints show a 6x6 matrix. Exit code 1 if
anything is wrong, or if fewer than 95 % do.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pinocchio as pin

import cartstiff
from cartstiff.errors import CartstiffError
from cartstiff.mechanisms.elastic import ElasticMechanism

# Poses of two programs that read the same decimal numbers.
SAME, SHARE = 1e-9, 0.95


def files() -> list[Path]:
    """All URDFs of example-robot-data."""
    import example_robot_data

    root = Path(example_robot_data.getModelPath("ur_description"))
    return sorted(root.rglob("*.urdf"))


def files_below(folders: list[str]) -> list[Path]:
    """Robot descriptions of all kinds below some folders."""
    found = [path for folder in folders for path in Path(folder).rglob("*")]
    found = [path for path in found if path.suffix in (".urdf", ".xacro", ".xml")]
    return sorted(
        path for path in found
        if path.suffix != ".xml" or "<mujoco" in path.read_text(encoding="utf-8", errors="replace")
    )  # fmt: skip


def pose_by_mujoco(path: Path, arm: ElasticMechanism, q: np.ndarray) -> np.ndarray | None:
    """Pose of the arm's body by MuJoCo; None for joints or frames of other kinds."""
    import mujoco

    model = mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(model)
    for name, value in zip(arm.names, q, strict=True):
        joint = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_JOINT, name)
        if joint < 0 or model.jnt_type[joint] < mujoco.mjtJoint.mjJNT_SLIDE:
            return None
        data.qpos[model.jnt_qposadr[joint]] = value
    body = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, arm.mechanism.frame)
    if body < 0 or model.nkey:
        return None
    mujoco.mj_kinematics(model, data)
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = data.xmat[body].reshape(3, 3), data.xpos[body]
    return T


def pose_by_pinocchio(path: Path, arm: ElasticMechanism, q: np.ndarray) -> np.ndarray | None:
    """Pose of the arm's frame; None where joints are expanded, which have no like in the file."""
    text = arm.mechanism.descriptions[0].text  # what a xacro file expands to
    model = pin.buildModelFromUrdf(str(path)) if text is None else pin.buildModelFromXML(text)
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


def loaded(path: Path, values: dict[str, str]) -> ElasticMechanism:
    """The robot; a xacro file gets the arguments that it asks for."""
    text = path.read_text(encoding="utf-8", errors="replace")
    own = {name: value for name, value in values.items() if f'name="{name}"' in text}
    return cartstiff.load(str(path), xacro_args=own if path.suffix == ".xacro" else None)


def main() -> int:
    """Print the survey."""
    count = {"loads": 0, "refused": 0, "wrong": 0}
    arms = regular = 0
    given = sys.argv[1:]
    values = dict(word.split(":=", 1) for word in given if ":=" in word)
    folders = [word for word in given if ":=" not in word]
    for path in files_below(folders) if folders else files():
        try:
            arm = loaded(path, values)
            result = cartstiff.analyse(arm)
        except CartstiffError as error:
            count["refused"] += 1
            print(f"{path.name:40} refused: {error}")
            continue
        by = pose_by_mujoco if path.suffix == ".xml" else pose_by_pinocchio
        wanted = by(path, arm, result.q)
        wrong = wanted is not None and np.abs(wanted - result.pose).max() > SAME
        count["wrong" if wrong else "loads"] += 1
        words = f"{len(arm.names)} joints to {arm.mechanism.frame}"
        if len(arm.names) >= 6:
            arms += 1
            shows = result.matrices["B"] is not None
            regular += shows
            chosen = any(note.code == "default-posture" for note in arm.notes)
            words += f", {'6x6' if shows else 'no 6x6'}{', posture chosen' if chosen else ''}"
        print(f"{path.name:40} {'WRONG ' if wrong else ''}{words}")
    print(", ".join(f"{k} {v}" for k, v in count.items()))
    print(f"arms of six or more joints: {regular} of {arms} show a 6x6")
    return int(count["wrong"] > 0 or regular < SHARE * arms)


if __name__ == "__main__":
    sys.exit(main())
