r"""A body on lines in a basis of its own: the lines' lengths instead of its pose.

The stiffness of lines g with springs k is ``sum k g g^T + R``, R by tensions and all else. Added
up, a soft spring is lost behind a stiff one, and near a type-2 singularity, where the lines are
nearly dependent, the digits of all. In the motions B that lengthen one of six independent lines,
the stiffest ones, by 1 and the others not, ``G B = 1`` and the sum is

    diag(k) + B^T (sum k g g^T over the other lines + R) B,

which never adds a stiff spring to a soft one.
"""

from __future__ import annotations

import numpy as np

from cartstiff import numerics
from cartstiff.mechanisms.contract import MechanismPosture
from cartstiff.mechanisms.elastic import ElasticMechanism
from cartstiff.stiffness.free_motions import FreeMotions

__all__ = ["springs_apart"]


def springs_apart(elastic: ElasticMechanism, posture: MechanismPosture) -> FreeMotions | None:
    """The motions of a body on lines by their lengths; None where these do not determine its pose.

    Parameters
    ----------
    elastic : ElasticMechanism
        With the rest lengths that are used.
    posture : MechanismPosture
        Whose coordinates are the pose.
    """
    parts = elastic.line_springs_apart(posture)
    if parts is None:
        return None
    lines, k, rest = parts
    natural = np.repeat([1.0, posture.length], 3)
    scaled = lines * natural
    if len(k) < 6 or not numerics.is_regular(np.linalg.svd(scaled, compute_uv=False)):
        return None
    leading = numerics.first_independent(scaled.T * np.sqrt(k))
    others = np.delete(np.arange(len(k)), leading)
    motions = natural[:, None] * np.linalg.inv(scaled[leading])
    along = lines[others] @ motions
    added = (along.T * k[others]) @ along
    turned = motions.T @ rest @ motions
    hessian = np.diag(k[leading]) + added + turned
    terms = np.diag(k[leading]) + np.abs(added) + np.abs(motions.T) @ np.abs(rest) @ np.abs(motions)
    return FreeMotions(
        motions, hessian, lambda: terms, lambda: float(np.abs(terms).max()), motions,
        numerics.is_symmetric(rest), springs=(lines, k),
        error=numerics.EPSILON * float(np.linalg.cond(scaled[leading])),
    )  # fmt: skip
