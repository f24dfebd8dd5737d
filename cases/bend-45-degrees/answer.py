"""The tip at rest under each force."""

import cartstiff


def answers(inputs, folder):
    bend = cartstiff.load(folder / "mechanism.yaml")
    loads = [cartstiff.DeadForce([0, 0, force]) for force in inputs["forces"]]
    return {"tip": [cartstiff.equilibrium(bend, load).pose[:3, 3] for load in loads]}
