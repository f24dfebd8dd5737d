"""All results of the stiffness at one posture, as one dict of plain values.

`summarise` needs only matrices, `sections` adds the load and the deflection, and
`cartstiff.recorded.gradients.spread.analyse_posture` joint stiffness for a target and
uncertainty.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from cartstiff.answer.analysis import asymmetry as asymmetries
from cartstiff.answer.analysis.centres import centres_of, decoupling_frame, normal_form
from cartstiff.answer.analysis.ellipsoids import Freedom, MatrixPair, Others, Quantity
from cartstiff.answer.analysis.indices import best_conditioned_length, indices_of
from cartstiff.answer.analysis.matrices import (
    as_symmetric,
    definiteness,
    invert,
    move_compliance,
    move_stiffness,
    symmetric_part,
)
from cartstiff.answer.analysis.metrics import (
    characteristic_length,
    inertia_metric,
    length_metric,
    modes,
)
from cartstiff.answer.analysis.screws import (
    CompliantAxis,
    eigenscrews,
    twist_compliant_axes,
    wrench_compliant_axes,
)
from cartstiff.answer.analysis.sections import Notes, section
from cartstiff.core import numerics
from cartstiff.core.arrays import (
    Array,
    checked_matrix,
    checked_pose,
    checked_unit,
    checked_vector,
    plain,
    read_only,
)
from cartstiff.core.errors import UndefinedError, UnknownNameError
from cartstiff.core.geometry import se3
from cartstiff.core.geometry.connections import NAMED
from cartstiff.core.stiffness.compute import PostureStiffness
from cartstiff.core.stiffness.posture import StiffnessInFrame, inverse_pair

if TYPE_CHECKING:
    from cartstiff.answer.analysis.deflection import Deflection


def change_from_symmetric(r: PostureStiffness, name: str) -> Array:
    """K^X - K^B: what the connection adds under the load; zero without one."""
    if name == "load":
        return r.change_by_load
    if name in NAMED and r.wrench is not None:  # without the round-off of a difference
        return NAMED["B"].wrench_term(r.wrench) - NAMED[name].wrench_term(r.wrench)
    base, K = r.matrices["B"], r.matrices.get(name)
    return np.zeros((6, 6)) if base is None or K is None else K - base


def is_tangent(r: PostureStiffness, connection: str) -> bool:
    """Whether K^X is the tangent stiffness under the load,
    rotations in characteristic lengths.
    """
    if connection == "load" or not r.is_loaded:
        return True
    changes = np.array(
        [r.change_by_load - change_from_symmetric(r, connection), r.change_by_load]
    )
    per = np.repeat([1.0 / r.posture.length, 1.0], 3)
    difference, size = (np.abs(changes) * np.outer(per, per)).max(axis=(1, 2))
    return bool(difference <= numerics.SYMMETRY * size)


class FoundDeflection(NamedTuple):
    """Linear deflection of a point of the body, with its cause and its shares."""

    by: Literal["load", "preload", "added load"]
    connection: str
    whole: Deflection
    added: Array
    acts_at: Array
    shares: dict[str, Any] | None

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON."""
        return {
            "by": self.by,
            **plain(self.whole),
            "wrench": plain(self.added),
            "wrench_about_origin": plain(self.whole.wrench),
            "acts_at": plain(self.acts_at),
            "connection": self.connection,
            **plain(self.shares or {"kind": None, "shares": None}),
        }


def deflection_found(
    r: PostureStiffness,
    name: str,
    added: Array | None,
    acts_at: Array,
    point: Array,
    notes: Notes,
) -> FoundDeflection | None:
    """Linear deflection ``(K^X)^-1 dW`` at a point of the body,
    under a wrench at another.

    Parameters
    ----------
    r : PostureStiffness
        The posture.
    name : str
        The connection X.
    added : ndarray (6,) or None
        Wrench in the axes of M about `acts_at`; None for the load, at its own point.
    acts_at, point : ndarray (3,)
        In M.
    notes : Notes
        Takes the reason why there is none.
    """
    by: Literal["load", "preload", "added load"] = "added load"
    if added is None:
        if r.wrench is None or not r.is_loaded:
            return None
        by = "load" if r._load_is_given else "preload"
        whole_wrench, acts_at = r.wrench, np.array(r.load.at)
        added = whole_wrench - _about_origin(acts_at, whole_wrench[3:])
    else:
        whole_wrench = added + _about_origin(acts_at, added[3:])
    C = r.at().compliances[name]
    if C is None:
        reason = UndefinedError("no compliance exists here", code="no-compliance")
        notes.add(reason, "deflection")
        return None
    from cartstiff.answer.analysis.deflection import deflection_of

    whole = _without_rounding(C, deflection_of(C, whole_wrench, point), r.length)
    shares = notes.attempt("shares of the deflection", _shares, r, name, whole)
    return FoundDeflection(by, name, whole, added, acts_at, shares)


