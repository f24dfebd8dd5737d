"""Products of the joints' transformations, and the joints' screws seen from the tool."""

import numpy as np


def answers(inputs, folder):
    T, axes, points = np.eye(4), [], []
    for (d, a, alpha), q in zip(inputs["table"], inputs["posture"], strict=True):
        c, s, ca, sa = np.cos(q), np.sin(q), np.cos(alpha), np.sin(alpha)
        T = T @ [
            [c, -s, 0, a],
            [s * ca, c * ca, -sa, -sa * d],
            [s * sa, c * sa, ca, ca * d],
            [0, 0, 0, 1],
        ]
        axes.append(T[:3, 2])
        points.append(T[:3, 3])
    T = T @ inputs["tool"]
    moving = np.cross(axes, T[:3, 3] - points)
    return {
        "pose": T,
        "jacobian": np.vstack([T[:3, :3].T @ moving.T, T[:3, :3].T @ np.transpose(axes)]),
    }
