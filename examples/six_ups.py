"""A platform as a tree of links with closures is the platform with six lines.

The bundled 6-ups is a URDF of six legs with universal joints, sliders and ball joints; the hexapod
of the same geometry is six springs between points. Stiffness, and the place where both come to
rest under a payload, agree to rounding. The picture shows both on the way up.
"""

from pathlib import Path

import numpy as np

import cartstiff
from cartstiff import equilibrium, payload

HEIGHTS = np.linspace(-0.1, 0.1, 9)  # m from the home pose
WEIGHT = payload(200.0, [0.0, 0.0, -9.81], [0.1, 0.0, 0.05])  # kg, m/s^2, m


def main(picture: Path | None = None) -> dict[str, float]:
    """Largest relative differences of the two models, and what both say."""
    hexapod, tree = cartstiff.load("hexapod"), cartstiff.load("6-ups")
    home = hexapod.mechanism.at(hexapod.q).lines.lengths
    worst = {"pose": 0.0, "K^B": 0.0, "K^F": 0.0}
    vertical = []
    for z in HEIGHTS:
        q = np.add(hexapod.q, [0.02, -0.01, z, 0.05, -0.04, 0.1])
        lines = cartstiff.analyse(hexapod, q)
        slides = hexapod.mechanism.at(q).lines.lengths - home
        links = cartstiff.analyse(tree, {f"leg{i + 1}_slide": s for i, s in enumerate(slides)})
        pairs = {
            "pose": (lines.pose, links.pose),
            "K^B": (lines.B.matrix, links.B.matrix),
            "K^F": (lines.F.matrix, links.F.matrix),
        }
        for name, (a, b) in pairs.items():
            worst[name] = max(worst[name], float(np.abs(a - b).max() / np.abs(a).max()))
        vertical.append([1 / lines.compliances["B"][5, 5], 1 / links.compliances["B"][5, 5]])
    rest = [equilibrium(m, WEIGHT).displacement for m in (hexapod, tree)]
    if picture is not None:
        draw(np.array(vertical), picture)
    return {
        **{f"{name}, largest relative difference": value for name, value in worst.items()},
        "sinking under 200 kg, mm": float(-1e3 * rest[0][5]),
        "difference of the sinking, mm": float(1e3 * abs(rest[0][5] - rest[1][5])),
        "turning under 200 kg, mrad": float(1e3 * np.linalg.norm(rest[0][:3])),
    }


def draw(vertical: np.ndarray, picture: Path) -> None:
    """Stiffness against a vertical force, against height."""
    import matplotlib.pyplot as plt

    figure, axis = plt.subplots(figsize=(6, 3.4), layout="constrained")
    axis.plot(1e3 * HEIGHTS, vertical[:, 0] / 1e6, label="six lines")
    axis.plot(1e3 * HEIGHTS, vertical[:, 1] / 1e6, "o", label="links with closures")
    axis.set(xlabel="height above the home pose [mm]", ylabel="vertical stiffness [kN/mm]")
    axis.legend()
    figure.savefig(picture, dpi=80)
