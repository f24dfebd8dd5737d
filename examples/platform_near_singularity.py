"""A platform turned towards its singularity: the stiffness of one motion falls to zero.

The cubic platform turned by 90 degrees about its axis: the six legs' lines become dependent, and
the leg lengths no longer hold the platform (type-2 singularity).
"""

from pathlib import Path

import numpy as np

import cartstiff

ANGLES = np.radians(np.concatenate([np.arange(0, 85, 5), np.arange(85, 90.5, 0.5)]))
LENGTH = 0.4  # m; turns metres into radians where rotations and translations are compared


def main(picture: Path | None = None) -> dict[str, object]:
    """Smallest eigenvalue of the scaled stiffness along the way, and the notes at its end."""
    platform = cartstiff.load("cubic")
    scale = np.array([1.0, 1.0, 1.0, LENGTH, LENGTH, LENGTH])
    smallest, codes = [], []
    for angle in ANGLES:
        result = cartstiff.analyse(platform, [0, 0, 0, 0, 0, angle])
        K = result.matrices["B"] * np.outer(scale, scale)
        smallest.append(np.linalg.eigvalsh(K)[0])
        codes.append({note.code for note in result.notes})
    if picture is not None:
        draw(smallest, picture)
    return {
        "smallest at 0 deg, N m/rad": float(smallest[0]),
        "smallest at 85 deg, N m/rad": float(smallest[17]),
        "smallest at 90 deg, N m/rad": float(smallest[-1]),
        "notes at 85 deg": sorted(codes[17]),
        "notes at 90 deg": sorted(codes[-1]),
        "K^F exists at 90 deg": result.matrices["F"] is not None,
    }


def draw(smallest: list[float], picture: Path) -> None:
    """Smallest stiffness against the angle."""
    import matplotlib.pyplot as plt

    figure, axis = plt.subplots(figsize=(6, 3.4), layout="constrained")
    axis.semilogy(np.degrees(ANGLES), np.maximum(smallest, 1e-3), ".-")
    axis.set(xlabel="angle about the axis [deg]", ylabel="smallest scaled stiffness [N m/rad]")
    figure.savefig(picture, dpi=80)
