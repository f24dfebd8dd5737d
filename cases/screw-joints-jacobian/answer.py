"""The joints as helical joints of Pinocchio, and cartstiff's Jacobian in the body's axes."""

import numpy as np
import pinocchio as pin

import cartstiff


def answers(inputs, folder):
    model, parent, reached = pin.Model(), 0, np.zeros(3)
    for i, screw in enumerate(np.array(inputs["screws"], float)):
        axis, moment = screw[:3], screw[3:]
        pitch, point = axis @ moment, np.cross(axis, moment)
        joint = pin.JointModelHelicalUnaligned(axis, pitch)
        place = pin.SE3(np.eye(3), point - reached)
        parent, reached = model.addJoint(parent, joint, place, f"joint{i + 1}"), point
    end = pin.SE3(np.eye(3), -reached)
    model.addFrame(pin.Frame("end", parent, end, pin.FrameType.OP_FRAME))
    arm = cartstiff.load(model, frame="end", q=np.array(inputs["posture"]))
    return {"jacobian": cartstiff.analyse(arm).jacobian}
