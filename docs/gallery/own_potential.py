"""Your own potential: a soft magnet at the flange, whose energy is all that you write.

The energy is a well that pulls the flange to a place. cartstiff differentiates it; `taylor_check`
tests derivatives of yours: with the right ones the error falls with the third power of the step.
"""

import matplotlib.pyplot as plt
import numpy as np

import cartstiff
from cartstiff.extend import gradient_and_hessian, taylor_check
from cartstiff.geometry import se3

CENTRE, DEPTH, WIDTH = np.array([0.62, 0.32, 0.30]), 40.0, 0.10  # m, J, m


def energy(T: np.ndarray) -> float:
    """A Gaussian well."""
    d = T[:3, 3] - CENTRE
    return -DEPTH * float(np.exp(-(d @ d) / (2 * WIDTH**2)))


arm = cartstiff.load("ur5")
alone = cartstiff.analyse(arm)
pulled = cartstiff.analyse(arm.with_potential(cartstiff.PoseFunction(energy, length=WIDTH)))
change = pulled.B.matrix - alone.B.matrix
print("the magnet changes K^B by up to", round(float(np.abs(change[3:, 3:]).max()), 1), "N/m")

at, direction = alone.pose, np.array([0.3, -0.2, 0.5, 0.04, 0.03, -0.02])
for factor in (1.0, 1.1):  # of the Hessian: right, and wrong by a tenth
    gradient, hessian = gradient_and_hessian(lambda x: energy(at @ se3.exp(x)), [WIDTH] * 6)
    check = taylor_check(lambda x: energy(at @ se3.exp(x)), gradient, factor * hessian, direction)
    print(f"Hessian times {factor}: the error falls with the step's power {check.slope:.1f}")

figure, ax = plt.subplots(figsize=(6, 3.2), layout="constrained")
steps = np.linspace(-0.2, 0.2, 101)
ax.plot(steps, [energy(at @ se3.exp(np.array([0, 0, 0, s, 0, 0]))) for s in steps])
ax.set(xlabel="way along the flange's x axis [m]", ylabel="energy of the magnet [J]")
figure.savefig("own_potential.png", dpi=80)
