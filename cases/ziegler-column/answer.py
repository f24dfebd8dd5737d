"""The first critical load of a force that keeps its direction in the second link."""

import cartstiff


def answers(inputs, folder):
    column = cartstiff.load(folder / "mechanism.yaml")
    push = cartstiff.FollowerWrench([0, 0, 0, -1, 0, 0])
    (critical,) = cartstiff.load_curve(column, push, to=2.5).critical
    return {"load": critical.factor} if critical.kind == "flutter" else {}
