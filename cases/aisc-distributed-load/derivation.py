"""The column's differential equation under a uniform load, with the shortening by its axial force.

Along the unloaded axis, from the hinge: across'' = -c / E I (P across + c w (h s - s^2 / 2)) with
c = 1 - P / (E A). Without the shortening (c = 1) the last deflection would be 0.312, not 0.311 in.
"""

import numpy as np


def answers(inputs, folder):
    EI, half, w = inputs["E"] * inputs["inertia"], inputs["length"] / 2, inputs["uniform"]
    P = np.array(inputs["axial"], float)
    c = 1 - P / (inputs["E"] * inputs["area"])
    u = np.sqrt(c * np.where(P > 0, P, 1) / EI) * half
    bent = np.where(P > 0, (1 / np.cos(u) - 1 - u**2 / 2) / u**4, 5 / 24)
    top = c**2 * w * half**4 / EI * bent
    return {"deflection": top, "moment": c * w * half**2 / 2 + P * top}
