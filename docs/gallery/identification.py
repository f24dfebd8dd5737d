"""Identification: the joint stiffnesses of a UR5 from measured deflections, with their intervals.

The measurements are simulated: 30 postures, 100 N in random directions, a tracker with 0.02 mm of
noise. Each joint's true stiffness has to lie in its interval in 95 of 100 such campaigns.
"""

import matplotlib.pyplot as plt
import numpy as np

import cartstiff
from cartstiff.identify import identify

arm = cartstiff.load("ur5", tcp=[0.1, 0.0, 0.15])  # a hook beside the flange
rng = np.random.default_rng(2)
stiffness = [24e3, 24e3, 16e3, 4e3, 4e3, 3.2e3]  # N m/rad, 0.8 times those of the file
truth = arm.with_springs(stiffness)
rows = []
for q in arm.q + rng.uniform(-0.8, 0.8, (30, 6)):
    force = rng.normal(size=3)
    load = np.array([0.0, 0.0, 0.0, *(100.0 * force / np.linalg.norm(force))])  # in axes of M
    result = cartstiff.analyse(truth, q)
    R = result.pose[:3, :3]
    moved = R @ (np.asarray(result.compliance) @ load)[3:] + rng.normal(0.0, 2e-5, 3)
    rows.append([*q, *(R @ load[3:]), *moved])
names = [*(f"q_{name}" for name in arm.names), "fx", "fy", "fz", "dx", "dy", "dz"]
found = identify(arm, dict(zip(names, np.transpose(rows), strict=True)))

figure, ax = plt.subplots(figsize=(6, 3.2), layout="constrained")
for estimate, true in zip(found.estimates, stiffness, strict=True):
    low, high = np.array(estimate.stiffness_interval, float)
    print(f"{estimate.name:20} {low:6.0f} to {high:6.0f} N m/rad, true {true:6.0f}")
    ax.plot([low / true, high / true], [estimate.name] * 2, "|-", color="C0")
ax.axvline(1.0, color="k", linewidth=0.8)
ax.set(xlabel="interval of the stiffness over its true value")
figure.savefig("identification.png", dpi=80)
