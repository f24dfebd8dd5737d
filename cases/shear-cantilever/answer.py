"""The tip's displacement at rest under the force."""

import cartstiff


def answers(inputs, folder):
    bar = cartstiff.load(folder / "mechanism.yaml")
    rest = cartstiff.equilibrium(bar, cartstiff.DeadForce([0, -inputs["force"], 0]))
    return {"deflection": -rest.pose[1, 3]}
