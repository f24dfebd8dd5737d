"""Parallel machines by the names of their legs, drawn side by side: all bundled ones.

Each leg is a line from the ground through its joints to the body. The numbers are the stiffnesses
along z. Only the motors are compliant, and the forearms of the Delta.
"""

from pathlib import Path

import numpy as np

import cartstiff

NAMES = ["6-pus", "hexaglide", "6-rus", "3-rps", "3-prs", "delta", "tricept", "orthoglide"]


def main(picture: Path | None = None) -> dict[str, float]:
    """Force along z for a small displacement along z, all other loads absent."""
    machines = [cartstiff.load(name) for name in NAMES]
    results = [cartstiff.analyse(machine) for machine in machines]
    if picture is not None:
        draw(results, picture)
    return {
        f"{result.elastic.name}, N/mm": 1e-3 / float(result.compliances["B"][5, 5])
        for result in results
    }


def legs_of(result: cartstiff.PostureStiffness) -> dict[str, np.ndarray]:
    """Origins (n, 3) of each leg's joints, from the ground to the body."""
    chain, legs = result.elastic.mechanism, {}
    for name in result.elastic.names:
        if "." in name:  # how a link gives
            continue
        leg = name.split("/")[0]
        origin = result.posture.pose_at(chain.placement(name))[:3, 3]
        legs.setdefault(leg, []).append(origin)
    return {leg: np.array(points) for leg, points in legs.items()}


def draw(results: list[cartstiff.PostureStiffness], picture: Path) -> None:
    """Eight stick figures."""
    import matplotlib.pyplot as plt
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    figure = plt.figure(figsize=(10, 5.6), layout="constrained")
    for place, result in enumerate(results, start=1):
        axis = figure.add_subplot(2, 4, place, projection="3d")
        legs = legs_of(result)
        for points in legs.values():
            axis.plot(*points.T, "o-", markersize=3, color="0.35")
        for end, colour in ((0, "0.75"), (-1, "tab:blue")):
            plate = np.array([points[end] for points in legs.values()])
            axis.add_collection3d(Poly3DCollection([plate], color=colour, alpha=0.6))
        axis.view_init(elev=22, azim=-50)
        axis.set_aspect("equal")
        axis.set_axis_off()
        axis.set_title(result.elastic.name, y=0.95)
    figure.savefig(picture, dpi=80)