def motion_of(r: PostureStiffness, found: FoundDeflection) -> Array | None:
    """How far a deflection moves the coordinates of the derivatives: joints, or the body
    by its twist.

    None where the joints' parts do not exist.
    """
    if r.posture.coordinates_are_pose:
        return found.whole.twist
    if r.posture.closure is not None:
        change = change_from_symmetric(r, found.connection)
        return r.motion_under(found.whole.wrench, change)
    if found.shares is None:
        return None
    return np.array([row["motion"] for row in found.shares["shares"]])


def _without_rounding(C: Array, deflection: Deflection, length: float) -> Deflection:
    """A motion without the parts that are rounding of the others,
    angles times the length.

    All of it is rounding where the structure carries the load: beside C, not beside
    itself.
    """
    twist, displacement = deflection.twist.tolist(), deflection.displacement.tolist()
    sizes = [*(length * abs(x) for x in twist[:3]), *map(abs, twist[3:] + displacement)]
    units = np.array([length] * 3 + [1.0] * 3)
    most = (
        np.abs(C * units * units[:, None]).max() * np.abs(deflection.wrench / units).max()
    )
    rounding = max(numerics.ROUNDOFF * max(sizes), numerics.ZERO_SHARE * float(most))
    if min(sizes) > rounding:
        return deflection
    twist = read_only(np.where(np.array(sizes[:6]) > rounding, deflection.twist, 0.0))
    moved = np.where(np.array(sizes[6:]) > rounding, deflection.displacement, 0.0)
    energy = 0.5 * float(deflection.wrench @ twist)
    return replace(deflection, twist=twist, displacement=read_only(moved), energy=energy)


def _about_origin(point: Array, force: Array) -> Array:
    """Wrench (6,) that a force at a point adds to its moment about the origin."""
    return np.array([*se3.cross(point, force).tolist(), 0.0, 0.0, 0.0])


def _shares(r: PostureStiffness, name: str, whole: Deflection) -> dict[str, Any]:
    """Each joint's or leg's part, with its name and unit kind."""
    from cartstiff.answer.analysis.deflection import joint_shares

    posture = r.posture
    mechanism = r.mechanism
    if posture.closure is None and not posture.coordinates_are_pose:
        J = posture.motion.jacobian
        W = np.zeros(6) if r.wrench is None else r.wrench
        H = r.evaluation.hessian - posture.motion.curvature(W)
        # The same change of connection in the joints: J (H_W + J^T D J)^-1 J^T = (K^B +
        # D)^-1.
        H = H + J.T @ change_from_symmetric(r, name) @ J
        shares = joint_shares(J, H, whole.wrench, whole.point)
        part = shares.share if whole.displacement.any() else np.full(len(H), np.nan)
        columns: dict[str, Iterable[Any]] = {
            "name": mechanism.names,
            "motion": shares.motion,
            "is_length": mechanism.is_length.tolist(),
            "twist": shares.twists.T,
            "displacement": shares.displacements.T,
            "energy": shares.energy,
            "share": part,
        }
        return {"kind": "joints", "shares": _rows(columns), "load_share": 0.0}
    elastic = r.elastic_as_given
    if posture.coordinates_are_pose:
        motion = whole.twist
        if elastic.springs is not None and elastic.springs.unilateral:
            elastic = r.elastic  # what is slack depends on rest lengths
    else:
        elastic = r.elastic
        motion = r.motion_under(whole.wrench, change_from_symmetric(r, name))
    found: list[tuple[str, bool | None, float, float]] = []
    for own in elastic.parts(posture):
        x = own.rows @ motion
        if own.whole:
            # Along its own deflection a link is one spring, of that much turn and
            # displacement.
            size = numerics.norm(x) or 1.0
            found.append((own.whole, None, float(x @ own.stiffness @ x) / size**2, size))
            continue
        k = own.stiffness.diagonal().tolist()
        found += zip(own.names, own.slides, k, x.tolist(), strict=True)
    if (
        not posture.coordinates_are_pose
    ):  # slack cables are shown, joints without a spring not
        found = [part for part in found if part[2]]
    if not found:
        raise UndefinedError("no springs share the deflection", code="no-shares")
    return _of_springs(found, whole.energy)


