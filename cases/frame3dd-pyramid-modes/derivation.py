"""Bars with shear, thrust and consistent mass, added up at the apex."""

import numpy as np

SIGN = np.diag([1, -1])


def at_apex(inputs, thrust):
    """Stiffness and mass (displacements, turns) of a bar along x, at its free end."""
    E, G, L = inputs["E"], inputs["G"], inputs["length"]
    area, Iz, J = inputs["area"], inputs["inertia"], inputs["torsion"]
    f, N = 12 * E * Iz / (G * inputs["shear_area"] * L**2), thrust
    D, EI, t = (1 + f) ** 2, E * Iz / (1 + f), inputs["density"] * area * L
    b = 12 * EI / L**3 + N / L * (1.2 + 2 * f + f * f) / D
    e = 6 * EI / L**2 + N / 10 / D
    g = (4 + f) * EI / L + N * L * (2 / 15 + f / 6 + f * f / 12) / D
    r = inputs["density"] * Iz
    a, c = 13 * t / 35 + 6 * r / (5 * L), 11 * t * L / 210 + r / 10
    K = np.diag([E * area / L, 0, 0, G * J / L + N / L * J / area, 0, 0])
    M = np.diag([t / 3, 0, 0, inputs["density"] * J * L / 3, 0, 0])
    across, mass = (
        np.array([[b, -e], [-e, g]]),
        np.array([[a, -c], [-c, t * L * L / 105 + 2 * L * r / 15]]),
    )
    for matrix, block in ((K, across), (M, mass)):
        matrix[np.ix_([1, 5], [1, 5])] = block
        matrix[np.ix_([2, 4], [2, 4])] = SIGN @ block @ SIGN
    return K, M


def answers(inputs, folder):
    K, M = np.zeros((6, 6)), np.diag([inputs["mass"]] * 3 + [0, 0, 0])
    for foot, thrust in zip(inputs["feet"], inputs["thrusts"], strict=True):
        x = (np.array(inputs["apex"]) - foot) / inputs["length"]
        y = np.cross([0, 0, 1], x) / np.linalg.norm(np.cross([0, 0, 1], x))
        axes = np.kron(np.eye(2), np.array([x, y, np.cross(x, y)]))
        k, m = at_apex(inputs, thrust)
        K, M = K + axes.T @ k @ axes, M + axes.T @ m @ axes
    squares = np.linalg.eigvals(np.linalg.solve(M, K))
    return {"frequencies": np.sqrt(np.sort(squares.real)) / (2 * np.pi)}
