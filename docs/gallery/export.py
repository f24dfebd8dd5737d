"""Export: the stiffness of a Panda as one C function for a controller, and where it is regular.

The function has no allocation and needs no library but the C math library. Its numbers are those of
`record`, whose calls take microseconds in Python, too.
"""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import cartstiff

arm = cartstiff.load("panda")
program = cartstiff.record(arm, ["stiffness_B", "translation_free_min"])
source = program.source("c", name="panda_stiffness")
Path("panda_stiffness.c").write_text(source, encoding="utf-8")
print(next(line for line in source.splitlines() if line.startswith("int panda_stiffness")))
one, core = program(arm.q), cartstiff.analyse(arm).B.matrix
print("agrees with the analysis:", np.allclose(one["stiffness_B"], core, atol=1e-9 * core.max()))

elbow = np.linspace(-3.0, -0.1, 200)
postures = np.tile(arm.q, (200, 1))
postures[:, 3] = elbow
many = program.many(postures)
print("states:", many.counts())

figure, ax = plt.subplots(figsize=(6, 3.2), layout="constrained")
ax.plot(elbow, 1e-3 * many["translation_free_min"])
ax.set(xlabel="fourth joint [rad]", ylabel="softest direction [N/mm]")
figure.savefig("export.png", dpi=80)
