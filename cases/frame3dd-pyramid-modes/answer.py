"""Frequencies of the pyramid whose bars are superelements."""

import cartstiff


def answers(inputs, folder):
    return {"frequencies": cartstiff.modes(cartstiff.load(folder / "mechanism.yaml")).frequencies}
