"""The best turn of a tool about its axis, and the best place of the workpiece.

A UR5 deburrs an edge with a spindle at right angles to its flange. The tool may turn about its own
axis, so that the arm has a choice at every point. Above, how far the cutting force moves the tool's
tip: with the tool turned as drawn, with the best constant turn, and with the best turn at each
point. Below, the worst deflection along the edge over places of the workpiece: an objective over
`optimise_path`, on a grid and then around its best place. The joint stiffnesses are those of the
bundled file: illustrative, not the maker's.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np

import cartstiff
from cartstiff import OptimisedPath, ToolPath, optimise_path
from cartstiff.geometry import se3

TIP = se3.pose(translation=[0.12, 0.0, 0.05])  # m, in the flange's frame; the spindle is its x
CUTTING = [0.0, 0.0, 0.0, -80.0, 30.0, 40.0]  # N: back along the tool, along the edge, up
PLACE = (0.62, 0.05, 0.3)  # m, of the workpiece on the drawing
X, Y = np.array([0.5, 0.62, 0.74]), np.array([-0.1, 0.05, 0.2])  # m, places to compare


def edge() -> ToolPath:
    """The edge in the workpiece's frame: 0.3 m along y, the tool along x, tilted on the way."""
    s = np.linspace(0.0, 1.0, 7)
    points = np.column_stack([0.03 * s**2, 0.3 * s - 0.15, 0.05 * s])
    angles = np.column_stack([np.zeros(7), np.zeros(7), 0.3 * s])
    return ToolPath(se3.from_roll_pitch_yaw(points, angles), CUTTING)


def placed_path(arm: cartstiff.ElasticMechanism, x: float, y: float, **more: bool) -> OptimisedPath:
    """The best path with the workpiece at a place."""
    there = edge().moved(se3.pose(translation=[x, y, PLACE[2]]))
    return optimise_path(arm, there, free="x", samples=18, **more)


def worst(arm: cartstiff.ElasticMechanism, x: float, y: float) -> float:
    """The objective: worst deflection (m) along the edge at a place; infinite out of reach."""
    if not (X[0] <= x <= X[-1] and Y[0] <= y <= Y[-1]):
        return np.inf
    try:
        return placed_path(arm, x, y, refine=False).worst
    except cartstiff.UndefinedError:
        return np.inf


def main(picture: Path | None = None) -> dict[str, object]:
    """Worst deflection (mm) along the edge, and the best place (m)."""
    arm = cartstiff.load("ur5")
    chain = arm.mechanism
    arm = replace(arm, mechanism=chain.with_placements({}, chain.body.T_j_f @ TIP))
    there = edge().moved(se3.pose(translation=PLACE))
    drawn = optimise_path(arm, there)
    result = optimise_path(arm, there, free="x")
    grid = np.array([[worst(arm, x, y) for y in Y] for x in X])
    i, j = np.unravel_index(grid.argmin(), grid.shape)
    around = [(X[i], y) for y in Y[j] + [0.075, -0.075]] + [(x, Y[j]) for x in X[i] + [0.06, -0.06]]
    place = min([(X[i], Y[j]), *around], key=lambda at: worst(arm, *at))
    placed = placed_path(arm, *place)
    if picture is not None:
        draw(drawn, result, placed, grid, place, picture)
    return {
        "as drawn, worst, mm": 1e3 * drawn.worst,
        "best constant turn, worst, mm": 1e3 * float(result.constant.values.max()),
        "best turn at each point, worst, mm": 1e3 * result.worst,
        "largest step of a joint is allowed": bool(np.abs(result.steps).max() <= 0.5),
        "best place, x, m": float(place[0]),
        "best place, y, m": float(place[1]),
        "best place, worst, mm": 1e3 * placed.worst,
    }


def draw(
    drawn: OptimisedPath,
    result: OptimisedPath,
    placed: OptimisedPath,
    grid: np.ndarray,
    place: tuple[float, float],
    picture: Path,
) -> None:
    """Deflection along the edge; worst deflection over the places."""
    import matplotlib.pyplot as plt

    figure, (above, below) = plt.subplots(2, 1, figsize=(6, 5.6), layout="constrained")
    points = np.arange(1, len(result.q) + 1)
    above.plot(points, 1e3 * drawn.values, "v:", color="0.5", label="turned as drawn")
    above.plot(points, 1e3 * result.constant.values, "s--", color="0.5", label="best constant turn")
    above.plot(points, 1e3 * result.values, "o-", label="best turn at each point")
    above.plot(points, 1e3 * placed.values, "^-", label="the same at the best place")
    above.set(xlabel="point of the edge", ylabel="deflection [mm]", ylim=(0, None))
    above.legend(fontsize="small")
    mesh = below.pcolormesh(X, Y, 1e3 * grid.T, shading="nearest", cmap="cividis")
    figure.colorbar(mesh, ax=below, label="worst deflection [mm]")
    below.plot(*place, "*", color="C3", markersize=12)
    below.set(xlabel="workpiece x [m]", ylabel="workpiece y [m]")
    figure.savefig(picture, dpi=80)
