"""The four matrices of the platform."""

import cartstiff


def answers(inputs, folder):
    result = cartstiff.analyse(cartstiff.load(folder / "mechanism.yaml"))
    return {f"K_{name}": result.matrices[name] for name in "ABKF"}
