"""Second derivative of the energy by the object's turn, and its root.

When the object turns by t, the contact rolls along the face by r t. The tip's centre then stands
at R(t) (r t, a + r): to second order (-a t, a + r + (r - a) t^2 / 2). The springs along the face
take the first number, the squeeze the second.
"""


def answers(inputs, folder):
    a, f, k = inputs["half_width"], inputs["squeeze"], inputs["along"]
    turn = [2 * (k * a**2 + f * (r - a)) for r in inputs["radii"]]
    return {"small": turn[0], "large": turn[1], "radius": a - k * a**2 / f}
