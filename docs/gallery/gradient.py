"""The gradient: which joint stiffness and which angle matter most for a UR5's softest direction.

The derivatives are exact; a step along them has to change the quantity as they say.
"""

import matplotlib.pyplot as plt
import numpy as np

import cartstiff

arm = cartstiff.load("ur5")
load = np.array([0.0, 0.0, 0.0, 0.0, 0.0, -100.0])  # N m, N, in axes of the hand
found = cartstiff.gradient(arm, of="translation_free_min", by=["stiffness", "q"], wrench=load)
for name in ("stiffness.elbow_joint", "q.elbow_joint"):
    print(f"{name}: {found[name]:.4f}")

stiffer = arm.with_springs({"elbow_joint": 20_200.0})  # 1 % more
again = cartstiff.gradient(stiffer, of="translation_free_min", by=["stiffness"], wrench=load)
predicted = found["stiffness.elbow_joint"] * 200.0
print(f"1 % on the elbow: {again.value - found.value:.2f} N/m, predicted {predicted:.2f} N/m")

figure, ax = plt.subplots(figsize=(6, 3.2), layout="constrained")
found.plot(ax=ax)
ax.set(xlabel="change for 1 % of each [N/m]")
figure.savefig("gradient.png", dpi=80)
