"""Planar-jointed beam structures by finite elements: Euler-Bernoulli elements in space.

Unknowns are node displacements in fixed axes, (translation, rotation). A hinge about z gives an
element its own rotation about z at a node and shares the other five.
"""

from itertools import pairwise

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


class Frame:
    """Beams, hinges and one rigid body, assembled unknown by unknown."""

    def __init__(self):
        self.count = 6  # the body's translation and rotation come first
        self.entries = []

    def new(self, n=6):
        """Selection rows of n new unknowns."""
        first = self.count
        self.count += n
        return [_unit(first + i) for i in range(n)]

    @staticmethod
    def on_body(arm):
        """Rows of a point of the body: u = u_b + r x arm, and its rotation."""
        x, y, z = arm
        turn = np.array([[0, z, -y], [-z, 0, x], [y, -x, 0]])
        rows = [np.concatenate([np.eye(3)[i], turn[i]]) for i in range(3)]
        return rows + [_unit(3 + i) for i in range(3)]

    def beam(
        self,
        start,
        end,
        a,
        b,
        section,
        pieces=1,
    ):
        """A straight beam in the x-y plane from a to b, in equal elements."""
        along = (b - a) / np.linalg.norm(b - a)
        R = np.stack([along, np.cross([0, 0, 1], along), [0, 0, 1]])
        turn = np.kron(np.eye(4), R)
        K = turn.T @ element(section, float(np.linalg.norm(b - a)) / pieces) @ turn
        nodes = [start, *(self.new() for _ in range(pieces - 1)), end]
        for first, second in pairwise(nodes):
            self.entries.append((self._stack([*first, *second]), K))

    def spring(self, row, k):
        self.entries.append((self._stack([row]), np.array([[k]])))

    @staticmethod
    def _stack(rows):
        width = max(len(r) for r in rows)
        return np.array([np.pad(r, (0, width - len(r))) for r in rows])

    def body_stiffness(self):
        """Everything else eliminated: 6x6 in fixed axes, (rotation, translation) at the origin."""
        K = np.zeros((self.count, self.count))
        for rows, k in self.entries:
            full = np.pad(rows, ((0, 0), (0, self.count - rows.shape[1])))
            K += full.T @ k @ full
        held, free = slice(0, 6), slice(6, None)
        reduced = K[held, held] - K[held, free] @ np.linalg.solve(K[free, free], K[free, held])
        order = [3, 4, 5, 0, 1, 2]
        return reduced[np.ix_(order, order)]


GROUND = np.zeros(0)


def _unit(i):
    row = np.zeros(i + 1)
    row[i] = 1.0
    return row
