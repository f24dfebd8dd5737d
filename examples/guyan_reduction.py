"""A link from a finite-element model: its stiffness and mass, reduced to the node at its tip.

A bar that is clamped to a wall holds 0.5 kg. It has twelve
beam elements, here made by hand and otherwise read from a program's files. With the base clamped,
Guyan's reduction lets all other nodes follow the tip statically; the two 6x6 are the `stiffness`
and the `mass` of a flexible link. The picture compares frequencies with those of all elements.
"""

import json
import tempfile
from pathlib import Path

import numpy as np

import cartstiff

LENGTH, ELEMENTS, HUNG = 0.6, 12, 0.5  # m, kg at the tip
E, G, DENSITY = 7.0e10, 2.7e10, 2700.0  # aluminium
AREA, IY, IZ, J = 6.0e-4, 4.5e-8, 2.0e-8, 5.0e-8  # m^2, m^4
ROWS = {"bend_z": [1, 5, 7, 11], "bend_y": [2, 4, 8, 10], "along": [0, 6], "twist": [3, 9]}
LINK = """<robot name="bar"><link name="wall"/><link name="bar"/><link name="tip"/>
  <joint name="clamp" type="fixed"><parent link="wall"/><child link="bar"/></joint>
  <joint name="end" type="fixed"><parent link="bar"/><child link="tip"/>
  <origin xyz="{} 0 0"/></joint></robot>"""


def element(h: float) -> tuple[np.ndarray, np.ndarray]:
    """Stiffness and consistent mass of an element; x y z rx ry rz of either end."""
    K, M = np.zeros((12, 12)), np.zeros((12, 12))
    m, two, third = DENSITY * AREA * h, np.array([[1, -1], [-1, 1]]), np.array([[2, 1], [1, 2]])
    for name, k, mass in (
        ("along", E * AREA / h, m),
        ("twist", G * J / h, DENSITY * (IY + IZ) * h),
    ):
        K[np.ix_(ROWS[name], ROWS[name])] = k * two
        M[np.ix_(ROWS[name], ROWS[name])] = mass / 6 * third
    for name, inertia, s in (("bend_z", IZ, h), ("bend_y", IY, -h)):
        bend = [[12, 6 * s, -12, 6 * s], [0, 4 * h * h, -6 * s, 2 * h * h], [0, 0, 12, -6 * s]]
        mass = [
            [156, 22 * s, 54, -13 * s],
            [0, 4 * h * h, 13 * s, -3 * h * h],
            [0, 0, 156, -22 * s],
        ]
        for matrix, upper, size in ((K, bend, E * inertia / h**3), (M, mass, m / 420)):
            whole = np.triu(np.array([*upper, [0, 0, 0, 4 * h * h]]))
            block = size * (whole + whole.T - np.diag(np.diag(whole)))
            matrix[np.ix_(ROWS[name], ROWS[name])] = block
    return K, M


def bar() -> tuple[np.ndarray, np.ndarray]:
    """Stiffness and mass of all nodes."""
    K, M = np.zeros((2, 6 * ELEMENTS + 6, 6 * ELEMENTS + 6))
    for i in range(ELEMENTS):
        at = slice(6 * i, 6 * i + 12)
        k, m = element(LENGTH / ELEMENTS)
        K[at, at] += k
        M[at, at] += m
    return K, M


def reduced(K: np.ndarray, M: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Stiffness and mass (6, 6) at the last node, the first one clamped, rotation first."""
    inner, tip = slice(6, -6), slice(-6, None)
    follow = np.zeros((len(K), 6))
    follow[inner] = -np.linalg.solve(K[inner, inner], K[inner, tip])
    follow[tip] = np.eye(6)
    turn = np.ix_([3, 4, 5, 0, 1, 2], [3, 4, 5, 0, 1, 2])
    return (follow.T @ K @ follow)[turn], (follow.T @ M @ follow)[turn]


def main(picture: Path | None = None) -> dict[str, object]:
    """Tip stiffness, and frequencies (Hz) of the link and of all elements."""
    K, M = bar()
    stiffness, mass = ((m + m.T) / 2 for m in reduced(K, M))
    with tempfile.TemporaryDirectory() as folder:
        Path(folder, "bar.urdf").write_text(LINK.format(LENGTH), encoding="utf-8")
        link = {"stiffness": stiffness.tolist(), "mass": mass.tolist()}
        link["offset"] = {"xyz": [LENGTH, 0, 0]}
        file = {"kind": "serial", "model": "bar.urdf", "frame": "tip"}
        file |= {"flexible": {"bar": link}, "payload": {"mass": HUNG}}
        Path(folder, "bar.yaml").write_text(json.dumps(file), encoding="utf-8")
        arm = cartstiff.load(Path(folder, "bar.yaml"))
    found = cartstiff.modes(arm).frequencies
    M[-6:-3, -6:-3] += HUNG * np.eye(3)
    squares = np.linalg.eigvals(np.linalg.solve(M[6:, 6:], K[6:, 6:])).real
    whole = np.sqrt(np.sort(squares)[:6]) / (2 * np.pi)
    if picture is not None:
        draw(found, whole, picture)
    return {
        "stiffness along y, N/m": float(1 / cartstiff.analyse(arm).compliances["B"][4, 4]),
        "3 E I / L^3, N/m": 3 * E * IZ / LENGTH**3,
        "first frequency of the link, Hz": float(found[0]),
        "first frequency of all elements, Hz": float(whole[0]),
        "second frequency of the link, Hz": float(found[1]),
        "second frequency of all elements, Hz": float(whole[1]),
    }


def draw(found: np.ndarray, whole: np.ndarray, picture: Path) -> None:
    """Frequencies by mode."""
    import matplotlib.pyplot as plt

    figure, axis = plt.subplots(figsize=(6, 3.2), layout="constrained")
    modes = np.arange(1, 7)
    axis.semilogy(modes, whole, "o", label=f"{ELEMENTS} elements")
    axis.semilogy(modes, found, "x", label="reduced to the tip")
    axis.set(xlabel="mode", ylabel="natural frequency [Hz]")
    axis.legend()
    figure.savefig(picture, dpi=80)
