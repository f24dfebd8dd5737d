"""From measurements to springs: the whole way."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from cartstiff.arrays import Array
from cartstiff.errors import CartstiffError, InputError, UnknownNameError
from cartstiff.identify.checks import checked, contradictions, inflation_of
from cartstiff.identify.fitting import Fit, Noise, fitted
from cartstiff.identify.linear_model import LinearModel, Model, small_loads
from cartstiff.identify.loaded_model import LoadedModel, model_of, needs_equilibrium
from cartstiff.identify.measurements import POSITION, TURN, Measurements
from cartstiff.identify.notes import notes_of
from cartstiff.identify.result import Identification, Rejected, estimates
from cartstiff.identify.robust import Robust, robust_fit
from cartstiff.identify.sessions import OFFSETS, aligned, nuisance_of, other_axes
from cartstiff.identify.unknowns import Unknowns, unknowns_of
from cartstiff.mechanisms.elastic import ElasticMechanism

FITS = ("plain", "robust")
# Compliances below this share of the mechanism's own, or above its inverse, are no place to begin.
_FAR = 1e-2
# Shares of the compliances with which a search begins where they are too soft for the loads.
_STIFFER = (0.5, 0.25, 0.1)


def identify(
    elastic: ElasticMechanism,
    measured: Measurements,
    *,
    sought: Sequence[str] = (),
    ties: Sequence[Sequence[str]] = (),
    known: Mapping[str, float] | None = None,
    priors: Mapping[str, tuple[float, float]] | None = None,
    offsets: Literal["none", "translation", "rigid"] | None = None,
    loaded: bool = False,
    fit: Literal["plain", "robust"] = "plain",
    reject: float | Literal["suspects"] | None = None,
    level: float = 0.95,
    progress: Callable[[int, float], None] | None = None,
) -> Identification:
    r"""Springs of a mechanism from measured loads and deflections, with honest intervals.

    Parameters
    ----------
    elastic : ElasticMechanism
        Its geometry is taken as known; its springs are where the search starts.
    measured : Measurements
        From `read_measurements`.
    sought, ties, known, priors
        What is to be found, see `cartstiff.identify.unknowns.unknowns_of`.
    offsets : {"rigid", "translation", "none"}, optional
        What is unknown of the measuring frame in each session, for measured positions; default
        "rigid" where the table has sessions. Without sessions, positions are in the robot's own
        base frame B.
    loaded : bool
        Fit the equilibrium under load itself, not displacements linear in the load.
    fit : {"plain", "robust"}
        Whose estimates are told first: least squares, or the robust fit, which is made anyway.
    reject : float or "suspects", optional
        Rows that are left out: those that the robust fit suspects, or those with a number
        beyond this many standard deviations from it.
    level : float
        Probability of the intervals.
    progress : callable, optional
        Called with the number of a step and the norm of the residuals over their deviations.

    Returns
    -------
    Identification
        Estimates with intervals, covariance, suspects, checks of the model, notes.

    Raises
    ------
    InputError
        For fewer numbers than unknowns, rows that contradict each other, and what cannot be used.
    ConvergenceError
        If the fit does not settle.
    """
    _check(offsets, measured, fit, reject, level)
    offsets = offsets or "rigid"
    unknowns = unknowns_of(elastic, sought, ties=ties, known=known, priors=priors)
    contradictions(measured)
    rows = measured.rows
    measured = _in_base(unknowns, measured, offsets)
    model, plain, robust = _fits(unknowns, measured, offsets, loaded, progress)
    rejected: tuple[Rejected, ...] = ()
    if reject is not None:
        drop = robust.suspects if reject == "suspects" else robust.beyond(float(reject))
        reasons = robust.reasons(model.observations, measured)
        rejected = tuple(Rejected(int(measured.rows[n]), reasons[n]) for n in drop)
        if rejected:
            keep = np.ones(len(measured), bool)
            keep[drop] = False
            measured = measured.chosen(keep)
            model, plain, robust = _fits(unknowns, measured, offsets, loaded, progress)
    chosen = robust.fit if fit == "robust" else plain
    seen = model.observations
    checks = checked(model, chosen, unknowns, measured, rows_in_fit(robust, fit, len(seen)))
    inflation = inflation_of(checks)
    springs = estimates(chosen.solved, unknowns, level, inflation)
    result = Identification(
        elastic,
        unknowns,
        measured,
        len(rows),
        rejected,
        model,
        chosen,
        plain,
        robust,
        tuple(springs),
        checks,
        level,
        fit,
        offsets,
        isinstance(model, LoadedModel),
        inflation,
    )
    doubts = other_axes(unknowns, measured, chosen.solved.residual, seen.target, offsets)
    return replace(result, notes=(*doubts, *notes_of(result)))


def rows_in_fit(robust: Robust, fit: str, count: int) -> NDArray[np.bool_]:
    """Which numbers the chosen fit rests on (m,)."""
    return robust.kept if fit == "robust" else np.ones(count, bool)


def _check(
    offsets: str | None,
    measured: Measurements,
    fit: str,
    reject: float | str | None,
    level: float,
) -> None:
    if offsets is not None and offsets not in OFFSETS:
        raise UnknownNameError("kind of offset", offsets, OFFSETS, where="--offsets")
    has_positions = any(name in measured.values for name in (*POSITION, *TURN))
    if offsets in ("rigid", "translation") and not (measured.session and has_positions):
        missing = "column session" if has_positions else "measured positions x, y, z"
        raise InputError(
            f"there is no {missing}: nothing has an offset", where="--offsets", got=offsets
        )
    if fit not in FITS:
        raise UnknownNameError("fit", fit, FITS, where="--fit")
    if not 0.0 < level < 1.0:
        raise InputError(
            "level cannot be used", where="--level", expected="between 0 and 1", got=level
        )
    if isinstance(reject, str) and reject != "suspects":
        raise InputError(
            "unknown rule",
            where="--reject",
            got=repr(reject),
            expected="suspects, or a number of standard deviations",
        )
    if isinstance(reject, float | int) and not reject >= 1.0:
        raise InputError(
            "rule cannot be used",
            where="--reject",
            got=reject,
            expected="suspects, or at least 1 standard deviation",
        )


def _in_base(unknowns: Unknowns, measured: Measurements, offsets: str) -> Measurements:
    """Positions in the robot's base frame, from the sessions' own frames."""
    if not measured.session or offsets != "rigid":
        return measured
    elastic = unknowns.elements.elastic
    poses = LinearModel(unknowns, measured).poses
    T_F_B = elastic.mechanism.base_pose
    in_room = poses[:, :3, 3] + poses[:, :3, :3] @ np.asarray(measured.point)
    points = (in_room - T_F_B[:3, 3]) @ T_F_B[:3, :3]
    return aligned(measured, points)


def _fits(
    unknowns: Unknowns,
    measured: Measurements,
    offsets: str,
    loaded: bool,
    progress: Callable[[int, float], None] | None,
) -> tuple[Model, Fit, Robust]:
    """The plain and the robust fit."""
    model = model_of(unknowns, measured, loaded)
    start = None
    seen = model.observations
    noise = Noise.of(seen.deviation, seen.is_angle)
    nuisance = nuisance_of(seen, measured, offsets).columns
    _check_count(len(seen), unknowns, nuisance.shape[1])
    if isinstance(model, LoadedModel):
        start = _at_rest(model, unknowns, _near(unknowns, measured, noise, nuisance))
    plain = fitted(model, unknowns, noise, nuisance=nuisance, start=start, progress=progress)
    robust = robust_fit(model, unknowns, noise, nuisance, plain)
    return model, plain, robust


def _at_rest(model: LoadedModel, unknowns: Unknowns, near: Array) -> Array:
    """Where every row comes to rest: near, else at the file's own, else at stiffer parameters."""
    own = unknowns.nominal
    stiffer = [np.where(unknowns.is_bounded, share * own, own) for share in _STIFFER]
    for start in (near, own, *stiffer):
        try:
            model.at(start)
        except CartstiffError:
            continue
        return start
    return own  # and the fit says which row does not


def _near(unknowns: Unknowns, measured: Measurements, noise: Noise, nuisance: Array) -> Array:
    """Where small loads would have the parameters, if that costs little, else the file's own."""
    if needs_equilibrium(unknowns.elements.elastic):
        return unknowns.nominal
    try:
        first = fitted(small_loads(unknowns, measured), unknowns, noise, nuisance=nuisance)
    except CartstiffError:  # no stiffness, or a law that does not reach so far
        return unknowns.nominal
    nominal = unknowns.nominal
    share = first.theta / nominal
    sound = ~unknowns.is_bounded | ((share > _FAR) & (share < 1.0 / _FAR))
    return np.where(first.solved.is_determined & sound, first.theta, nominal)


def _check_count(numbers: int, unknowns: Unknowns, offsets: int) -> None:
    priors = sum(u.prior is not None for u in unknowns.parameters)
    wanted = len(unknowns.parameters) + offsets
    if numbers + priors < wanted:
        raise InputError(
            "fewer numbers than unknowns",
            got=f"{numbers} measured",
            expected=f"at least {wanted} ({len(unknowns.parameters)} compliances"
            + (f", {offsets} offsets of sessions)" if offsets else ")"),
        )
