"""Eigenvalues of the springs' energy over the work of the load, in the links' angles."""

import numpy as np


def answers(inputs, folder):
    n = inputs["links"]
    springs = 2 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1)
    springs[-1, -1] = 1
    return {"loads": np.linalg.eigvalsh(springs)}
