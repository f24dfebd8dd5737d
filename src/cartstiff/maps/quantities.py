r"""Named numbers of many postures: what a map can hold.

A quantity is evaluated on stacks of matrices and equals, posture by posture, what
`cartstiff.analysis` says of the same thing. An asymmetric matrix (K^A, a tangent under load) is
read by its symmetric part, as there. What does not exist at a posture is NaN.

Any other number of the analysis can be named by its path in the analysis of one posture, such as
``indices.condition_exponent`` or ``centres.stiffness.2``; it is then found posture by posture, some
hundred times slower.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from cartstiff import numerics
from cartstiff.analysis.ellipsoids import (
    Freedom,
    Others,
    compliance_ellipsoid,
    stiffness_about,
    stiffness_along,
    stiffness_ellipsoid,
)
from cartstiff.analysis.matrices import ROTATION, TRANSLATION, UNITS, stiffness_of_motion
from cartstiff.errors import InputError, UndefinedError, UnknownNameError
from cartstiff.geometry.se3 import Array
from cartstiff.maps import row_by_row
from cartstiff.maps.quantity import Quantity as Quantity
from cartstiff.maps.quantity import Settings as Settings
from cartstiff.maps.quantity import Stacks
from cartstiff.matrix_names import OF_MANY
from cartstiff.mechanisms.elastic import ElasticMechanism
from cartstiff.mechanisms.platform import Platform
from cartstiff.vibration.many_modes import ManyModes

_K, _C, _FREE = ("stiffness_{matrix}",), ("inverse",), ("free",)
_DEFLECT = ("compliance_{connection}", "pose", "wrench")
_BLOCKS = {"rotation": ROTATION, "translation": TRANSLATION}
_STIFF, _SOFT = UNITS.stiffness, UNITS.compliance


_FREEDOMS: tuple[Freedom, ...] = ("translation", "rotation")
_OTHERS: tuple[Others, ...] = ("free", "held")


def _principal(
    s: Stacks, kind: str, freedom: Freedom, others: Others, pair: Others | None = None
) -> Array:
    """Principal values (N, 3) of stiffness or compliance, the other freedoms held or free."""

    def make() -> Array:
        stiff = kind == "stiffness"
        function = stiffness_ellipsoid if stiff else compliance_ellipsoid

        def one(matrix: Array, inverse: Array) -> Array:
            return function(matrix, freedom, others, None, inverse).eigenvalues

        taken = others if pair is None else pair
        K, C = s.pair(taken)
        stack, inverse = (K, C) if stiff else (C, K)
        return row_by_row.block_values(
            stack, inverse, _BLOCKS[freedom], stiff == (others == "held"), one
        )

    return s.once(f"{kind} {freedom} {others} {pair}", make)


def _principal_quantities() -> list[Quantity]:
    quantities = []
    for kind, prefix, units in (("stiffness", "", _STIFF), ("compliance", "compliance_", _SOFT)):
        for freedom in _FREEDOMS:
            for others in _OTHERS:
                needs = (*_K, *_C) if others == "held" else _FREE
                for end, which, column in (("min", "smallest", 0), ("max", "largest", 2)):

                    def function(
                        s: Stacks,
                        key: tuple[str, Freedom, Others] = (kind, freedom, others),
                        column: int = column,
                    ) -> Array:
                        return _principal(s, *key)[:, column]

                    other = "rotation" if freedom == "translation" else "translation"
                    quantities.append(
                        Quantity(
                            f"{prefix}{freedom}_{others}_{end}",
                            f"{which} principal {freedom}al {kind}, {other} {others}",
                            units[freedom],
                            function,
                            needs,
                            better="larger" if kind == "stiffness" else "smaller",
                        )
                    )
    return quantities


def _on_axis(s: Stacks, block: slice, others: str) -> Array:
    """Stiffness along or about the direction through the frame's origin."""
    u = s.direction()
    if others == "held":
        return _held_on_axis(s, block, u)
    K, C = s.pair("free")
    C = C[:, block, block]
    give = np.einsum("ni,nij,nj->n", u, C, u)
    with np.errstate(divide="ignore", invalid="ignore"):
        stiffness: Array = 1.0 / give
    exists = np.isfinite(K).all(axis=(1, 2))
    # Without a K, a direction that does not give is held by the structure: no number says how much.
    rigid = np.abs(give) <= numerics.ZERO * np.abs(C).max(axis=(1, 2))
    stiffness[~exists & rigid] = np.nan
    function = stiffness_along if block is TRANSLATION else stiffness_about
    for i in np.flatnonzero(exists & ~np.isfinite(C).all(axis=(1, 2))):
        try:
            stiffness[i] = function(K[i], u[i], others="free")
        except UndefinedError:
            stiffness[i] = np.nan
    return stiffness


