"""Buckling: a column of rigid links on springs, at its critical load and bent beyond it.

Links of length l with a spring k in every joint buckle at P l / k = 2 - 2 cos(pi / (2 n + 1)).
"""

import matplotlib.pyplot as plt
import numpy as np

import cartstiff

LENGTH, STIFFNESS = 0.5, 200.0  # m, N m/rad
JOINT = """<joint name="joint{0}" type="revolute"><parent link="link{1}"/><child link="link{0}"/>
  <origin xyz="{2} 0 0"/><axis xyz="0 0 1"/>
  <limit lower="-3" upper="3" effort="0" velocity="0"/></joint><link name="link{0}"/>"""
TOP = """<link name="link0"/><link name="top"/><joint name="end" type="fixed">
  <parent link="link{0}"/><child link="top"/><origin xyz="{1} 0 0"/></joint>"""
unit = cartstiff.DeadForce(np.array([-STIFFNESS / LENGTH, 0.0, 0.0]))  # the factor is P l / k

figure, ax = plt.subplots(figsize=(6, 3.2), layout="constrained")
for n in (1, 2, 3, 4):
    joints = [JOINT.format(i, i - 1, LENGTH if i > 1 else 0.0) for i in range(1, n + 1)]
    text = f'<robot name="column">{TOP.format(n, LENGTH)}{"".join(joints)}</robot>'
    column = cartstiff.load(text, frame="top").with_springs(STIFFNESS)
    exact = 2 - 2 * np.cos(np.pi / (2 * n + 1))
    curve = cartstiff.load_curve(column, unit, to=1.6 * exact)
    bent = curve.branch(0)
    print(f"{n} links: critical at {curve.critical[0].factor:.6f}, closed form {exact:.6f}")
    ax.plot(
        np.abs(bent.displacement[:, 4]) / (n * LENGTH), bent.factors / exact, label=f"{n} links"
    )
ax.plot([0, 0], [0, 1.5], "--", color="k", label="straight")
ax.set(xlabel="sideways motion of the top over the height", ylabel="load over critical load")
ax.set(xlim=(-0.02, 0.8), ylim=(0, 1.5))
ax.legend()
figure.savefig("buckling.png", dpi=80)
