"""Modes and responses as text for people, and as figures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from cartstiff import numerics
from cartstiff.choices import AXES_WORDS, ORDERS
from cartstiff.errors import joined, one_line
from cartstiff.report.layout import (
    COSINES,
    body_frame,
    note_lines,
    number,
    percent,
    table,
    vector,
)
from cartstiff.stiffness.tensor import format_matrix
from cartstiff.units import Units, convert_length

if TYPE_CHECKING:
    from cartstiff.vibration.controllers import Impedance
    from cartstiff.vibration.modes import Modes
    from cartstiff.vibration.response import FrequencyResponse
    from cartstiff.vibration.sensitivities import (
        Accuracy,
        FrequencyInterval,
        Sensitivities,
    )


def describe_modes(
    modes: Modes, unloaded: Modes | None = None, extra: Sequence[str] = ()
) -> str:
    """Describe frequencies with their load, shapes, masses, nodal axes and notes.

    Parameters
    ----------
    modes : Modes
        Modes under the load.
    unloaded : Modes, optional
        Modes without the load, for comparison.
    extra : sequence of str
        Lines before the notes.
    """
    elastic, mechanism, units = (
        modes.elastic,
        modes.elastic.mechanism,
        modes.elastic.units,
    )
    weighed = modes.to_dict()["weighed"]
    masses = ", ".join(f"{part['name']} {part['mass']:.4g}" for part in weighed)
    lines = [
        f"{elastic.name}: {mechanism.kind}, {body_frame(mechanism)}, small undamped "
        "motions "
        f"about rest, {modes.load['words']}",
        _load(modes),
        f"Masses that move [kg]: {masses or 'none'}",
        "",
        "Frequencies in Hz",
        *_frequencies(modes, unloaded),
        "",
        "Share of each coordinate in the kinetic energy, in per cent",
        *_participation(modes),
        "",
        f"Screw axis of the body's motion, in its frame ({units.length})",
        *_axes(modes),
        *extra,
    ]
    return joined([*lines, *note_lines(modes.notes)]).rstrip()


def _load(modes: Modes) -> str:
    units, W = modes.elastic.units, modes.load["wrench"]
    if W is None or not any(W):
        return f"Load: {modes.load['meaning'] if W is None else 'none'}"
    return (
        f"Load: {modes.load['kind']}, moment {vector(W[:3])} {units.moment}, force "
        f"{vector(W[3:])} {units.force} about the frame's origin, in its axes; "
        f"{modes.load['meaning']}"
    )


def _hertz(value: float) -> str:
    return "unstable" if np.isnan(value) else "free" if value == 0.0 else f"{value:.6g}"


def _frequencies(modes: Modes, unloaded: Modes | None) -> list[str]:
    masses, total = modes.effective_masses, modes._momentum
    titles = ["mode", modes.load["words"]]
    if unloaded is not None:
        titles += ["unloaded", "change"]
    if masses is not None and total is not None:
        titles += [f"effective mass along {axis} [kg]" for axis in "xyz"]
    rows = []
    for i, f in enumerate(modes.frequencies):
        cells = [str(i + 1), _hertz(f)]
        if unloaded is not None:
            bare = unloaded.frequencies[i] if i < len(unloaded.frequencies) else np.nan
            change = f / bare - 1.0 if bare else None
            if change is not None and abs(change) < numerics.REPORTED_ERROR:
                change = 0.0  # accuracy of two eigenvalue problems
            cells += [_hertz(bare), percent(change)]
        if masses is not None and total is not None:
            cells += [number(m, 4, size=COSINES * total[1]) for m in masses[i]]
        rows.append(cells)
    return table(titles, rows)


#: Largest number of coordinates whose shares are all shown.
_MAX_COLUMNS = 8


def _participation(modes: Modes) -> list[str]:
    names, shares = modes.elastic.names, modes.participation
    if modes.posture.coordinates_are_pose:
        names = ("rx", "ry", "rz", "x", "y", "z")
    if len(names) <= _MAX_COLUMNS:
        rows = [
            [str(i + 1), *(f"{100 * s + 0.0:.1f}" for s in row)]
            for i, row in enumerate(shares)
        ]
        return table(["mode", *names], rows)
    lines = []
    for i, row in enumerate(shares):
        first = np.argsort(-row)[:4]
        words = ", ".join(
            f"{names[j]} {100 * row[j]:.0f}" for j in first if row[j] > 0.005
        )
        lines.append(f"  {i + 1:>3}  {words}")
    return lines


def _axes(modes: Modes) -> list[str]:
    lines, size = [], modes.posture.length
    for i, screw in enumerate(modes.nodal_axes):
        if not np.isfinite(screw.direction).all():
            words = "does not move"
        elif not np.isfinite(screw.pitch):
            words = f"moves along {vector(screw.direction)}"
        else:
            point = vector(screw.point, size=size)
            words = (
                f"about {vector(screw.direction, size=COSINES)} through {point}, pitch "
            )
            reach = max(size, float(np.linalg.norm(screw.point)))
            words += number(
                screw.pitch
                if abs(screw.pitch) > numerics.PRINTED_AS_ZERO * reach
                else 0.0,
                3,
            )
        lines.append(f"  {i + 1:>3}  {words}")
    return lines


def _list(values: np.ndarray) -> str:
    return " ".join(f"{_hertz(f):>9}" for f in values)


#: Entries of the diagonal of a stiffness matrix.
_DIAGONAL = ("m_x/r_x", "m_y/r_y", "m_z/r_z", "f_x/x", "f_y/y", "f_z/z")
#: Number of parameters listed, those with the largest effect.
_MAX_PARAMETERS = 20
#: Largest number of characters about missing parameters; the JSON has all of them.
_MAX_LEFT_OUT = 400


def describe_sensitivities(known: Sensitivities, units: Units) -> list[str]:
    """List changes of each frequency for one per cent of stiffnesses and masses,
    1 mm of lengths.

    Without frequencies the changes are those of the diagonal of K^K.
    """
    millimetre, _ = convert_length(Units("mm"), units)
    slopes, titles = (
        known.frequencies,
        [f"mode {i + 1}" for i in range(known.frequencies.shape[1])],
    )
    what = "change of each frequency in Hz"
    if not titles:
        slopes = np.diagonal(known.stiffness["K"], axis1=1, axis2=2)
        titles = [*_DIAGONAL]
        of = units.stiffness
        what = (
            f"change of the diagonal of K^K in {of['rotation']} and {of['translation']}"
        )
    rows = []
    for name, x, row, is_angle in zip(
        known.names, known.values, slopes, known.angles, strict=True
    ):
        group = name.partition(".")[0]
        unit, factor = ("per mrad", 1e-3) if is_angle else ("per mm", millimetre)
        if group in ("stiffness", "mass", "parameter"):
            unit, factor = ("per 1 %", 0.01 * x) if x else ("per unit", 1.0)
        rows.append((name, unit, factor * row))
    if not np.isfinite([entry[2] for entry in rows]).any():
        reason = "no stiffness matrix, and no frequency, exists at this posture"
        return ["", f"Sensitivities: none, as {reason}"]
    rows.sort(key=lambda entry: -float(np.nanmax(np.abs(entry[2]), initial=0.0)))
    lines = ["", f"Sensitivities: {what}"]
    sizes = np.nanmax([np.abs(entry[2]) for entry in rows], axis=0, initial=0.0)
    cells = [
        [
            name,
            unit,
            *(number(x, 3, size=size) for x, size in zip(shown, sizes, strict=True)),
        ]
        for name, unit, shown in rows[:_MAX_PARAMETERS]
    ]
    lines += table(["parameter", "", *titles], cells)
    if len(rows) > _MAX_PARAMETERS:
        lines.append(
            f"  {len(rows) - _MAX_PARAMETERS} more, which matter less, with --json"
        )
    if known.left_out:
        lines.append(f"  {one_line(known.left_out, _MAX_LEFT_OUT)}")
    return lines


def describe_accuracy(known: Accuracy, units: Units) -> list[str]:
    """List standard deviations of pose, stiffness and frequencies with the main
    contributors.
    """
    lines = [
        "",
        f"Accuracy to first order: standard deviations ({known.factor:.4g} of them hold "
        f"{100 * known.level:g} per cent), and who contributes to the variance",
    ]
    parts = [
        (
            "pose",
            ["turn x", "turn y", "turn z", "place x", "place y", "place z"],
            [units.angle] * 3 + [units.length] * 3,
        ),
        (
            "K",
            [f"K^K {entry}" for entry in _DIAGONAL],
            [units.stiffness["rotation"]] * 3 + [units.stiffness["translation"]] * 3,
        ),
        (
            "frequencies",
            [f"mode {i + 1}" for i in range(len(known.nominal.get("frequencies", ())))],
            ["Hz"] * len(known.nominal.get("frequencies", ())),
        ),
    ]
    rows = []
    for quantity, names, unit in parts:
        if quantity not in known.deviations:
            continue
        nominal, sd = known.nominal[quantity], known.deviations[quantity]
        for i, name in enumerate(names):
            at = (i, i) if sd.ndim == 2 else (i,)
            main = ", ".join(f"{who} {percent(x)}" for who, x in known.main(quantity, at))
            rows.append([name, unit[i], number(nominal[at]), number(sd[at], 3), main])
    lines += table(["", "unit", "nominal", "deviation", "contributors"], rows)
    if known.left_out:
        lines.append(f"  {one_line(known.left_out, _MAX_LEFT_OUT)}")
    return lines


def describe_intervals(modes: Modes, band: FrequencyInterval) -> list[str]:
    """List the interval of each frequency."""
    lines = [
        "",
        f"Intervals that hold {100 * band.level:g} per cent, in Hz, to first order",
    ]
    for i, (f, low, high) in enumerate(
        zip(modes.frequencies, band.low, band.high, strict=True)
    ):
        lines.append(f"  {i + 1:>3}  {_hertz(f)}  from {low:.6g} to {high:.6g}")
    return lines


def describe_response(
    response: FrequencyResponse, direction: ArrayLike | None
) -> list[str]:
    """List the largest value of each curve, and its values at both ends."""
    lines = [
        "",
        f"Response: {response.kind} in {response.unit}, "
        f"{response.frequencies[0]:.6g} to {response.frequencies[-1]:.6g} Hz",
    ]
    for name, values in response.curves(direction).items():
        size = np.abs(values)
        if not np.isfinite(size).any():
            continue
        top = int(np.nanargmax(size))
        lines.append(
            f"  {name:<10} {size[0]:.4g} at the start, largest {size[top]:.4g} at "
            f"{response.frequencies[top]:.6g} Hz, {size[-1]:.4g} at the end"
        )
    return lines + [f"  {note}" for note in response.notes]


def describe_impedance(
    answer: Impedance, shown: Mapping[str, Any], units: Units
) -> list[str]:
    """Describe stiffness and damping for a controller, and the result of the
    square-root rule.
    """
    turning, moving = (
        f"{units.moment}/rad | {units.force}",
        f"{units.force}/rad | {units.stiffness['translation']}",
    )
    rows = [turning] * 3 + [moving] * 3
    if shown["order"] == ORDERS[1]:
        rows = [f"{units.stiffness['translation']} | {units.force}/rad"] * 3
        rows += [f"{units.force} | {units.moment}/rad"] * 3
    lines = [
        "",
        f"Impedance controller: order {shown['order']}, {AXES_WORDS[shown['axes']]}, "
        "about the "
        f"origin of {shown['about']!r}",
        "  stiffness",
        *format_matrix(np.array(shown["stiffness"]), [f"[{row}]" for row in rows]).split(
            "\n"
        ),
        "  damping by double diagonalisation; units of the stiffness times s",
        *format_matrix(np.array(shown["damping"]), [""] * 6).split("\n"),
        f"  closed loop without damping  {_list(answer.frequencies)} Hz",
        "  by square roots instead the ratios are "
        + " ".join(f"{x:.3g}" for x in answer.ratios)
        + f", and {percent(answer.coupling)} couples them",
    ]
    K = answer.joint_stiffness
    aside = np.linalg.norm(K - np.diag(np.diag(K)))
    left = float(aside) / max(float(np.linalg.norm(K)), numerics.TINY)
    lines.append(
        f"  joints: J^T K J and J^T D J, {len(K)}x{len(K)}, in --json and -o; gains of "
        "single "
        f"joints, the diagonal, leave out {percent(left)}"
    )
    for z, m in zip(answer.null_motions, answer.null_masses, strict=True):
        lines.append(
            f"  null motion {vector(z, 2, size=1.0)} of the joints: no stiffness, no "
            "damping; with "
            f"a stiffness k of its own 2 ratio sqrt({m:.3g} k) damps it"
        )
    if answer.dropped:
        lines.append(f"  antisymmetric part dropped: {percent(answer.dropped)}")
    return lines
