"""The paper's table: the stiffness of Zefran and Kumar's platform, entry by entry.

K^A as the paper prints it, and the bundled platform's, in N cm, N and N/cm. The picture shows the
difference of each entry from the printed one: rounding, and nothing else.
"""

import matplotlib.pyplot as plt
import numpy as np

import cartstiff

PRINTED = """
    2141.4  -1725.1  -3895.1   206.9  -581.5   466.5
   -2094.7   4107.4   -336.5   303.5     5.3  -836.8
   -1518.7    608.6   3263.9  -239.5   516.7  -212.2
     206.9   -202.4   -180.2    80.0     5.2    75.6
     -75.5      5.3    212.0     5.2    39.3     5.2
     407.2   -532.2   -212.2    75.6     5.2   150.6"""
printed = np.array(PRINTED.split(), float).reshape(6, 6)

platform = cartstiff.load("stewart-gough")
K = cartstiff.analyse(platform).A
print(np.round(K.matrix, 1))
print("largest difference from the table:", round(float(np.abs(K.matrix - printed).max()), 4))
print("asymmetry, as the table's:", np.round(K.matrix - K.matrix.T, 1)[0])

figure, ax = plt.subplots(figsize=(4.6, 3.6), layout="constrained")
shown = ax.imshow(K.matrix - printed, cmap="RdBu", vmin=-0.05, vmax=0.05)
ax.set(title="computed minus printed $K^A$", xticks=[], yticks=[])
figure.colorbar(shown, label="half a printed digit is 0.05")
figure.savefig("paper_table.png", dpi=80)
