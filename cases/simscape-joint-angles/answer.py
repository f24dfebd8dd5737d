"""Every corner of the box of motions by the platform's own lines."""

from itertools import product

import numpy as np

import cartstiff
from cartstiff.geometry import se3


def answers(inputs, folder):
    platform = cartstiff.load(folder / "mechanism.yaml")
    hexapod, start = platform.mechanism, cartstiff.analyse(platform).pose
    move, turn = inputs["translation"], inputs["rotation"]

    def directions(T):
        q = hexapod.coordinates_of(T)
        J = np.linalg.inv(cartstiff.analyse(platform, q).jacobian)  # of the lengths
        return J[:, 3:] @ T[:3, :3].T  # the struts' directions, in the axes of the base

    still, angles = directions(start), []
    for x, y, z, a, b in product((-1.0, 1.0), repeat=5):
        T = se3.from_roll_pitch_yaw([move * x, move * y, move * z], [turn * a, turn * b, 0.0])
        T[:3, 3] += start[:3, 3]
        angles.append(np.linalg.norm(np.cross(still, directions(T)), axis=1))
    return {"bending": 1e3 * np.max(angles)}
