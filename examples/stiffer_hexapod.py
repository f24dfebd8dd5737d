"""A hexapod that is stiffer at the worst posture of its workspace: ten numbers, exact gradients.

Radii and half angles of the joints' pairs on base and platform, and the stiffness of each leg, are
changed within limits; all legs together stay as stiff as they were. The smallest stiffness
against a force at nine postures is to be as large as possible:

    maximise t with t <= k(x, posture) for all postures,

which SciPy's SLSQP solves. `cartstiff.gradient` has the derivatives of each k by all points and
stiffnesses, and the rule of the chain those by the ten numbers. By finite differences the same
search asks for eleven stiffnesses where one gradient serves.
"""

from itertools import product
from pathlib import Path

import numpy as np
from scipy.optimize import minimize

import cartstiff

SOFTEST = "translation_free_min"
HEXAPOD = cartstiff.load("hexapod")
K_0 = float(HEXAPOD.springs.stiffness.mean())
#: Middles of the joints' pairs [degrees], and the side of its pair on which each leg has its joint.
PAIRS = {
    "base": ([0, 0, 120, 120, 240, 240], [-1, 1, -1, 1, -1, 1]),
    "platform": ([-60, 60, 60, 180, 180, -60], [1, -1, 1, -1, 1, -1]),
}
#: Nine postures: the middle, and the corners of a box with edges of 16 cm.
Q = [HEXAPOD.q + np.append(s, np.zeros(3)) for s in [(0, 0, 0), *product((-0.08, 0.08), repeat=3)]]
#: Limits: radii [m] and half angles [rad] of base and platform, shares of the legs' stiffness.
LIMITS = [(0.5, 0.7), (0.1, 0.9), (0.25, 0.4), (0.1, 0.9), *[(0.5, 2.0)] * 6]
START = np.array([0.6, 0.22, 0.35, 0.24, *np.ones(6)])


def numbers_of(x: np.ndarray) -> tuple[dict[str, float], np.ndarray]:
    """Numbers of the mechanism by name, and their derivatives (30, 10) by the variables."""
    values, slopes = dict[str, float](), list[np.ndarray]()
    unit = np.eye(10)
    for i, (body, (middles, sides)) in enumerate(PAIRS.items()):
        radius, half = x[2 * i : 2 * i + 2]
        for leg, (middle, side) in enumerate(zip(middles, sides, strict=True), 1):
            angle = np.deg2rad(middle) + side * half
            c, s = np.cos(angle), np.sin(angle)
            values |= {f"{body}.leg{leg}.x": radius * c, f"{body}.leg{leg}.y": radius * s}
            slopes.append(c * unit[2 * i] - radius * s * side * unit[2 * i + 1])
            slopes.append(s * unit[2 * i] + radius * c * side * unit[2 * i + 1])
    values |= {f"stiffness.leg{leg}": K_0 * x[3 + leg] for leg in range(1, 7)}
    return values, np.array([*slopes, *K_0 * unit[4:]])


def softest(x: np.ndarray, q: np.ndarray) -> tuple[float, np.ndarray]:
    """Smallest stiffness [N/um] at a posture, and its derivatives by the ten variables."""
    values, slopes = numbers_of(x)
    found = cartstiff.gradient(HEXAPOD.with_numbers(values), q, of=SOFTEST, by=list(values))
    return 1e-6 * found.value, 1e-6 * np.array([found[name] for name in values]) @ slopes


def without_derivatives(x: np.ndarray, q: np.ndarray) -> tuple[float, np.ndarray]:
    """The same stiffness alone, for finite differences."""
    stiffness = cartstiff.analyse(HEXAPOD.with_numbers(numbers_of(x)[0]), q).B
    return 1e-6 / np.linalg.norm(np.linalg.inv(stiffness)[3:, 3:], 2), np.zeros(10)


def search(exact: bool) -> tuple[np.ndarray, float, int]:
    """Best variables, the worst stiffness there, and the number of stiffnesses asked for."""
    known: dict[bytes, tuple[np.ndarray, np.ndarray]] = {}

    def at(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        if x.tobytes() not in known:
            each = [(softest if exact else without_derivatives)(x, q) for q in Q]
            known[x.tobytes()] = np.array([k for k, _ in each]), np.array([s for _, s in each])
        return known[x.tobytes()]

    # Variables are the ten and t, the worst stiffness, which is to be as large as possible.
    room = {"type": "ineq", "fun": lambda y: at(y[:10])[0] - y[10]}
    legs = {"type": "ineq", "fun": lambda y: 6.0 - y[4:10].sum()}
    more = {}
    if exact:
        room["jac"] = lambda y: np.column_stack([at(y[:10])[1], -np.ones(len(Q))])
        legs["jac"] = lambda _: -np.concatenate([np.zeros(4), np.ones(6), [0.0]])
        more["jac"] = lambda _: -np.eye(11)[10]
    found = minimize(
        lambda y: -y[10],
        np.append(START, at(START)[0].min()),
        method="SLSQP",
        bounds=[*LIMITS, (0.0, None)],
        constraints=[room, legs],
        options={"ftol": 1e-7, "maxiter": 60},
        **more,
    )
    return found.x[:10], float(at(found.x[:10])[0].min()), len(known)


def main(picture: Path | None = None) -> dict[str, object]:
    """The worst stiffness before and after, and the answers that both searches ask for."""
    before = min(softest(START, q)[0] for q in Q)
    x, worst, count = search(exact=True)
    _, by_differences, many = search(exact=False)
    if picture is not None:
        draw(x, picture)
    return {
        "worst before, N/um": before,
        "worst after, N/um": worst,
        "the same by differences, N/um": by_differences,
        "searched designs with exact gradients": count,
        "searched designs by differences": many,
    }


def draw(x: np.ndarray, picture: Path) -> None:
    """Which number of the hexapod matters most at its worst posture."""
    values, _ = numbers_of(x)
    q = min(Q, key=lambda at: softest(x, at)[0])
    found = cartstiff.gradient(HEXAPOD.with_numbers(values), q, of=SOFTEST)
    found.plot(most=16).savefig(picture, dpi=80)


if __name__ == "__main__":
    for name, value in main().items():
        print(f"{name:<40} {value:.6g}" if isinstance(value, float) else f"{name:<40} {value}")