def _held_on_axis(s: Stacks, block: slice, u: Array) -> Array:
    """`stiffness_of_motion` of turning about, or shifting along, a direction (N, 3)."""
    twists = np.zeros((len(u), 6))
    twists[:, block] = u
    values: Array = np.einsum("ni,nij,nj->n", twists, s.K, twists)
    size = np.abs(twists)
    terms = numerics.EPSILON * np.einsum("ni,nij,nj->n", size, np.abs(s.K), size)
    for i in np.flatnonzero(terms > numerics.REPORTED_ERROR * np.abs(values)):
        is_singular = not np.isfinite(s.C[i]).all()
        value = stiffness_of_motion(twists[i], s.K[i], is_singular)
        values[i] = np.nan if value is None else value
    return values


def _deflection(s: Stacks, part: slice) -> Array:
    def make() -> Array:
        C = s.arrays[f"compliance_{s.settings.connection}"]
        return np.einsum("nij,nj->ni", C, s.added_wrench())

    return np.linalg.norm(s.once("deflection", make)[:, part], axis=1)


def _unstable(s: Stacks) -> Array:
    rr, tt = row_by_row.block_norms(s.K)
    with np.errstate(divide="ignore", invalid="ignore"):
        length = np.where((rr > 0) & (tt > 0), np.sqrt(rr / tt), 1.0)
    values = row_by_row.eigenvalues(s.K, s.C, length)
    return np.where(np.isnan(values).any(axis=1), np.nan, row_by_row.signs(values)[0])


def _natural_length(s: Stacks) -> Array:
    with np.errstate(divide="ignore", invalid="ignore"):
        translation = _principal(s, "stiffness", "translation", "held")
        rotation = _principal(s, "stiffness", "rotation", "free", pair="held")
        positive = np.ones(len(translation), bool)
        for values in (translation, rotation):
            positive &= row_by_row.signs(values)[2] == 3
        length = np.exp((np.log(rotation).sum(axis=1) - np.log(translation).sum(axis=1)) / 6.0)
    return np.where(positive, length, np.nan)


def _asymmetry(s: Stacks) -> Array:
    def size(K: Array) -> Array:
        rr, tt = row_by_row.block_norms(K)
        coupling = np.sqrt(rr * tt)
        edge = np.sqrt(np.einsum("nij,nij->n", K[:, :3, 3:], K[:, :3, 3:]))
        coupling = np.where(coupling == 0.0, edge, coupling)
        scales = np.array([[rr, coupling], [coupling, tt]]).transpose(2, 0, 1)
        scales = np.kron(scales, np.ones((1, 3, 3)))
        scales[scales == 0.0] = 1.0
        return (np.abs(K - K.swapaxes(1, 2)) / scales).max(axis=(1, 2))

    return row_by_row.on_finite(size, s.arrays["stiffness_A"])


def _connection_change(s: Stacks) -> Array:
    """Largest change that `cartstiff.analysis.asymmetry.compare_connections` finds."""
    reference = s.arrays[f"stiffness_{s.settings.connection}"]
    base = row_by_row.scale_lengths(reference, s.settings.length)
    half = row_by_row.symmetric_part(base)
    values = row_by_row.on_finite(np.linalg.eigvalsh, half, shape=(6,))
    positive = row_by_row.signs(values)[2] == 6
    worst = np.full(len(base), np.nan)
    for name in OF_MANY:
        other = s.arrays[f"stiffness_{name}"]
        if name == s.settings.connection:
            continue
        both = np.isfinite(other).all(axis=(1, 2)) & np.isfinite(base).all(axis=(1, 2))
        change = np.full(len(base), np.nan)
        d = row_by_row.scale_lengths(other - reference, s.settings.length)
        if (rows := both & positive).any():
            root = np.linalg.cholesky(half[rows])
            left = np.linalg.solve(root, d[rows])
            relative = np.linalg.solve(root, left.swapaxes(1, 2))
            change[rows] = np.linalg.norm(relative, 2, axis=(1, 2))
        if (rows := both & ~positive).any():
            with np.errstate(divide="ignore", invalid="ignore"):
                size = np.linalg.norm(base[rows], 2, axis=(1, 2))
                change[rows] = np.linalg.norm(d[rows], 2, axis=(1, 2)) / size
        worst = np.fmax(worst, change)
    return worst


def _ratio(s: Stacks) -> Array:
    values = s.once("singular values", s.singular_values)
    with np.errstate(divide="ignore", invalid="ignore"):
        return values[:, -1] / values[:, 0]


