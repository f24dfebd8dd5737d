"""A planar 3-RRR manipulator: out of its plane only the links are compliant.

In the plane the motors' springs and the links share the deflection; out of the plane the motors
have no effect. The picture shows how far the platform sinks under 50 N while it turns about its own
axis.
"""

from pathlib import Path

import numpy as np

import cartstiff
from cartstiff import DeadForce, equilibrium

TURNS = np.linspace(-0.4, 0.2, 7)  # rad, of all three motors alike
MOTORS = ("leg1/motor", "leg2/motor", "leg3/motor")


def along(robot: cartstiff.ElasticMechanism, axis: int, **posture: float) -> float:
    """Force per displacement of the platform's origin, all else free to follow."""
    return float(1 / cartstiff.analyse(robot, posture or None).compliances["B"][axis, axis])


def main(picture: Path | None = None) -> dict[str, float]:
    """Stiffness along the axes, the links' part in it, and an equilibrium out of the plane."""
    robot = cartstiff.load("3-rrr")
    hard = robot.with_springs(dict.fromkeys(MOTORS, 2e9))  # the links alone
    at_home = dict(zip(robot.names, robot.q.tolist(), strict=True))
    sinking = []
    for turn in TURNS:
        motors = {name: at_home[name] + float(turn) for name in MOTORS}
        C = cartstiff.analyse(robot, motors).compliances["B"]
        sinking.append([50e3 * C[5, 5], 50e3 * C[3, 3]])
    state = equilibrium(robot, DeadForce([0.0, 0.0, -50.0]))
    if picture is not None:
        draw(np.array(sinking), picture)
    in_plane, in_plane_links = along(robot, 3), along(hard, 3)
    vertical, vertical_links = along(robot, 5), along(hard, 5)
    return {
        "in the plane, N/m": in_plane,
        "in the plane, the links alone, N/m": in_plane_links,
        "the links' part in the plane, %": 100 * in_plane / in_plane_links,
        "out of the plane, N/m": vertical,
        "the links' part out of the plane, %": 100 * vertical / vertical_links,
        "sinking under 50 N, mm": float(-1e3 * state.displacement[5]),
    }


def draw(sinking: np.ndarray, picture: Path) -> None:
    """Deflection under 50 N against the motors' turn."""
    import matplotlib.pyplot as plt

    figure, axis = plt.subplots(figsize=(6, 3.4), layout="constrained")
    axis.plot(np.degrees(TURNS), sinking[:, 0], "o-", label="50 N across the plane")
    axis.plot(np.degrees(TURNS), sinking[:, 1], "s-", label="50 N in the plane")
    axis.set(xlabel="turn of the motors [deg]", ylabel="deflection [mm]")
    axis.set_ylim(bottom=0)
    axis.legend()
    figure.savefig(picture, dpi=80)
