"""Rank of the legs' lines from what the note says of their singular values."""

import cartstiff


def answers(inputs, folder):
    result = cartstiff.analyse(cartstiff.load(folder / "mechanism.yaml"))
    note = next(n for n in result.notes if n.code == "type-2-singularity")
    values = note.values["singular_values"]
    return {"rank": sum(value > 1e-12 * values[0] for value in values)}
