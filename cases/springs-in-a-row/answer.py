"""The springs at rest, the last node held where the second wall is."""

import cartstiff


def answers(inputs, folder):
    row = cartstiff.load(folder / "mechanism.yaml")
    load = cartstiff.DeadForce([inputs["force"], 0, 0], frame_b="node4")
    rest = cartstiff.equilibrium(row, load, held={"x": 0.0})
    first, second, _ = rest.q
    return {
        "displacements": [first, first + second],
        "reactions": [-inputs["stiffness"][0] * first, rest.reactions.held["x"]],
    }
