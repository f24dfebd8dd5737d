"""Stiffness matrices of plane beams, added up at the nodes of the half frame."""

import numpy as np


def answers(inputs, folder):
    nodes, E, A = np.array(inputs["nodes"]), inputs["E"], inputs["area"]
    EI = E * inputs["inertia"]
    K = np.zeros((12, 12))
    for k in range(3):
        d = nodes[k + 1] - nodes[k]
        L = np.hypot(*d)
        c, s = d / L
        a, b, e, f = E * A / L, 12 * EI / L**3, 6 * EI / L**2, 4 * EI / L
        local = np.array(
            [
                [a, 0, 0, -a, 0, 0],
                [0, b, e, 0, -b, e],
                [0, e, f, 0, -e, f / 2],
                [-a, 0, 0, a, 0, 0],
                [0, -b, -e, 0, b, -e],
                [0, e, f / 2, 0, -e, f],
            ]
        )
        turn = np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]])
        T = np.kron(np.eye(2), turn)
        K[3 * k : 3 * k + 6, 3 * k : 3 * k + 6] += T.T @ local @ T
    free = [3, 4, 5, 6, 7, 8, 10]  # the foot is clamped; the middle moves up and down
    force, moved = np.zeros(12), np.zeros(12)
    force[7] = -inputs["force"]
    moved[free] = np.linalg.solve(K[np.ix_(free, free)], force[free])
    reaction = K @ moved
    return {"thrust": reaction[0], "moment": reaction[2], "deflection": moved[7]}
