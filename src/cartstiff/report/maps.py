"""A map in words: its size, its states, the range of its quantities, tables of postures."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from cartstiff.errors import joined
from cartstiff.report.layout import number, table

__all__ = ["describe_comparison", "describe_map"]


def describe_map(answer: Mapping[str, Any]) -> str:
    """The answer of ``cartstiff map``, for reading."""
    parts, units = answer["parts"], answer["units"]
    lines = [
        f"{answer['mechanism']}: {answer['postures']} postures, body frame {answer['frame']!r}, "
        f"K^{answer['connection']}, characteristic length "
        f"{answer['characteristic_length']:.6g} {units['length']}",
        f"{answer['file']}: {parts['total']} part(s), {parts['found']} found there, "
        f"{parts['computed']} computed",
        *_searched(answer.get("branches")),
        *_load(answer),
        *([answer["intervals"]] if answer.get("intervals") else []),
        "",
        "States",
        *table(("state", "postures"), [(k, str(n)) for k, n in answer["states"].items()]),
        "",
        "Quantities",
        *table(
            ("quantity", "unit", "smallest", "mean", "largest", "undefined"),
            [
                (name, q["unit"], *(number(q[k]) for k in ("smallest", "mean", "largest")),
                 str(q["undefined"]))
                for name, q in answer["quantities"].items()
            ],
        ),
    ]  # fmt: skip
    for which in ("below", "above"):
        if (found := answer.get(which)) is not None:
            unit = answer["quantities"][found["quantity"]]["unit"]
            lines += ["", f"{found['quantity']} {which} {number(found['limit'])} {unit}: "
                      f"{100 * found['share']:.1f} % of what is reached ({found['within']} of "
                      f"{found['reached']})"]  # fmt: skip
            if (single := found.get("single_branch")) is not None:
                lines.append(
                    f"  by the best single branch, without a flip: {100 * single['share']:.1f} % "
                    f"({single['within']}; it reaches {single['places']})"
                )
    for which in ("best", "worst"):
        for name, rows in answer.get(which, {}).items():
            unit = answer["quantities"][name]["unit"]
            lines += ["", f"{which.capitalize()} of {name} [{unit}]", *_postures(rows, units)]
    return joined(lines)


def _searched(branches: Mapping[str, int] | None) -> list[str]:
    """How many branches there are at a place, and how they were looked for."""
    if branches is None:
        return []
    legs = branches["legs"]
    how = f"each of {legs} legs" if legs else "the mechanism as a whole"
    return [
        f"at most {branches['found']} branches found at a place, up to {branches['kept']} kept; "
        f"searched from {branches['starts']} starts: {how}"
    ]


def _load(answer: Mapping[str, Any]) -> list[str]:
    """What K^load supposes of the load."""
    if answer["connection"] != "load":
        return []
    load = answer["load"]
    at = ", ".join(number(x) for x in load["at"])
    return [f"K^load: the tangent under the load, {load['kind']} at ({at}): {load['meaning']}"]


def _postures(rows: list[dict[str, Any]], units: Mapping[str, str]) -> list[str]:
    if not rows:
        return ["  none"]
    half = ["half_width"] if "half_width" in rows[0] else []  # where springs were measured
    titles = ["value", *(name.replace("_", " ") for name in half), *rows[0]["q"]]
    titles += [f"{c} [{units['length']}]" for c in "xyz"]
    return table(
        titles,
        [
            [number(row["value"]), *(number(row[name], 3) for name in half),
             *(number(x) for x in (*row["q"].values(), *row["position"]))]
            for row in rows
        ],
    )  # fmt: skip


def describe_comparison(answer: Mapping[str, Any], words: str) -> str:
    """The answer of ``cartstiff compare``, for reading."""
    unit = "" if answer["unit"] == "1" else f" {answer['unit']}"
    lines = [
        words,
        f"  {answer['places']} of {answer['of']} places have a number in both maps",
        f"  smallest {number(answer['smallest'])}{unit}, mean {number(answer['mean'])}{unit}, "
        f"largest {number(answer['largest'])}{unit}",
    ]
    if (share := answer["first_is_better"]) is not None:
        lines.append(f"  the first is better at {100 * share:.1f} % of them")
    if answer["differs"]:
        lines += ["What else differs", *(f"  {words}" for words in answer["differs"])]
    return joined(lines)
