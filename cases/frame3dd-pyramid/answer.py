"""The apex at rest under the force."""

import cartstiff
from cartstiff.geometry import se3


def answers(inputs, folder):
    frame = cartstiff.load(folder / "mechanism.yaml")
    rest = cartstiff.equilibrium(frame, cartstiff.DeadForce(inputs["force"]))
    moved = se3.log(rest.pose)  # the apex's frame starts in the axes of the room
    return {
        "displacement": 1000 * (rest.pose[:3, 3] - inputs["apex"]),
        "rotation": moved[:3],
    }
