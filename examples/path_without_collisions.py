"""The stiffest way along a seam on which a UR5 does not hit itself, by the shapes of its URDF.

`optimise_path` knows nothing of collisions. It stays near each posture that reaches the first point
in turn (`near`), and Pinocchio tests the links along the way, but for pairs on neighbouring joints
and pairs that touch at the default posture. The picture shows the deflection along every way. The
joint stiffnesses are those of the bundled file: illustrative.
"""

from collections.abc import Callable
from functools import cache
from pathlib import Path

import example_robot_data
import numpy as np
import pinocchio as pin

import cartstiff
from cartstiff import ToolPath, inverse_kinematics, optimise_path

POINTS = [[0.22, y, 0.1] for y in np.linspace(-0.12, 0.12, 5)]  # m, close to the base
LOAD = [0, 0, 0, -80, 30, 0]  # N, along the axes of the room
PATH = ToolPath.from_axes(POINTS, [0, 0, -1], "x", wrenches=LOAD, axes="world")


@cache
def checker() -> Callable[[np.ndarray], bool]:
    """Whether links collide at a posture."""
    robot = example_robot_data.load("ur5")
    model, shapes = robot.model, robot.collision_model
    shapes.removeAllCollisionPairs()
    joints = [shape.parentJoint for shape in shapes.geometryObjects]
    pairs = [(a, b) for b in range(len(joints)) for a in range(b) if abs(joints[a] - joints[b]) > 1]
    for pair in pairs:
        shapes.addCollisionPair(pin.CollisionPair(*pair))
    data, results = model.createData(), pin.GeometryData(shapes)
    pin.computeCollisions(model, data, shapes, results, cartstiff.load("ur5").q, False)
    touching = [found.isCollision() for found in results.collisionResults]

    def hits(row: np.ndarray) -> bool:
        pin.computeCollisions(model, data, shapes, results, row, False)
        found = [one.isCollision() for one in results.collisionResults]
        return any(now and not always for now, always in zip(found, touching, strict=True))

    return hits


def main(picture: Path | None = None) -> dict[str, object]:
    """Worst deflections (mm) of all ways and of the best that does not collide."""
    arm = cartstiff.load("ur5")
    ways = []
    for branch in inverse_kinematics(arm, PATH.poses[0]):
        try:
            way = optimise_path(arm, PATH, free="x", near=branch, samples=8)
        except cartstiff.UndefinedError:
            continue  # this configuration does not reach every point
        if not any(np.allclose(way.q, other.q, atol=1e-3) for other, _ in ways):
            ways.append((way, any(map(checker(), way.q))))
    free = min((way for way, hits in ways if not hits), key=lambda way: way.worst)
    if picture is not None:
        draw(ways, picture)
    return {
        "ways": len(ways),
        "ways on which links collide": sum(hits for _, hits in ways),
        "stiffest of all, worst, mm": 1e3 * min(way.worst for way, _ in ways),
        "stiffest without collisions, worst, mm": 1e3 * free.worst,
    }


def draw(ways: list, picture: Path) -> None:
    """Deflection along every way."""
    import matplotlib.pyplot as plt

    figure, axis = plt.subplots(figsize=(6, 3.2), layout="constrained")
    for way, hits in ways:
        style, label = (":", "links collide") if hits else ("-", "free")
        axis.plot(np.arange(1, len(way.q) + 1), 1e3 * way.values, style, marker="o", label=label)
    axis.set(xlabel="point of the seam", ylabel="deflection [mm]", ylim=(0, None))
    axis.legend(fontsize="small")
    figure.savefig(picture, dpi=80)
