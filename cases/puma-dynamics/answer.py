"""The arm in Pinocchio, rotors as its armature: gravity's gradient, and the masses of its modes."""

import numpy as np
import pinocchio as pin

import cartstiff


def answers(inputs, folder):
    model, placement = pin.Model(), pin.SE3.Identity()
    for i, (d, a, alpha) in enumerate(inputs["links"]):
        joint = model.addJoint(i, pin.JointModelRZ(), placement, f"joint{i + 1}")
        turn = pin.SE3(pin.utils.rotate("x", alpha), np.array([a, 0.0, d]))  # its frame at q = 0
        centre = turn.act(np.array(inputs["centres"][i]))
        tensor = turn.rotation @ np.diag(inputs["inertias"][i]) @ turn.rotation.T
        model.appendBodyToJoint(
            joint, pin.Inertia(inputs["masses"][i], centre, tensor), pin.SE3.Identity()
        )
        placement = turn
    model.addFrame(pin.Frame("tip", 6, placement, pin.FrameType.OP_FRAME))
    model.armature = np.array(inputs["gears"]) ** 2 * np.array(inputs["rotors"])
    arm = cartstiff.load(model, frame="tip", q=np.array(inputs["posture"]), stiffness=1e6)
    gravity = arm.mechanism.at(arm.q).gravity(np.array(inputs["gravity"])).gradient
    return {"gravity": gravity, "inertia": cartstiff.modes(arm).mass}