def _rows(columns: Mapping[str, Iterable[Any]]) -> list[dict[str, Any]]:
    """A table, row by row."""
    return [
        dict(zip(columns, row, strict=True))
        for row in zip(*columns.values(), strict=True)
    ]


def _of_springs(
    parts: Iterable[tuple[str, bool | None, float, float]], whole: float
) -> dict[str, Any]:
    """Each spring's part in the energy of a deflection.

    From its name, kind, stiffness k and elongation e: force k e, energy ``1/2 k e^2``,
    and its share, NaN if the whole is zero. Shares and the load's, by the turning of
    loaded springs' lines and by other potentials, add up to 1.
    """
    rows, sum_of_shares = list[dict[str, Any]](), 0.0
    for name, is_length, k, elongation in parts:
        force = k * elongation
        energy = 0.5 * force * elongation
        share = energy / whole if whole != 0.0 else float("nan")
        sum_of_shares += share
        rows.append(
            {
                "name": name,
                "elongation": elongation,
                "force": force,
                "energy": energy,
                "share": share,
                "is_length": is_length,
            }
        )
    return {"kind": "springs", "shares": rows, "load_share": 1.0 - sum_of_shares}


def target_section(
    r: PostureStiffness, target: ArrayLike, connection: str | None = None
) -> dict[str, Any]:
    """Joint or leg stiffness for a desired stiffness in M under the present load.

    ``K^X - K^B`` depends on the load alone, so that the springs must produce ``K^B = K -
    sym(K^X - K^B)`` for a desired symmetric part K of K^X.
    """
    from cartstiff.answer.analysis.congruence import joint_stiffness
    from cartstiff.core.potentials.line_springs import second_derivative

    desired, W = as_symmetric(target, "target stiffness"), r.wrench
    if W is None:
        raise UndefinedError("no load balances this posture", code="unbalanced")
    name, _ = _matrices(r, r.at(), connection)
    if name == "F":
        r.tensor("F")  # refuses where there is none
    change = change_from_symmetric(r, name)
    K = desired - 0.5 * (change + change.T)
    posture, springs = r.posture, r.elastic.springs
    n = posture.motion.jacobian.shape[1]
    gradient, hessian = np.zeros(n), np.zeros((n, n))
    for term in r.elastic.terms(springs=False):
        _, g, h = term.evaluate(posture)
        gradient, hessian = gradient + g, hessian + h
    if (lines := posture.lines) is not None and springs is not None:
        J = None if springs.gives_aside else r.jacobian
        if J is None or len(lines.lengths) != 6:
            raise UndefinedError(
                "leg stiffnesses follow from a stiffness only for six independent legs",
                code="kf-undefined",
            )
        tension = np.linalg.solve(lines.lines.T, W - gradient)
        own = second_derivative(lines, r.elastic.mechanism.points, tension)
        joint_springs = joint_stiffness(K, J, W, load_term=-J.T @ (own + hessian) @ J)
        names, torque, lengths = r.elastic.spring_names, tension, [True] * 6
    elif posture.closure is None and not posture.coordinates_are_pose:
        J = posture.motion.jacobian
        joint_springs = joint_stiffness(
            K, J, W, load_term=posture.motion.curvature(W) - hessian
        )
        torque = joint_springs.torque - gradient
        names = r.elastic.names
        lengths = r.elastic.mechanism.is_length.tolist()
    else:
        raise UndefinedError(
            "joint stiffnesses for a target are found for serial arms and six-legged "
            "platforms",
            code="kf-undefined",
        )
    answer: dict[str, Any] = {
        "joints": names,
        "are_lengths": lengths,
        **plain(joint_springs),
    }
    if (fit := answer["diagonal_fit"]) is not None and fit["cartesian"] is not None:
        fit["cartesian"] = np.array(fit["cartesian"]) + change
    antisymmetric = numerics.asymmetry(change) > 0.0
    answer |= {"connection": name, "is_symmetric": not antisymmetric}
    # The tangent under the load decides stability, whichever matrix was asked for.
    tangent = K + 0.5 * (r.change_by_load + r.change_by_load.T)
    root = np.sqrt(np.abs(np.diag(tangent)))
    definite = root.all() and definiteness(
        np.linalg.eigvalsh(tangent / np.outer(root, root))
    )
    answer["stable"] = definite == "positive"
    return answer | {"desired": desired, "torque": torque}


