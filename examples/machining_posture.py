"""The best turn of a tool about its axis, and the best place of the workpiece.

A UR5 deburrs an edge with a spindle at right angles to its flange. The tool may turn about its own
axis, so that the arm has a choice at every point. Above, how far the cutting force moves the tool's
tip: with the tool turned as drawn, with the best constant turn, and with the best turn at each
point. Below, the worst deflection along the edge over places of the workpiece. The joint
stiffnesses are those of the bundled file: illustrative, not the maker's.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np

import cartstiff
from cartstiff.geometry import se3
from cartstiff.toolpaths.optimise import OptimisedPath, optimise_path
from cartstiff.toolpaths.placement import Placement, best_placement
from cartstiff.toolpaths.tool_path import ToolPath

TIP = se3.pose(translation=[0.12, 0.0, 0.05])  # m, in the flange's frame; the spindle is its x
CUTTING = [0.0, 0.0, 0.0, -80.0, 30.0, 40.0]  # N: back along the tool, along the edge, up
PLACE = {"x": 0.62, "y": 0.05, "z": 0.3}  # m, of the workpiece on the drawing


def edge() -> ToolPath:
    """The edge in the workpiece's frame: 0.3 m along y, the tool along x, tilted on the way."""
    s = np.linspace(0.0, 1.0, 7)
    points = np.column_stack([0.03 * s**2, 0.3 * s - 0.15, 0.05 * s])
    angles = np.column_stack([np.zeros(7), np.zeros(7), 0.3 * s])
    return ToolPath(se3.from_roll_pitch_yaw(points, angles), CUTTING)


def main(picture: Path | None = None) -> dict[str, object]:
    """Worst deflection (mm) along the edge, and the best place (m)."""
    arm = cartstiff.load("ur5")
    chain = arm.mechanism
    arm = replace(arm, mechanism=chain.with_placements({}, chain.body.T_j_f @ TIP))
    there = edge().moved(se3.pose(translation=list(PLACE.values())))
    drawn = optimise_path(arm, there)
    result = optimise_path(arm, there, free="x")
    region = {"x": [0.5, 0.62, 0.74], "y": [-0.1, 0.05, 0.2], "z": [0.3]}
    placed = best_placement(arm, edge(), region, halvings=1, free="x", samples=18)
    if picture is not None:
        draw(drawn, result, placed, picture)
    return {
        "as drawn, worst, mm": 1e3 * drawn.worst,
        "best constant turn, worst, mm": 1e3 * float(result.constant.values.max()),
        "best turn at each point, worst, mm": 1e3 * result.worst,
        "largest step of a joint is allowed": bool(np.abs(result.steps).max() <= 0.5),
        "best place, x, m": placed.place["x"],
        "best place, y, m": placed.place["y"],
        "best place, worst, mm": 1e3 * placed.path.worst,
    }


def draw(drawn: OptimisedPath, result: OptimisedPath, placed: Placement, picture: Path) -> None:
    """Deflection along the edge; worst deflection over the places."""
    import matplotlib.pyplot as plt

    figure, (above, below) = plt.subplots(2, 1, figsize=(6, 5.6), layout="constrained")
    points = np.arange(1, len(result.q) + 1)
    above.plot(points, 1e3 * drawn.values, "v:", color="0.5", label="turned as drawn")
    above.plot(points, 1e3 * result.constant.values, "s--", color="0.5", label="best constant turn")
    above.plot(points, 1e3 * result.values, "o-", label="best turn at each point")
    above.plot(points, 1e3 * placed.path.values, "^-", label="the same at the best place")
    above.set(xlabel="point of the edge", ylabel="deflection [mm]", ylim=(0, None))
    above.legend(fontsize="small")
    x, y = placed.axes["x"], placed.axes["y"]
    mesh = below.pcolormesh(x, y, 1e3 * placed.worst[:, :, 0].T, shading="nearest", cmap="cividis")
    figure.colorbar(mesh, ax=below, label="worst deflection [mm]")
    below.plot(placed.place["x"], placed.place["y"], "*", color="C3", markersize=12)
    below.set(xlabel="workpiece x [m]", ylabel="workpiece y [m]")
    figure.savefig(picture, dpi=80)
