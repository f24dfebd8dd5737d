"""Roots by Newton's method."""

import math


def answers(inputs, folder):
    roots = []
    for x in (4.7, 7.8, 11.0):
        for _ in range(20):
            value = math.cos(x) - 1 / math.cosh(x)
            slope = -math.sin(x) + math.sinh(x) / math.cosh(x) ** 2
            x -= value / slope
        roots.append(x)
    return {"roots": roots}
