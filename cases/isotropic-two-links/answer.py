"""The Jacobian and the compliance of the tip's translations in the plane."""

import numpy as np

import cartstiff


def answers(inputs, folder):
    result = cartstiff.analyse(cartstiff.load(folder / "mechanism.yaml"))
    values = np.linalg.svd(result.jacobian[3:5], compute_uv=False)
    C = result.compliance.matrix[3:5, 3:5]
    return {
        "condition": values[0] / values[1],
        "manipulability": values[0] * values[1],
        "compliance": [C[0, 0], C[1, 1], C[0, 1]],
    }
