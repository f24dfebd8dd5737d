"""Frequencies of the pyramid whose bars are springs with masses, six by six."""

import cartstiff


def answers(inputs, folder):
    return {"frequencies": cartstiff.modes(cartstiff.load(folder / "mechanism.yaml")).frequencies}
