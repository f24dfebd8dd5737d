"""The arm as a Pinocchio model, and cartstiff's Jacobian in the body's axes."""

import numpy as np
import pinocchio as pin

import cartstiff


def answers(inputs, folder):
    model, parent = pin.Model(), 0
    for i, (d, a, alpha) in enumerate(inputs["table"]):
        about_x = pin.SE3(pin.utils.rotate("x", alpha), np.array([a, 0, 0]))
        place = about_x * pin.SE3(np.eye(3), np.array([0, 0, d]))
        parent = model.addJoint(parent, pin.JointModelRZ(), place, f"joint{i + 1}")
    tool = pin.SE3(np.array(inputs["tool"]))
    model.addFrame(pin.Frame("tool", parent, tool, pin.FrameType.OP_FRAME))
    arm = cartstiff.load(model, frame="tool", q=np.array(inputs["posture"]))
    result = cartstiff.analyse(arm)
    return {"pose": result.pose, "jacobian": result.jacobian[[3, 4, 5, 0, 1, 2]]}
