"""The half frame at rest, its middle held along x and against turning."""

import numpy as np

import cartstiff


def answers(inputs, folder):
    frame = cartstiff.load(folder / "mechanism.yaml")
    rows = []
    for small in (1e-3, -1e-3):  # linear, as the source: a small load and its opposite
        load = cartstiff.DeadForce([0, -small * inputs["force"], 0], frame_b="load")
        rest = cartstiff.equilibrium(frame, load, held={"x": 0.0, "rz": 0.0})
        at, _ = frame.mechanism.at(rest.q).relative("world", "load")
        rows.append([rest.reactions.held["x"], rest.reactions.held["rz"], at[1, 3]])
    thrust, turn, deflection = (np.array(rows[0]) - rows[1]) / 2e-3
    (_, _), (_, _), (x, _), (_, height) = inputs["nodes"]
    # What the foot bears for the balance of the half.
    moment = inputs["force"] * x + thrust * height - turn
    return {"thrust": -thrust, "moment": moment, "deflection": deflection}
