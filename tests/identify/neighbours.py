"""Mechanisms around one with measured springs carry the covariance to any number."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from tests.doors import Elements

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
    elements = Elements(elastic)
    patterns, own = elements.patterns(known.patterns), np.sqrt(np.diag(elements.compliance))
    # Of a coefficient that is all but zero its deviation is the natural size.
    of_laws = np.array([bool(p.law) for p in known.patterns], bool)
    sizes = np.maximum(np.abs(known.values), np.sqrt(known.covariance.diagonal()))
    pairs = []
    for change in _roots(known.covariance).T:
        share = np.tensordot(change, patterns, axes=1) / np.multiply.outer(own, own)
        bent = np.abs(change[of_laws]) / sizes[of_laws]
        largest = max(float(np.abs(share).max(initial=0.0)), float(bent.max(initial=0.0)))
        if not largest > 0.0:
            continue
        step = _STEP / largest * change
        more, less = (elements.with_parameters(known.patterns, sign * step) for sign in (1.0, -1.0))
        pairs.append(Neighbours(more, less, 0.5 * largest / _STEP))
    return pairs
