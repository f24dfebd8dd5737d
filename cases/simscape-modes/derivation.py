"""Mass and stiffness of the platform and its struts, as matrices of the platform's twist."""

import numpy as np


def skew(a):
    return np.array([[0, -a[2], a[1]], [a[2], 0, -a[0]], [-a[1], a[0], 0]])


def answers(inputs, folder):
    base, points = np.array(inputs["base"]), np.array(inputs["platform"])
    centre, m = np.array(inputs["centre"]), inputs["bar_mass"]
    # Twists (omega, v) of the mass centre, base axes.
    M = np.zeros((6, 6))
    M[:3, :3], M[3:, 3:] = inputs["inertia"], inputs["mass"] * np.eye(3)
    K = np.zeros((6, 6))
    r, h, c = inputs["bar_radius"], inputs["bar_length"], inputs["bar_centre"]
    across = m * (r**2 / 4 + h**2 / 12)  # of a bar about its centre
    for a, b in zip(base, points, strict=True):
        length = np.linalg.norm(b - a)
        s = (b - a) / length
        V = np.hstack([-skew(b - centre), np.eye(3)])  # velocity of the platform's joint
        line = s @ V
        K += inputs["stiffness"] * np.outer(line, line)
        side = (np.eye(3) - np.outer(s, s)) @ V  # what turns the strut, times its length
        lower = (m * c**2 + across) / length**2
        # The upper bar's centre goes with its joint but for the turn over the distance c.
        upper = m * ((length - c) / length) ** 2 + across / length**2
        M += (lower + upper) * side.T @ side + m * np.outer(line, line)
    squares = np.sort(np.linalg.eigvals(np.linalg.solve(M, K)).real)
    return {"frequencies": np.sqrt(squares) / (2 * np.pi)}
