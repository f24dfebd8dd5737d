"""What is given beside a mechanism file replaces what the file says."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from cartstiff.arrays import Array
from cartstiff.errors import InputError, check_name
from cartstiff.geometry import se3
from cartstiff.loading.schema import PoseModel, pose_of


def with_overrides(file: Any, overrides: Mapping[str, Any]) -> Any:
    """Return the file with overrides, which replace its own values.

    Parameters
    ----------
    file : a model of the schema
        The mechanism file.
    overrides : mapping
        Any of "frame", "locked", "tcp" (pose of M in that frame), "gravity",
        "actuator_springs", "xacro", "package_path". The file's payload stays where it is.

    Raises
    ------
    InputError
        For what the file's kind does not have.
    """
    keys: dict[str, Any] = {}
    if (frame := overrides.get("frame")) is not None:
        file = _with_frame(file, frame)
    if locked := overrides.get("locked"):
        if file.kind not in ("serial", "closed-chain"):
            raise InputError(
                f"kind {file.kind} has no joints to lock",
                expected="kind serial or closed-chain",
            )
        keys["locked"] = {**file.locked, **locked}
    if overrides.get("xacro") or overrides.get("package_path"):
        file = _with_ros(file, overrides)
    if overrides.get("actuator_springs"):
        if not hasattr(file, "actuator_springs"):
            raise InputError(f"kind {file.kind} has no actuators", where="--springs")
        keys["actuator_springs"] = True
    payload = file.payload
    if (T := overrides.get("tcp")) is not None:
        back = se3.inverse(T)
        key = "frame" if file.kind in ("stewart-gough", "springs") else "offset"
        keys[key] = _model_of(pose_of(getattr(file, key)) @ T)
        if payload is not None and payload.carrier is None:
            centre = (back @ np.append(payload.com, 1.0))[:3]
            payload = payload.model_copy(update={"com": centre.tolist()})
    if (gravity := overrides.get("gravity")) is not None:
        keys["gravity"] = list(gravity)
    if payload is not file.payload:
        keys["payload"] = payload
    return file.model_copy(update=keys) if keys else file


def _model_of(T: Array) -> PoseModel:
    xyz, rpy = T[:3, 3].tolist(), se3.roll_pitch_yaw(T).tolist()
    return PoseModel.model_construct(xyz=xyz, rpy=rpy)


def _with_ros(file: Any, overrides: Mapping[str, Any]) -> Any:
    """Return the file with more xacro arguments and package folders for its robots."""
    if hasattr(file, "model"):
        return file.with_ros(
            overrides.get("xacro", {}), overrides.get("package_path", ())
        )
    if isinstance(file.legs, list) and any(leg.drawing is None for leg in file.legs):
        legs = [
            _with_ros(leg, overrides) if leg.drawing is None else leg for leg in file.legs
        ]
        return file.model_copy(update={"legs": legs})
    raise InputError(
        f"kind {file.kind} has no robot description",
        expected="no xacro arguments and no package path",
    )


def _with_frame(file: Any, frame: str) -> Any:
    """Return the file with another frame of interest."""
    only = {"stewart-gough": "platform", "springs": "platform", "parallel": "body"}.get(
        file.kind
    )
    if only is not None:
        check_name("frame", frame, [only])
        return file
    payload = file.payload and file.payload.carried_by(file.frame, file.offset)
    other = {"frame": frame, "offset": _model_of(np.eye(4)), "payload": payload}
    return file.model_copy(update=other)
