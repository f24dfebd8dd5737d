"""The null space: a Panda's elbow moves, its hand does not, and the hand's stiffness changes.

Seven joints leave one free motion. The script walks along it from the default posture.
"""

import matplotlib.pyplot as plt
import numpy as np

import cartstiff

arm = cartstiff.load("panda")
goal = cartstiff.analyse(arm).pose
way, postures = np.linspace(0.0, 0.75, 16), [arm.q]  # rad, in joint space
direction = np.eye(7)[0]
for step in np.diff(way):
    free = np.linalg.svd(cartstiff.analyse(arm, postures[-1]).posture.motion.jacobian)[2][-1]
    direction = free if free @ direction > 0 else -free
    ahead = postures[-1] + step * direction

    def distances(candidates: np.ndarray, ahead: np.ndarray = ahead) -> np.ndarray:
        """From a step ahead, squared."""
        return np.asarray(((candidates - ahead) ** 2).sum(axis=-1))

    postures.append(cartstiff.inverse_kinematics(arm, goal, [ahead], cost=distances)[0])

C = cartstiff.analyse_many(arm, np.array(postures), outputs=["compliance_B"])["compliance_B"]
softest = 1e-3 / np.linalg.eigvalsh(C[:, 3:, 3:])[:, -1]  # felt by a force alone
up = np.linalg.inv(goal[:3, :3])[:, 2]
vertical = 1e-3 / np.einsum("i,nij,j->n", up, C[:, 3:, 3:], up)
print("softest direction:", np.round(softest[::5], 3), "N/mm")
print("vertical:", np.round(vertical[::5], 3), "N/mm")

figure, ax = plt.subplots(figsize=(6, 3.2), layout="constrained")
ax.plot(way, vertical, label="vertical")
ax.plot(way, softest, label="in the softest direction")
ax.set(xlabel="way along the self-motion [rad]", ylabel="stiffness to a force [N/mm]", ylim=(0, 10))
ax.legend()
figure.savefig("null_space.png", dpi=80)
