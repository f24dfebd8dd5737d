"""The tip at rest under a moment that keeps its direction, 8 and 16 segments extrapolated."""

import numpy as np

import cartstiff


def answers(inputs, folder):
    moment = cartstiff.DeadWrench([0, -inputs["moment"], 0, 0, 0, 0])
    tips = []
    for file in ("mechanism.yaml", "mechanism-16.yaml"):
        bar = cartstiff.load(folder / file)
        tips.append(cartstiff.equilibrium(bar, moment).pose[[0, 2], 3])
    return {"tip": np.abs(tips[1] + (tips[1] - tips[0]) / 3)}
