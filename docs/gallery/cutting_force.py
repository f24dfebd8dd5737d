"""A platform under a cutting force: where in its workspace a milling hexapod is softest.

The force turns with the cut: 200 N in the plane of the table, in 24 directions. The picture shows
the largest deflection of the tool at each place.
"""

import matplotlib.pyplot as plt
import numpy as np

import cartstiff
from cartstiff.maps import Grid, map_of

FORCE = 200.0  # N
platform = cartstiff.load("hexapod")
axis = (-0.06, 0.06, 7)  # m: from, to, how many
where = Grid({"x": axis, "y": axis}, platform.names, platform.q)
largest = np.zeros((7, 7))
for angle in np.linspace(0.0, 2 * np.pi, 24, endpoint=False):
    cut = [0, 0, 0, FORCE * np.cos(angle), FORCE * np.sin(angle), 0]
    data = map_of(platform, where, ["deflection"], deflect=cut, world=True, connection="B")
    largest = np.maximum(largest, 1e6 * data["deflection"].values)
worst = np.unravel_index(largest.argmax(), largest.shape)
ticks = 1e3 * np.linspace(*axis)  # mm
place = [round(float(ticks[i]), 1) for i in worst]
print(f"in the middle {largest[3, 3]:.3f}, at worst {largest.max():.3f} micrometres, at {place} mm")

figure, ax = plt.subplots(figsize=(4.8, 3.6), layout="constrained")
shown = ax.pcolormesh(ticks, ticks, largest.T)
ax.set(xlabel="x [mm]", ylabel="y [mm]", aspect="equal")
figure.colorbar(shown, label=f"largest deflection under {FORCE:.0f} N [µm]")
figure.savefig("cutting_force.png", dpi=80)
