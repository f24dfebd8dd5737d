"""Yoshikawa's measure from the axes of the joints."""

import numpy as np


def answers(inputs, folder):
    axes = np.array(inputs["axes"])
    motion = np.cross(axes, np.array(inputs["at"]) - np.array(inputs["points"]))
    rows = {"all": np.hstack([motion, axes]), "translation": motion, "rotation": axes}
    return {name: np.sqrt(np.linalg.det(J.T @ J)) for name, J in rows.items()}