def _manipulability(s: Stacks) -> Array:
    return row_by_row.on_finite(
        lambda m: np.prod(np.linalg.svd(m, compute_uv=False), axis=1), s.arrays["jacobian"]
    )


def _vibration_quantities() -> list[Quantity]:
    def lowest(s: Stacks, which: int) -> Array:
        return s.frequencies()[:, which]

    def damped(s: Stacks, which: int) -> Array:
        return s.damping_ratios()[:, which]

    words = "natural frequency {} under the load, the lowest first"
    share = "damping ratio of mode {} under the load, the slowest first"
    return [
        *(
            Quantity(
                f"frequency_{i + 1}", words.format(i + 1), "Hz", partial(lowest, which=i), ("pose",)
            )
            for i in range(6)
        ),
        *(
            Quantity(
                f"damping_{i + 1}",
                share.format(i + 1),
                "1",
                partial(damped, which=i),
                ("pose",),
                "damping",
            )
            for i in range(6)
        ),
        Quantity(
            "limiting_depth",
            "depth of a milling cut that is stable at every speed",
            "{length}",
            lambda s: s.limiting_depths(),
            ("pose",),
            "milling",
        ),
    ]


_EVERY = tuple(f"stiffness_{name}" for name in OF_MANY)

#: Every quantity by name.
QUANTITIES: dict[str, Quantity] = {
    q.name: q
    for q in (
        *_principal_quantities(),
        Quantity(
            "along_free",
            "stiffness along the direction, everything else free",
            _STIFF["translation"],
            lambda s: _on_axis(s, TRANSLATION, "free"),
            (*_FREE, "pose"),
            "direction",
        ),
        Quantity(
            "along_held",
            "stiffness along the direction, everything else held",
            _STIFF["translation"],
            lambda s: _on_axis(s, TRANSLATION, "held"),
            (*_K, *_C, "pose"),
            "direction",
        ),
        Quantity(
            "about_free",
            "stiffness about the direction, everything else free",
            _STIFF["rotation"],
            lambda s: _on_axis(s, ROTATION, "free"),
            (*_FREE, "pose"),
            "direction",
        ),
        Quantity(
            "about_held",
            "stiffness about the direction, everything else held",
            _STIFF["rotation"],
            lambda s: _on_axis(s, ROTATION, "held"),
            (*_K, *_C, "pose"),
            "direction",
        ),
        Quantity(
            "deflection",
            "displacement of the frame's origin under the given wrench",
            "{length}",
            lambda s: _deflection(s, TRANSLATION),
            _DEFLECT,
            "deflect",
            "smaller",
        ),
        Quantity(
            "deflection_angle",
            "rotation of the body under the given wrench",
            "rad",
            lambda s: _deflection(s, ROTATION),
            _DEFLECT,
            "deflect",
            "smaller",
        ),
        Quantity(
            "condition",
            "condition number of K at the characteristic length",
            "1",
            lambda s: row_by_row.condition(s.eigenvalues()),
            (*_K, *_C),
            "length",
            "smaller",
        ),
        Quantity(
            "isotropy",
            "geometric over arithmetic mean of the eigenvalues of K",
            "1",
            lambda s: row_by_row.isotropy(s.eigenvalues()),
            (*_K, *_C),
            "length",
        ),
        Quantity(
            "minimum",
            "smallest eigenvalue of K at the characteristic length",
            _STIFF["translation"],
            lambda s: s.eigenvalues()[:, 0],
            (*_K, *_C),
            "length",
        ),
        Quantity(
            "translation_condition",
            "condition number of the translational block of K",
            "1",
            lambda s: row_by_row.condition(_principal(s, "stiffness", "translation", "held")),
            (*_K, *_C),
            better="smaller",
        ),
        Quantity(
            "rotation_condition",
            "condition number of the rotational block of K",
            "1",
            lambda s: row_by_row.condition(_principal(s, "stiffness", "rotation", "held")),
            (*_K, *_C),
            better="smaller",
        ),
        Quantity(
            "determinant",
            "determinant of K",
            UNITS.determinant,
            lambda s: row_by_row.determinant(s.eigenvalues(), s.settings.length),
            (*_K, *_C),
        ),
        Quantity(
            "unstable_directions",
            "number of negative eigenvalues of K",
            "1",
            _unstable,
            (*_K, *_C),
            better="smaller",
        ),
        Quantity(
            "natural_length",
            "length at which rotation and translation are equally stiff",
            "{length}",
            _natural_length,
            (*_K, *_C),
            better=None,
        ),
        Quantity(
            "asymmetry",
            "largest entry of K^A - (K^A)^T, relative to its block",
            "1",
            _asymmetry,
            ("stiffness_A",),
            better="smaller",
        ),
        Quantity(
            "connection_change",
            "largest relative change of stiffness by another choice of connection",
            "1",
            _connection_change,
            _EVERY,
            "length",
            "smaller",
        ),
        Quantity(
            "singular_value_ratio",
            "smallest over largest singular value of the Jacobian",
            "1",
            _ratio,
            ("jacobian",),
            "length",
        ),
        Quantity(
            "manipulability",
            "product of the Jacobian's singular values, each joint in its own unit",
            "{length}^3",
            _manipulability,
            ("jacobian",),
        ),
        *_vibration_quantities(),
        Quantity(
            "moment",
            "size of the load's moment",
            UNITS.moment,
            lambda s: np.linalg.norm(s.arrays["wrench"][:, :3], axis=1),
            ("wrench",),
            better=None,
        ),
        Quantity(
            "force",
            "size of the load's force",
            "{force}",
            lambda s: np.linalg.norm(s.arrays["wrench"][:, 3:], axis=1),
            ("wrench",),
            better=None,
        ),
        Quantity(
            "energy",
            "potential energy of springs, gravity and loads",
            UNITS.moment,
            lambda s: s.arrays["energy"],
            ("energy",),
            better=None,
        ),
    )
}


