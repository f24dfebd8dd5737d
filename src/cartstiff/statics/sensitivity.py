r"""How a state of rest moves when its springs are softer.

At rest ``g(q, theta) + A^T lam = 0``. A compliance parameter with pattern S changes the elements'
forces t at fixed q by ``-K S t``, K = Gamma^-1, and so

    dq / d theta = N H_N^-1 N^T B^T K S (t - t_0)

with H_N the tangent of everything that acts. t_0 are the forces of elements whose rest positions
are chosen so that they carry what acts at the start: these follow the compliance.
"""

from __future__ import annotations

import numpy as np

from cartstiff import numerics
from cartstiff.arrays import Array
from cartstiff.mechanisms.contract import MechanismPosture
from cartstiff.mechanisms.elastic import ElasticMechanism
from cartstiff.mechanisms.elements import Elements
from cartstiff.potentials.springs import JointSprings
from cartstiff.statics.balance import Balance


def motion_under_forces(posture: MechanismPosture, balance: Balance, forces: Array) -> Array:
    """Motion (n, k) of the coordinates at rest under small generalised forces (n, k)."""
    columns = posture.coordinate_lengths[:, None]
    right = forces * columns
    if balance.free is not None:
        right = balance.free.T @ right
    per = 1.0 / np.sqrt(balance.hardness)[:, None]
    y = per * np.linalg.lstsq(balance.scaled, per * right, rcond=numerics.ZERO)[0]
    return np.asarray(columns * balance.motion(y))


def motion_by_compliance(
    posture: MechanismPosture,
    balance: Balance,
    elements: Elements,
    patterns: Array,
    chosen: Array | None = None,
) -> Array:
    """Derivative (n, P) of the coordinates at rest by each compliance parameter.

    Parameters
    ----------
    posture : MechanismPosture
        At rest.
    balance : Balance
        What acts there.
    elements : Elements
        Elements of the mechanism with all rest positions chosen.
    patterns : ndarray (P, E, E)
        S of each parameter.
    chosen : ndarray (E,), optional
        t_0, from `chosen_forces`; default zero.
    """
    t = elements.forces(posture)
    if chosen is not None:
        t = t - chosen
    softer = elements.stiffness @ (patterns @ t).T
    return motion_under_forces(posture, balance, elements.rows(posture).T @ softer)


def chosen_forces(
    given: ElasticMechanism, balanced: ElasticMechanism, start: MechanismPosture
) -> Array:
    """Forces (E,) at the start of the elements whose rest positions were open; others zero."""
    elements = Elements(balanced)
    springs = given.springs
    open_ = np.zeros(len(elements.names), bool)
    if springs is not None:
        rest = springs.is_open() if isinstance(springs, JointSprings) else np.isnan(springs.rest)
        loose = [n for n, is_open in zip(given.spring_names, rest, strict=True) if is_open]
        open_ = np.array([name in loose for name in elements.names], bool)
    return np.where(open_, elements.forces(start), 0.0)
