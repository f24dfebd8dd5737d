"""The limit point on the curve of a growing force downwards."""

import cartstiff


def answers(inputs, folder):
    truss = cartstiff.load(folder / "mechanism.yaml")
    curve = cartstiff.load_curve(truss, cartstiff.DeadForce([0, 0, -1]), to=0.2)
    first = curve.critical[0]
    return {"load": first.factor, "rise": first.q[0]} if first.kind == "limit" else {}
