"""The arm as a Pinocchio model at the posture, each joint at zero there."""

import numpy as np
import pinocchio as pin

import cartstiff


def answers(inputs, folder):
    model, parent, at = pin.Model(), 0, np.zeros(3)
    for i, (axis, point) in enumerate(zip(inputs["axes"], np.array(inputs["points"]), strict=True)):
        joint = pin.JointModelRevoluteUnaligned(np.array(axis))
        parent = model.addJoint(parent, joint, pin.SE3(np.eye(3), point - at), f"joint{i + 1}")
        at = point
    tip = pin.SE3(np.eye(3), np.array(inputs["at"]) - at)
    model.addFrame(pin.Frame("tip", parent, tip, pin.FrameType.OP_FRAME))
    arm = cartstiff.load(model, frame="tip", q=np.zeros(model.nq))
    J = cartstiff.analyse(arm).jacobian  # angular first

    def measure(rows):
        return np.sqrt(np.linalg.det(rows @ rows.T))

    return {"all": measure(J), "translation": measure(J[3:]), "rotation": measure(J[:3])}
