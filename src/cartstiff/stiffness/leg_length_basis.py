r"""A body on lines in a basis of its own: the lines' lengths instead of its pose.

The stiffness of lines g with springs k is ``sum k g g^T + R``, R by tensions and all else. Added
up, a soft spring is lost behind a stiff one, and near a type-2 singularity, where the lines are
nearly dependent, the digits of all. In the motions B that lengthen one of six independent lines,
the stiffest ones, by 1 and the others not, ``G B = 1`` and the sum is

    diag(k) + B^T (sum k g g^T over the other lines + R) B,

which never adds a stiff spring to a soft one.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cartstiff import numerics
from cartstiff.geometry.se3 import Array
from cartstiff.mechanisms.contract import MechanismPosture
from cartstiff.mechanisms.elastic import ElasticMechanism
from cartstiff.stiffness.free_motions import FreeMotions


def leg_length_basis(elastic: ElasticMechanism, posture: MechanismPosture) -> FreeMotions | None:
    """The motions of a body on lines by their lengths; None where these do not determine its pose.

    Parameters
    ----------
    elastic : ElasticMechanism
        With the rest lengths that are used.
    posture : MechanismPosture
        Whose coordinates are the pose.
    """
    parts = elastic.line_springs_and_rest(posture)
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
        springs=(lines, k),
        error=numerics.EPSILON * basis.condition,
    )


class ByLengths(NamedTuple):
    """Motions B (6, 6) by lengths of lines, the stiffness on them, and what it is the sum of.

    `condition` is that of the lines that lead, which are those of these numbers.
    """

    motions: Array
    stiffness: Array
    terms: Array
    condition: float
    leading: NDArray[np.intp]


def by_lengths(lines: Array, k: Array, rest: Array) -> ByLengths | None:
    """``diag(k) + B^T (sum k g g^T + R) B`` of this module; None for dependent lines.

    Slack ones do not count.

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
