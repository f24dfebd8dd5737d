"""Your own energy on the pose: a soft magnet at the flange, with and without derivatives.

The energy is a well that pulls the flange to a place. cartstiff differentiates it numerically, or
takes your derivatives; `taylor_check` verifies them.
"""

from pathlib import Path

import numpy as np

import cartstiff
from cartstiff import PoseFunction
from cartstiff.extend import taylor_check
from cartstiff.geometry import se3

CENTRE = np.array([0.62, 0.32, 0.30])  # m
DEPTH, WIDTH = 40.0, 0.10  # J, m


def energy(T: np.ndarray) -> float:
    """A Gaussian well."""
    d = T[:3, 3] - CENTRE
    return -DEPTH * float(np.exp(-(d @ d) / (2 * WIDTH**2)))


def wrench(T: np.ndarray) -> np.ndarray:
    """Its dPhi in body axes: a force alone, as the energy does not feel rotations."""
    d = T[:3, :3].T @ (T[:3, 3] - CENTRE)
    return np.concatenate([np.zeros(3), -energy(T) * d / WIDTH**2])


def stiffness(T: np.ndarray) -> np.ndarray:
    """Its K^A: the Hessian in space, and f x for the rotation of the body's axes."""
    d = T[:3, :3].T @ (T[:3, 3] - CENTRE)
    K = np.zeros((6, 6))
    K[3:, 3:] = -energy(T) / WIDTH**2 * (np.eye(3) - np.outer(d, d) / WIDTH**2)
    K[3:, :3] = se3.skew(wrench(T)[3:])
    return K


def main(picture: Path | None = None) -> dict[str, float]:
    """Agreement of both ways, the check's slopes, and the magnet's effect on the arm."""
    arm = cartstiff.load("ur5")
    by_hand = PoseFunction(energy=energy, wrench=wrench, stiffness=stiffness)
    by_differences = PoseFunction(energy=energy, length=WIDTH)
    # Gravity and loads aside, springs without rest positions balance the magnet at q.
    with_magnet = cartstiff.analyse(arm.with_potential(by_hand))
    numerical = cartstiff.analyse(arm.with_potential(by_differences))
    alone = cartstiff.analyse(arm)

    T = alone.pose
    K = stiffness(T)
    direction = np.array([0.3, -0.2, 0.5, 0.04, 0.03, -0.02])
    right = taylor_check(lambda x: energy(T @ se3.exp(x)), wrench(T), 0.5 * (K + K.T), direction)
    wrong = taylor_check(lambda x: energy(T @ se3.exp(x)), wrench(T), np.zeros((6, 6)), direction)
    if picture is not None:
        draw(T, direction, picture)
    change = with_magnet.B.matrix - alone.B.matrix
    differ = numerical.B.matrix - with_magnet.B.matrix
    return {
        "slope, right derivatives": right.slope,
        "slope, Hessian left out": wrong.slope,
        "numerical against by hand": float(np.abs(differ).max() / np.abs(alone.B.matrix).max()),
        "largest change of K^B": float(np.abs(change).max()),
        "unbalanced wrench": float(np.abs(with_magnet.wrench).max()),
    }


def draw(T: np.ndarray, direction: np.ndarray, picture: Path) -> None:
    """Errors of the Taylor polynomials against the step."""
    import matplotlib.pyplot as plt

    steps = np.logspace(0, -4, 33)
    values = np.array([energy(T @ se3.exp(t * direction)) for t in steps]) - energy(T)
    first = wrench(T) @ direction
    second = 0.5 * direction @ stiffness(T) @ direction
    figure, axis = plt.subplots(figsize=(6, 3.4), layout="constrained")
    axis.loglog(steps, np.abs(values), label="energy alone: slope 1")
    axis.loglog(steps, np.abs(values - first * steps), label="with the wrench: slope 2")
    axis.loglog(
        steps, np.abs(values - first * steps - second * steps**2), label="with K too: slope 3"
    )
    axis.set(xlabel="step", ylabel="error of the energy [J]")
    axis.legend()
    figure.savefig(picture, dpi=80)
