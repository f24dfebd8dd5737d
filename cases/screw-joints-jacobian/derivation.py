"""Screws seen from the end: each is moved back by the motions of the joints after it."""

import numpy as np


def skew(a):
    return np.array([[0, -a[2], a[1]], [a[2], 0, -a[0]], [-a[1], a[0], 0]])


def motion(screw, angle):
    """Rotation and displacement by a screw with a unit direction."""
    W, v = skew(screw[:3]), screw[3:]
    s, c = np.sin(angle), np.cos(angle)
    R = np.eye(3) + s * W + (1 - c) * W @ W
    return R, (np.eye(3) * angle + (1 - c) * W + (angle - s) * W @ W) @ v


def answers(inputs, folder):
    screws, q = np.array(inputs["screws"], float), inputs["posture"]
    R, p, columns = np.eye(3), np.zeros(3), []
    for screw, angle in zip(screws[::-1], q[::-1], strict=True):
        columns.append(np.r_[R.T @ screw[:3], R.T @ (screw[3:] + np.cross(screw[:3], p))])
        turn, move = motion(screw, angle)
        R, p = turn @ R, move + turn @ p
    return {"jacobian": np.transpose(columns[::-1])}
