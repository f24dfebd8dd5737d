"""The apex at rest under the force, and what the bars carry there."""

import cartstiff
from cartstiff.geometry import se3


def answers(inputs, folder):
    frame = cartstiff.load(folder / "mechanism.yaml")
    rest = cartstiff.equilibrium(frame, cartstiff.DeadForce(inputs["force"]))
    moved = se3.log(rest.pose)  # the apex's frame starts in the axes of the room
    bars = [one.wrench for one in rest.stiffness.wrenches if one.frame == "far end"]
    return {
        "thrust": [bar[3] for bar in bars],
        "torsion": [1000 * abs(bar[0]) for bar in bars],
        "displacement": 1000 * (rest.pose[:3, 3] - inputs["apex"]),
        "rotation": moved[:3],
    }