def choose_quantities(
    names: Sequence[str], settings: Settings, elastic: ElasticMechanism
) -> tuple[Quantity, ...]:
    """Quantities by name, checked against the settings and the mechanism.

    Raises
    ------
    UnknownNameError
        For a name that is neither in `QUANTITIES` nor a path of the analysis.
    InputError
        If a quantity asks for a setting that is missing, is named twice, or does not exist for this
        kind of mechanism.
    """
    if settings.connection not in OF_MANY:
        raise UnknownNameError("connection", settings.connection, OF_MANY)
    if not names:
        raise InputError("no quantity was named", expected="one or more names")
    chosen = []
    for name in names:
        if names.count(name) > 1:
            raise InputError("quantity given twice", got=repr(name))
        if "." in name:
            from cartstiff.maps.analysis_paths import path_quantity

            chosen.append(path_quantity(name))
            continue
        if name not in QUANTITIES:
            raise UnknownNameError("quantity", name, QUANTITIES)
        quantity = QUANTITIES[name]
        if quantity.asks == "direction" and settings.direction is None:
            raise InputError(f"the quantity {name} needs a direction")
        if quantity.asks == "deflect" and settings.deflect is None and not settings.is_loaded:
            raise InputError(f"the quantity {name} needs a wrench to deflect the body")
        if quantity.asks == "milling" and settings.milling is None:
            raise InputError(f"the quantity {name} needs a cutter (milling)")
        if quantity.asks in ("damping", "milling") and not settings.damping.acts_on(elastic):
            raise InputError(f"the quantity {name} needs damping", got="no ratio, no dampers")
        if "jacobian" in quantity.needs and elastic.mechanism.kind in ("closed-chain", "parallel"):
            raise InputError(
                f"the quantity {name} is not defined for a mechanism with closures",
                expected="a serial chain or a platform",
            )
        if name == "manipulability":
            quantity = replace(quantity, unit=_manipulability_unit(elastic))
        chosen.append(quantity)
    return tuple(chosen)


def _manipulability_unit(elastic: ElasticMechanism) -> str:
    """Unit of the product of singular values: each joint counts in its own unit."""
    mechanism = elastic.mechanism
    slides = sum(c.is_length for c in mechanism.coordinates)
    if isinstance(mechanism, Platform):
        slides = 6  # what moves are the legs
    elif len(mechanism.coordinates) < 6 or (slides and len(mechanism.coordinates) > 6):
        return "mixed, of rad and {length}"
    return f"{{length}}^{3 - slides}"


def evaluate(
    quantities: Sequence[Quantity],
    arrays: Mapping[str, Array],
    settings: Settings,
    lengths: Array | None = None,
    swing: ManyModes | None = None,
) -> dict[str, Array]:
    """Values (N,) of quantities by name, from the arrays of `analyse_many`.

    Parameters
    ----------
    quantities : sequence of Quantity
        From `choose_quantities`.
    arrays : mapping of str to ndarray
        Outputs by name, with NaN where one does not exist.
    settings : Settings
        What the quantities refer to.
    lengths : ndarray of bool, shape (n,), optional
        Which coordinates are distances; default none.
    swing : ManyModes, optional
        Small vibrations at the postures, where they may be asked for.
    """
    source = Stacks(arrays, settings, lengths, swing)
    with np.errstate(all="ignore"):
        return {q.name: np.asarray(q.function(source), float) for q in quantities}
