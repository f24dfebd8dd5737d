"""Text of the screws, modes and springs of a stiffness matrix."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from cartstiff import numerics
from cartstiff.mechanisms.contract import Units
from cartstiff.report.layout import COSINES, number, row, table


def _line(a: Mapping[str, Any], size: float) -> list[str]:
    pitch = a["pitch"]
    if pitch is not None and abs(pitch) < numerics.BLANK * size:
        pitch = 0.0
    return [number(pitch, 5, "infinite"), row(a["direction"], 4, COSINES), row(a["point"], 4, size)]


def screw_lines(s: Mapping[str, Any], u: Units) -> list[str]:
    """Eigenscrews and compliant axes."""
    lines: list[str] = []
    size = s["length"]["value"]
    where = [f"pitch [{u.pitch}]", "direction", f"point [{u.length}]"]
    screws = s["eigenscrews"]
    if screws is not None:
        lines += ["", "eigenscrews: twists answered by a wrench on the same screw"]
        lines += table(
            [
                f"eigenvalue [{u.blocks['tr']}]",
                f"about [{u.stiffness['rotation']}]",
                f"along [{u.stiffness['translation']}]",
                *where,
            ],
            [
                [
                    number(e["eigenvalue"]),
                    number(e["rotational_stiffness"]),
                    number(e["translational_stiffness"]),
                    *_line(e, size),
                ]
                for e in screws["screws"]
            ],
        )
        if not screws["complete"]:
            lines.append(f"  only {len(screws['screws'])} real, independent eigenscrews")
        for z in screws["complex_eigenvalues"]:
            lines.append(f"  complex eigenvalue {number(z[0])} {z[1]:+.5g}i {u.blocks['tr']}")
    for kind, meaning, freedom in (
        ("wrench", "translation answered by a parallel force", "translation"),
        ("twist", "moment answered by a parallel rotation", "rotation"),
    ):
        key = f"{kind}_compliant_axes"
        if s[key] is not None:
            lines += ["", f"{kind}-compliant axes: {meaning}"]
            lines += table(
                [f"stiffness [{u.stiffness[freedom]}]", *where],
                [[number(a["stiffness"]), *_line(a, size)] for a in s[key]],
            )
    return lines


def mode_lines(m: Mapping[str, Any] | None, u: Units, length: float) -> list[str]:
    """Eigenvalues and twists with respect to the metric."""
    if m is None:
        return []
    if m["metric"] == "inertia":
        lines = ["", "modes with respect to the inertia of the body"]
        title = "frequency [Hz]"
        pairs = zip(m["frequencies"], m["eigenvalues"], strict=True)
        values = [_frequency(f, x) for f, x in pairs]
    else:
        lines = ["", "modes with respect to the metric length^2 |omega|^2 + |v|^2"]
        title = f"stiffness [{u.stiffness['translation']}]"
        values = [number(x) for x in m["eigenvalues"]]
    titles = [title, f"rotation [{u.angle}]", f"translation [{u.length}]"]
    columns = list(zip(*m["twists"], strict=True))
    return lines + table(
        titles,
        [
            [
                x,
                row(t[:3], 4, max(map(abs, t[3:])) / length),
                row(t[3:], 4, max(map(abs, t[:3])) * length),
            ]
            for x, t in zip(values, columns, strict=True)
        ],
    )


def _frequency(frequency: float | None, eigenvalue: float) -> str:
    """Hz, or how fast a motion grows that is not held."""
    if frequency is None:
        return f"unstable ({number((-eigenvalue) ** 0.5)} /s)"
    return number(frequency)


def synthesis_lines(s: Mapping[str, Any] | None, u: Units, full: bool, size: float) -> list[str]:
    """Springs that realise the matrix."""
    if s is None or "passive" not in s:
        return []
    trace = 0.0 if s["relative_trace"] < numerics.UNCOUPLED else s["trace"]
    trace = f"trace of the coupling block {number(trace, 3)} {u.blocks['tr']}"
    if not s["passive"]:
        text = "no unloaded springs in parallel give this matrix: it has a negative eigenvalue"
    elif s["by_line_springs"]:
        text = f"{s['rank']} line or torsional springs in parallel give this matrix ({trace})"
    else:
        text = (
            f"{s['rank']} springs in parallel give this matrix, "
            f"{s['screw_springs']} of them with a pitch ({trace})"
        )
    if not full or not s["springs"]:
        return ["", "synthesis", f"  {text}"]
    rows = [
        [
            x["kind"],
            number(x["stiffness"]),
            u.stiffness["rotation" if x["kind"] == "torsional" else "translation"],
            *_line(x, size),
        ]
        for x in s["springs"]
    ]
    titles = ["kind", "stiffness", "", f"pitch [{u.pitch}]", "direction", f"point [{u.length}]"]
    return [
        "",
        "synthesis",
        f"  {text}",
        *table(titles, rows),
        f"  largest difference from the matrix {number(s['residual'], 2)} of its block",
    ]
