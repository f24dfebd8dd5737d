"""Deflections of a UR5: the ball of all 100 N forces, and the ellipsoid of flange deflections.

Three postures of the same arm. Deflections are drawn 120 times too large. The joint stiffnesses
are those of the bundled file: illustrative, not the maker's.
"""

from pathlib import Path

import numpy as np

import cartstiff

POSTURES = {
    "reaching up": [0.0, -1.5, 0.6, -0.8, -1.57, 0.0],
    "bundled posture": [0.3, -1.1, 1.4, -0.7, 0.9, 0.2],
    "stretched out": [0.0, -0.8, 0.3, 0.5, -1.57, 0.0],
}
FORCE, MAGNIFIED = 100.0, 120.0
LINKS = ["base_link", "upper_arm_link", "forearm_link", "wrist_1_link", "wrist_2_link"]


def main(picture: Path | None = None) -> dict[str, float]:
    """Largest and smallest deflection (mm) of the flange under 100 N, in each posture."""
    arm = cartstiff.load("ur5")
    numbers, scenes = {}, []
    for name, q in POSTURES.items():
        result = cartstiff.analyse(arm, q)
        R = result.pose[:3, :3]
        C = R @ np.asarray(result.B.compliance())[3:, 3:] @ R.T  # m/N, in the base's axes
        values, axes = np.linalg.eigh(C)
        numbers[f"{name}, softest, mm"] = float(1e3 * FORCE * values[-1])
        numbers[f"{name}, firmest, mm"] = float(1e3 * FORCE * values[0])
        points = [result.posture.relative("world", link)[0][:3, 3] for link in LINKS]
        scenes.append((name, np.array([*points, result.pose[:3, 3]]), FORCE * values, axes))
    if picture is not None:
        draw(scenes, picture)
    return numbers


def draw(scenes: list[tuple[str, np.ndarray, np.ndarray, np.ndarray]], picture: Path) -> None:
    """The arms as lines, with the ellipsoids at the flange."""
    import matplotlib.pyplot as plt

    u, v = np.meshgrid(np.linspace(0, 2 * np.pi, 37), np.linspace(0, np.pi, 19))
    ball = np.array([np.cos(u) * np.sin(v), np.sin(u) * np.sin(v), np.cos(v)]).reshape(3, -1)
    figure = plt.figure(figsize=(10, 3.9), layout="constrained")
    for i, (name, points, radii, axes) in enumerate(scenes, start=1):
        axis = figure.add_subplot(1, 3, i, projection="3d")
        axis.plot(*points.T, "-o", color="#33506b", linewidth=4, markersize=5)
        surface = points[-1][:, None] + MAGNIFIED * axes @ (radii[:, None] * ball)
        axis.plot_surface(*surface.reshape(3, *u.shape), color="#d9722e", alpha=0.55, linewidth=0)
        softest = 1e3 * radii[-1]
        axis.set_title(
            f"{name}\n100 N moves it {1e3 * radii[0]:.2f} to {softest:.2f} mm", fontsize=9
        )
        axis.set(xlim=(-0.1, 1.0), ylim=(-0.55, 0.55), zlim=(0, 1.1))
        axis.set_box_aspect((1, 1, 1), zoom=1.15)
        axis.view_init(18, -62)
        axis.tick_params(labelsize=6, pad=-2)
    figure.savefig(picture, dpi=90)
