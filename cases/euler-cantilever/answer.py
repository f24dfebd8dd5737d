"""The first critical load on the curve of a growing dead force."""

import cartstiff


def answers(inputs, folder):
    column = cartstiff.load(folder / "mechanism.yaml")
    curve = cartstiff.load_curve(column, cartstiff.DeadForce([-1, 0, 0]), to=3.0)
    return {"load": curve.critical[0].factor}
