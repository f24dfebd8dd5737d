"""The legend of a picture in words: what its lengths, colours and factors mean."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

__all__ = ["legend_lines"]


def legend_lines(legend: Mapping[str, Any]) -> list[dict[str, str]]:
    """Lines with a mark ("translation", "rotation", "force", ...) and a text.

    Parameters
    ----------
    legend : mapping
        From `Scene.draw`.
    """
    length = legend["length"]["unit"]
    lines = []
    for freedom, facts in legend["ellipsoids"].items():
        if facts is None:
            continue
        words = (
            _radius(facts["scale"], facts["unit"], length)
            if facts["shown"]
            else f"not drawn: {facts['reason']}"
        )
        if facts["shown"] and facts["reason"]:
            words += f"; {facts['reason']}"
        lines.append({"mark": freedom, "text": f"{freedom}: {words}"})
    wrench = legend["wrench"]
    if wrench is not None:
        scales = [
            f"{kind} {_n(per)} {wrench['units'][kind]} per {length}"
            for kind in ("force", "moment")
            if wrench[kind] and (per := wrench["scale"][kind]["value_per_length"])
        ]
        if scales:
            lines.append({"mark": "force", "text": f"arrows: {', '.join(scales)}"})
    moved = legend["deflection"]
    if moved is not None:
        if moved["shown"]:
            at = ", ".join(_n(x) for x in moved["acts_at"])
            place = f"at ({at}) {length} of M" if any(moved["acts_at"]) else "at the origin of M"
            text = f"deflection enlarged {_n(moved['exaggeration'])} times, under the load {place}"
        else:
            text = f"deflection: {moved['reason']}"
        lines.append({"mark": "deflection", "text": text})
    tension = legend["tension"]
    if tension is not None and tension.get("limits", [0, 0])[1]:
        low, high = tension["limits"]
        text = f"legs: blue {_n(low)} to orange {_n(high)} {tension['unit']}"
        lines.append({"mark": "tension", "text": text})
    for name, words in (("screws", "eigenscrews"), ("centres", "centres")):
        facts = legend[name]
        if isinstance(facts, Mapping) and facts.get("shown") is False:
            lines.append({"mark": name, "text": f"{words} not drawn: {facts['reason']}"})
    if (nodal := legend.get("nodal")) is not None:
        text = f"{nodal['name']}, {_n(nodal['value'])} Hz"
        if nodal["shown"]:
            text += f", pitch {_n(nodal['pitch'])} {length}"
        else:
            text += f" not drawn: {nodal['reason']}"
        lines.append({"mark": "nodal", "text": text})
    lines += [{"mark": "note", "text": str(note)} for note in legend["notes"]]
    return lines


def _radius(scale: Mapping[str, Any], unit: str, length: str) -> str:
    if scale["kind"] == "linear":
        return f"radius {_n(scale['value_per_length'])} {unit} per {length}"
    return (
        f"radius 0 at {_n(scale['zero_at'])} {unit}, and "
        f"{_n(scale['length_per_decade'])} {length} for each factor of 10"
    )


def _n(x: float | None) -> str:
    text = "–" if x is None else f"{x:.3g}"
    return text.replace("e+0", "e").replace("e-0", "e-").replace("e+", "e")
