"""A cable robot: preload adds stiffness, slack cables have none.

Eight crossed cables hold a frame. A rotation about the vertical stretches the cables very
little: this stiffness comes mostly from the preload.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np

import cartstiff

PRELOADS = np.array([25.0, 50, 100, 200, 400, 800, 1600])  # N


def main(picture: Path | None = None) -> dict[str, object]:
    """Twisting stiffness against preload, and the cables that go slack when pushed sideways."""
    robot = cartstiff.load("cable-robot")
    lengths = robot.mechanism.leg_lengths(robot.q)
    twisting, sideways = [], []
    for preload in PRELOADS:
        rest = lengths - preload / robot.springs.stiffness
        tight = replace(robot, springs=robot.springs.replaced(robot.springs.stiffness, rest))
        K = cartstiff.analyse(tight).B.matrix
        twisting.append(K[2, 2])
        sideways.append(K[3, 3])
    pushed = cartstiff.analyse(robot, [0.01, 0, 0.6, 0, 0, 0])
    slack = [note.values["slack"] for note in pushed.notes if note.code == "slack"]
    if picture is not None:
        draw(twisting, sideways, picture)
    slope, start = np.polyfit(PRELOADS, twisting, 1)
    return {
        "twisting without preload (extrapolated), N m/rad": float(start),
        "twisting at preload 200 N, N m/rad": float(twisting[3]),
        "twisting per preload, m/rad": float(slope),
        "sideways at preload 25 N, N/m": float(sideways[0]),
        "sideways at preload 200 N, N/m": float(sideways[3]),
        "slack 10 mm to the side": slack[0] if slack else [],
        "sideways 10 mm to the side, N/m": float(pushed.matrices["B"][3, 3]),
    }


def draw(twisting: list[float], sideways: list[float], picture: Path) -> None:
    """Two stiffnesses against preload."""
    import matplotlib.pyplot as plt

    figure, (left, right) = plt.subplots(1, 2, figsize=(8, 3.2), layout="constrained")
    left.plot(PRELOADS, twisting, "o-")
    left.set(xlabel="preload of a cable [N]", ylabel="twisting stiffness [N m/rad]", ylim=(0, None))
    right.plot(PRELOADS, np.array(sideways) / 1e3, "o-")
    right.set(xlabel="preload of a cable [N]", ylabel="sideways stiffness [N/mm]", ylim=(0, None))
    figure.savefig(picture, dpi=80)
