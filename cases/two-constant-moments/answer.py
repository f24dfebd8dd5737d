"""The tip at rest under both moments, and how it turns when they grow."""

import numpy as np

import cartstiff


def answers(inputs, folder):
    bar = cartstiff.load(folder / "mechanism.yaml")
    rest = cartstiff.equilibrium(bar, cartstiff.DeadWrench([*inputs["moment"], 0, 0, 0]))
    R = rest.pose[:3, :3]
    turns = R @ np.linalg.inv(rest.stiffness.A.matrix)[:3, :3] @ R.T  # in the axes of the room
    stiffness = np.linalg.inv(turns)
    return {
        "tip": rest.pose[:3, 3],
        "axes": R,
        "turns": turns,
        "unsymmetric": stiffness - stiffness.T,
        "potential": float(rest.is_conservative),
    }
