"""The half column at rest under dead forces at its end and its own weight, in inches and kips."""

import numpy as np

import cartstiff
from cartstiff.extend import Gravity

INCH, KIP = 0.0254, 4448.2216152605


def answers(inputs, folder):
    half, load = inputs["length"] / 2, inputs["uniform"]
    small = 1e-3  # to first order, as the source computes
    tops = []
    for file in ("mechanism-8.yaml", "mechanism.yaml"):
        column = cartstiff.load(folder / file)
        weight = small * load * KIP / INCH / (inputs["area"] * INCH**2)  # of 1 kg / m^3
        column = column.with_potential(Gravity(np.array([0.0, -weight, 0.0])))
        found = []
        for axial in inputs["axial"]:
            end = cartstiff.DeadForce([-axial * KIP, small * load * half * KIP, 0])
            found.append(cartstiff.equilibrium(column, end).pose[:2, 3] / INCH)
        tops.append(np.array(found))
    along, across = (tops[1] + (tops[1] - tops[0]) / 3).T
    top = across / small
    moment = load * half * along / 2 + np.array(inputs["axial"]) * top
    return {"deflection": top, "moment": moment}
