"""The answer on vibrations: modes, and what was asked beside them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from cartstiff.answer.data import (
    COSINES,
    Answer,
    Column,
    Quantity,
    Statement,
    Table,
    rounded,
    said,
    table,
)
from cartstiff.answer.posture import load_of
from cartstiff.core import numerics
from cartstiff.core.choices import AXES_WORDS, ORDERS
from cartstiff.core.errors import one_line
from cartstiff.core.units import Units, convert_length

if TYPE_CHECKING:
    from cartstiff.answer.vibration.controllers import Impedance
    from cartstiff.answer.vibration.modes import Modes
    from cartstiff.answer.vibration.response import FrequencyResponse
    from cartstiff.answer.vibration.sensitivities import (
        Accuracy,
        FrequencyInterval,
        Sensitivities,
    )

#: Largest number of coordinates whose shares are all listed, and the least of more that
#: is.
_MAX_COLUMNS, _LEAST_SHARE = 8, 0.005
#: Entries of the diagonal of a stiffness matrix.
_DIAGONAL = ("m_x/r_x", "m_y/r_y", "m_z/r_z", "f_x/x", "f_y/y", "f_z/z")
#: Number of parameters listed, those with the largest effect.
_MAX_PARAMETERS = 20
#: Largest number of characters about missing parameters; the JSON has all of them.
_MAX_LEFT_OUT = 400


def answer_of_modes(
    modes: Modes, unloaded: Modes | None, more: Iterable[Table] = ()
) -> Answer:
    """Frequencies with their load, shapes and nodal axes.

    Parameters
    ----------
    modes : Modes
        Modes under the load.
    unloaded : Modes or None
        Modes without the load, for comparison.
    more : iterable of Table
        What was asked beside them.
    """
    masses = {part["name"]: part["mass"] for part in modes.to_dict()["weighed"]}
    tables = _frequencies(modes, unloaded), _participation(modes), _axes(modes)
    return Answer.about_mechanism(
        "modes",
        modes.elastic,
        modes.notes,
        _state(modes),
        about=[
            said("swinging", load=modes.load["words"]),
            said("moving-masses", masses=masses or "none"),
        ],
        load=load_of(modes.result) if modes.result is not None else None,
        tables=[*tables, *more],
    )


def _state(modes: Modes) -> Statement:
    """The motions that grow or are free; without any the lowest frequency."""
    hertz = modes.frequencies
    growing, free = int(np.isnan(hertz).sum()), int((hertz == 0.0).sum())
    if growing or free:
        code = ("free-modes", "unstable-modes")[growing > 0]
        return said(code, all=len(hertz), count=growing or free)
    lowest = Quantity(float(hertz.min()), "Hz")
    return said("lowest-frequency", frequency=lowest, mode=int(hertz.argmin()) + 1)


def _hertz(values: Iterable[float]) -> Iterator[float | str]:
    """Frequencies, or the words for motions without one."""
    for value in values:
        yield "unstable" if np.isnan(value) else float(value) or "free"


def _frequencies(modes: Modes, unloaded: Modes | None) -> Table:
    """Each frequency, that without the load, and the masses that move with it."""
    hertz, count = modes.frequencies, len(modes.frequencies)
    heads = f"mode | {modes.load['words']} [Hz] : 6"
    cells: list[Iterable[Any]] = [range(1, count + 1), _hertz(hertz)]
    if unloaded is not None:
        bare = np.append(unloaded.frequencies, np.full(count, np.nan))[:count]
        with numerics.silent():
            change = hertz / bare - 1.0
        # accuracy of two eigenvalue problems
        change[np.abs(change) < numerics.REPORTED_ERROR] = 0.0
        heads += " | unloaded [Hz] : 6 | change : %"
        cells += [_hertz(bare), change.tolist()]
    masses, total = modes.effective_masses, modes._momentum
    if masses is not None and total is not None:
        heads += "".join(f" | effective mass along {axis} [kg] : 4" for axis in "xyz")
        cells += [rounded(m, COSINES * total[1]) for m in masses.T]
    return table("frequencies", heads, zip(*cells, strict=True))


def _participation(modes: Modes) -> Table:
    """Share of each coordinate in the kinetic energy, in per cent."""
    names, shares = modes.elastic.names, 100.0 * modes.participation
    if modes.posture.coordinates_are_pose:
        names = ("rx", "ry", "rz", "x", "y", "z")
    if len(names) <= _MAX_COLUMNS:
        heads = [Column("mode"), *(Column(name, form="1f") for name in names)]
        return table("energies", heads, _numbered(*shares.T.tolist()))
    largest = [
        {names[j]: own[j] for j in np.argsort(-own)[:4] if own[j] > 100.0 * _LEAST_SHARE}
        for own in shares
    ]
    return table("energies", " | : 0f<", _numbered(largest))


def _numbered(*columns: Iterable[Any]) -> Iterator[tuple[Any, ...]]:
    """Rows of columns, with their numbers."""
    return ((i, *row) for i, row in enumerate(zip(*columns, strict=True), 1))


def _axes(modes: Modes) -> Table:
    """The screw axis of the body in each mode, in its frame."""
    motions, units, size = list[Statement](), modes.elastic.units, modes.posture.length
    for screw in modes.nodal_axes:
        along = Quantity(rounded(screw.direction, COSINES), "1")
        if not np.isfinite(screw.direction).all():
            motions.append(said("mode-still"))
        elif not np.isfinite(screw.pitch):
            motions.append(said("mode-slides", direction=along))
        else:
            reach = max(size, numerics.norm(screw.point))
            point = Quantity(rounded(screw.point, size), units.length)
            (pitch,) = rounded([screw.pitch], reach)
            own = {"point": point, "pitch": Quantity(pitch, units.pitch)}
            motions.append(said("mode-turns", direction=along, **own))
    return table("axes", " | : <", _numbered(motions))


def _left_out(names: str | None) -> list[Statement]:
    """The parameters that are missing."""
    return [said("left-out", names=one_line(names, _MAX_LEFT_OUT))] if names else []


def sensitivity_table(known: Sensitivities, units: Units) -> Table:
    """Changes of each frequency for one per cent of stiffnesses and masses,
    1 mm of lengths.

    Without frequencies the changes are those of the diagonal of K^K.
    """
    millimetre, _ = convert_length(Units("mm"), units)
    slopes, name = known.frequencies, "sensitivities of frequencies"
    heads = [f"mode {i + 1}" for i in range(slopes.shape[1])]
    if not heads:
        slopes, heads = np.diagonal(known.stiffness["K"], axis1=1, axis2=2), [*_DIAGONAL]
        name = "sensitivities of stiffness"
    rows: list[tuple[str, str, Any]] = []
    for own, x, slope, is_angle in zip(
        known.names, known.values, slopes, known.angles, strict=True
    ):
        unit, factor = (("per mm", millimetre), ("per mrad", 1e-3))[is_angle]
        if own.partition(".")[0] in ("stiffness", "mass", "preload", "parameter"):
            unit, factor = ("per 1 %", 0.01 * x) if x else ("per unit", 1.0)
        rows.append((own, unit, factor * slope))
    changes = np.array([change for *_, change in rows])
    if not np.isfinite(changes).any():
        return table("no sensitivities", (), ())
    sizes = np.abs(changes)
    changes[sizes < numerics.PRINTED_AS_ZERO * np.nanmax(sizes, axis=0, initial=0.0)] = (
        0.0
    )
    # Equal effects, as those of a symmetric machine's legs, stay in its order.
    largest = np.nanmax(sizes, axis=1, initial=0.0)
    order = np.argsort(-np.round(largest / (largest.max() or 1.0), 9), kind="stable")
    shown = [(*rows[i][:2], *changes[i].tolist()) for i in order[:_MAX_PARAMETERS]]
    columns = [Column("parameter"), Column(""), *(Column(h, form="3") for h in heads)]
    more = said("more-parameters", count=len(rows) - len(shown))
    below = [more] * (len(rows) > len(shown)) + _left_out(known.left_out)
    return table(name, columns, shown, *below, **units.stiffness)


def accuracy_table(known: Accuracy, units: Units) -> Table:
    """Standard deviations of pose, stiffness and frequencies with the main
    contributors.
    """
    count, of = len(known.nominal.get("frequencies", ())), units.stiffness
    parts = {
        "pose": [f"{what} {axis}" for what in ("turn", "place") for axis in "xyz"],
        "K": [f"K^K {entry}" for entry in _DIAGONAL],
        "frequencies": [f"mode {i + 1}" for i in range(count)],
    }
    unit = {
        "pose": [units.angle] * 3 + [units.length] * 3,
        "K": [of["rotation"]] * 3 + [of["translation"]] * 3,
        "frequencies": ["Hz"] * count,
    }
    rows = list[tuple[Any, ...]]()
    for quantity in parts.keys() & known.deviations.keys():
        nominal, sd = known.nominal[quantity], known.deviations[quantity]
        for i, name in enumerate(parts[quantity]):
            at = (i,) * sd.ndim
            numbers = float(nominal[at]), float(sd[at])
            rows.append(
                (name, unit[quantity][i], *numbers, dict(known.main(quantity, at)))
            )
    return table(
        "accuracy",
        " | unit | nominal | deviation : 3 | contributors : %",
        rows,
        *_left_out(known.left_out),
        factor=known.factor,
        level=100.0 * known.level,
    )


def interval_table(modes: Modes, band: FrequencyInterval) -> Table:
    """The interval of each frequency."""
    rows = _numbered(_hertz(modes.frequencies), band.low.tolist(), band.high.tolist())
    heads = "mode | frequency [Hz] : 6 | from [Hz] : 6 | to [Hz] : 6"
    return table("intervals", heads, rows, level=100.0 * band.level)


def response_table(response: FrequencyResponse, direction: ArrayLike | None) -> Table:
    """The largest value of each curve, and its values at both ends."""
    hertz, rows = response.frequencies.tolist(), list[tuple[Any, ...]]()
    for name, values in response.curves(direction).items():
        size = np.abs(values)
        if np.isfinite(size).any():
            top, ends = int(np.nanargmax(size)), size.tolist()
            rows.append((name, ends[0], ends[top], hertz[top], ends[-1]))
    return table(
        "response",
        " | at the start : 4 | largest : 4 | at [Hz] : 6 | at the end : 4",
        rows,
        *(said("noted", note=note) for note in response.notes),
        kind=response.kind,
        unit=response.unit,
        low=Quantity(hertz[0], "Hz"),
        high=Quantity(hertz[-1], "Hz"),
    )


def impedance_tables(
    answer: Impedance, shown: Mapping[str, Any], units: Units
) -> list[Table]:
    """Stiffness and damping for a controller, and the result of the square-root rule."""
    # Units of a row: moments above forces, or the other way round in the other order.
    stiff = units.stiffness["translation"]
    rows = [f"[{units.moment}/rad | {units.force}]"] * 3
    rows += [f"[{units.force}/rad | {stiff}]"] * 3
    if shown["order"] == ORDERS[1]:
        rows = [f"[{stiff} | {units.force}/rad]"] * 3
        rows += [f"[{units.force} | {units.moment}/rad]"] * 3
    # Gains of single joints leave out what couples joints: how much that is.
    K = answer.joint_stiffness
    aside = numerics.norm(K - np.diag(np.diag(K)))
    left_out = aside / max(numerics.norm(K), numerics.TINY)
    # What the controller will do: frequencies, damping ratios, motions of the arm itself.
    below = [
        said("closed-loop", frequencies=[*_hertz(answer.frequencies)]),
        said("square-roots", ratios=answer.ratios.tolist(), coupling=answer.coupling),
        said("joint-gains", count=len(K), left_out=left_out),
        *(
            said("null-motion", motion=Quantity(rounded(z, 1.0), "1"), mass=float(m))
            for z, m in zip(answer.null_motions, answer.null_masses, strict=True)
        ),
        *[said("antisymmetric-part", share=answer.dropped)] * bool(answer.dropped),
    ]
    about = {"order": shown["order"], "about": shown["about"]}
    return [
        table("impedance", (), (), **about, axes=AXES_WORDS[shown["axes"]]),
        _matrix("impedance stiffness", shown["stiffness"], rows),
        _matrix("impedance damping", shown["damping"], [""] * 6, *below),
    ]


def _matrix(
    name: str, matrix: ArrayLike, units: Sequence[str], *below: Statement
) -> Table:
    """A matrix with the unit of each row behind it."""
    M = np.array(matrix, float)
    M[np.abs(M) < numerics.ROUNDOFF_OF_SUMS * numerics.largest(M)] = 0.0
    rows = ((*row, unit) for row, unit in zip(M.tolist(), units, strict=True))
    return table(name, " : 6 |" * len(M) + " : <", rows, *below)
