"""Draw the package's imports, read from the code, as SVG; the architecture page does it by itself.

Usage: ``python docs/draw_architecture.py picture.svg``
"""

from __future__ import annotations

import ast
import sys
from collections import Counter
from pathlib import Path

SOURCES = Path(__file__).resolve().parents[1] / "src" / "cartstiff"
# From the ground up; a room may import from its own row and from rows below.
ROWS = [
    ["core/numerics"],
    ["core/geometry"],
    ["core/potentials"],
    ["core/mechanisms"],
    ["core/stiffness"],
    ["core/statics"],
    ["kinematics"],
    ["files"],
    ["answer"],
    ["recorded"],
    ["wings/maps", "wings/toolpaths", "wings/reach", "wings/identify"],
    ["shown/report", "shown/scene"],
    ["shown/page"],
    ["shown/cli"],
]
WORDS = {
    "core/numerics": "when a number counts as zero",
    "core/geometry": "SE(3), connections, charts",
    "core/potentials": "energies: springs, loads, gravity, your own",
    "core/mechanisms": "coordinates to poses",
    "core/stiffness": "the one reduction; the tensor",
    "core/statics": "equilibrium, stability, load curves",
    "kinematics": "inverse kinematics",
    "files": "files and models to mechanisms",
    "answer": "what the matrices say; modes; what is said, once",
    "recorded": "many postures at once; exact derivatives",
    "wings/maps": "workspaces and designs, in files",
    "wings/toolpaths": "the stiffest postures",
    "wings/reach": "where it can be",
    "wings/identify": "springs from measurements",
    "shown/report": "text, JSON, figures",
    "shown/scene": "3D pictures",
    "shown/page": "the page in the browser",
    "shown/cli": "parse, call, print",
}
# Rooms of several: each of theirs is drawn. Files between them are read by everything.
HOUSES = {"core", "wings", "shown"}
WIDTH, HEIGHT, GAP, MARGIN = 320, 52, 34, 20
SIDE = 110  # room for the arrows that pass by a row


def room_of(parts: tuple[str, ...]) -> str:
    """Room of a module: "core/geometry" of ("core", "geometry", "se3"); "" of no room."""
    if not parts or not (SOURCES / parts[0]).is_dir():
        return ""
    if parts[0] not in HOUSES:
        return parts[0]
    is_room = len(parts) > 1 and "/".join(parts[:2]) in WORDS
    return "/".join(parts[:2]) if is_room else ""


def imports() -> dict[str, dict[str, int]]:
    """How many modules of each room import from each other room."""
    found: dict[str, dict[str, int]] = {}
    for path in sorted(SOURCES.rglob("*.py")):
        room = room_of(path.relative_to(SOURCES).with_suffix("").parts)
        if not room:
            continue
        seen = set()
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom) and node.module and node.level == 0:
                names = [f"{node.module}.{alias.name}" for alias in node.names]
            elif isinstance(node, ast.Import):
                names = [alias.name for alias in node.names]
            else:
                continue
            own = (name.split(".")[1:] for name in names if name.startswith("cartstiff."))
            seen |= {room_of(tuple(parts)) for parts in own}
        counts = found.setdefault(room, {})
        for other in seen - {"", room}:
            counts[other] = counts.get(other, 0) + 1
    return found


def sizes() -> list[tuple[str, int, int, int]]:
    """Package, files, lines, and lines of code: neither blank nor comments nor docstrings."""
    table: dict[str, Counter[str]] = {}
    for path in SOURCES.rglob("*.py"):
        text = path.read_text(encoding="utf-8")
        words = {
            line
            for node in ast.walk(ast.parse(text))
            if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)
            for line in range(node.lineno, (node.end_lineno or node.lineno) + 1)
        }
        lines = [line.strip() for line in text.splitlines()]
        code = sum(
            bool(line) and not line.startswith("#") and i not in words
            for i, line in enumerate(lines, start=1)
        )
        parts = path.relative_to(SOURCES).parts
        at_top = "(public names)" if len(parts) == 1 else f"{parts[0]} (between its rooms)"
        for name in (room_of(parts[:-1]) or at_top, "all"):
            table.setdefault(name, Counter()).update(files=1, lines=len(lines), code=code)
    ordered = sorted(table.items(), key=lambda item: item[1]["lines"])
    return [(name, row["files"], row["lines"], row["code"]) for name, row in ordered]


