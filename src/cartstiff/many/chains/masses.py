r"""Masses of a chain or a tree on recording numbers: the matrix of its kinetic energy.

With m, h and I the mass, first and second moment about the origin of C of a joint and of all that
hangs on it, and joint b on or behind joint a,

    M_ab = omega_a . (I omega_b + h x v_b) + v_a . (m v_b - h x omega_b).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cartstiff.geometry.se3 import Array
from cartstiff.many.algebra import congruence, cross, is_zero, zeros
from cartstiff.many.chains.chain_twists import ChainKinematics, numbers
from cartstiff.many.chains.tree_twists import TreeKinematics
from cartstiff.mechanisms.tree import KinematicTree


@dataclass(frozen=True)
class Bodies:
    """Masses that the joints carry, as plain numbers; a key.

    Attributes
    ----------
    masses : of each joint's body.
    centres : in the joints' frames (joints, 3), flat.
    moments : of inertia about these (joints, 3, 3), flat.
    armatures : of each joint, what turns or shifts with its coordinate alone.
    """

    masses: tuple[float, ...]
    centres: tuple[float, ...]
    moments: tuple[float, ...]
    armatures: tuple[float, ...]

    @staticmethod
    def of(tree: KinematicTree) -> Bodies:
        """Those of a tree, in kg and its unit of length."""
        masses, centres = tree.masses()
        moments = np.array([body.inertia for body in list(tree.model.inertias)[1:]])
        return Bodies(*map(numbers, (masses, centres, moments, np.array(tree.model.armature))))


def kinetic(bodies: Bodies, kinematics: ChainKinematics | TreeKinematics) -> Array:
    """Masses' matrix (joints, joints) in the joint positions."""
    J, joints = kinematics.J, kinematics.J.shape[1]
    centres = np.reshape(bodies.centres, (joints, 3))
    moments = np.reshape(bodies.moments, (joints, 3, 3))
    mass, first, second = zeros(joints), zeros(joints, 3), zeros(joints, 3, 3)
    for j, own in enumerate(bodies.masses):
        if not (own or moments[j].any()):
            continue
        R, p = kinematics.behind(j)
        c = R @ centres[j] + p
        I_j = congruence(R.T, moments[j]) + (np.eye(3) * (c @ c) - np.outer(c, c)) * own
        for a, behind in enumerate(kinematics.outward):
            if j in behind:
                mass[a], first[a], second[a] = mass[a] + own, first[a] + c * own, second[a] + I_j
    M = zeros(joints, joints)
    for b in range(joints):
        turn, shift = J[:3, b], J[3:, b]
        if all(is_zero(x) for x in (mass[b], *second[b].flat)):
            continue
        moment = second[b] @ turn + cross(first[b], shift)
        force = shift * mass[b] - cross(first[b], turn)
        for a in (a for a, behind in enumerate(kinematics.outward) if b in behind):
            M[a, b] = M[b, a] = J[:3, a] @ moment + J[3:, a] @ force
    for a, armature in enumerate(bodies.armatures):
        M[a, a] = M[a, a] + armature
    return M
