"""Joint compliances from measured loads, by cartstiff's least squares."""

import cartstiff
from cartstiff.identify import identify, read_measurements


def answers(inputs, folder):
    robot = cartstiff.load("fanuc-r2000ic")
    rows = read_measurements(folder / "measurements.csv", robot)
    kept = [n not in inputs["rejected_rows"] for n in rows.rows]
    found = identify(robot, rows.chosen(kept), fit="plain").estimates
    k = [1.0 / e.compliance for e in found]
    return {"first": k, "present": k}
