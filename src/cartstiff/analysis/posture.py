r"""Everything that can be read from the stiffness at one posture, as one dict of plain values.

To the sections of `cartstiff.analysis.summary`, which need only matrices, come those that need the
mechanism: deflection, joint stiffness for a target, uncertainty.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from cartstiff import numerics
from cartstiff.analysis import asymmetry as asymmetries
from cartstiff.analysis.mechanism_sections import (
    change_from_symmetric,
    deflection_section,
    target_section,
)
from cartstiff.analysis.plain import Notes, numbers, plain
from cartstiff.analysis.summary import summarise
from cartstiff.arrays import checked_input, checked_vector
from cartstiff.errors import (
    CartstiffError,
    InputError,
    UndefinedError,
    UnknownNameError,
    checked_kind,
)
from cartstiff.geometry.se3 import Array
from cartstiff.matrix_names import LETTERS
from cartstiff.stiffness.compute import PostureStiffness
from cartstiff.stiffness.posture import StiffnessInFrame

if TYPE_CHECKING:
    from cartstiff.analysis.tolerances import Tolerances, UncertainParameters
    from cartstiff.analysis.uncertainty import Propagation


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
    wrench_at: ArrayLike | None = None,
    target: ArrayLike | None = None,
    tolerances: Tolerances | None = None,
    samples: int = 0,
    threshold: float = asymmetries.THRESHOLD,
    springs: bool = True,
    progress: Callable[[int, int], None] | None = None,
) -> dict[str, Any]:
    r"""Analyse a mechanism at a posture, in any state.

    Parameters
    ----------
    result : PostureStiffness
        From `cartstiff.analyse`.
    connection : str, optional
        One of `cartstiff.matrix_names.LETTERS`: the matrix that is analysed. Default "load", the
        tangent under the load, where there is one; without a load all are the same and the default
        is B.
    length : float, optional
        Characteristic length in the mechanism's unit; see `summarise`.
    mass, inertia, mass_centre : float, array_like (3, 3), array_like (3,), optional
        A rigid body as the metric of "modes"; in the frame of the analysis, mass in
        force time^2 per length.
    at : array_like, shape (4, 4), optional
        ``T_M_N``: the frame N fixed to the body in which everything but "deflection" is given;
        the point of "deflection" is its origin. Every matrix moves there as a tensor: K^K stays
        that of M's origin, and the load acts where it does.
    direction : array_like, shape (3,), optional
        Direction in N along and about which the stiffness is given, besides x, y, z.
    wrench : array_like, shape (6,), optional
        Wrench (moment, force) in the axes of M added to the load, whose linear deflection is
        given; default the load itself, if there is one.
    wrench_at : array_like, shape (3,), optional
        Point in M at which the wrench acts; default the origin of N.
    target : array_like, shape (6, 6), optional
        Desired K^B in M, for which joint (or leg) stiffnesses are given.
    tolerances : Tolerances, optional
        Standard deviations of the parameters; without them those of measured springs count, where
        the mechanism has any.
    samples : int
        Draws for a Monte Carlo propagation of the tolerances; 0 propagates to first order.
    threshold : float
        Relative change above which the choice of connection matters.
    springs : bool
        Whether springs that give the matrix are looked for.
    progress : callable, optional
        Called with (done, total) while tolerances are propagated.

    Returns
    -------
    dict
        The keys of `summarise`, and "deflection", "uncertainty"; "synthesis" has "target". What
        was not asked for is None; what does not exist is None with a reason in "notes".

    Raises
    ------
    UnknownNameError
        For an unknown connection.
    InputError
        For a wrong shape or numbers that are not finite.
    """
    checked_kind(result, PostureStiffness, "posture", "what cartstiff.analyse answers")
    if connection is not None and connection not in LETTERS:
        raise UnknownNameError("connection", connection, LETTERS)
    if samples < 0 or samples == 1:
        raise InputError("samples cannot be used", expected="0, or 2 and more", got=samples)
    added = None if wrench is None else checked_input(wrench, (6,), "wrench")
    acts_at = None if wrench_at is None else checked_vector(wrench_at, 3, "point of the wrench")
    if acts_at is not None and added is None:
        raise InputError("the point of an added wrench needs the wrench", expected="both, or none")

    def sections(r: PostureStiffness, springs: bool) -> tuple[dict[str, Any], Notes]:
        here = r.at(at)
        name, stiffness = _matrices(r, here, connection)
        W = np.zeros(6) if here.wrench is None else here.wrench
        answer = summarise(
            stiffness,
            W,
            length,
            connection=name,
            compliance=here.compliances[name],
            inverse=here.pair(name, "held")[1],
            is_singular=stiffness[name] is not None and here.compliances[name] is None,
            mass=mass,
            inertia=inertia,
            mass_centre=mass_centre,
            direction=direction,
            threshold=threshold,
            springs=springs,
        )
        notes = Notes()
        notes.entries = answer.pop("notes")
        answer["frame"] = here.T_M_N.tolist()
        answer["load"] = plain(_load(r, name))
        point = here.T_M_N[:3, 3]
        force_at = point if acts_at is None else acts_at
        answer["deflection"] = plain(deflection_section(r, name, added, force_at, point, notes))
        return answer, notes

    if samples and tolerances is None and result.elastic.identified is None:
        raise InputError(
            "samples need tolerances to draw from",
            expected="both, or none",
            got=f"samples={samples}",
        )
    answer, notes = sections(result, springs)
    if answer["synthesis"] is not None or target is not None:
        section = None
        if target is not None:
            section = notes.attempt(
                "joint stiffness for the target", target_section, result, target
            )
        answer["synthesis"] = {**(answer["synthesis"] or {}), "target": plain(section)}
    answer["uncertainty"] = None
    if tolerances is not None or result.elastic.identified is not None:
        from cartstiff.analysis.tolerances import Tolerances, UncertainParameters

        tolerances = tolerances or Tolerances()  # measured springs bring their own
        parameters = UncertainParameters(result, tolerances)
        answer["uncertainty"] = plain(
            notes.attempt(
                "uncertainty",
                _uncertainty,
                parameters,
                numbers(answer),
                lambda r: numbers(sections(r, springs=False)[0], answer),
                samples,
                progress,
            )
        )
    answer["notes"] = notes.entries
    return answer


def _matrices(
    r: PostureStiffness, here: StiffnessInFrame, connection: str | None
) -> tuple[str, dict[str, Array | None]]:
    """What is analysed, and the matrices that it is compared with."""
    if connection is None:
        connection = "load" if r.is_loaded else "B"
    names = ["A", "B", "K", "F", *(["load"] if r.is_loaded else [])]
    if connection not in names:
        names.append(connection)
    return connection, {n: here.matrices[n] for n in names}


def _load(r: PostureStiffness, connection: str) -> dict[str, Any] | None:
    """The load about its own point, in M, and what it does while the body moves."""
    if r.wrench is None or not r.is_loaded:
        return None
    moment, force = r.wrench[:3] - np.cross(r.load.at, r.wrench[3:]), r.wrench[3:]
    missed = np.abs(r.change_by_load - change_from_symmetric(r, connection)).max()
    return {
        "kind": r.load.kind,
        "meaning": r.load.words,
        "at": r.load.at,
        "moment": moment,
        "force": force,
        "is_tangent": missed <= numerics.SYMMETRY * np.abs(r.change_by_load).max(),
    }


def _uncertainty(
    parameters: UncertainParameters,
    nominal: Mapping[str, Array],
    evaluate: Callable[[PostureStiffness], dict[str, Array]],
    samples: int,
    progress: Callable[[int, int], None] | None,
) -> dict[str, Any]:
    """Standard deviation and interval of every number of the analysis."""
    from cartstiff.analysis.uncertainty import propagate_first_order, propagate_monte_carlo

    named = parameters.named
    total = samples or 1 + 4 * len(named)
    done = 0

    def function(values: dict[str, float]) -> dict[str, Array]:
        nonlocal done
        done += 1
        if progress is not None:
            progress(done, total)
        values_there = evaluate(parameters.at(values))
        missing = {name: np.full(x.shape, np.nan) for name, x in nominal.items()}
        return {
            name: values_there[name]
            if name in values_there and values_there[name].shape == x.shape
            else missing[name]
            for name, x in nominal.items()
        }

    try:
        p: Propagation = (
            propagate_monte_carlo(
                function, named, samples=samples, correlation=parameters.correlation
            )
            if samples
            else propagate_first_order(
                function, named, correlation=parameters.correlation, degrees=parameters.degrees
            )
        )
    except InputError as error:
        raise UndefinedError(f"within the tolerances {error}", code="no-samples") from None
    except UndefinedError:
        raise
    except CartstiffError as error:
        raise UndefinedError(f"within the tolerances {error}", code="no-samples") from None
    entries: dict[str, Any] = {}
    shares = None if p.contributions is None else np.array(list(p.contributions.values()))
    at_nominal = [x for values in nominal.values() for x in values.flat]
    for i, (name, x) in enumerate(zip(p.names, at_nominal, strict=True)):
        if not np.isfinite(p.centre[i]):
            continue
        entry = {
            "nominal": x,
            "mean": None if p.mean is None else p.mean[i],
            "deviation": p.deviation[i],
            "lower": p.lower[i],
            "upper": p.upper[i],
        }
        if shares is not None and p.deviation[i] > 0:
            worst = int(np.argmax(shares[:, i]))
            entry |= {"main_parameter": list(named)[worst], "main_share": shares[worst, i]}
        entries[name] = entry
    return {
        "method": p.method,
        "level": p.level,
        "samples": p.samples,
        "failures": p.failures,
        "tolerances": parameters.tolerances,
        "left_out": parameters.left_out,
        "parameters": named,
        "numbers": entries,
    }
