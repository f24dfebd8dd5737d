"""A closed loop: a 3-RRR manipulator is as stiff as its links across its plane, and softer in it.

In the plane the motors' springs and the links share the deflection; out of the plane the motors
have no effect. The picture shows the deflection under 50 N while the platform turns about its own
axis.
"""

import matplotlib.pyplot as plt
import numpy as np

import cartstiff

MOTORS = ("leg1/motor", "leg2/motor", "leg3/motor")
robot = cartstiff.load("3-rrr")
hard = robot.with_springs(dict.fromkeys(MOTORS, 2e9))  # the links alone
for axis, words in ((3, "in the plane"), (5, "out of the plane")):
    both, links = (1 / np.diag(cartstiff.analyse(one).compliance)[axis] for one in (robot, hard))
    print(f"{words}: {1e-3 * both:.2f} N/mm, of which the links alone {1e-3 * links:.2f} N/mm")
state = cartstiff.equilibrium(robot, cartstiff.DeadForce(np.array([0.0, 0.0, -50.0])))
print(f"equilibrium under 50 N: it sinks by {-1e3 * state.displacement[5]:.4f} mm")

turns, home = np.linspace(-0.4, 0.2, 7), dict(zip(robot.names, robot.q.tolist(), strict=True))
moved = []
for turn in turns:  # the passive joints follow the motors
    C = cartstiff.analyse(robot, {n: home[n] + float(turn) for n in MOTORS}).compliance
    moved.append(50e3 * np.diag(C)[[5, 3]])

figure, ax = plt.subplots(figsize=(6, 3.2), layout="constrained")
ax.plot(np.degrees(turns), moved, "o-", label=["50 N across the plane", "50 N in the plane"])
ax.set(xlabel="turn of the motors [deg]", ylabel="deflection [mm]", ylim=(0, None))
ax.legend()
figure.savefig("closed_loop.png", dpi=80)
