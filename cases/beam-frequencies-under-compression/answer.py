"""Frequencies for 8 to 24 segments, extrapolated: the error goes with even powers of the length."""

import numpy as np

import cartstiff

SEGMENTS = (8, 12, 16, 24)


def answers(inputs, folder):
    rows = []
    for count in SEGMENTS:
        bar = cartstiff.load(folder / "mechanism.yaml", parameters={"segments": count})
        pressed = cartstiff.equilibrium(bar, cartstiff.DeadForce([-inputs["force"], 0, 0]))
        # Each bending mode comes twice: about y and about z.
        rows.append([cartstiff.modes(state).squares[:4:2] for state in (bar, pressed)])
    powers = np.vander([count**-2.0 for count in SEGMENTS], increasing=True)
    squares = np.linalg.solve(powers, np.reshape(rows, (len(SEGMENTS), 4)))[0]
    free, loaded = np.sqrt(squares).reshape(2, 2) / (2 * np.pi)
    return {"without_load": free, "under_load": loaded}
