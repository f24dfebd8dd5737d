"""Gravity's gradient, and the wrench through cartstiff's Jacobian."""

import numpy as np
import pinocchio as pin

import cartstiff


def answers(inputs, folder):
    model, parent, reached = pin.Model(), 0, np.zeros(3)
    scales, q, home = [], [], pin.SE3.Identity()
    for i, screw in enumerate(np.array(inputs["screws"], float)):
        size = np.linalg.norm(screw[:3])  # the source turns by this much per unit of its coordinate
        axis, moment = screw[:3] / size, screw[3:] / size
        pitch, point = axis @ moment, np.cross(axis, moment)
        joint = pin.JointModelHelicalUnaligned(axis, pitch)
        parent = model.addJoint(parent, joint, pin.SE3(np.eye(3), point - reached), f"joint{i + 1}")
        centre = np.array(inputs["centres"][i]) - point
        body = pin.Inertia(inputs["masses"][i], centre, np.eye(3))
        model.appendBodyToJoint(parent, body, home)
        reached = point
        scales.append(size)
        q.append(size * inputs["posture"][i])
    end = pin.SE3(np.array(inputs["end_axes"], float), np.array(inputs["end"]) - reached)
    model.addFrame(pin.Frame("end", parent, end, pin.FrameType.OP_FRAME))
    arm = cartstiff.load(model, frame="end", q=np.array(q))
    posture = arm.mechanism.at(np.array(q))
    gravity = posture.gravity(np.array(inputs["gravity"])).gradient
    wrench = posture.motion.jacobian.T @ np.array(inputs["wrench"])
    return {"gravity": scales * gravity, "wrench": scales * wrench}
