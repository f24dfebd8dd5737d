"""The lengths' rates by the Jacobian of cartstiff: its body twists are in the base's axes here."""

import numpy as np

import cartstiff


def answers(inputs, folder):
    result = cartstiff.analyse(cartstiff.load(folder / "mechanism.yaml"))
    rates = np.linalg.inv(result.jacobian)  # of the lengths, by the twist, angular first
    turn, move = inputs["rotation"], inputs["translation"]
    strokes = rates @ np.diag([turn, turn, 0, move, move, move])
    # Along a strut's own direction no other lengthens faster: there the sphere is touched.
    fastest = np.linalg.norm(rates[:, 3:], axis=1).max()
    return {
        "stroke": 1e6 * (strokes.max() - strokes.min()),
        "radius": 1e6 * inputs["stroke"] / fastest,
    }