_PREFERRED = ("B", "K", "F", "A", "+")
_QUANTITIES: tuple[Quantity, ...] = ("stiffness", "compliance")
_FREEDOMS: tuple[Freedom, ...] = ("translation", "rotation")
_OTHERS: tuple[Others, ...] = ("held", "free")
_AXES = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}


@dataclass(frozen=True, eq=False)
class PostureMatrices:
    """The matrices of a posture in the body frame M, of which one is analysed.

    Attributes
    ----------
    stiffness : mapping of str to (6, 6) array or None
        By connection name; None where undefined.
    wrench : array_like, shape (6,)
        Load (moment, force).
    connection : str, optional
        The matrix that is analysed; default the first that exists of B, K, F, A, +. An
        asymmetric one is analysed by its symmetric part, and the result says so; what
        other freedoms do that are free is read from the symmetric part of its inverse.
    compliance : array_like, shape (6, 6), optional
        Default the inverse of the analysed matrix; needed where no stiffness exists.
    inverse : array_like, shape (6, 6), optional
        Inverse of the symmetric part of the analysed matrix, if it is known better than
        by inversion.
    is_singular : bool
        Whether the analysed matrix is known to have no inverse, even if rounding gives it
        one.
    """

    stiffness: Mapping[str, ArrayLike | None]
    wrench: ArrayLike
    connection: str | None = None
    compliance: ArrayLike | None = None
    inverse: ArrayLike | None = None
    is_singular: bool = False

    @property
    def analysed(self) -> str | None:
        """Name of the analysed matrix; None if it does not exist."""
        if self.connection is not None:
            if self.connection not in self.stiffness:
                raise UnknownNameError("connection", self.connection, self.stiffness)
            return (
                self.connection if self.stiffness[self.connection] is not None else None
            )
        names = (*_PREFERRED, *self.stiffness)
        return next((n for n in names if self.stiffness.get(n) is not None), None)


@dataclass(frozen=True, eq=False)
class Reading:
    """How the matrices of a posture are read.

    Attributes
    ----------
    length : float, optional
        Characteristic length; else from `mass` and `inertia`, else natural, else one
        unit. The result says which.
    mass, inertia, mass_centre : float, array_like (3, 3), array_like (3,), optional
        Rigid body whose kinetic energy is the metric of "modes"; inertia about the mass
        centre, in the frame of the analysis. Default the metric of the characteristic
        length.
    direction : array_like, shape (3,), optional
        A direction, besides x, y and z, along and about which the stiffness is given.
    T_m_n : array_like, shape (4, 4), optional
        Frame in which the analysis is given. The table of connections stays in M, since
        the kinematic connection does not move as a tensor.
    threshold : float
        Relative change above which the choice of connection matters.
    """

    length: float | None = None
    mass: float | None = None
    inertia: ArrayLike | None = None
    mass_centre: ArrayLike = (0.0, 0.0, 0.0)
    direction: ArrayLike | None = None
    T_m_n: ArrayLike | None = None
    threshold: float = asymmetries.THRESHOLD

    def metric(self, length: float) -> tuple[str, Array]:
        """Name and matrix of the metric of "modes", without a body that of a length."""
        if self.mass is None or self.inertia is None:
            return "length", length_metric(length)
        return "inertia", inertia_metric(self.mass, self.inertia, self.mass_centre)


