"""Timoshenko's cantilever: bending and shear."""


def answers(inputs, folder):
    E, nu, L, F = inputs["E"], inputs["poisson"], inputs["length"], inputs["force"]
    area = inputs["width"] * inputs["height"]
    inertia = area * inputs["height"] ** 2 / 12
    shear = E / (2 * (1 + nu)) * area * 10 * (1 + nu) / (12 + 11 * nu)
    return {"deflection": F * L**3 / (3 * E * inertia) + F * L / shear}
