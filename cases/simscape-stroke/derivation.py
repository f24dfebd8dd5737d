"""The same from the lines of the struts; the radius by trying all directions."""

import numpy as np


def answers(inputs, folder):
    base, points = np.array(inputs["base"]), np.array(inputs["platform"])
    s = (points - base) / np.linalg.norm(points - base, axis=1)[:, None]
    moments = np.cross(points - inputs["at"], s)
    turns = inputs["rotation"] * moments[:, :2]
    strokes = np.hstack([turns, inputs["translation"] * s])
    # Each direction allows what its fastest strut allows; a strut's own direction is the worst.
    allowed = inputs["stroke"] / np.abs(s @ s.T).max(axis=0)
    return {"stroke": 1e6 * (strokes.max() - strokes.min()), "radius": 1e6 * allowed.min()}
