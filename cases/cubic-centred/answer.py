"""The platform's stiffness, in the order of the table."""

import cartstiff


def answers(inputs, folder):
    K = cartstiff.analyse(cartstiff.load(folder / "mechanism.yaml")).matrices["B"]
    order = [3, 4, 5, 0, 1, 2]  # the table has translations first
    return {"stiffness": K[order][:, order]}
