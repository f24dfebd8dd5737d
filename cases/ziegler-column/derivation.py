"""The load at which the frequencies of the two links' small vibrations meet."""

import numpy as np


def answers(inputs, folder):
    m1, m2 = inputs["masses"]
    mass = np.array([[m1 + m2, m2], [m2, m2]])

    def flutters(load):
        stiffness = np.array([[2 - load, load - 1], [-1, 1]])
        return np.abs(np.linalg.eigvals(np.linalg.solve(mass, stiffness)).imag).max() > 0

    low, high = 1.0, 3.0
    while high - low > 1e-12:
        middle = (low + high) / 2
        low, high = (low, middle) if flutters(middle) else (middle, high)
    return {"load": low}
