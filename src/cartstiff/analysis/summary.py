r"""Everything that a stiffness matrix says, as one dict of plain values.

Arrays become nested lists; numbers that are infinite or do not exist become None, and `notes` says
why. `cartstiff.report.analysis` prints the same dict.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from cartstiff import numerics
from cartstiff.analysis import asymmetry as asymmetries
from cartstiff.analysis.centres import centres_of
from cartstiff.analysis.compliant_axes import (
    CompliantAxis,
    twist_compliant_axes,
    wrench_compliant_axes,
)
from cartstiff.analysis.ellipsoids import (
    compliance_ellipsoid,
    stiffness_about,
    stiffness_along,
    stiffness_ellipsoid,
)
from cartstiff.analysis.indices import best_conditioned_length, indices_of
from cartstiff.analysis.matrices import (
    ROTATION,
    TRANSLATION,
    as_symmetric,
    invert,
    move_compliance,
    move_stiffness,
    stiffness_of_motion,
    symmetric_part,
)
from cartstiff.analysis.metrics import characteristic_length, inertia_metric, length_metric, modes
from cartstiff.analysis.normal_forms import decoupling_frame, normal_form
from cartstiff.analysis.plain import Notes, plain, section
from cartstiff.analysis.screws import eigenscrews
from cartstiff.analysis.synthesis import realisability, realise
from cartstiff.arrays import checked_matrix, checked_pose, checked_unit, checked_vector
from cartstiff.errors import UndefinedError, UnknownNameError
from cartstiff.geometry.se3 import Array
from cartstiff.stiffness.posture import inverse_pair

_PREFERRED = ("B", "K", "F", "A", "+")
_FREEDOMS = ("translation", "rotation")
_POINTS = ("stiffness", "compliance", "elasticity", "least_coupling")
_SCREW = ("direction", "point", "pitch")
_EIGENSCREW = (*_SCREW, "eigenvalue", "rotational_stiffness", "translational_stiffness")
_COMPLIANT_AXIS = (*_SCREW, "stiffness")
_AXES = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}


def summarise(
    stiffness: Mapping[str, ArrayLike | None],
    wrench: ArrayLike,
    length: float | None = None,
    *,
    connection: str | None = None,
    compliance: ArrayLike | None = None,
    inverse: ArrayLike | None = None,
    is_singular: bool = False,
    mass: float | None = None,
    inertia: ArrayLike | None = None,
    mass_centre: ArrayLike = (0.0, 0.0, 0.0),
    direction: ArrayLike | None = None,
    T_m_n: ArrayLike | None = None,
    threshold: float = asymmetries.THRESHOLD,
    springs: bool = True,
) -> dict[str, Any]:
    r"""Analyse one posture: ellipsoids, centres, screws, indices, and what the connection changes.

    Parameters
    ----------
    stiffness : mapping of str to (6, 6) array or None
        By connection name, in body frame M; None where undefined.
    wrench : array_like, shape (6,)
        Load (moment, force) in frame M.
    length : float, optional
        Characteristic length; else from `mass` and `inertia`, else natural, else one unit.
        The result says which.
    connection : str, optional
        The matrix that is analysed; default the first that exists of B, K, F, A, +. An asymmetric
        one is analysed by its symmetric part, and the result says so; what other freedoms do that
        are free is read from the symmetric part of its inverse.
    compliance : array_like, shape (6, 6), optional
        In frame M. Default the inverse of the analysed matrix; needed where no stiffness exists.
    inverse : array_like, shape (6, 6), optional
        Inverse of the symmetric part of the analysed matrix, in frame M, where it is known better
        than the matrix tells it.
    is_singular : bool
        Whether the analysed matrix is known to have no inverse, whatever its rounding says.
    mass, inertia, mass_centre : float, array_like (3, 3), array_like (3,), optional
        Rigid body whose kinetic energy is the metric of "modes"; inertia about the mass centre, in
        the frame of the analysis. Default the metric of the characteristic length.
    direction : array_like, shape (3,), optional
        A direction, besides x, y and z, along and about which the stiffness is given.
    T_m_n : array_like, shape (4, 4), optional
        Frame in which the analysis is given. The table of connections stays in M, since the
        kinematic connection does not move as a tensor.
    threshold : float
        Relative change above which the choice of connection matters.
    springs : bool
        Whether to construct the springs that realise the matrix.

    Returns
    -------
    dict
        Keys "connection", "symmetrised", "definiteness", "frame", "length", "stiffness",
        "compliance", "ellipsoids", "directions", "centres", "normal_form", "decoupling_frame",
        "eigenscrews", "wrench_compliant_axes", "twist_compliant_axes", "indices", "modes",
        "synthesis", "asymmetry", "connections", "notes".

    Raises
    ------
    UnknownNameError
        If `connection` is not among the names.
    InputError
        If a shape is wrong or a number is not finite.
    """
    notes = Notes()
    W = checked_vector(wrench, 6, "wrench")
    name = _chosen(stiffness, connection)
    base = None if name is None else _moved(stiffness[name], None, move_stiffness)
    skewness = 0.0 if base is None else asymmetries.asymmetry_of(base, W).size
    if is_singular:
        what = "stiffness is singular: it has no inverse"
        notes.add(UndefinedError(what, code="singular"), "compliance")
    elif compliance is None and base is not None:
        compliance = notes.attempt("compliance", invert, base)
    elif compliance is not None:
        compliance = checked_matrix(compliance, "compliance")
    base = _moved(base, T_m_n, move_stiffness)
    free = inverse_pair(base, _moved(compliance, T_m_n, move_compliance))
    K = None if base is None else symmetric_part(base)
    C = free[1]
    if inverse is not None:
        C = symmetric_part(inverse if T_m_n is None else move_compliance(inverse, T_m_n))
    elif base is not None and not numerics.is_about_symmetric(base):
        C = None if (inverted := numerics.invert(symmetric_part(base))) is None else inverted.matrix
    scale = characteristic_length(K, C, given=length, mass=mass, inertia=inertia)
    if K is None:
        reason = (
            "no stiffness matrix exists here; what follows comes from the compliance alone"
            if C is not None
            else "neither stiffness nor compliance exists here"
        )
        notes.add(UndefinedError(reason, code="no-stiffness"), "stiffness")
    metric = ("length", length_metric(scale.value))
    if mass is not None and inertia is not None:
        metric = ("inertia", inertia_metric(mass, inertia, mass_centre))
    axes = {name: np.array(axis) for name, axis in _AXES.items()}
    if direction is not None:
        axes["given"] = checked_unit(direction)
    result: dict[str, Any] = {
        "connection": name,
        "symmetrised": skewness > numerics.SYMMETRY,
        "definiteness": None,
        "frame": np.eye(4) if T_m_n is None else checked_pose(T_m_n, "frame"),
        "length": scale,
        "stiffness": K,
        "compliance": free[1],
        "ellipsoids": _ellipsoids({"held": (K, C), "free": free}, notes),
        "directions": _directions(K, free[1], C is None, axes),
    }
    result |= _of_stiffness(K, C, scale.value, metric, springs, notes)
    minus = stiffness.get("A")
    result["asymmetry"] = result["connections"] = None
    if minus is not None:
        predicted = asymmetries.asymmetry_of(minus, W)
        result["asymmetry"] = section(("size", "residual", "agrees", "predicted"), predicted)
    if name is not None:
        result["connections"] = asymmetries.compare_connections(
            stiffness, reference=name, length=scale.value, threshold=threshold
        )
    result["notes"] = notes.entries
    answer: dict[str, Any] = plain(result)
    return answer


def _chosen(stiffness: Mapping[str, ArrayLike | None], connection: str | None) -> str | None:
    if connection is not None:
        if connection not in stiffness:
            raise UnknownNameError("connection", connection, stiffness)
        return connection if stiffness[connection] is not None else None
    names = [n for n in (*_PREFERRED, *stiffness) if stiffness.get(n) is not None]
    return names[0] if names else None


def _moved(
    matrix: ArrayLike | None, T_m_n: ArrayLike | None, move: Callable[..., Array]
) -> Array | None:
    """A matrix, if there is one, checked and in the frame of the analysis."""
    if matrix is None:
        return None
    return checked_matrix(matrix) if T_m_n is None else move(matrix, T_m_n)


def _ellipsoids(
    pairs: Mapping[str, tuple[Array | None, Array | None]],
    notes: Notes,
) -> dict[str, Any]:
    """Nested by quantity, freedom and others; `pairs` by the last."""
    tables: dict[str, Any] = {}
    for i, (quantity, function) in enumerate(
        (("stiffness", stiffness_ellipsoid), ("compliance", compliance_ellipsoid))
    ):
        tables[quantity] = {
            freedom: {
                others: None
                if pair[i] is None
                else notes.attempt(
                    f"{quantity} of {freedom}, others {others}",
                    function,
                    pair[i],
                    freedom,
                    others,
                    None,
                    pair[1 - i],
                )
                for others, pair in pairs.items()
            }
            for freedom in _FREEDOMS
        }
    return tables


def _directions(
    K: Array | None,
    C: Array | None,
    is_singular: bool,
    axes: Mapping[str, Array],
) -> list[dict[str, Any]]:
    """Stiffness along and about lines through the origin, the other freedoms held and free.

    Held: the diagonal of K, see `stiffness_of_motion`; free: the inverse of the diagonal of C (see
    `stiffness_along`, `stiffness_about`), or by elimination where C does not exist.
    """
    table = []
    for name, axis in axes.items():
        row: dict[str, Any] = {"name": name, "direction": axis}
        for kind, own, function in (
            ("along", TRANSLATION, stiffness_along),
            ("about", ROTATION, stiffness_about),
        ):
            free: float | None = None
            twist = np.zeros(6)
            twist[own] = axis
            if C is not None:
                give, most = float(twist @ C @ twist), float(np.abs(C[own, own]).max())
                # Without a K, a direction that does not give is held by the structure.
                is_rigid = K is None and abs(give) <= numerics.ZERO * most
                free = None if is_rigid else 1.0 / give if give else float("inf")
            elif K is not None:
                free = Notes().attempt(kind, function, K, axis, np.zeros(3), "free")
            held = None if K is None else stiffness_of_motion(twist, K, is_singular)
            row[kind] = {"held": held, "free": free}
        table.append(row)
    return table


_OF_STIFFNESS = (
    "definiteness",
    "centres",
    "normal_form",
    "decoupling_frame",
    "eigenscrews",
    "wrench_compliant_axes",
    "twist_compliant_axes",
    "indices",
    "modes",
    "synthesis",
)


def _of_stiffness(
    K: Array | None,
    C: Array | None,
    length: float,
    metric: tuple[str, Array],
    springs: bool,
    notes: Notes,
) -> dict[str, Any]:
    """Sections that need the stiffness matrix."""
    if K is None:
        return dict.fromkeys(_OF_STIFFNESS)
    K = as_symmetric(K)
    points = centres_of(K, C)
    for what, reason in points.reasons.items():
        notes.add(reason, f"centre ({what.replace('_', ' ')})")
    screws = notes.attempt("eigenscrews", eigenscrews, K, C)
    wrenches = notes.attempt("wrench-compliant axes", wrench_compliant_axes, K, C)
    twists = notes.attempt("twist-compliant axes", twist_compliant_axes, K, C)
    numbers = notes.attempt("indices", indices_of, K, length, C)
    best = notes.attempt("indices", best_conditioned_length, K, C)
    judgement = notes.attempt("springs in parallel", realisability, K, C)
    realised = None
    if springs and judgement is not None and judgement.passive:
        realised = notes.attempt("springs in parallel", realise, K, length, C)
    return {
        "definiteness": None if numbers is None else numbers.definiteness,
        "centres": section(_POINTS, points),
        "normal_form": notes.attempt("normal form", normal_form, K, C),
        "decoupling_frame": notes.attempt("decoupling frame", decoupling_frame, K, C),
        "eigenscrews": None
        if screws is None
        else {
            "screws": [section(_EIGENSCREW, e, e.screw) for e in screws.screws],
            "complete": screws.complete,
            "complex_eigenvalues": [[z.real, z.imag] for z in screws.complex_eigenvalues],
        },
        "wrench_compliant_axes": None if wrenches is None else _axes(wrenches),
        "twist_compliant_axes": None if twists is None else _axes(twists),
        "indices": None
        if numbers is None
        else {
            **plain(numbers),
            "best_length": None if best is None else best[0],
            "condition_at_best_length": None if best is None else best[1],
        },
        "modes": notes.attempt("modes", modes, K, metric[1], metric[0], C),
        "synthesis": None
        if judgement is None
        else {
            **plain(judgement),
            "springs": None if realised is None else realised.springs,
            "residual": None if realised is None else realised.residual,
        },
    }


def _axes(axes: Sequence[CompliantAxis]) -> list[dict[str, Any]]:
    return [section(_COMPLIANT_AXIS, axis, axis.screw) for axis in axes]
