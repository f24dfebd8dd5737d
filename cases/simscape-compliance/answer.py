"""The platform's compliance, in the order of the table."""

import cartstiff


def answers(inputs, folder):
    C = cartstiff.analyse(cartstiff.load(folder / "mechanism.yaml")).compliances["B"]
    order = [3, 4, 5, 0, 1, 2]  # the table has translations first
    return {"compliance": C[order][:, order]}
