"""Mechanisms around one with measured springs carry the covariance to any number."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from cartstiff import ElasticMechanism

# Relative change of the compliances between which differences are taken.
_STEP = 1e-3


class Neighbours(NamedTuple):
    """Two mechanisms on both sides of one with measured springs.

    Attributes
    ----------
    more, less : ElasticMechanism
        With compliances to both sides along one principal direction of their covariance.
    per : float
        Change of a number for one standard deviation along it, over that between the two.
    """

    more: ElasticMechanism
    less: ElasticMechanism
    per: float


def _roots(covariance: np.ndarray) -> np.ndarray:
    """Columns h (P, k) with ``Sigma = sum h h^T``, found relative to each standard deviation."""
    s = np.sqrt(covariance.diagonal())
    per = np.where(s > 0.0, 1.0 / np.where(s > 0.0, s, 1.0), 0.0)
    variances, axes = np.linalg.eigh(covariance * np.multiply.outer(per, per))
    there = variances > 0.0
    return s[:, None] * axes[:, there] * np.sqrt(variances[there])


def neighbours(elastic: ElasticMechanism) -> list[Neighbours]:
    r"""Mechanisms around one with measured springs: they carry the covariance to any number.

    With ``Sigma = sum h_k h_k^T`` a number f has, to first order, the variance
    ``sum (df/dc . h_k)^2``: central differences along each h_k, so that what covaries does.

    Returns
    -------
    list of Neighbours
        None for a mechanism whose springs were not measured.
    """
    known = elastic.identified
    if known is None:
        return []
    own, pairs = elastic.compliances, []
    sizes = dict[str, float]()
    for key in own:
        one, _, axis = key.partition("*")
        other = f"{one.rpartition('.')[0]}.{axis}" if axis else one
        sizes[key] = float(np.sqrt(abs(own[one].value * own[other].value)))
    # Of a coefficient that is all but zero its deviation is the natural size.
    for pattern, variance in zip(known.patterns, known.covariance.diagonal(), strict=True):
        for key, _ in pattern.keys:
            sizes[key] = max(sizes[key], float(np.sqrt(variance))) if " x^" in key else sizes[key]
    for change in _roots(known.covariance).T:
        changed = dict.fromkeys(own, 0.0)
        for pattern, step in zip(known.patterns, change.tolist(), strict=True):
            for key, weight in pattern.keys:
                changed[key] += weight * step
        largest = max((abs(x) / sizes[key] for key, x in changed.items() if x), default=0.0)
        if not largest > 0.0:
            continue
        more, less = (
            elastic.with_compliances(
                {key: own[key].value + sign * _STEP / largest * x for key, x in changed.items()}
            )
            for sign in (1.0, -1.0)
        )
        pairs.append(Neighbours(more, less, 0.5 * largest / _STEP))
    return pairs