def summarise(given: PostureMatrices, reading: Reading | None = None) -> dict[str, Any]:
    r"""Analyse one posture: ellipsoids, centres, screws, indices,
    and what the connection changes.

    Parameters
    ----------
    given : PostureMatrices
        Stiffness under each connection, load and compliance.
    reading : Reading, optional
        Frame, length, body and direction of the analysis.

    Returns
    -------
    dict
        Keys "connection", "symmetrised", "definiteness", "frame", "length", "stiffness",
        "compliance", "ellipsoids", "directions", "centres", "normal_form",
        "decoupling_frame", "eigenscrews", "wrench_compliant_axes",
        "twist_compliant_axes", "indices", "modes", "asymmetry", "connections", "notes".

    Raises
    ------
    UnknownNameError
        If the connection is not among the names.
    InputError
        If a shape is wrong or a number is not finite.
    """
    reading, notes = reading or Reading(), Notes()
    W, T = checked_vector(given.wrench, 6, "wrench"), reading.T_m_n
    name, stiffness = given.analysed, given.stiffness
    base = None if name is None else _moved(stiffness[name], None, move_stiffness)
    skewness = 0.0 if base is None else asymmetries.asymmetry_of(base, W).size
    compliance, inverse = _inverses(given, base, notes)
    # In the frame of the analysis: the pair that free others have, and the symmetric
    # parts.
    base = _moved(base, T, move_stiffness)
    free = inverse_pair(base, _moved(compliance, T, move_compliance))
    C = _moved(inverse, T, move_compliance)
    K, C = (None if matrix is None else symmetric_part(matrix) for matrix in (base, C))
    scale = characteristic_length(
        K, C, given=reading.length, mass=reading.mass, inertia=reading.inertia
    )
    if K is None:
        reason = "neither stiffness nor compliance exists here"
        if C is not None:
            reason = (
                "no stiffness matrix exists here; what follows comes from the "
                "compliance alone"
            )
        notes.add(UndefinedError(reason, code="no-stiffness"), "stiffness")
    metric = reading.metric(scale.value)
    pairs: dict[Others, MatrixPair] = {
        "held": MatrixPair(K, C),
        "free": MatrixPair(*free),
    }
    axes = {name: np.array(axis) for name, axis in _AXES.items()}
    if reading.direction is not None:
        axes["given"] = checked_unit(reading.direction)
    ellipsoids = _ellipsoids(pairs, notes)
    of_stiffness = {} if K is None else _of_stiffness(K, C, scale.value, metric, notes)
    minus = stiffness.get("A")
    predicted = None if minus is None else asymmetries.asymmetry_of(minus, W)
    compared = None
    if name is not None:
        compared = asymmetries.compare_connections(
            stiffness,
            reference=name,
            length=scale.value,
            threshold=reading.threshold,
            compliance=inverse,
        )
    answer: dict[str, Any] = plain(
        {
            "connection": name,
            "symmetrised": skewness > numerics.SYMMETRY,
            "definiteness": None,
            "frame": np.eye(4) if T is None else checked_pose(T, "frame"),
            "length": scale,
            "stiffness": K,
            "compliance": free[1],
            "ellipsoids": ellipsoids,
            "directions": _directions(pairs, axes),
            **dict.fromkeys(_OF_STIFFNESS),
            **of_stiffness,
            "asymmetry": section("asymmetry", predicted),
            "connections": compared,
            "notes": notes.entries,
        }
    )
    return answer


def _inverses(
    given: PostureMatrices, base: Array | None, notes: Notes
) -> tuple[ArrayLike | None, ArrayLike | None]:
    """Compliance of the analysed matrix, and the inverse of its symmetric part, in M."""
    compliance, inverse = given.compliance, given.inverse
    if given.is_singular:
        what = "stiffness is singular: it has no inverse"
        notes.add(UndefinedError(what, code="singular"), "compliance")
    elif compliance is None and base is not None:
        compliance = notes.attempt("compliance", invert, base)
    elif compliance is not None:
        compliance = checked_matrix(compliance, "compliance")
    if inverse is None:
        inverse = compliance
        if base is not None and not numerics.is_about_symmetric(base):
            inverted = numerics.invert(symmetric_part(base))
            inverse = None if inverted is None else inverted.matrix
    return compliance, inverse


def _moved(
    matrix: ArrayLike | None, T_m_n: ArrayLike | None, move: Callable[..., Array]
) -> Array | None:
    """A matrix, if there is one, checked and in the frame of the analysis."""
    if matrix is None:
        return None
    return checked_matrix(matrix) if T_m_n is None else move(matrix, T_m_n)


def _ellipsoids(pairs: Mapping[Others, MatrixPair], notes: Notes) -> dict[str, Any]:
    """Ellipsoids nested by quantity, freedom and others; `pairs` by the last."""
    found: dict[str, Any] = {}
    for quantity, freedom, others in product(_QUANTITIES, _FREEDOMS, pairs):
        what = f"{quantity} of {freedom}, others {others}"
        shape = notes.attempt(what, pairs[others].ellipsoid, freedom, others, quantity)
        found.setdefault(quantity, {}).setdefault(freedom, {})[others] = shape
    return found


