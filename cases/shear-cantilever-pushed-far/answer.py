"""Tip at rest for 8, 16 and 32 segments; the errors of orders two and four are taken off."""

from itertools import pairwise

import numpy as np

import cartstiff


def answers(inputs, folder):
    load = cartstiff.DeadForce([0, inputs["force"], 0])
    tips = []
    for file in ("mechanism-8.yaml", "mechanism.yaml", "mechanism-32.yaml"):
        bar = cartstiff.load(folder / file)
        tips.append(np.array(cartstiff.equilibrium(bar, load).pose[:2, 3]))
    halved = [fine + (fine - coarse) / 3 for coarse, fine in pairwise(tips)]
    tip = halved[1] + (halved[1] - halved[0]) / 15
    return {"along": inputs["length"] - tip[0], "across": tip[1]}