def upward(found: dict[str, dict[str, int]]) -> list[tuple[str, str]]:
    """Imports that point from a lower row to a higher one: there should be none."""
    level = {name: i for i, row in enumerate(ROWS) for name in row}
    return [
        (a, b)
        for a, others in found.items()
        for b in others
        if level.get(a, len(ROWS)) < level.get(b, len(ROWS))
    ]


def direct(found: dict[str, dict[str, int]]) -> dict[str, set[str]]:
    """Imports that do not follow from a chain of others: what is worth an arrow."""

    def reached(name: str) -> set[str]:
        below: set[str] = set()
        for other in found.get(name, {}):
            below |= {other} | reached(other)
        return below

    return {
        a: {b for b in others if not any(b in reached(c) for c in others if c != b)}
        for a, others in found.items()
    }


def svg(found: dict[str, dict[str, int]]) -> str:
    """Boxes in rows, an arrow for every import that others do not imply."""
    known = {name for row in ROWS for name in row}
    rows = [[n for n in row if n in found] for row in ROWS]
    rows = [row for row in rows if row]
    if extra := sorted(set(found) - known):
        rows.append(extra)
    columns = max(len(row) for row in rows)
    total = 2 * MARGIN + columns * WIDTH + (columns - 1) * GAP + 2 * SIDE
    height = 2 * MARGIN + len(rows) * HEIGHT + (len(rows) - 1) * GAP
    at = {}
    for i, row in enumerate(rows):
        span = len(row) * WIDTH + (len(row) - 1) * GAP
        for j, name in enumerate(row):
            x = (total - span) / 2 + j * (WIDTH + GAP)
            at[name] = (x, height - MARGIN - HEIGHT - i * (HEIGHT + GAP))
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {total} {height}" '
        'font-family="system-ui, sans-serif" role="img">',
        "<title>Rooms of cartstiff and their imports</title>",
        '<defs><marker id="tip" viewBox="0 0 8 8" refX="7" refY="4" markerWidth="7" '
        'markerHeight="7" orient="auto"><path d="M0 0 8 4 0 8z" fill="#5b7083"/></marker></defs>',
        f'<rect width="{total}" height="{height}" fill="#ffffff"/>',
    ]
    passing = 0
    for a, others in sorted(direct(found).items()):
        for b in sorted(others & set(at)):
            passing += at[b][1] - at[a][1] > HEIGHT + GAP
            parts.append(_arrow(at[a], at[b], passing))
    for name, (x, y) in at.items():
        parts += [
            f'<rect x="{x:.0f}" y="{y:.0f}" width="{WIDTH}" height="{HEIGHT}" rx="8" '
            'fill="#eef3f7" stroke="#33506b"/>',
            f'<text x="{x + WIDTH / 2:.0f}" y="{y + 22:.0f}" text-anchor="middle" '
            f'font-weight="600" fill="#1c2d3c">{name}</text>',
            f'<text x="{x + WIDTH / 2:.0f}" y="{y + 40:.0f}" text-anchor="middle" '
            f'font-size="12" fill="#4a5c6c">{WORDS.get(name, "")}</text>',
        ]
    return "\n".join([*parts, "</svg>"]) + "\n"


def _arrow(start: tuple[float, float], end: tuple[float, float], passing: int) -> str:
    (x1, y1), (x2, y2) = start, end
    if y2 - y1 <= HEIGHT + GAP:
        ends = x1 + WIDTH / 2, y1 + HEIGHT, x2 + WIDTH / 2, y2
        path = "M{:.0f} {:.0f}L{:.0f} {:.0f}".format(*ends)
    else:  # around the rows in between
        out = max(x1, x2) + WIDTH + 40 + 30 * ((passing - 1) % 3)
        path = (
            f"M{x1 + WIDTH:.0f} {y1 + HEIGHT / 2:.0f}C{out:.0f} {y1 + HEIGHT / 2:.0f} "
            f"{out:.0f} {y2 + HEIGHT / 2:.0f} {x2 + WIDTH:.0f} {y2 + HEIGHT / 2:.0f}"
        )
    return (
        f'<path d="{path}" fill="none" stroke="#5b7083" stroke-width="1.5" marker-end="url(#tip)"/>'
    )


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit("usage: python docs/draw_architecture.py picture.svg")
    Path(sys.argv[1]).write_text(svg(imports()), encoding="utf-8")
    for name, others in imports().items():
        print(f"{name:<12} imports {', '.join(sorted(others)) or 'nothing of the package'}")
    for lower, higher in upward(imports()):
        print(f"points the wrong way: {lower} imports {higher}")
    for name, *numbers in sizes():
        print(f"{name:<28}", *(f"{n:>7}" for n in numbers))
