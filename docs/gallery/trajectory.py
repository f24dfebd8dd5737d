"""A trajectory: how far a UR5's tool deflects along a row of holes, and what corrects it.

The drill points along the base's x axis; the work pushes back with 120 N. The joint stiffnesses are
those of the bundled file: illustrative. Corrected commands put the loaded tool on the holes.
"""

import matplotlib.pyplot as plt
import numpy as np

import cartstiff
from cartstiff import DeadForce, compensate
from cartstiff.geometry import se3

DRILLING = np.array([[0.0, 0.0, 1.0], [0.0, -1.0, 0.0], [1.0, 0.0, 0.0]])  # tool z along x
holes = np.linspace(-0.3, 0.3, 13)  # m, along the base's y axis
poses = np.array([se3.pose(DRILLING, np.array([0.45, y, 0.45])) for y in holes])

arm = cartstiff.load("ur5")
first = cartstiff.inverse_kinematics(arm, poses[0], [[0.3, -1.4, 1.9, -0.5, 1.27, 0.0]])[0]
path = compensate(arm, poses, [DeadForce(np.array([-120.0, 0.0, 0.0]))] * len(poses), q=first)
before, after = (1e3 * np.linalg.norm(e[:, 3:], axis=1) for e in (path.before, path.after))
print("deflection along the row:", np.round(before[::4], 3), "mm")
print("after correction, largest:", round(float(after.max()), 6), "mm")
print("largest correction:", round(1e3 * float(np.abs(path.offsets).max()), 3), "mrad")

figure, ax = plt.subplots(figsize=(6, 3.2), layout="constrained")
ax.plot(1e3 * holes, before, "o-", label="as commanded")
ax.plot(1e3 * holes, after, "s-", label="corrected")
ax.set(xlabel="place of the hole [mm]", ylabel="distance from the hole [mm]")
ax.legend()
figure.savefig("trajectory.png", dpi=80)
