"""A grasp: two fingers hold an object, and squeezing changes how stiffly.

Point contacts cannot resist a spin about the line that joins them. The other two rotational
stiffnesses fall as the fingers squeeze harder: the load on each finger enters K, although the
object as a whole is unloaded.
"""

import matplotlib.pyplot as plt
import numpy as np

import cartstiff

hand = cartstiff.load("grasp")
at = dict(zip(hand.names, hand.q.tolist(), strict=True))
behind = {"proximal": 0.0469, "distal": 0.0174}  # rad, of the rest positions in the file
squeezes, stiffness = np.linspace(0.0, 4.0, 9), []
for squeeze in squeezes:  # rest positions further behind the posture squeeze more
    rest = {
        f"leg{finger}/{joint}": at[f"leg{finger}/{joint}"] + squeeze * way
        for finger in (1, 2)
        for joint, way in behind.items()
    }
    K = cartstiff.analyse(hand.with_springs(rest=rest)).B.matrix
    stiffness.append(np.diag(K)[:3])
values = np.array(stiffness)
for name, column in zip("xyz", values.T, strict=True):
    print(f"about {name}:", np.round(np.abs(column[[0, 2, 8]]), 4), "N m/rad")

figure, ax = plt.subplots(figsize=(6, 3.2), layout="constrained")
ax.plot(squeezes, values, "o-", label=["about x", "about y", "about z"])
ax.set(xlabel="squeeze against the file's", ylabel="rotational stiffness [N m/rad]")
ax.legend()
figure.savefig("grasp.png", dpi=80)
