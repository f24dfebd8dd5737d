"""Curves of a report: the displacement under the load, one joint at a time."""

from __future__ import annotations

import numpy as np

from cartstiff.answer.posture import parts_of_links
from cartstiff.core import numerics
from cartstiff.core.arrays import Array
from cartstiff.core.mechanisms.elastic import ElasticMechanism
from cartstiff.core.mechanisms.limits import limits_of
from cartstiff.core.stiffness.applied_load import LoadKind
from cartstiff.core.units import SI, Units, convert_length
from cartstiff.shown.page.report_parts import text
from cartstiff.shown.scene.scales import round_number
from cartstiff.wings.toolpaths.better import LoadedPostures

# Values along the sweep of a coordinate, and how far it goes: rad, or characteristic
# lengths.
_COUNT, _REACH = 21, 0.5
# Curves that have their names beside them.
_NAMED_CURVES = 14
_COLOURS = (
    "#2060c0",
    "#c04020",
    "#208040",
    "#8040a0",
    "#b08000",
    "#008090",
    "#c0307a",
    "#606060",
)

Sweeps = dict[str, tuple[Array, Array]]


def sweeps_of(
    elastic: ElasticMechanism, start: Array, wrench: Array, kind: LoadKind
) -> Sweeps:
    """Displacement of the tip under a wrench (6,) in the room over each coordinate;
    none for closed chains, whose coordinates do not move one by one.
    """
    mechanism, sweeps = elastic.mechanism, Sweeps()
    if mechanism.closures:
        return sweeps
    question = LoadedPostures.of(elastic, start, wrench, kind)
    posture, virtual = mechanism.at(start), parts_of_links(elastic)
    limits, length = limits_of(mechanism), posture.length
    limits = limits.leaving_out(
        limits.side(limits.values(posture.q, posture.pose), length)
    )
    for j, c in enumerate(mechanism.coordinates[:40]):
        if c.name in virtual:
            continue
        reach = _REACH * posture.coordinate_lengths[j]
        x = start[j] + reach * np.linspace(-1, 1, _COUNT)
        Q = np.tile(start, (_COUNT, 1))
        Q[:, j] = x
        moved = question.measures(Q).displacement
        moved[(x < min(c.lower, start[j])) | (x > max(c.upper, start[j]))] = np.nan
        if limits.legs is not None:  # coordinates are within theirs, legs need not be
            poses = np.array([mechanism.at(q).pose for q in Q])
            moved[limits.exceeded(limits.values(Q, poses))] = np.nan
        sweeps[c.name] = x, moved
    return sweeps


def _ticks(low: float, high: float, count: int = 5) -> Array:
    """Round numbers from low to high, about so many."""
    step = round_number((high - low) / count)
    steps = [k * step for k in (1.0, 2.0, 2.5, 5.0)]
    step = next((s for s in steps if (high - low) / s <= count), steps[-1])
    rounding = numerics.NEGLIGIBLE_DIFFERENCE
    ends = np.ceil(low / step - rounding), np.floor(high / step + rounding)
    return step * np.arange(ends[0], ends[1] + 1.0) + 0.0


def plot(swept: Sweeps, elastic: ElasticMechanism) -> str:
    """The sweeps as curves over the change of the coordinate,
    angles and lengths apart.
    """
    mm = convert_length(elastic.units, Units("mm", SI.force))[0]
    lengths = {c.name: c.is_length for c in elastic.mechanism.coordinates}
    finite = np.concatenate([y[np.isfinite(y)] for _, y in swept.values()])
    largest = 1.0
    if finite.any():
        largest = mm * float(np.quantile(finite, 0.98)) or 1.0
    rises = _ticks(0.0, 1.25 * largest, 4)
    top = float(rises[-1])
    plots, scales = [], {True: (mm, "mm"), False: (float(np.degrees(1.0)), "deg")}
    for is_length in sorted({lengths[name] for name in swept}):
        own = {n: xy for n, xy in swept.items() if lengths[n] is is_length}
        per, unit = scales[is_length]
        reach = per * max(float(np.ptp(x)) for x, _ in own.values()) / 2.0
        plots.append(_curves(own, per, unit, reach, mm, rises, top))
    return "".join(plots)


def _curves(
    swept: Sweeps,
    per: float,
    unit: str,
    reach: float,
    mm: float,
    rises: Array,
    top: float,
) -> str:
    """Curves (mm) over the change of coordinates,
    which is at most `reach` in its unit.
    """
    lines = [
        f'<path d="M50 {220 - 200 * x / top:.1f}h380" stroke="#ddd"/>'
        f'<text x="45" y="{224 - 200 * x / top:.1f}" text-anchor="end">{x:.4g}</text>'
        for x in rises
    ]
    lines += [
        f'<path d="M{240 + 190 * x / reach:.1f} 220v4" stroke="#888"/>'
        f'<text x="{240 + 190 * x / reach:.1f}" y="236" '
        f'text-anchor="middle">{x + 0.0:.4g}</text>'
        for x in _ticks(-reach, reach)
    ]
    for i, (name, (x, y)) in enumerate(swept.items()):
        known, middle = np.isfinite(y), 0.5 * (x[0] + x[-1])
        drawn = "".join(
            f"{'ML'[bool(k and known[k - 1])]}{240 + 190 * per * (x[k] - middle) / reach:.1f},"  # noqa: E501
            f"{max(220 - 200 * mm * y[k] / top, 10):.1f}"
            for k in np.flatnonzero(known)
        )
        colour = _COLOURS[i % len(_COLOURS)]
        lines.append(
            f'<path d="{drawn}" fill="none" stroke="{colour}" stroke-width="2"/>'
        )
        if i < _NAMED_CURVES:
            lines.append(
                f'<text x="440" y="{20 + 15 * i}" fill="{colour}">{text(name)}</text>'
            )
    lines.append(
        f'<text x="240" y="252" text-anchor="middle">change of the coordinate [{unit}], '
        "within "
        'the limits</text><text x="50" y="8">displacement of the tip [mm]</text>'
    )
    return (
        '<svg viewBox="0 0 620 258" width="620" height="258" font-size="11" '
        f'font-family="sans-serif" role="img">{"".join(lines)}</svg>'
    )
