"""Natural frequencies of a UR5 from a 6x6 stiffness at its flange, with the load's part or without.

The operational-space mass Lambda = (J M^-1 J^T)^-1 has all masses as the flange feels them. With it
the tangent under the load has the exact frequencies, and so has K^K for a force at the flange. The
matrices of other connections are off by their part of the load.
The picture shows the error of the first frequency as the load grows.
"""

from pathlib import Path

import numpy as np

import cartstiff

MATRICES = ("A", "B", "K", "F", "tangent")
LOADS = np.array([0.0, 250.0, 500.0, 1000.0, 2000.0])  # N, downwards


def errors(force: float) -> tuple[float, dict[str, float]]:
    """First frequency (Hz), and the largest relative error of the six from each matrix."""
    arm = cartstiff.load("ur5")
    result = cartstiff.analyse(arm, wrench=[0, 0, 0, 0, 0, -force], load_axes="world")
    found = cartstiff.modes(result)
    J = result.jacobian @ found.basis  # rates of the flange, by the free motions
    mass = np.linalg.inv(J @ np.linalg.inv(found.mass) @ J.T)
    stiffness = {**result.matrices, "tangent": result.tangent}
    answer = {}
    for name in MATRICES:
        squares = np.sort(np.linalg.eigvals(np.linalg.inv(mass) @ stiffness[name]).real)
        hertz = np.sqrt(squares) / (2 * np.pi)
        answer[name] = float(np.abs(hertz / found.frequencies - 1).max())
    return float(found.frequencies[0]), answer


def main(picture: Path | None = None) -> dict[str, object]:
    """Frequency at 500 N, and errors of the matrices in per cent."""
    first, at_500 = errors(500.0)
    if picture is not None:
        draw(picture)
    return {
        "first frequency under 500 N, Hz": first,
        **{f"largest error of {name}, %": 100 * value for name, value in at_500.items()},
    }


def draw(picture: Path) -> None:
    """Largest error over the load."""
    import matplotlib.pyplot as plt

    found = [errors(force)[1] for force in LOADS]
    figure, axes = plt.subplots(figsize=(6, 3.2), layout="constrained")
    for name in MATRICES:
        label = "tangent" if name == "tangent" else f"$K^{name}$"
        axes.plot(LOADS, [100 * one[name] for one in found], "o-", label=label)
    axes.set(xlabel="load [N]", ylabel="largest error of a frequency [%]")
    axes.legend()
    figure.savefig(picture, dpi=80)
