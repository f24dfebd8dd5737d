"""Inertia of the platform about its frame's origin, as cartstiff's vibrations use it."""

import cartstiff


def answers(inputs, folder):
    robot = cartstiff.load(folder / "mechanism.yaml")
    tensor = robot.mechanism.body_inertia[:3, :3]
    return {
        "inertia": [
            [x if i == j else -x for j, x in enumerate(row)] for i, row in enumerate(tensor)
        ]
    }
