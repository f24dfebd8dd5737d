"""Without a force the moment m is the same along the whole bar, and so is its part along the bar.

Each section turns by m/EI against the room, and by b = m_x (1/GJ - 1/EI) about the bar besides.
"""

import numpy as np


def expm(w):
    a = np.linalg.norm(w)
    S = np.array([[0, -w[2], w[1]], [w[2], 0, -w[0]], [-w[1], w[0], 0]])
    turn = np.eye(3) + np.sin(a) / a * S + (1 - np.cos(a)) / a**2 * S @ S
    along = np.eye(3) + (1 - np.cos(a)) / a**2 * S + (a - np.sin(a)) / a**3 * S @ S  # its integral
    return turn, along


def at_tip(m, EI, GJ, L):
    turn, along = expm(np.array(m) * L / EI)
    twist, _ = expm(np.array([m[0] * (1 / GJ - 1 / EI) * L, 0, 0]))
    return L * along[:, 0], turn @ twist


def answers(inputs, folder):
    m, h = np.array(inputs["moment"]), 1e-5
    constants = inputs["bending_stiffness"], inputs["torsional_stiffness"], inputs["length"]
    tip, R = at_tip(m, *constants)
    turns = np.zeros((3, 3))
    for i, d in enumerate(h * np.eye(3)):
        dR = (at_tip(m + d, *constants)[1] - at_tip(m - d, *constants)[1]) @ R.T / (2 * h)
        turns[:, i] = dR[2, 1], dR[0, 2], dR[1, 0]
    stiffness = np.linalg.inv(turns)
    return {"tip": tip, "axes": R, "turns": turns, "unsymmetric": stiffness - stiffness.T}
