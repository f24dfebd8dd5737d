"""The four stiffness matrices of Zefran & Kumar's platform, against the printed tables.

The paper prints the platform's coordinates rounded. The picture shows the error of each of
the 144 printed entries, with the printed coordinates and with those of the bundled file.
"""

from pathlib import Path

import numpy as np

import cartstiff
from cartstiff import ElasticMechanism, LineSprings
from cartstiff.extend import Platform

# Upper triangles would do for B, K and F; the tables stand here as the paper prints them.
PRINTED = {
    "A": """2141.4 -1725.1 -3895.1 206.9 -581.5 466.5   -2094.7 4107.4 -336.5 303.5 5.3 -836.8
            -1518.7 608.6 3263.9 -239.5 516.7 -212.2    206.9 -202.4 -180.2 80.0 5.2 75.6
            -75.5 5.3 212.0 5.2 39.3 5.2                407.2 -532.2 -212.2 75.6 5.2 150.6""",
    "B": """2141.4 -1909.9 -2706.9 206.9 -328.5 436.9   -1909.9 4107.4 136.0 50.6 5.3 -684.5
            -2706.9 136.0 3263.9 -209.9 364.3 -212.2    206.9 50.6 -209.9 80.0 5.2 75.6
            -328.5 5.3 364.3 5.2 39.3 5.2               436.9 -684.5 -212.2 75.6 5.2 150.6""",
    "K": """2141.4 -1909.9 -2706.9 206.9 -581.5 466.5   -1909.9 4107.4 136.0 303.5 5.3 -836.8
            -2706.9 136.0 3263.9 -239.5 516.7 -212.2    206.9 303.5 -239.5 80.0 5.2 75.6
            -581.5 5.3 516.7 5.2 39.3 5.2               466.5 -836.8 -212.2 75.6 5.2 150.6""",
    "F": """2345.9 -1354.5 -1695.2 229.3 -87.1 387.0    -1354.5 2674.9 559.7 -253.8 -9.6 -493.8
            -1695.2 559.7 1423.5 -141.6 90.5 -219.8     229.3 -253.8 -141.6 57.3 6.4 87.2
            -87.1 -9.6 90.5 6.4 12.0 7.7                387.0 -493.8 -219.8 87.2 7.7 140.7""",
}
TABLES = {name: np.array(text.split(), float).reshape(6, 6) for name, text in PRINTED.items()}


def with_printed_coordinates(elastic: ElasticMechanism) -> ElasticMechanism:
    """The same springs between the points as section 5.2 prints them (cm)."""
    O, P, Q = [0, 0, 0], [7, 0, 0], [3.5, 6, 0]  # noqa: E741
    r, s, t = [10, 4, 12], [14, 8, 16], [14.5, 1.1, 16.5]
    platform = Platform([O, P, P, Q, Q, O], [s, s, t, t, r, r], units=elastic.units)
    springs = LineSprings(
        anchors=platform.anchors,
        points=platform.points,
        stiffness=elastic.springs.stiffness,
        rest_length=elastic.springs.rest_length,
    )
    return ElasticMechanism("printed coordinates", platform, elastic.q, springs)


def main(picture: Path | None = None) -> dict[str, float]:
    """Largest deviation from each table, with the bundled and with the printed coordinates."""
    bundled = cartstiff.load("stewart-gough")
    cases = {"printed": with_printed_coordinates(bundled), "bundled": bundled}
    missed = {
        (case, name): np.abs(K - TABLES[name])
        for case, elastic in cases.items()
        for name, K in cartstiff.analyse(elastic).matrices.items()
    }
    if picture is not None:
        draw(missed, picture)
    return {f"{case} {name}": float(m.max()) for (case, name), m in missed.items()}


def draw(missed: dict[tuple[str, str], np.ndarray], picture: Path) -> None:
    """Two rows of four maps of deviations."""
    import matplotlib.pyplot as plt
    from matplotlib.colors import LogNorm

    figure, axes = plt.subplots(2, 4, figsize=(9, 4.6), layout="constrained")
    for axis, ((case, name), m) in zip(axes.flat, missed.items(), strict=True):
        shown = axis.imshow(np.maximum(m, 1e-3), norm=LogNorm(1e-3, 100), cmap="viridis")
        axis.set_title(f"$K^{name}$, {case} coordinates", fontsize=9)
        axis.set_xticks([])
        axis.set_yticks([])
    figure.colorbar(shown, ax=axes, label="|computed - printed|")
    figure.savefig(picture, dpi=80)
