"""Deflection of a UR5 along a row of holes in a vertical plate.

The drill points along the base's x axis, its tip 0.15 m before the flange; the work pushes back
with 120 N. The joint stiffnesses are those of the bundled file: illustrative, not the maker's.
"""

from pathlib import Path

import numpy as np

import cartstiff
from cartstiff.geometry import se3

HOLES = np.linspace(-0.3, 0.3, 7)  # m, along the base's y axis
TIP = se3.pose(translation=[0.0, 0.0, 0.15])
FORCE = 120.0  # N
# Flange z along the base's x, flange x down.
DRILLING = np.array([[0.0, 0.0, 1.0], [0.0, -1.0, 0.0], [1.0, 0.0, 0.0]])


def main(picture: Path | None = None) -> dict[str, float]:
    """Deflection of the drill's tip at the holes (mm): along the drill and across it."""
    arm = cartstiff.load("ur5")
    q = np.array([0.3, -1.4, 1.9, -0.5, 1.27, 0.0])
    along, across = [], []
    for y in HOLES:
        found = cartstiff.inverse_kinematics(arm, se3.pose(DRILLING, [0.45, y, 0.45]), [q])
        q = min(found, key=lambda branch: np.abs(branch - q).max())
        at_tip = cartstiff.analyse(arm, q).B.to_frame(TIP, "drill tip")
        push = np.array([0.0, 0.0, 0.0, 0.0, 0.0, -FORCE])  # on the drill, in its own axes
        moved = np.asarray(at_tip.compliance()) @ push
        along.append(1e3 * moved[5])
        across.append(1e3 * np.hypot(moved[3], moved[4]))
    if picture is not None:
        draw(along, across, picture)
    return {
        "pushed back at the first hole, mm": float(-along[0]),
        "wandering at the first hole, mm": float(across[0]),
        "pushed back at the middle hole, mm": float(-along[3]),
        "wandering at the middle hole, mm": float(across[3]),
        "pushed back at the last hole, mm": float(-along[-1]),
        "wandering at the last hole, mm": float(across[-1]),
    }


def draw(along: list[float], across: list[float], picture: Path) -> None:
    """Deflection against the hole's place."""
    import matplotlib.pyplot as plt

    figure, axis = plt.subplots(figsize=(6, 3.4), layout="constrained")
    axis.plot(1e3 * HOLES, -np.array(along), "o-", label="back along the drill")
    axis.plot(1e3 * HOLES, across, "s-", label="across the drill")
    axis.set(xlabel="place of the hole, base y [mm]", ylabel=f"deflection under {FORCE:.0f} N [mm]")
    axis.set_ylim(bottom=0)
    axis.legend()
    figure.savefig(picture, dpi=80)
