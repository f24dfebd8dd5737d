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
    grid = np.array(np.meshgrid(*[[-1.0, 1.0]] * 5)).reshape(5, -1).T
    corners = []
    for x, y, z, a, b in grid * ([inputs["translation"]] * 3 + [inputs["rotation"]] * 2):
        about_x = np.array([[1, 0, 0], [0, np.cos(a), -np.sin(a)], [0, np.sin(a), np.cos(a)]])
        about_y = np.array([[np.cos(b), 0, np.sin(b)], [0, 1, 0], [-np.sin(b), 0, np.cos(b)]])
        at = inputs["at"] + np.array([x, y, z])
        moved = (points - inputs["at"]) @ (about_y @ about_x).T + at - base
        corners.append(np.linalg.norm(moved, axis=1) - np.linalg.norm(points - base, axis=1))
    return {
        "stroke": 1e6 * (strokes.max() - strokes.min()),
        "radius": 1e6 * allowed.min(),
        "combined": 1e6 * np.ptp(corners),
    }
