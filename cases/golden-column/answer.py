"""All critical loads on the curve of a growing dead force."""

import cartstiff


def answers(inputs, folder):
    column = cartstiff.load(folder / "mechanism.yaml")
    curve = cartstiff.load_curve(column, cartstiff.DeadForce([-1, 0, 0]), to=3.0)
    return {"loads": [critical.factor for critical in curve.critical]}
