"""The numeric policy, and inverses, bases and eigenvalues that keep the digits that are there."""

from __future__ import annotations

from cartstiff.numerics.bases import (
    first_independent,
    graded_basis,
)
from cartstiff.numerics.inverses import (
    Inverse,
    equilibration,
    error_of_inverting,
    inverse_of_sum,
    inverses_of_sums,
    invert,
    invert_each,
)
from cartstiff.numerics.policy import (
    BALANCE,
    EPSILON,
    IDLE,
    INVERTIBLE,
    LOST,
    NEAR,
    PAIRED,
    RANK,
    REPEATED,
    ROUNDING,
    SYMMETRY,
    TELLING,
    ZERO,
    Array,
    is_about_symmetric,
    is_regular,
    is_symmetric,
    rank,
    ratio,
)
from cartstiff.numerics.spectra import (
    condition,
    eigenpairs,
    eigenvalues,
    pair_conditions,
)

__all__ = [
    "BALANCE",
    "EPSILON",
    "IDLE",
    "INVERTIBLE",
    "LOST",
    "NEAR",
    "PAIRED",
    "RANK",
    "REPEATED",
    "ROUNDING",
    "SYMMETRY",
    "TELLING",
    "ZERO",
    "Array",
    "Inverse",
    "condition",
    "eigenpairs",
    "eigenvalues",
    "equilibration",
    "error_of_inverting",
    "first_independent",
    "graded_basis",
    "inverse_of_sum",
    "inverses_of_sums",
    "invert",
    "invert_each",
    "is_about_symmetric",
    "is_regular",
    "is_symmetric",
    "pair_conditions",
    "rank",
    "ratio",
]
