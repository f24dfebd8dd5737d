"""The arm as a Pinocchio model; cartstiff's Jacobian is in the body's axes."""

import numpy as np
import pinocchio as pin

import cartstiff


def answers(inputs, folder):
    model, parent, length = pin.Model(), 0, 0.0
    for i, (angle, slides) in enumerate(zip(inputs["angles"], inputs["slides"], strict=True)):
        joint = pin.JointModelPZ() if slides else pin.JointModelRZ()
        place = pin.SE3(pin.utils.rotate("z", angle), np.array([length, 0, 0]))
        parent = model.addJoint(parent, joint, place, f"joint{i + 1}")
        length = inputs["lengths"][i]
    tool = pin.SE3(np.eye(3), np.array([length, 0, 0]))
    model.addFrame(pin.Frame("tool", parent, tool, pin.FrameType.OP_FRAME))
    arm = cartstiff.load(model, frame="tool", q=np.array(inputs["posture"]))
    result = cartstiff.analyse(arm)
    R, J = result.pose[:3, :3], result.jacobian
    return {
        "in_base_axes": np.vstack([R @ J[3:], R @ J[:3]]),
        "in_tool_axes": J[[3, 4, 5, 0, 1, 2]],
    }
