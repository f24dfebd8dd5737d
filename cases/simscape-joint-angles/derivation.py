"""The same from the ends of the struts."""

from itertools import product

import numpy as np


def answers(inputs, folder):
    base, points, at = (np.array(inputs[k]) for k in ("base", "platform", "at"))

    def directions(ends):
        return (ends - base) / np.linalg.norm(ends - base, axis=1)[:, None]

    bending = []
    for x, y, z, a, b in product((-1.0, 1.0), repeat=5):
        a, b = inputs["rotation"] * a, inputs["rotation"] * b
        about_x = np.array([[1, 0, 0], [0, np.cos(a), -np.sin(a)], [0, np.sin(a), np.cos(a)]])
        about_y = np.array([[np.cos(b), 0, np.sin(b)], [0, 1, 0], [-np.sin(b), 0, np.cos(b)]])
        moved = (points - at) @ (about_y @ about_x).T + at
        moved += inputs["translation"] * np.array([x, y, z])
        bending.append(np.linalg.norm(np.cross(directions(points), directions(moved)), axis=1))
    return {"bending": 1e3 * np.max(bending)}
