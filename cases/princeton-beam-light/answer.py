"""The tip's displacement under a dead force at each angle from the stiff axis."""

import numpy as np

import cartstiff


def answers(inputs, folder):
    bar = cartstiff.load(folder / "mechanism.yaml")
    tips = []
    for angle in np.deg2rad(inputs["angles"]):
        force = inputs["force"] * np.array([0, -np.cos(angle), np.sin(angle)])
        tips.append(cartstiff.equilibrium(bar, cartstiff.DeadForce(force)).pose[:3, 3])
    tips = np.array(tips)
    return {"stiff_axis": -tips[:, 1], "soft_axis": tips[:, 2]}
