"""Connections under load: which of the four matrices a UR5 has depends on what is held constant.

The flange is pushed with 400 N, far more than the arm may carry, so that the differences from K^B
can be seen. Without a load all four are the same.
"""

import matplotlib.pyplot as plt
import numpy as np

import cartstiff

arm = cartstiff.load("ur5")
load = [0, 0, 0, 150, 0, -370]  # moment [N m] and force [N], in the flange's axes
loaded = cartstiff.analyse(arm, wrench=load)
unloaded = cartstiff.analyse(arm)

figure, axes = plt.subplots(1, 3, figsize=(8, 2.9), layout="constrained")
for ax, name in zip(axes, "AKF", strict=True):
    change = getattr(loaded, name).matrix - loaded.B.matrix
    rotation, coupling, translation = change[:3, :3], change[:3, 3:], change[3:, 3:]
    print(
        f"K^{name} - K^B: rotation {abs(rotation).max():.1f} N m/rad,",
        f"coupling {abs(coupling).max():.1f} N, translation {abs(translation).max():.1f} N/m",
    )
    ax.imshow(np.cbrt(change), cmap="RdBu")
    ax.set(title=f"$K^{name} - K^B$, cube roots", xticks=[], yticks=[])
print("asymmetry of K^A:", round(float(abs(loaded.A.matrix - loaded.A.matrix.T).max()), 1), "N")
same = max(abs(K.matrix - unloaded.B.matrix).max() for K in (unloaded.A, unloaded.K, unloaded.F))
print("without the load:", round(float(same), 6))
figure.savefig("connections_under_load.png", dpi=80)
