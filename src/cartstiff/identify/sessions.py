r"""Frames of the measuring device: unknown in each session, and estimated with the springs.

A position of a session is ``T_s x`` of the one in the robot's base frame. A first T_s comes from
the positions of the rigid mechanism [Arun]_; what is left of it, a small translation t and turn w,
is in the regressor as ``u . (t + w x (p - c))`` for the direction u of a number and its place p.

Whether a table fits along other axes than it is said to be along: the rows are fitted once more
with loads and displacements along body, base or world, and with the displacements' axes exchanged
or turned round. The share of the measured numbers that is left, :math:`u^2 = \frac1m \sum (r_i /
s_i)^2` with s the root mean square of the lengths and of the angles, tells which axes fit. With as
many numbers and unknowns each way, the ratio of two u^2 is held against Fisher's distribution, for
all that were tried (Bonferroni).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import permutations, product

import numpy as np

from cartstiff import numerics
from cartstiff.arrays import Array
from cartstiff.errors import CartstiffError, InputError
from cartstiff.geometry import se3
from cartstiff.identify.fitting import Fit, Noise, fitted
from cartstiff.identify.linear_model import LinearModel, small_loads
from cartstiff.identify.loaded_model import needs_equilibrium
from cartstiff.identify.measurements import DISPLACEMENT, POSITION, ROTATION, TURN, Measurements
from cartstiff.identify.observations import Observations
from cartstiff.identify.unknowns import Unknowns
from cartstiff.notes import Note

#: What is unknown of a session's frame.
OFFSETS = ("none", "translation", "rigid")
# Other axes are looked for where more than this share is left; they are named where this many times
# less is left, which chance brings about less often than this.
_POOR, _SMALLER, _BY_CHANCE = 0.1, 3.0, 1e-4
# Rows of a long table that are looked at.
_MOST = 200
_FRAMES = ("base", "body", "world")
_Forces = dict[bytes, tuple[Array, Array, Array, Array]]


@dataclass(frozen=True, eq=False)
class Offsets:
    """Columns of the sessions' offsets.

    Attributes
    ----------
    columns : ndarray (m, S)
        In the regressor.
    names : tuple of str (S,)
        "session.tx" and so on.
    """

    columns: Array
    names: tuple[str, ...]


def nuisance_of(seen: Observations, measured: Measurements, kind: str) -> Offsets:
    """Columns of small offsets of all sessions; those that nothing feels are left out."""
    if not measured.session or kind == "none" or not seen.is_absolute.any():
        return Offsets(np.zeros((len(seen), 0)), ())
    sessions = np.array(measured.session)[seen.row]
    columns, names = [], []
    for name in dict.fromkeys(measured.session):
        mine = (sessions == name) & seen.is_absolute
        centre = (
            seen.place[mine & ~seen.is_angle].mean(axis=0)
            if np.any(mine & ~seen.is_angle)
            else np.zeros(3)
        )
        shift = np.where((mine & ~seen.is_angle)[:, None], seen.axis, 0.0)
        about = np.cross(seen.place - centre, seen.axis)
        turn = np.where(mine[:, None], np.where(seen.is_angle[:, None], seen.axis, about), 0.0)
        both = [shift, turn] if kind == "rigid" else [shift]
        for part, letter in zip(both, "tr", strict=False):
            for i, axis in enumerate("xyz"):
                if part[:, i].any():
                    columns.append(part[:, i])
                    names.append(f"{name}.{letter}{axis}")
    if not columns:
        return Offsets(np.zeros((len(seen), 0)), ())
    return Offsets(np.stack(columns, axis=1), tuple(names))


def aligned(measured: Measurements, points: Array) -> Measurements:
    """Positions and orientations of each session moved into the base frame of a rigid arm.

    Parameters
    ----------
    measured : Measurements
        With whole positions, or they are left as they are.
    points : ndarray (N, 3)
        The measured point of the rigid mechanism in the robot's base frame.

    Raises
    ------
    InputError
        For a session of fewer than three places.
    """
    if not measured.session or not all(name in measured.values for name in POSITION):
        return measured
    x = np.stack([measured.values[name] for name in POSITION], axis=1)
    has_turn = all(name in measured.values for name in TURN)
    turned = np.stack([measured.values[n] for n in TURN], axis=1) if has_turn else None
    sessions = np.array(measured.session)
    x = x.copy()
    for name in dict.fromkeys(measured.session):
        rows = np.flatnonzero((sessions == name) & ~np.isnan(x).any(axis=1))
        if not rows.size:
            continue
        T = _fit(x[rows], points[rows], name)
        x[rows] = x[rows] @ T[:3, :3].T + T[:3, 3]
        if turned is None:
            continue
        for n in rows[~np.isnan(turned[rows, 0])]:
            R = T[:3, :3] @ se3.from_roll_pitch_yaw(np.zeros(3), turned[n])[:3, :3]
            turned[n] = se3.roll_pitch_yaw(se3.pose(R))
    values = {**measured.values, **{name: x[:, i] for i, name in enumerate(POSITION)}}
    if turned is not None:
        values |= {name: turned[:, i] for i, name in enumerate(TURN)}
    return replace(measured, values=values)


def _fit(seen: Array, there: Array, session: str) -> Array:
    """Pose that moves points onto others with the least squares of distances."""
    a, b = seen.mean(axis=0), there.mean(axis=0)
    U, values, Vt = np.linalg.svd((seen - a).T @ (there - b))
    if not values[1] > numerics.RANK * max(values[0], numerics.TINY):
        raise InputError(
            f"the points of session {session!r} stand in one line: its frame is not known",
            where="column session",
            expected="three points that are not in line, or --offsets translation",
        )
    D = np.diag([1.0, 1.0, np.sign(np.linalg.det(Vt.T @ U.T))])
    R = Vt.T @ D @ U.T
    return se3.pose(R, b - R @ a)


def other_axes(
    unknowns: Unknowns, measured: Measurements, residual: Array, target: Array, offsets: str
) -> list[Note]:
    """A note on the axes along which the rows fit much better, if there are such.

    Parameters
    ----------
    unknowns : Unknowns
        What is fitted.
    measured : Measurements
        The rows, as they were declared.
    residual, target : ndarray (m,)
        Of the fit to them.
    offsets : str
        As in `identify`.
    """
    few = np.linalg.norm(residual) <= _POOR**2 * np.linalg.norm(target)
    if few or needs_equilibrium(unknowns.elements.elastic):
        return []
    if len(measured) > _MOST:
        measured = measured.chosen(np.unique(np.linspace(0, len(measured) - 1, _MOST).astype(int)))
    known: _Forces = {}
    declared = _left(unknowns, measured, offsets, known)
    if declared is None or declared[0] < _POOR:
        return []
    tried, count = [], 0
    for words, other in _others(unknowns, measured):
        count += 1
        if (misfit := _left(unknowns, other, offsets, known, declared[0])) is not None:
            tried.append((*misfit, words))
    if not tried:
        return []
    share, rms, freedom, words = min(tried)
    ratio = declared[0] / max(share, numerics.TINY)
    if ratio < _SMALLER or freedom < 1.0:
        return []
    from scipy.special import fdtrc

    if count * fdtrc(freedom, freedom, ratio**2) > _BY_CHANCE:
        return []
    passage = (
        f"the rows fit much better with {words}: residuals of {rms:.3g} instead of "
        f"{declared[1]:.3g} (rms); if so they were measured, the springs above are wrong"
    )
    return [Note("other-axes", passage, {"residual_rms": declared[1], "other_rms": rms})]


def _left(
    unknowns: Unknowns, measured: Measurements, offsets: str, known: _Forces, most: float = np.inf
) -> tuple[float, float, float] | None:
    """Share that is left, residual rms of lengths (else of angles), degrees of freedom.

    None where the first linear step leaves more than a share. `known` are forces at these postures.
    """
    try:
        model = small_loads(unknowns, measured)
        if isinstance(model, LinearModel):
            model = replace(model, known=known)
        seen = model.observations
        nuisance = nuisance_of(seen, measured, offsets).columns
        noise = Noise.of(seen.deviation, seen.is_angle)
        fit = fitted(model, unknowns, noise, nuisance=nuisance, once=True)
        share, rms = _share(seen, fit)
        if share > most:
            return None
        if not model.is_linear:
            fit = fitted(model, unknowns, noise, nuisance=nuisance)
            share, rms = _share(seen, fit)
    except CartstiffError:
        return None
    return share, rms, len(seen) - float(np.sum(fit.solved.leverage))


def _share(seen: Observations, fit: Fit) -> tuple[float, float]:
    """Share of the numbers that a fit leaves, and the residual rms of lengths (else of angles)."""
    scaled, rms = np.zeros(len(seen)), 0.0
    for angles in (True, False):
        mine = seen.is_angle == angles
        if mine.any():
            r = fit.solved.residual[mine]
            rms = float(np.sqrt(np.mean(r**2)))
            size = float(np.sqrt(np.mean(seen.target[mine] ** 2)))
            scaled[mine] = r / max(size, numerics.TINY)
    return float(np.sqrt(np.mean(scaled**2))), rms


def _others(unknowns: Unknowns, measured: Measurements) -> Iterator[tuple[str, Measurements]]:
    """The same rows along other axes, and words for these."""
    base = unknowns.elements.elastic.mechanism.base_pose[:3, :3]
    frames = [f for f in _FRAMES if f != "world" or not np.allclose(base, np.eye(3))]
    R = LinearModel(unknowns, measured).poses[:, :3, :3]
    turns = {"body": base.T @ R, "world": np.broadcast_to(base.T, R.shape)}
    declared = measured.axes if measured.axes in frames else "base"
    for load, seen in product(frames if measured.wrench.any() else [declared], frames):
        moved = _turned(measured, turns[seen]) if seen != "base" else measured
        if moved is None or (load, seen) == (declared, "base"):
            continue
        words = [f"loads along the {load}'s axes (--axes {load})"] * (load != declared)
        words += [f"displacements along the {seen}'s axes, not the base's"] * (seen != "base")
        yield " and ".join(words), replace(moved, axes=load)
    yield from _exchanged(measured)


def _turned(measured: Measurements, R: Array) -> Measurements | None:
    """Displacements (and the gauge's direction) along other axes, in those of the base."""
    values, is_turned = dict(measured.values), "d" in measured.values
    for names in (DISPLACEMENT, ROTATION):
        there = [name in values for name in names]
        if any(there) and not all(there):
            return None
        if all(there):
            vectors = np.stack([values[name] for name in names], axis=1)
            values |= dict(zip(names, np.einsum("nij,nj->in", R, vectors), strict=True))
            is_turned = True
    direction = np.einsum("nij,nj->ni", R, measured.direction)
    return replace(measured, values=values, direction=direction) if is_turned else None


def _exchanged(measured: Measurements) -> Iterator[tuple[str, Measurements]]:
    """Displacements with their axes exchanged or turned round, each way once."""
    moving = (*DISPLACEMENT, *ROTATION)
    known = set()
    for order, signs in product(permutations(range(3)), product((1.0, -1.0), repeat=3)):
        hand = float(np.linalg.det(np.eye(3)[list(order)] * np.array(signs)[:, None]))
        values = {n: v for n, v in measured.values.items() if n not in moving}
        spreads = {n: measured.deviations[n] for n in values}
        words = []
        for names, turn in ((DISPLACEMENT, 1.0), (ROTATION, hand)):
            for i, sign in enumerate(signs):
                if (name := names[i]) in measured.values:
                    to = names[order[i]]
                    values[to] = sign * turn * measured.values[name]
                    spreads[to] = measured.deviations[name]
                    if to != name or sign * turn < 0:
                        words.append(f"{name} as {'-' if sign * turn < 0 else ''}{to}")
        text = ", ".join(words)
        if text and text not in known:
            known.add(text)
            yield text, replace(measured, values=values, deviations=spreads)
