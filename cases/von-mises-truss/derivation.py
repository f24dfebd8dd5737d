"""The maximum of the force, where L^3 = L0 a^2."""

import math


def answers(inputs, folder):
    a, rise, k = inputs["half_span"], inputs["rise"], inputs["stiffness"]
    free = math.hypot(a, rise)
    length = (free * a**2) ** (1 / 3)
    h = math.sqrt(length**2 - a**2)
    return {"load": 2 * k * (free - length) * h / length, "rise": h}
