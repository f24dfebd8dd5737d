"""Buckling of a column of rigid links: critical loads, and the bent column beyond them.

Equal links of length l form a column with a spring k in every joint. A force P acts on the top
along the column. The straight column buckles at P l / k = 2 - 2 cos(pi / (2 n + 1)) for n
links: 0.38197 for two, 0.19806 for three. The picture shows the load against the sideways motion of
the top, along the branches that start there.
"""

import tempfile
from pathlib import Path

import numpy as np

import cartstiff
from cartstiff import DeadForce, ElasticMechanism, LoadCurve, load_curve

LENGTH, STIFFNESS = 0.5, 200.0  # m, N m/rad
LINKS = (1, 2, 3, 4, 5)
JOINT = """<joint name="joint{0}" type="revolute"><parent link="link{1}"/><child link="link{0}"/>
  <origin xyz="{2} 0 0"/><axis xyz="0 0 1"/>
  <limit lower="-3" upper="3" effort="0" velocity="0"/></joint><link name="link{0}"/>"""
TOP = """<joint name="end" type="fixed"><parent link="link{0}"/><child link="top"/>
  <origin xyz="{1} 0 0"/></joint><link name="top"/>"""


def column(n: int) -> ElasticMechanism:
    """A straight column of n links along x."""
    joints = [JOINT.format(i, i - 1, LENGTH if i > 1 else 0.0) for i in range(1, n + 1)]
    parts = ['<link name="link0"/>', *joints, TOP.format(n, LENGTH)]
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "column.urdf"
        file.write_text(f'<robot name="column">{"".join(parts)}</robot>', encoding="utf-8")
        return cartstiff.load(str(file), frame="top").with_springs(STIFFNESS)


def main(picture: Path | None = None) -> dict[str, object]:
    """Critical loads P l / k, their distance from the closed form, and the branch of two links."""
    unit = DeadForce([-STIFFNESS / LENGTH, 0.0, 0.0])  # the factor is then P l / k
    exact = {n: float(2 - 2 * np.cos(np.pi / (2 * n + 1))) for n in LINKS}
    found, branches = {}, {}
    for n in LINKS:
        straight = load_curve(column(n), unit, to=1.6 * exact[n])
        found[n] = straight.critical[0].factor
        branches[n] = straight.branch(0)
    two = branches[2]
    if picture is not None:
        draw(branches, exact, picture)
    return {
        "two links, P l / k": float(found[2]),
        "three links, P l / k": float(found[3]),
        "largest distance from the closed form": float(
            max(abs(found[n] - exact[n]) for n in LINKS)
        ),
        "the branch of two links is stable": all(s is not False for s in two.stable),
        "two links, P l / k at 0.5 m aside": float(
            np.interp(0.5, np.abs(two.displacement[:, 4]), two.factors)
        ),
    }


def draw(branches: dict[int, LoadCurve], exact: dict[int, float], picture: Path) -> None:
    """Load against the top's way sideways."""
    import matplotlib.pyplot as plt

    figure, axis = plt.subplots(figsize=(6, 3.4), layout="constrained")
    for i, (n, curve) in enumerate(branches.items()):
        aside = np.abs(curve.displacement[:, 4]) / (n * LENGTH)
        axis.plot(aside, curve.factors / exact[n], color=f"C{i}", label=f"{n} link{'s' * (n > 1)}")
    axis.plot([0, 0], [0, 1], color="k", label="straight")
    axis.plot([0, 0], [1, 1.5], "--", color="k", label="straight, unstable")
    axis.set(xlabel="sideways motion of the top over the height", ylabel="load over critical load")
    axis.set(xlim=(-0.02, 0.8), ylim=(0, 1.5))
    axis.legend()
    figure.savefig(picture, dpi=80)
