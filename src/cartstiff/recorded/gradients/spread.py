"""The analysis of a posture: all its numbers, and how far they are uncertain.

Spreads follow to first order from exact derivatives of the matrices.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from cartstiff.answer.analysis import asymmetry as asymmetries
from cartstiff.answer.analysis.posture import Reading, sections, target_section
from cartstiff.answer.analysis.sections import numbers
from cartstiff.core import numerics
from cartstiff.core.arrays import (
    Array,
    NamedArrays,
    checked_input,
    checked_vector,
    plain,
)
from cartstiff.core.checked_call import checked
from cartstiff.core.errors import (
    CartstiffError,
    InputError,
    UndefinedError,
    UnknownNameError,
    checked_kind,
)
from cartstiff.core.matrix_names import LETTERS
from cartstiff.core.stiffness.compute import PostureStiffness

if TYPE_CHECKING:
    from cartstiff.answer.analysis.parameters import Parameters
    from cartstiff.answer.analysis.tolerances import Tolerances


@checked
def analyse_posture(
    result: PostureStiffness,
    *,
    connection: str | None = None,
    length: float | None = None,
    mass: float | None = None,
    inertia: ArrayLike | None = None,
    mass_centre: ArrayLike = (0.0, 0.0, 0.0),
    at: ArrayLike | None = None,
    direction: ArrayLike | None = None,
    wrench: ArrayLike | None = None,
    load_at: ArrayLike | None = None,
    target: ArrayLike | None = None,
    tolerances: Tolerances | None = None,
    threshold: float = asymmetries.THRESHOLD,
    progress: Callable[[int, int], None] | None = None,
) -> dict[str, Any]:
    r"""Analyse a mechanism at a posture, in any state.

    Parameters
    ----------
    result : PostureStiffness
        From `cartstiff.analyse`.
    connection : str, optional
        Letter of the matrix that is analysed. One of load, A, B, K, F and +; default
        under a load: load, the tangent stiffness under it; without a load all are the
        same, and it is B.
    length : float, optional
        Characteristic length, which makes angles comparable with lengths; default that of
        the rigid body, if one is given, else the natural length, else one unit.
    mass, inertia, mass_centre : float, array_like (3, 3), array_like (3,), optional
        A rigid body as the metric of "modes"; in the frame of the analysis, mass in
        force time^2 per length.
    at : array_like, shape (4, 4), optional
        ``T_M_N``: the frame N fixed to the body in which everything but "deflection" is
        given; the point of "deflection" is its origin. Every matrix moves there as a
        tensor: K^K stays that of M's origin, and the load acts where it does.
    direction : array_like, shape (3,), optional
        Direction for stiffness along and about it, besides x, y, z; in the axes of the
        analysis.
    wrench : array_like, shape (6,), optional
        Wrench added to the load, whose linear deflection is given: moment and force, in
        the axes of M; default the load itself, if there is one.
    load_at : array_like, shape (3,), optional
        Point of the body, in M, at which that wrench acts; default the point that is
        analysed.
    target : array_like, shape (6, 6), optional
        Desired symmetric part of the analysed matrix (see `connection`) in M, for which
        joint (or leg) stiffnesses are given.
    tolerances : Tolerances, optional
        Standard deviations: relative of every spring stiffness, absolute of every length
        and rotation [rad] of the geometry. Without them those of measured springs count,
        where the mechanism has any.
    threshold : float
        Relative change above which the choice of connection matters.
    progress : callable, optional
        Called with (done, total) while tolerances are propagated.

    Returns
    -------
    dict
        The keys of `summarise`, and "deflection", "uncertainty", "synthesis" with
        "target". Optional results are None by default; one that does not exist is None
        with a reason in "notes".

    Raises
    ------
    UnknownNameError
        For an unknown connection.
    InputError
        For a wrong shape or numbers that are not finite.
    """
    # The reader's wishes, before anything is computed.
    checked_kind(result, PostureStiffness, "posture", "what cartstiff.analyse answers")
    if connection is not None and connection not in LETTERS:
        raise UnknownNameError("connection", connection, LETTERS)
    added = None if wrench is None else checked_input(wrench, (6,), "wrench")
    acts_at = (
        None if load_at is None else checked_vector(load_at, 3, "point of the wrench")
    )
    if acts_at is not None and added is None:
        raise InputError(
            "the point of an added wrench needs the wrench", expected="both, or none"
        )

    reading = Reading(length, mass, inertia, mass_centre, direction, threshold=threshold)

    # Everything that is read from the matrices of one posture; tolerances read it again.
    asked = (reading, connection, at, added, acts_at)
    answer, notes = sections(result, *asked)
    answer["wrenches"] = [one.to_dict() for one in result.wrenches]
    answer["synthesis"] = None
    if target is not None:
        found = notes.attempt(
            "joint stiffness for the target", target_section, result, target, connection
        )
        answer["synthesis"] = {"target": plain(found)}
    answer["uncertainty"] = None
    if tolerances is not None or result.elastic.identified is not None:
        from cartstiff.answer.analysis.tolerances import Tolerances

        answer["uncertainty"] = plain(
            notes.attempt(
                "uncertainty",
                _uncertainty,
                result,
                tolerances or Tolerances(),  # measured springs bring their own
                numbers(answer),
                lambda r: numbers(sections(r, *asked)[0], answer),
                progress,
            )
        )
    answer["notes"] = notes.entries
    return answer


def _uncertainty(
    result: PostureStiffness,
    tolerances: Tolerances,
    nominal: Mapping[str, Array],
    evaluate: Callable[[PostureStiffness], dict[str, Array]],
    progress: Callable[[int, int], None] | None,
) -> dict[str, Any]:
    """Standard deviation and interval of every number of the analysis."""
    from cartstiff.answer.analysis.parameters import Parameters
    from cartstiff.answer.analysis.tolerances import Uncertain, shares_of

    parameters = Parameters(result)
    uncertain, here = Uncertain.of(parameters, tolerances), [*nominal.values()]

    def seen(r: PostureStiffness) -> list[Array]:
        # Numbers that do not exist at another value have no derivative.
        found = evaluate(r)
        each = [(found.get(name, np.zeros(0)), x) for name, x in nominal.items()]
        return [there if there.shape == x.shape else x * np.nan for there, x in each]

    slopes = _slopes(parameters, uncertain.names, seen, here, progress)
    deviations, shares = shares_of(uncertain.variances(slopes))
    level = 0.95
    factor = uncertain.factor(level)
    each_name = [
        f"{name}[{', '.join(map(str, index))}]" if index else name
        for name, x in nominal.items()
        for index in np.ndindex(x.shape)
    ]
    values = np.concatenate([x.ravel() for x in here])
    entries: dict[str, Any] = {}
    for i in np.flatnonzero(np.isfinite(values)):
        x, deviation = values[i], deviations[i]
        entry = entries[each_name[i]] = {
            "nominal": x,
            "deviation": deviation,
            "lower": x - factor * deviation,
            "upper": x + factor * deviation,
        }
        if deviation > 0:
            worst = int(np.argmax(shares[:, i]))
            entry |= {
                "main_parameter": uncertain.names[worst],
                "main_share": shares[worst, i],
            }
    each_value = zip(uncertain.names, uncertain.deviations, strict=True)
    return {
        "level": level,
        "tolerances": tolerances,
        "left_out": parameters.left_out if tolerances.moves else None,
        "parameters": {
            name: {"nominal": parameters.value(name), "deviation": deviation}
            for name, deviation in each_value
        },
        "numbers": entries,
    }


def _slopes(
    parameters: Parameters,
    names: Sequence[str],
    seen: Callable[[PostureStiffness], list[Array]],
    here: list[Array],
    progress: Callable[[int, int], None] | None,
) -> Array:
    """Derivatives (p, ...) of all numbers by some parameters: along exact ones of the
    matrices, or by analysing the posture again where these are not recorded.
    """
    from cartstiff.recorded.gradients.exact import slopes_of_matrices

    result, exact = parameters.result, slopes_of_matrices(parameters, names)
    slopes = list[Array]()
    for done, name in enumerate(names):
        try:
            if exact is None:
                each = parameters.quotient(name, seen, here).slopes
            else:
                each = _along(result, {n: x[done] for n, x in exact.items()}, seen)
        except UndefinedError:
            raise
        except CartstiffError as error:
            words = f"within the tolerances {error}"
            raise UndefinedError(words, code="no-samples") from None
        slopes.append(np.concatenate([x.ravel() for x in each]))
        if progress is not None:
            progress(done + 1, len(names))
    return np.array(slopes)


def _along(
    result: PostureStiffness,
    own: Mapping[str, Array],
    seen: Callable[[PostureStiffness], list[Array]],
) -> list[Array]:
    """Derivatives of all numbers along `own` ones of the matrices.

    Every number follows from K^B, K^F and the wrench, which are moved without another
    analysis of the mechanism.
    """
    sizes = np.repeat([1.0, result.length], 3)
    energies = np.outer(sizes, sizes)
    most = float(np.abs(np.asarray(result.matrices["B"]) * energies).max())
    changes = [own["wrench"] * sizes / result.length]
    changes += [x * energies for name, x in own.items() if name != "wrench"]
    # Some numbers, as the place of the base, change nothing.
    largest = max(float(np.abs(x).max()) for x in changes)
    step = numerics.DIFFERENCE_STEP * most / (largest or most)
    ahead, behind = (seen(_changed(result, own, h)) for h in (step, -step))
    return [(x - y) / (2.0 * step) for x, y in zip(ahead, behind, strict=True)]


def _changed(
    result: PostureStiffness, slopes: Mapping[str, Array], step: float
) -> PostureStiffness:
    """The posture with matrices and a wrench moved along their derivatives."""
    K_F, W = result.matrices["F"], result.wrench
    W = np.zeros(6) if W is None else W + step * slopes["wrench"]
    K = np.asarray(result.matrices["B"]) + step * slopes["stiffness_B"]
    A, of_K, load = K + result.load.changes(W)
    F = None if K_F is None else K_F + step * slopes["stiffness_F"]
    own = {"A": A, "B": K, "K": of_K, "F": F}
    inverses = {n: None if X is None else np.linalg.inv(X) for n, X in own.items()}
    known = {part.name: getattr(result, part.name) for part in fields(result)}
    return PostureStiffness.of_numbers(
        {
            **known,
            "matrices": NamedArrays(own, {"load": load}),
            "compliances": NamedArrays(inverses, {"load": np.linalg.inv(load)}),
            "inverse_of_symmetric_tangent": np.linalg.inv(0.5 * (load + load.T)),
            "wrench": None if result.wrench is None else W,
            "is_loaded": result.is_loaded,
        }
    )
