"""The parallel axes' theorem: moments, and products of inertia that are positive sums."""

import numpy as np


def answers(inputs, folder):
    x = np.array(inputs["centre"])
    about, moved = np.array(inputs["inertia_about_centre"]), inputs["mass"] * np.outer(x, x)
    return {"inertia": about + moved + np.diag(np.trace(moved) - 2 * np.diag(moved))}
