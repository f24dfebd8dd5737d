"""Vertical stiffness with and without the joints' own."""

import cartstiff


def answers(inputs, folder):
    real, ideal = (
        cartstiff.analyse(cartstiff.load(folder / file)).B.matrix[5, 5]
        for file in ("mechanism.yaml", "mechanism-ideal.yaml")
    )
    return {"share": real / ideal}
