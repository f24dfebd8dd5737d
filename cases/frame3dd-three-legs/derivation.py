"""Bars with shear and the geometric stiffness of first order, their thrusts found by iteration."""

import numpy as np


def bar(area, shear, torsion, inertia, E, G, L, N):
    f = 12 * E * inertia / (G * shear * L**2)
    D, EI = (1 + f) ** 2, E * inertia / (1 + f)
    b = 12 * EI / L**3 + N / L * (1.2 + 2 * f + f * f) / D
    e = 6 * EI / L**2 + N / 10 / D
    g = (4 + f) * EI / L + N * L * (2 / 15 + f / 6 + f * f / 12) / D
    h = (2 - f) * EI / L - N * L * (1 / 30 + f / 6 + f * f / 12) / D
    K, ends = np.zeros((12, 12)), np.array([[1, -1], [-1, 1]])
    K[np.ix_([0, 6], [0, 6])] = E * area / L * ends
    K[np.ix_([3, 9], [3, 9])] = (G * torsion / L + N / L * torsion / area) * ends
    across = np.array([[b, e, -b, e], [e, g, -e, h], [-b, -e, b, -e], [e, h, -e, g]])
    K[np.ix_([1, 5, 7, 11], [1, 5, 7, 11])] = across
    sign = np.diag([1, -1, 1, -1])
    K[np.ix_([2, 4, 8, 10], [2, 4, 8, 10])] = sign @ across @ sign
    return K


def answers(inputs, folder):
    nodes, force = np.array(inputs["nodes"]), np.zeros((12, 6))
    for node, wrench in zip(inputs["loaded"], inputs["loads"], strict=True):
        force[node - 1] = wrench[3:] + wrench[:3]
    free = np.array([6 * (n - 1) + k for n in inputs["shown"] for k in range(6)])
    thrusts, moved = np.zeros(15), np.zeros((12, 6))
    for _ in range(15):
        K, unit_thrusts = np.zeros((72, 72)), np.zeros((15, 72))
        for k, (i, j) in enumerate(inputs["bars"]):
            section = inputs["leg" if i in inputs["feet"] else "beam"]
            L = np.linalg.norm(nodes[j - 1] - nodes[i - 1])
            x = (nodes[j - 1] - nodes[i - 1]) / L
            y = np.cross([0, 0, 1], x) if abs(x[2]) < 0.5 else np.array([0, 1, 0])
            axes = np.kron(np.eye(4), np.array([x, y, np.cross(x, y)]))
            rows = np.r_[6 * i - 6 : 6 * i, 6 * j - 6 : 6 * j]
            K[np.ix_(rows, rows)] += axes.T @ bar(**section, L=L, N=thrusts[k]) @ axes
            stretch = section["E"] * section["area"] / L * x
            unit_thrusts[k, rows[:3]], unit_thrusts[k, rows[6:9]] = -stretch, stretch
        moved.ravel()[free] = np.linalg.solve(K[np.ix_(free, free)], force.ravel()[free])
        thrusts = unit_thrusts @ moved.ravel()
    return {"second_order": moved[np.array(inputs["shown"]) - 1]}
