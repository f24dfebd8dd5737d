"""The softest translation of a UR5 over its elbow and wrist.

The map goes to a file that xarray opens; the joint stiffnesses are illustrative.
"""

import tempfile
from pathlib import Path

import numpy as np

import cartstiff
from cartstiff.maps import Axis, Grid, best, compute_map, draw_map, summary

QUANTITY = "translation_free_min"


def main(picture: Path | None = None) -> dict[str, object]:
    """Ranges (kN/m) and extreme postures (rad) of the map, and how many are singular."""
    arm = cartstiff.load("ur5")
    axes = {"elbow_joint": Axis(-2.4, 2.4, 49), "wrist_2_joint": Axis(-2.4, 2.4, 33)}
    with tempfile.TemporaryDirectory() as folder:
        dataset = compute_map(
            arm, Grid(axes, arm.names, arm.q), [QUANTITY], Path(folder) / "map.zarr"
        ).load()
    found = summary(dataset)
    stiffest = best(dataset, QUANTITY)
    softest = dataset.isel(dataset[QUANTITY].argmin(...))
    if picture is not None:
        draw_map(dataset, QUANTITY).savefig(picture)
    return {
        "postures": int(dataset[QUANTITY].size),
        "singular": found["states"]["serial-singularity"],
        "softest, kN/m": float(softest[QUANTITY]) / 1e3,
        "elbow there, rad": float(np.abs(softest["elbow_joint"])),
        "stiffest, kN/m": float(stiffest[QUANTITY][0]) / 1e3,
        "elbow at the stiffest, rad": float(np.abs(stiffest["elbow_joint"][0])),
    }
