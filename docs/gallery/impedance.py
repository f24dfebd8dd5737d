"""An impedance controller: damping and joint gains for the stiffness wanted at a Panda's hand.

Mass and stiffness are made diagonal together, so that all six oscillators have the wanted damping
ratio; square roots of the stiffness alone would not do that. See the how-to on impedance.
"""

import matplotlib.pyplot as plt
import numpy as np

import cartstiff
from cartstiff.vibration import impedance

arm = cartstiff.load("panda", frame="panda_hand_tcp")
wanted = np.diag([40.0, 40.0, 20.0, 2000.0, 2000.0, 500.0])  # N m/rad, N/m, in the hand's axes
modes = cartstiff.modes(cartstiff.analyse(arm))
controller = impedance(modes, wanted, ratios=0.7)
print("frequencies:", np.round(controller.frequencies, 3), "Hz")
print("damping ratios by square roots instead:", np.round(controller.ratios, 3))
print("damping, force per velocity:", np.round(np.diag(controller.damping)[3:], 2), "N s/m")
print("stiffness at the joints:", np.round(np.diag(controller.joint_stiffness), 2), "N m/rad")

figure, (left, right) = plt.subplots(1, 2, figsize=(8, 3.2), layout="constrained")
left.imshow(np.cbrt(controller.damping), cmap="RdBu", vmin=-6, vmax=6)
left.set(title="damping, cube roots", xticks=[], yticks=[])
controller.plot(ax=right)
figure.savefig("impedance.png", dpi=80)
