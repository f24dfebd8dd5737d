"""Principal values of a posture's stiffness and compliance:
one decomposition for all of them.
"""

from __future__ import annotations

from functools import lru_cache
from math import exp, log
from typing import Literal

import numpy as np

from cartstiff import numerics
from cartstiff.analysis.ellipsoids import (
    Ellipsoid,
    Freedom,
    Others,
    compliance_ellipsoid,
    shape_of,
    stiffness_ellipsoid,
)
from cartstiff.analysis.indices import held_condition
from cartstiff.analysis.matrices import ROTATION, TRANSLATION, definiteness
from cartstiff.analysis.metrics import (
    NATURAL,
    NOT_NATURAL,
    CharacteristicLength,
    length_of_pair,
)
from cartstiff.arrays import Array
from cartstiff.lazily import cached_property
from cartstiff.stiffness.posture import StiffnessInFrame, inverse_pair

Quantity = Literal["stiffness", "compliance"]

# Place among K_tt, K_rr, C_rr, C_tt of the block of a freedom, the others held or free.
_PLACES: dict[tuple[Freedom, Others], int] = {
    ("translation", "held"): 0,
    ("rotation", "held"): 1,
    ("rotation", "free"): 2,
    ("translation", "free"): 3,
}


class MatrixPair:
    """A `StiffnessInFrame.pair`, and what is read from it together.

    Each of these numbers has a function of its own (`cartstiff.analysis.ellipsoids`,
    `metrics`) that uses the matrix with more correct digits. If a block has all its
    digits, as nearly always, one call of LAPACK serves all of them.

    Parameters
    ----------
    K : ndarray, shape (6, 6)
        Symmetric: with the other freedoms held.
    C : ndarray, shape (6, 6), or None
        Its inverse.
    asymmetric : tuple, optional
        Stiffness and compliance of which K is the symmetric part, if the symmetric part
        of the compliance, with the other freedoms free, is not C.
    """

    def __init__(
        self,
        K: Array,
        C: Array | None,
        asymmetric: tuple[Array, Array | None] | None = None,
    ) -> None:
        self.K, self.C = K, C
        self._asymmetric = asymmetric
        self._shapes: dict[tuple[Freedom, Others, Quantity], Ellipsoid | None] = {}

    @cached_property
    def _free(self) -> tuple[Array | None, Array | None]:
        """The pair with the other freedoms free."""
        return (
            (self.K, self.C)
            if self._asymmetric is None
            else inverse_pair(*self._asymmetric)
        )

    @cached_property
    def _blocks(self) -> tuple[list[bool], Array, Array]:
        """Of K_tt, K_rr, C_rr and C_tt: whether all digits are there, values,
        and vectors.

        With the other freedoms free C is the compliance's own symmetric part, and the
        last block is (K^-1)_rr.
        """
        K, C = self.K, self.C
        own = C if self._asymmetric is None else self._asymmetric[1]
        if C is None or own is None:
            return [False] * 5, K, K
        free = own if own is C else 0.5 * (own + own.T)
        t, r = (TRANSLATION, TRANSLATION), (ROTATION, ROTATION)
        stack = np.array([K[t], K[r], free[r], free[t], *([] if own is C else [C[r]])])
        values, vectors = np.linalg.eigh(stack)
        return [*map(numerics.hold_all_digits, values)], values, vectors

    def condition(self, freedom: Freedom) -> float:
        """`cartstiff.analysis.indices.held_condition`."""
        is_whole, values, _ = self._blocks
        at = _PLACES[freedom, "held"]
        if is_whole[at]:
            return numerics.condition_of(values[at])
        return held_condition(self.K, self.C, freedom)

    def ellipsoid(
        self, freedom: Freedom, others: Others = "held", quantity: Quantity = "stiffness"
    ) -> Ellipsoid | None:
        """`stiffness_ellipsoid` or `compliance_ellipsoid` of
        `cartstiff.analysis.ellipsoids`.

        None without that matrix.

        Raises
        ------
        UndefinedError
            As that function.
        """
        key = freedom, others, quantity
        if key not in self._shapes:
            self._shapes[key] = self._ellipsoid(*key)
        return self._shapes[key]

    def _ellipsoid(
        self, freedom: Freedom, others: Others, quantity: Quantity
    ) -> Ellipsoid | None:
        is_whole, values, vectors = self._blocks
        at = _PLACES[freedom, others]
        if not is_whole[at]:
            K, C = (self.K, self.C) if others == "held" else self._free
            if quantity == "stiffness":
                return (
                    None
                    if K is None
                    else stiffness_ellipsoid(K, freedom, others, None, C)
                )
            return (
                None if C is None else compliance_ellipsoid(C, freedom, others, None, K)
            )
        own, axes = values[at], vectors[at]
        if (others == "free") == (quantity == "stiffness"):
            # Of the other matrix: same axes, inverse values.
            own = 1.0 / own
            order = np.argsort(own)
            own, axes = own[order], axes[:, order]
        return shape_of(own, axes, definiteness(own))

    @cached_property
    def length(self) -> CharacteristicLength:
        """`cartstiff.analysis.metrics.characteristic_length` without a given one."""
        is_whole, values, _ = self._blocks
        turning = 2 if self._asymmetric is None else -1
        if not (is_whole[0] and is_whole[turning]):
            return length_of_pair(self.K, self.C)
        moving, softness = values[0].tolist(), values[turning].tolist()
        if not (moving[0] > 0.0 and softness[0] > 0.0):
            return NOT_NATURAL
        logs = sum(map(log, softness)) + sum(map(log, moving))
        return CharacteristicLength(exp(-logs / 6.0), "natural", NATURAL)


def block_ellipsoid(
    here: StiffnessInFrame,
    connection: str,
    quantity: Quantity,
    freedom: Freedom,
    others: Literal["block", "free", "held"],
) -> Ellipsoid | None:
    """Ellipsoid of a 3x3 block, or with the other freedoms free or held;
    None without a matrix.

    Each value comes from the matrix, stiffness or compliance, that has more correct
    digits.

    Raises
    ------
    UndefinedError
        See `cartstiff.analysis.ellipsoids`.
    """
    is_block = others == "block"
    how: Others = (
        "free" if others == "free" or (is_block and quantity == "compliance") else "held"
    )
    if (pair := matrix_pair(here, connection)) is not None:
        return pair.ellipsoid(freedom, how, quantity)
    C = here.pair(connection, how)[1] if quantity == "compliance" else None
    return None if C is None else compliance_ellipsoid(C, freedom, how)


@lru_cache(maxsize=16)
def matrix_pair(here: StiffnessInFrame, connection: str) -> MatrixPair | None:
    """The matrices of a connection; None without a stiffness."""
    K, C = here.pair(connection, "held")
    own, given = here.compliances[connection], here.matrices[connection]
    if K is None or given is None:
        return None
    is_one = C is own or (C is not None and own is not None and np.array_equal(own, C))
    return MatrixPair(K, C, None if is_one else (given, own))
