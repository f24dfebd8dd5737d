"""Frequencies of the small motions without load."""

import cartstiff


def answers(inputs, folder):
    return {"frequencies": cartstiff.modes(cartstiff.load(folder / "mechanism.yaml")).frequencies}
