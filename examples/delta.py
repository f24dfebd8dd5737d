"""A Delta robot with compliant forearms: its stiffness, and that with the motors alone.

With rigid forearms the platform can only translate, and only the motors are compliant. The
bundled file has forearms of thin carbon tube; here they are made stiffer and stiffer.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np

import cartstiff
from cartstiff.extend import Beam

FACTORS = np.array([0.5, 1, 2, 5, 10, 30, 100, 1000])


def main(picture: Path | None = None) -> dict[str, float]:
    """Stiffness of the platform against the forearms' stiffness."""
    delta = cartstiff.load("delta")
    rows = []
    for factor in FACTORS:
        stiffer = replace(
            delta,
            potentials=tuple(
                replace(p, section=p.section.times(factor)) if isinstance(p, Beam) else p
                for p in delta.potentials
            ),
        )
        rows.append(np.diag(cartstiff.analyse(stiffer).B.matrix))
    values = np.array(rows)
    if picture is not None:
        draw(values, picture)
    return {
        "vertical, forearms as in the file, N/m": float(values[1, 5]),
        "vertical, forearms 1000 times stiffer, N/m": float(values[-1, 5]),
        "horizontal, forearms as in the file, N/m": float(values[1, 3]),
        "horizontal, forearms 1000 times stiffer, N/m": float(values[-1, 3]),
        "twist, forearms as in the file, N m/rad": float(values[1, 2]),
        "twist, forearms 1000 times stiffer, N m/rad": float(values[-1, 2]),
    }


def draw(values: np.ndarray, picture: Path) -> None:
    """Diagonal entries against the forearms' stiffness."""
    import matplotlib.pyplot as plt

    figure, axis = plt.subplots(figsize=(6, 3.4), layout="constrained")
    axis.loglog(FACTORS, values[:, 5] / 1e3, "o-", label="vertical [N/mm]")
    axis.loglog(FACTORS, values[:, 3] / 1e3, "s-", label="horizontal [N/mm]")
    axis.loglog(FACTORS, values[:, 2], "^-", label="twist about the axis [N m/rad]")
    axis.set(xlabel="stiffness of the forearms against the file's", ylabel="stiffness")
    axis.legend()
    figure.savefig(picture, dpi=80)
