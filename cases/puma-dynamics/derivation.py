"""Kinetic energy of every link and rotor by the columns of its Jacobian; weight times its rise."""

import numpy as np


def answers(inputs, folder):
    n, R, at = 6, np.eye(3), np.zeros(3)
    axes, points, weights, masses = [], [], np.zeros(6), np.zeros((6, 6))
    for i, (q, (d, a, alpha)) in enumerate(zip(inputs["posture"], inputs["links"], strict=True)):
        axes.append(R[:, 2])
        points.append(at)
        c, s, ca, sa = np.cos(q), np.sin(q), np.cos(alpha), np.sin(alpha)
        at = at + R @ [a * c, a * s, d]
        R = R @ np.array([[c, -s * ca, s * sa], [s, c * ca, -c * sa], [0, sa, ca]])
        centre = at + R @ inputs["centres"][i]
        turn, move = np.zeros((3, n)), np.zeros((3, n))
        turn[:, : i + 1] = np.transpose(axes)
        move[:, : i + 1] = np.cross(axes, centre - np.array(points)).T
        tensor = R @ np.diag(inputs["inertias"][i]) @ R.T
        masses += inputs["masses"][i] * move.T @ move + turn.T @ tensor @ turn
        weights -= inputs["masses"][i] * move.T @ np.array(inputs["gravity"])
    rotors = np.array(inputs["gears"]) ** 2 * np.array(inputs["rotors"])
    return {"gravity": weights, "inertia": masses + np.diag(rotors)}
