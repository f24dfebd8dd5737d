"""K^A by differentiating the wrench along the body's own twists, then its symmetric part."""

import numpy as np

STEP = 1e-30  # imaginary: no digit is lost


def exponential(twist):
    """The motion by a small twist (omega, v), to first order: all that its derivative needs."""
    w, v = twist[:3], twist[3:]
    T = np.eye(4, dtype=complex)
    T[:3, :3] += [[0, -w[2], w[1]], [w[2], 0, -w[0]], [-w[1], w[0], 0]]
    T[:3, 3] = v
    return T


def wrench(T, inputs):
    """Moment and force, in body axes at the body's origin, that stretch the legs as they are."""
    base, points = np.array(inputs["base"], float), np.array(inputs["platform"], float)
    ends = points @ T[:3, :3].T + T[:3, 3]
    lengths = np.sqrt(((ends - base) ** 2).sum(axis=1))
    tension = np.array(inputs["stiffness"]) * (lengths - np.array(inputs["rest_length"]))
    forces = (tension / lengths)[:, None] * (ends - base) @ T[:3, :3]
    return np.concatenate([np.cross(points, forces).sum(axis=0), forces.sum(axis=0)])


def answers(inputs, folder):
    columns = [wrench(exponential(1j * STEP * e), inputs).imag / STEP for e in np.eye(6)]
    A = np.array(columns).T  # column j: the wrench, changed along twist j
    return {"K_A": A, "K_B": (A + A.T) / 2}
