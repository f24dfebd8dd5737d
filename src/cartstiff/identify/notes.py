"""What a campaign assumed and found, in words."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from cartstiff import numerics
from cartstiff.arrays import Array
from cartstiff.errors import CartstiffError
from cartstiff.identify.linear_model import LinearModel, small_loads
from cartstiff.identify.loaded_model import LoadedModel, needs_equilibrium
from cartstiff.identify.measurements import POSITION, ROTATION, TURN
from cartstiff.identify.observations import EARTH
from cartstiff.identify.writing import written_values
from cartstiff.notes import Note
from cartstiff.potentials.line_springs import LineSprings

if TYPE_CHECKING:
    from cartstiff.identify.result import Identification

_FEW = 5.0
# Standard deviations of an error that is called gross, and rows that are shown in words.
_GROSS, _SHOWN = 20.0, 8
# Joints that move in a campaign of which all that is small is doubtful.
_SWUNG = 3
# Rows whose equilibrium is looked at: those that move most.
_LOOKED_AT = 3


def notes_of(result: Identification) -> list[Note]:
    """Notes on a finished campaign."""
    return [*_assumed(result), *_found(result), *_doubts(result), *_limits(result)]


def _assumed(result: Identification) -> list[Note]:
    elastic, measured = result.elastic, result.measured
    notes = [n for n in elastic.notes if n.code not in ("stiffness-assumed", "default-posture")]
    notes += _angles(result)
    masses = bool(measured.mass.any() or measured.mass0.any())
    if masses and elastic.gravity is None:
        words = "hung masses pull with 9.81 m/s^2 along -z of F: the mechanism names no gravity"
        notes.append(Note("gravity-assumed", words, {"gravity": list(EARTH)}))
    notes += _cables(result)
    if not result.loaded:
        words = (
            "displacements are taken as linear in the load, joints as where they are told: "
            "--loaded fits the equilibrium itself"
        )
        notes.append(Note("linear-model", words))
    if needs_equilibrium(elastic):
        words = (
            "nonlinear springs stand in a loop or beside lines: what each carries depends on how "
            "far all give, so the equilibrium under load is fitted, as by --loaded"
        )
        notes.append(Note("equilibrium-needed", words))
    absolute = result.model.observations.is_absolute.any()
    if absolute and (not measured.session or result.offsets == "none"):
        words = (
            "positions are taken in the base frame B exactly: errors of geometry and of the "
            "measuring frame go into the springs (column session gives each session an offset of "
            "its own)"
        )
        notes.append(Note("frame-taken-as-known", words))
    if (
        absolute
        and measured.session
        and result.offsets == "translation"
        and any(name in measured.values for name in POSITION)
    ):
        notes.append(Note("axes-taken-as-known", "the measuring frames' axes are taken as F's"))
    estimated = [w for w, entry in result.noise().items() if entry["sigma_is_estimated"]]
    if estimated:
        kinds = " and of ".join(f"{kind}s" for kind in estimated)
        words = f"no standard deviation was given: that of {kinds} is estimated"
        sizes = {w: result.noise()[w]["sigma"] for w in estimated}
        notes.append(Note("deviation-estimated", words, {"sigma": sizes}))
    return notes


def _cables(result: Identification) -> list[Note]:
    """Cables, which the fit takes as bars, and the rows in which the load alone slackens them."""
    elastic = result.elastic
    names: list[str] = []
    if isinstance(elastic.springs, LineSprings) and elastic.springs.unilateral:
        names += elastic.spring_names
    lines = [p for p in elastic.potentials if isinstance(p, LineSprings)]
    taut_only = [p.unilateral for p in lines for _ in p.stiffness]
    names += [f"line{i + 1}" for i, only in enumerate(taut_only) if only]
    if not names:
        return []
    model = result.model
    linear = model.linear if isinstance(model, LoadedModel) else model
    pushed: dict[str, list[int]] = {}
    if isinstance(linear, LinearModel):
        felt, _ = linear.forces_in(written_values(result))
        least = -numerics.ROUNDING * np.abs(felt).max(initial=0.0)
        for name in names:
            force = felt[:, result.unknowns.elements.index(name)]
            rows = np.unique(linear.observations.row[force < least])
            if rows.size:
                pushed[name] = [int(result.measured.rows[n]) for n in rows]
    words = f"cables are taken as taut in every row: {', '.join(names)}"
    if pushed:
        shown = "; ".join(
            f"{name} in row(s) {', '.join(map(str, rows))}" for name, rows in pushed.items()
        )
        words += f". Only preload keeps them so against the load: {shown}"
    return [Note("cables-taken-as-taut", words, {"cables": names, "against_load": pushed})]


def _found(result: Identification) -> list[Note]:
    notes = []
    lost = [e.name for e in result.estimates if e.verdict == "not-identifiable"]
    if lost:
        words = f"not identifiable from these rows: {', '.join(lost)}"
        notes.append(Note("not-identifiable", words, {"springs": lost}))
    least = {e.name: e.stiffness_interval[0] for e in result.estimates if e.verdict == "at-least"}
    if least:
        shown = ", ".join(f"{name} at least {k:.5g}" for name, k in least.items())
        words = f"no upper end, the rows may come from a rigid spring: {shown}"
        notes.append(Note("at-least", words, {"springs": least}))
    wrong = [e.name for e in result.estimates if e.verdict == "negative"]
    if wrong:
        words = (
            f"the compliance of {', '.join(wrong)} comes out negative beyond its interval: the "
            "model or the signs of load and displacement are wrong"
        )
        notes.append(Note("negative-compliance", words, {"springs": wrong}))
    active = result.chosen.solved.active
    if active.any():
        names = [result.unknowns.names[p] for p in np.flatnonzero(active)]
        words = (
            f"least squares would make {', '.join(names)} negative: zero is taken, and the others "
            "follow; intervals are those without the bound"
        )
        notes.append(Note("bound-active", words, {"springs": names}))
    if result.suspects:
        reasons = result.robust.reasons(result.model.observations, result.measured)
        shown = "; ".join(
            f"row {result.measured.rows[n]} ({reasons[int(n)]})" for n in result.robust.suspects
        )
        used = "left out by the robust fit" if result.fit == "robust" else "used all the same"
        notes.append(Note("suspects", f"suspect, and {used}: {shown}", {"rows": result.suspects}))
    notes += _unseen(result)
    if result.rejected:
        shown = "; ".join(f"row {r.row} ({r.reason})" for r in result.rejected)
        notes.append(
            Note(
                "rejected",
                f"left out by --reject: {shown}",
                {"rows": [r.row for r in result.rejected]},
            )
        )
    return notes


def _unseen(result: Identification) -> list[Note]:
    """Rows in which a gross error would not be seen, as hardly another one measures the same."""
    robust, seen = result.robust, result.model.observations
    rows: dict[int, float] = {}
    words = []
    for n in range(len(result.measured)):
        mine = np.flatnonzero((seen.row == n) & robust.kept)
        if not mine.size or robust.unseen[mine].max() < _GROSS:
            continue
        worst = mine[np.argmax(robust.unseen[mine])]
        size = float(robust.unseen[worst])
        rows[int(result.measured.rows[n])] = size
        words.append(f"row {result.measured.rows[n]} ({seen.column[worst]}: {size:.0f})")
    if not rows:
        return []
    more = f" and {len(words) - _SHOWN} more" if len(words) > _SHOWN else ""
    text = (
        "the fit follows these rows, which hardly another one checks, so that errors of fewer "
        f"standard deviations than told may stay unseen: {', '.join(words[:_SHOWN])}{more}"
    )
    return [Note("rows-unchecked", text, {"rows": list(rows), "errors": list(rows.values())})]


def _limits(result: Identification) -> list[Note]:
    """How far the linear model reaches, and whether matrices found are stiffnesses."""
    notes = []
    values = written_values(result)
    if not needs_equilibrium(result.elastic):
        notes += _against_equilibrium(result, values)
    Gamma = result.unknowns.compliance(values)
    entries = result.unknowns.parameters
    if any(not u.pattern.is_diagonal for u in entries):
        lowest = numerics.eigenvalues(Gamma)[0]
        if lowest <= 0.0:
            words = (
                "the compliance found for a link has a negative eigenvalue: the noise is larger "
                "than its smallest entries; --unknown LINK:diagonal asks for less"
            )
            notes.append(Note("not-definite", words, {"lowest": float(lowest)}))
    return notes


def _against_equilibrium(result: Identification, values: Array) -> list[Note]:
    """The equilibrium under load beside the small displacement, in the rows that move most."""
    seen, unknowns = result.model.observations, result.unknowns
    try:
        y, _ = result.model.at(values)
    except CartstiffError:
        return []
    size = np.abs(y) / result.chosen.solved.deviation
    worst = list(dict.fromkeys(seen.row[np.argsort(-size)].tolist()))[:_LOOKED_AT]
    keep = np.zeros(len(result.measured), bool)
    keep[worst] = True
    some = result.measured.chosen(keep)
    small = small_loads(unknowns, some)
    try:
        bent, _ = LoadedModel(unknowns, some).at(values)
        straight, _ = small.at(values)
    except CartstiffError:
        return []
    mine = np.isin(seen.row, np.flatnonzero(keep))
    deviation = result.chosen.solved.deviation[mine]
    apart = np.abs(bent - straight) / deviation
    i = int(np.argmax(apart))
    if not (apart[i] > 1.0 or result.loaded):
        return []
    row = int(some.rows[small.observations.row[i]])
    advice = (
        "the fit without --loaded would do"
        if not apart[i] > 1.0
        else ("--loaded is needed" if result.loaded else "fit it with --loaded")
    )
    words = (
        f"in row {row} the equilibrium under load differs from the linear displacement by "
        f"{apart[i]:.3g} standard deviations: {advice}"
    )
    values_ = {"row": row, "linear": float(straight[i]), "loaded": float(bent[i])}
    return [Note("linear-differs", words, values_)]


def _angles(result: Identification) -> list[Note]:
    """Names a campaign of an arm whose joints hardly leave zero: radians that were read as degrees.

    What is larger than a turn, degrees read as radians, is refused where it is read.
    """
    mechanism, q = result.elastic.mechanism, result.measured.q
    rotary = [not c.is_length for c in mechanism.coordinates]
    largest = float(np.abs(q[:, rotary]).max(initial=0.0))
    moving = int(np.count_nonzero(np.ptp(q[:, rotary], axis=0)))
    if mechanism.kind != "serial" or moving < _SWUNG or largest > np.radians(np.pi):
        return []
    words = (
        f"no joint is farther than {np.degrees(largest):.3g} degrees from zero in any row: "
        'if these columns are radians, say so in their heads, "NAME [rad]"'
    )
    return [Note("small-angles", words, {"largest": largest})]


def _doubts(result: Identification) -> list[Note]:
    notes, checks = [], result.checks
    if result.inflation > 1.0:
        words = (
            f"the scatter is {result.inflation:.3g} times what the deviations given explain "
            f"(probability {checks.probability:.2g}): all intervals are wider by that"
        )
        notes.append(Note("scatter-larger", words, {"factor": result.inflation}))
    if checks.lack_of_fit is not None and checks.lack_of_fit < 0.01:
        words = (
            "repeats agree with each other better than with the model (probability "
            f"{checks.lack_of_fit:.2g}): something that it does not know bends the rows"
        )
        notes.append(Note("lack-of-fit", words, {"probability": checks.lack_of_fit}))
    meaning = {
        "backlash": "a play or friction of {size} in {name}",
        "stiffening": "a compliance of {name} that changes with its torque ({size})",
        "drift": "a drift of {size} per second in {name}",
    }
    elements, units = result.unknowns.elements, result.elastic.units
    for p in checks.patterns:
        if p.kind == "drift":
            unit = units.angle if p.name in (*ROTATION, *TURN) else units.length
        else:
            is_length = bool(elements.is_length[elements.index(p.name)])
            unit = units.coordinate(is_length)
            if p.kind == "stiffening":
                unit += f"/({units.effort(is_length)})^2"
        what = meaning[p.kind].format(size=f"{p.size:.3g} {unit}", name=p.name)
        words = f"the residuals look like {what} (probability {p.probability:.2g} without)"
        notes.append(Note("residual-pattern", words, vars(p)))
    if result.degrees < _FEW:
        words = (
            f"the noise is estimated from {result.degrees:.3g} degrees of freedom: "
            "intervals are wide for that alone, more rows or known deviations help most"
        )
        notes.append(Note("few-rows", words, {"degrees": result.degrees}))
    differing = []
    for e, theta in zip(result.estimates, result.robust.fit.theta, strict=True):
        if e.interval is not None and not e.interval[0] <= theta <= e.interval[1]:
            differing.append(e.name)
    if differing and result.fit == "plain":
        words = f"the robust fit lies outside the intervals of {', '.join(differing)}"
        notes.append(Note("robust-differs", words, {"springs": differing}))
    return notes
