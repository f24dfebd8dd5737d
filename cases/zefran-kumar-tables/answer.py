"""The four matrices of the platform, and the inverse of its Jacobian."""

import numpy as np

import cartstiff


def answers(inputs, folder):
    result = cartstiff.analyse(cartstiff.load(folder / "mechanism.yaml"))
    matrices = {f"K_{name}": result.matrices[name] for name in "ABKF"}
    return matrices | {"J_inverse": np.linalg.inv(result.jacobian)}
