"""The lengths' rates by the Jacobian of cartstiff: its body twists are in the base's axes here."""

from itertools import product

import numpy as np

import cartstiff
from cartstiff.geometry import se3


def answers(inputs, folder):
    platform = cartstiff.load(folder / "mechanism.yaml")
    result = cartstiff.analyse(platform)
    rates = np.linalg.inv(result.jacobian)  # of the lengths, by the twist, angular first
    turn, move = inputs["rotation"], inputs["translation"]
    strokes = rates @ np.diag([turn, turn, 0, move, move, move])
    # Along a strut's own direction no other lengthens faster: there the sphere is touched.
    fastest = np.linalg.norm(rates[:, 3:], axis=1).max()
    # Every corner of the box of motions, by the inverse kinematics; M turns about its own origin.
    hexapod = platform.mechanism
    corners = []
    for x, y, z, a, b in product((-1.0, 1.0), repeat=5):
        T = se3.from_roll_pitch_yaw([move * x, move * y, move * z], [turn * a, turn * b, 0.0])
        T[:3, 3] += result.pose[:3, 3]
        corners.append(hexapod.leg_lengths(hexapod.coordinates_of(T)))
    corners = np.array(corners) - hexapod.leg_lengths(platform.q)
    return {
        "stroke": 1e6 * (strokes.max() - strokes.min()),
        "combined": 1e6 * (corners.max() - corners.min()),
        "radius": 1e6 * inputs["stroke"] / fastest,
    }
