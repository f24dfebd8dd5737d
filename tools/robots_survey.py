"""What cartstiff says of all robots of example-robot-data without a word from the user.

    python tools/robots_survey.py

Each URDF is loaded and analysed with nothing named; its pose is compared with Pinocchio's own
reading of the same file. Prints a line a robot, and at the end how many load, are refused or are
wrong, and how many arms of six or more joints show a 6x6 matrix. Exit code 1 if anything is wrong,
or if fewer than 95 % do.
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


def pose_by_pinocchio(path: Path, arm: ElasticMechanism, q: np.ndarray) -> np.ndarray | None:
    """Pose of the arm's frame; None where joints are expanded, which have no like in the file."""
    model = pin.buildModelFromUrdf(str(path))
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


def main() -> int:
    """Print the survey."""
    count = {"loads": 0, "refused": 0, "wrong": 0}
    arms = regular = 0
    for path in files():
        try:
            arm = cartstiff.load(str(path))
            result = cartstiff.analyse(arm)
        except CartstiffError as error:
            count["refused"] += 1
            print(f"{path.name:40} refused: {error}")
            continue
        wanted = pose_by_pinocchio(path, arm, result.q)
        wrong = wanted is not None and np.abs(wanted - result.pose).max() > SAME
        count["wrong" if wrong else "loads"] += 1
        words = f"{len(arm.names)} joints to {arm.mechanism.frame}"
        if len(arm.names) >= 6:
            arms += 1
            shows = result.B is not None
            regular += shows
            chosen = any(note.code == "default-posture" for note in arm.notes)
            words += f", {'6x6' if shows else 'no 6x6'}{', posture chosen' if chosen else ''}"
        print(f"{path.name:40} {'WRONG ' if wrong else ''}{words}")
    print(", ".join(f"{k} {v}" for k, v in count.items()))
    print(f"arms of six or more joints: {regular} of {arms} show a 6x6")
    return int(count["wrong"] > 0 or regular < SHARE * arms)


if __name__ == "__main__":
    sys.exit(main())
