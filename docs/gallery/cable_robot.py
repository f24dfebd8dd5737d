"""A cable robot: preload adds stiffness, and slack cables have none.

Eight crossed cables hold a frame. A rotation about the vertical stretches the cables very little:
this stiffness comes mostly from the preload.
"""

import matplotlib.pyplot as plt
import numpy as np

import cartstiff

robot = cartstiff.load("cable-robot")
stiffness, preload_of_file = 5.0e4, 200.0  # N/m, N
lengths = np.asarray(cartstiff.analyse(robot).leg_lengths)
preloads = np.array([25.0, 50.0, 100.0, 200.0, 400.0, 800.0, 1600.0])  # N
found = []
for preload in preloads:  # shorter cables are tighter
    rest = lengths - preload / stiffness
    found.append(np.diag(cartstiff.analyse(robot.with_springs(rest=rest)).B.matrix)[[2, 3]])
twisting, sideways = np.transpose(found)
slope, start = np.polyfit(preloads, twisting, 1)
print(f"twisting: {start:.2f} N m/rad, and {slope:.4f} m/rad for each N of preload")
print("sideways, 25 and 1600 N:", np.round(1e-3 * sideways[[0, -1]], 2), "N/mm")
tight = robot.with_springs(rest=lengths - preload_of_file / stiffness)
pushed = cartstiff.analyse(tight, [0.01, 0, 0.6, 0, 0, 0])
slack = next(note.values["slack"] for note in pushed.notes if note.code == "slack")
print("slack 10 mm to the side:", slack, "leaves", round(1e-3 * pushed.B.matrix[3, 3], 2), "N/mm")

figure, (left, right) = plt.subplots(1, 2, figsize=(8, 3), layout="constrained")
left.plot(preloads, twisting, "o-")
left.set(xlabel="preload of a cable [N]", ylabel="twisting stiffness [N m/rad]", ylim=(0, None))
right.plot(preloads, 1e-3 * sideways, "o-")
right.set(xlabel="preload of a cable [N]", ylabel="sideways stiffness [N/mm]", ylim=(0, None))
figure.savefig("cable_robot.png", dpi=80)
