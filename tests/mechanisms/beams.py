"""Planar-jointed beam structures by finite elements: Euler-Bernoulli elements in space.

Unknowns are node displacements in fixed axes, (translation, rotation). A hinge about z gives an
element its own rotation about z at a node and shares the other five.
"""

import numpy as np


def element(section, length):
    """Stiffness (12, 12) of a beam along x; per end: three displacements, three rotations."""
    E, G = section["E"], section["G"]
    a, t = E * section["area"] / length, G * section["J"] / length
    K = np.zeros((12, 12))

    def spring(i, j, k):
        K[np.ix_([i, j], [i, j])] += k * np.array([[1, -1], [-1, 1]])

    spring(0, 6, a)
    spring(3, 9, t)
    # Bending in x-y (v, rz) and in x-z (w, ry, where a positive ry lowers w along x).
    for v, r, inertia, s in ((1, 5, section["Iz"], 1.0), (2, 4, section["Iy"], -1.0)):
        b = E * inertia / length**3
        sub = b * np.array(
            [
                [12, 6 * length * s, -12, 6 * length * s],
                [6 * length * s, 4 * length**2, -6 * length * s, 2 * length**2],
                [-12, -6 * length * s, 12, -6 * length * s],
                [6 * length * s, 2 * length**2, -6 * length * s, 4 * length**2],
            ]
        )
        at = [v, r, v + 6, r + 6]
        K[np.ix_(at, at)] += sub
    return K
