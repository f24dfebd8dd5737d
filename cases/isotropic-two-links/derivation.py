"""The Jacobian written out in the axes of the second link."""

import numpy as np


def answers(inputs, folder):
    a, b = inputs["links"]
    elbow = np.deg2rad(135)
    # The shoulder moves the tip by the first link seen from the second, and by the second.
    J = np.array([[a * np.sin(elbow), 0], [a * np.cos(elbow) + b, b]])
    values = np.linalg.svd(J, compute_uv=False)
    C = J @ J.T
    return {
        "condition": values[0] / values[1],
        "manipulability": abs(np.linalg.det(J)),
        "compliance": [C[0, 0], C[1, 1], C[0, 1]],
    }
