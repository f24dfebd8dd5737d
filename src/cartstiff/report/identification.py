"""Springs found from measurements, as text for people."""

from __future__ import annotations

from typing import TYPE_CHECKING

from cartstiff.errors import joined
from cartstiff.report.layout import number, table

if TYPE_CHECKING:
    from cartstiff.identify.intervals import Estimate
    from cartstiff.identify.result import Identification

__all__ = ["describe_identification"]


def describe_identification(result: Identification) -> str:
    """Stiffnesses with their intervals, noise, checks, notes."""
    model = "the equilibrium under load" if result.loaded else "displacements linear in the load"
    used = len(result.measured)
    rows = f"{used} rows" if used == result.rows else f"{used} of {result.rows} rows"
    lines = [
        f"{result.elastic.name}, frame {result.elastic.mechanism.frame!r}: {rows}, "
        f"{len(result.model.observations)} numbers; {result.fit} fit of {model}",
        "",
        f"Stiffness, {100 * result.level:g} % intervals",
    ]
    robust = dict(zip(result.unknowns.names, result.robust.fit.theta, strict=True))
    titles = ("spring", "stiffness", "from", "to", "unit", "compliance", "sd", "robust fit", "")
    lines += table(titles, [_row(e, float(robust[e.name])) for e in result.estimates])
    lines += ["", "Scatter"]
    body = []
    for name, entry in result.noise().items():
        said = "estimated" if entry["sigma_is_estimated"] else "given"
        body.append((
            name, str(entry["count"]), number(entry["residual_rms"]), number(entry["sigma"]),
            said, number(entry["leave_one_out_rms"]), entry["unit"],
        ))  # fmt: skip
    heads = ("", "numbers", "residual rms", "sd of one", "", "left-out rms", "unit")
    lines += table(heads, body)
    values = result.chosen.solved.singular_values
    lines += [
        "",
        f"Singular values of the scaled regressor: {number(values[0], 3)} to "
        f"{number(values[-1], 3)}",
    ]
    for entry in result.weak_directions():
        shares = " ".join(f"{share:+.2f} {name}" for name, share in entry["springs"].items())
        lines.append(f"  not seen: {shares}" if shares else "  not seen: offsets only")
    if result.suspects:
        lines.append(f"Suspect rows: {', '.join(map(str, result.suspects))}")
    if result.notes:
        lines += ["", "Notes"]
        lines += [f"  {note.code}: {note.message}" for note in result.notes]
    return joined(lines)


def _row(e: Estimate, robust: float) -> tuple[str, ...]:
    low, high = e.stiffness_interval
    words = {
        "determined": "" if e.method == "linear" else e.method, "at-least": "at least",
        "not-identifiable": "not identifiable", "negative": "negative",
    }[e.verdict]  # fmt: skip
    if e.verdict == "not-identifiable":
        return (e.name, "-", "-", "-", e.unknown.unit, "-", "-", "-", words)
    shown = robust if not e.unknown.has_stiffness else 1.0 / robust if robust > 0.0 else None
    return (
        e.name, number(e.stiffness), number(low), number(high, missing="no end"), e.unknown.unit,
        number(e.compliance), number(e.deviation, 3), number(shown), words,
    )  # fmt: skip
