"""The numeric policy, and inverses, bases and eigenvalues that keep the digits that are there."""

from __future__ import annotations

from cartstiff.numerics import criteria
from cartstiff.numerics.bases import (
    first_independent,
    graded_basis,
)
from cartstiff.numerics.criteria import *  # noqa: F403 - its list of names stands there
from cartstiff.numerics.inverses import (
    Inverse,
    equilibration,
    error_of_inverting,
    inverse_of_sum,
    inverses_of_sums,
    invert,
    invert_each,
    plain_inverses,
)
from cartstiff.numerics.policy import (
    BALANCE,
    EPSILON,
    FAR_FROM_IDLE,
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
    TINY,
    WELL_CONDITIONED,
    ZERO,
    Array,
    is_about_symmetric,
    is_regular,
    is_symmetric,
    rank,
    ratio,
)
from cartstiff.numerics.small import inverted, singular_values
from cartstiff.numerics.spectra import (
    condition,
    eigenpairs,
    eigenvalues,
    pair_conditions,
)

__all__ = [
    "BALANCE",
    "EPSILON",
    "FAR_FROM_IDLE",
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
    "TINY",
    "WELL_CONDITIONED",
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
    "inverted",
    "is_about_symmetric",
    "is_regular",
    "is_symmetric",
    "pair_conditions",
    "plain_inverses",
    "rank",
    "ratio",
    "singular_values",
]
__all__ += criteria.__all__
