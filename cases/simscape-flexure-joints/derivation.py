"""Springs in a row: the compliances of two joints and a strut add up, carried to one point."""

import numpy as np


def carried(r):
    """Twist (turn, motion) at a point that stands at r from another, by the twist there."""
    cross = np.array([[0, -r[2], r[1]], [r[2], 0, -r[0]], [-r[1], r[0], 0]])
    return np.block([[np.eye(3), np.zeros((3, 3))], [-cross, np.eye(3)]])


def answers(inputs, folder):
    base, points, at = (np.array(inputs[k]) for k in ("base", "platform", "at"))
    joint = inputs["joint"]
    real, ideal = np.zeros((6, 6)), np.zeros((6, 6))
    for a, b in zip(base, points, strict=True):
        z = (b - a) / np.linalg.norm(b - a)
        x = np.cross([0, 1, 0], z) / np.linalg.norm(np.cross([0, 1, 0], z))
        R = np.kron(np.eye(2), np.column_stack([x, np.cross(z, x), z]))
        stiff = [joint[k] for k in ("bending", "bending", "torsion", "shear", "shear", "axial")]
        flexure = R @ np.diag(1 / np.array(stiff)) @ R.T
        strut = np.zeros((6, 6))
        strut[3:, 3:] = np.outer(z, z) / inputs["strut"]
        C = strut + sum(carried(at - p) @ flexure @ carried(at - p).T for p in (a, b))
        real += np.linalg.inv(C)
        line = np.concatenate([np.cross(b - at, z), z])
        ideal += inputs["strut"] * np.outer(line, line)
    return {"share": real[5, 5] / ideal[5, 5]}
