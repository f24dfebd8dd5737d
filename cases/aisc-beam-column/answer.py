"""The column at rest under dead forces at its top, in inches and kips."""

import cartstiff

INCH, KIP = 0.0254, 4448.2216152605


def answers(inputs, folder):
    column = cartstiff.load(folder / "mechanism.yaml")
    lateral, length = inputs["lateral"], inputs["length"]
    deflections, moments = [], []
    for axial in inputs["axial"]:
        # To first order, as the source computes: a thousandth of the lateral force.
        load = cartstiff.DeadForce([-axial * KIP, lateral / 1000 * KIP, 0])
        tip = cartstiff.equilibrium(column, load).pose[:3, 3] / INCH
        deflections.append(1000 * tip[1])
        moments.append(lateral * length + axial * 1000 * tip[1])
    return {"deflection": deflections, "moment": moments}