def _directions(
    pairs: Mapping[Others, MatrixPair], axes: Mapping[str, Array]
) -> list[dict[str, Any]]:
    """Stiffness along and about lines through the origin.

    `pairs` by what other freedoms do.
    """
    rows: list[dict[str, Any]] = [
        {"name": n, "direction": axis} for n, axis in axes.items()
    ]
    u = np.array(list(axes.values()))
    kinds: tuple[tuple[str, Freedom], ...] = (
        ("along", "translation"),
        ("about", "rotation"),
    )
    for (kind, freedom), others in product(kinds, _OTHERS):
        found = pairs[others].on_axes(u, freedom, others)
        for row, x in zip(rows, found, strict=True):
            row.setdefault(kind, {})[others] = x
    return rows


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
)


def _of_stiffness(
    K: Array,
    C: Array | None,
    length: float,
    metric: tuple[str, Array],
    notes: Notes,
) -> dict[str, Any]:
    """Sections that need the stiffness matrix."""
    # A reading that does not exist leaves a note and None; the others are there.
    K = as_symmetric(K)
    points = centres_of(K, C)
    for what, reason in points.reasons.items():
        notes.add(reason, f"centre ({what.replace('_', ' ')})")
    screws = notes.attempt("eigenscrews", eigenscrews, K, C)
    wrenches = notes.attempt("wrench-compliant axes", wrench_compliant_axes, K, C)
    twists = notes.attempt("twist-compliant axes", twist_compliant_axes, K, C)
    indices = notes.attempt("indices", indices_of, K, length, C)
    best = notes.attempt("indices", best_conditioned_length, K, C)
    return {
        "definiteness": None if indices is None else indices.definiteness,
        "centres": section("centres", points),
        "normal_form": notes.attempt("normal form", normal_form, K, C),
        "decoupling_frame": notes.attempt("decoupling frame", decoupling_frame, K, C),
        "eigenscrews": screws
        and {
            "screws": [section("eigenscrews.screws", e, e.screw) for e in screws.screws],
            "complete": screws.complete,
            "complex_eigenvalues": [[z.real, z.imag] for z in screws.complex_eigenvalues],
        },
        "wrench_compliant_axes": _axes(wrenches),
        "twist_compliant_axes": _axes(twists),
        "indices": section("indices", indices, best),
        "modes": notes.attempt("modes", modes, K, metric[1], metric[0], C),
    }


def _axes(axes: Sequence[CompliantAxis] | None) -> list[Any] | None:
    if axes is None:
        return None
    return [section("wrench_compliant_axes", axis, axis.screw) for axis in axes]


def sections(
    r: PostureStiffness,
    reading: Reading,
    connection: str | None = None,
    at: ArrayLike | None = None,
    wrench: Array | None = None,
    load_at: Array | None = None,
) -> tuple[dict[str, Any], Notes]:
    """`summarise` with "frame", "load" and "deflection"; see `analyse_posture`."""
    here = r.at(at)
    name, stiffness = _matrices(r, here, connection)
    W = np.zeros(6) if here.wrench is None else here.wrench
    given = PostureMatrices(
        stiffness,
        W,
        name,
        here.compliances[name],
        here.pair(name, "held")[1],
        is_singular=stiffness[name] is not None and here.compliances[name] is None,
    )
    answer = summarise(given, reading)
    notes = Notes()
    notes.entries = answer.pop("notes")
    answer["frame"] = here.T_M_N.tolist()
    answer["load"] = plain(_load(r, name))
    point = here.T_M_N[:3, 3]
    force_at = point if load_at is None else load_at
    moved = deflection_found(r, name, wrench, force_at, point, notes)
    answer["deflection"] = None if moved is None else moved.to_dict()
    return answer, notes


def _matrices(
    r: PostureStiffness, here: StiffnessInFrame, connection: str | None
) -> tuple[str, dict[str, Array | None]]:
    """The analysed connection, and the matrices that it is compared with."""
    if connection is None:
        connection = "load" if r.is_loaded else "B"
    names = ["A", "B", "K", "F", *(["load"] if r.is_loaded else [])]
    if connection not in names:
        names.append(connection)
    return connection, {n: here.matrices[n] for n in names}


def _load(r: PostureStiffness, connection: str) -> dict[str, Any] | None:
    """The load about its own point, in M, and its behaviour while the body moves."""
    if r.wrench is None or not r.is_loaded:
        return None
    moment, force = r.wrench[:3] - np.cross(r.load.at, r.wrench[3:]), r.wrench[3:]
    return {
        "kind": r.load.kind,
        "meaning": r.load.words,
        "at": r.load.at,
        "moment": moment,
        "force": force,
        "is_tangent": is_tangent(r, connection),
    }
