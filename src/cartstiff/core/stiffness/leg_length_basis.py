r"""Stiffness of a body on lines in the basis of the lines' lengths instead of the pose.

The stiffness of lines g with springs k is ``sum k g g^T + R``, R from tensions and all
else. In this sum the digits of a soft spring are lost beside those of a stiff one, and
near a type-2 singularity, where the lines are nearly dependent, those of all springs. In
the motions B that lengthen one of six independent lines, the stiffest ones, by 1 and the
others not, ``G B = 1`` and the sum is

    diag(k) + B^T (sum k g g^T over the other lines + R) B,

which does not add a stiff spring to a soft one.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cartstiff.core import numerics
from cartstiff.core.arrays import Array
from cartstiff.core.mechanisms.contract import MechanismPosture
from cartstiff.core.mechanisms.elastic import ElasticMechanism
from cartstiff.core.stiffness.free_motions import FreeMotions


def leg_length_basis(
    elastic: ElasticMechanism, posture: MechanismPosture
) -> FreeMotions | None:
    """Motions of a body on lines by the lines' lengths; None if these do not
    determine the pose.

    Parameters
    ----------
    elastic : ElasticMechanism
        Mechanism with all rest lengths.
    posture : MechanismPosture
        Posture whose coordinates are the pose.
    """
    parts = line_springs_and_rest(elastic, posture)
    if parts is None:
        return None
    lines, k, rest = parts
    natural = np.repeat([1.0, posture.length], 3)
    basis = by_lengths(lines * natural, k, rest * natural * natural[:, None])
    if basis is None:
        return None
    motions = natural[:, None] * basis.motions
    return FreeMotions(
        motions,
        basis.stiffness,
        basis.terms,
        motions,
        numerics.is_symmetric(rest),
        has_springs_apart=True,
        error=numerics.EPSILON * basis.condition,
    )


def line_springs_and_rest(
    elastic: ElasticMechanism, posture: MechanismPosture
) -> tuple[Array, Array, Array] | None:
    """Lines g (m, 6) from ground to body, their k (m,), and the rest of the Hessian.

    None where the coordinates are not the body's pose, or no lines hold it.
    """
    if not posture.coordinates_are_pose:
        return None
    lines, k, rest = list[Array](), list[Array](), np.zeros((6, 6))
    for term in elastic.terms():
        if (own := term.lines_and_rest(posture)) is not None:
            g, stiffness, turning = own
            lines.append(g)
            k.append(stiffness)
            rest = rest + turning
        else:
            rest = rest + term.evaluate(posture).hessian
    return (np.concatenate(lines), np.concatenate(k), rest) if lines else None


class ByLengths(NamedTuple):
    """Motions B (6, 6) by lengths of lines, the stiffness on them,
    and the sizes of its terms.

    `leading` are the six independent lines, `condition` is the condition number of their
    matrix.
    """

    motions: Array
    stiffness: Array
    terms: Array
    condition: float
    leading: NDArray[np.intp]


def by_lengths(lines: Array, k: Array, rest: Array) -> ByLengths | None:
    """``diag(k) + B^T (sum k g g^T + R) B`` of this module; None for dependent lines.

    Slack lines (k = 0) are not counted.

    Parameters
    ----------
    lines, k, rest : ndarray (m, 6), (m,), (6, 6)
        Lines, their stiffnesses, and R, for motions of one unit.
    """
    taut = lines[k > 0.0]
    if len(taut) < 6 or not numerics.is_regular(np.linalg.svd(taut, compute_uv=False)):
        return None
    leading = numerics.first_independent(lines.T * np.sqrt(k))
    others = np.delete(np.arange(len(k)), leading)
    motions = np.linalg.inv(lines[leading])
    along = lines[others] @ motions
    added = (along.T * k[others]) @ along
    own = np.diag(k[leading])
    turned = motions.T @ rest @ motions
    terms = own + np.abs(added) + np.abs(motions.T) @ np.abs(rest) @ np.abs(motions)
    condition = float(np.linalg.cond(lines[leading]))
    return ByLengths(motions, own + added + turned, terms, condition, leading)
