"""Run `cartstiff analyse` on two mechanisms, report on a third, and write that into a folder.

    python tools/demo_report.py FOLDER

For each: the text as `NAME.txt`, the JSON as `NAME.json`; `index.html` shows both for reading.
`spindle.html` is what `cartstiff report` says of a UR10 with a spindle under 300 N.
"""

from __future__ import annotations

import html
import json
import subprocess
import sys
from pathlib import Path
from typing import Any

RUNS = {
    "ur5": ["ur5", "--load", "0,0,0,0,0,-100"],
    "stewart-gough": ["stewart-gough"],
}
REPORT = [
    "ur10",
    "--tcp",
    "0,0,0.15",
    "--payload",
    "4,0,0,-0.05",
    "--load",
    "0,0,0,0,0,-300",
    "--world",
]
TITLES = {
    "ur5": "UR5 pushed with 100 N along the tool's axis",
    "stewart-gough": "The loaded Stewart-Gough platform of Žefran and Kumar, section 5.2",
}
CONNECTIONS = {
    "A": "wrench components in the moving body frame (Cartan minus)",
    "B": "symmetric part of K<sup>A</sup> (bi-invariant)",
    "K": "force components in inertial directions (kinematic)",
    "F": "Hessian in the joint coordinates (flat)",
}
STYLE = """
:root { color-scheme: light dark; }
body { font: 16px/1.5 system-ui, sans-serif; max-width: 60rem; margin: 2rem auto; padding: 0 1rem; }
code, td { font-family: ui-monospace, monospace; font-size: 0.85rem; }
table { border-collapse: collapse; margin: 0.3rem 0 1.5rem; display: block; overflow-x: auto; }
td { text-align: right; padding: 0.1rem 0.6rem; }
tr:nth-child(3) td { border-bottom: 1px solid; }
td:nth-child(3) { border-right: 1px solid; }
td.unit { text-align: left; opacity: 0.7; }
"""


def cartstiff(*arguments: str) -> str:
    """Standard output of the command line."""
    command = [sys.executable, "-m", "cartstiff", *arguments]
    done = subprocess.run(command, stdout=subprocess.PIPE, text=True, encoding="utf-8", check=False)
    if done.returncode:
        sys.exit(f"failed with exit code {done.returncode}: cartstiff {' '.join(arguments)}")
    return done.stdout


def table(matrix: list[list[float]], units: list[str] | None = None) -> str:
    """Matrix as an HTML table, one unit a row behind it."""
    rows = []
    for i, row in enumerate(matrix):
        cells = "".join(f"<td>{x + 0.0:.6g}</td>" for x in row)
        unit = f'<td class="unit">{html.escape(units[i])}</td>' if units else ""
        rows.append(f"<tr>{cells}{unit}</tr>")
    return f"<table>{''.join(rows)}</table>"


def section(name: str, data: dict[str, Any]) -> str:
    """One mechanism of the page."""
    length, force = data["units"]["length"], data["units"]["force"]
    moment, per_length = f"{force} {length}", f"{force}/{length}"
    units = [f"{moment}/rad | {force}"] * 3 + [f"{force}/rad | {per_length}"] * 3
    rounding = 1e-12 * max(map(abs, data["wrench"]))
    wrench = ", ".join(f"{x:.6g}" if abs(x) > rounding else "0" for x in data["wrench"])
    parts = [
        f'<h2 id="{name}">{html.escape(TITLES[name])}</h2>',
        f"<p><code>cartstiff analyse {' '.join(RUNS[name])}</code> "
        f'(<a href="{name}.txt">text</a>, <a href="{name}.json">JSON</a>)</p>',
        f"<p>Frame {html.escape(data['frame'])}; twists (ω, v); wrench (moment in {moment}, "
        f"force in {force}): <code>{wrench}</code></p>",
    ]
    for letter, meaning in CONNECTIONS.items():
        matrix = data["stiffness"][letter]
        shown = "<p>does not exist here</p>" if matrix is None else table(matrix, units)
        parts.append(f"<h3>K<sup>{letter}</sup>: {meaning}</h3>{shown}")
    if data["jacobian"] is not None:
        parts.append(f"<h3>Jacobian</h3>{table(data['jacobian'])}")
    notes = "".join(f"<li>{html.escape(note['message'])}</li>" for note in data["notes"])
    return "\n".join(parts) + (f"<h3>Notes</h3><ul>{notes}</ul>" if notes else "")


def main(folder: Path) -> Path:
    """Write the report and return its index."""
    folder.mkdir(parents=True, exist_ok=True)
    sections = []
    for name, arguments in RUNS.items():
        text = cartstiff("analyse", *arguments)
        (folder / f"{name}.txt").write_text(text, encoding="utf-8")
        data = json.loads(cartstiff("analyse", *arguments, "--json"))
        (folder / f"{name}.json").write_text(json.dumps(data, indent=1) + "\n", encoding="utf-8")
        sections.append(section(name, data))
    cartstiff("report", *REPORT, "-o", str(folder / "spindle.html"))
    index = folder / "index.html"
    index.write_text(
        '<!doctype html><html lang="en"><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width">'
        f"<title>cartstiff: two mechanisms</title><style>{STYLE}</style>\n"
        '<p>A report to send on: <a href="spindle.html">a UR10, a spindle, 300 N</a>.</p>\n'
        "<h1>Cartesian stiffness under four connections</h1>\n" + "\n".join(sections) + "</html>\n",
        encoding="utf-8",
    )
    return index


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit("usage: python tools/demo_report.py FOLDER")
    page = main(Path(sys.argv[1]))
    print(f"The stiffness matrices of {' and '.join(RUNS)} are in {page.parent}/:")
    for file in sorted(page.parent.iterdir()):
        print(f"  {file.name:<20} {file.stat().st_size:>7} bytes")
    print(f"Open {(page.parent / 'spindle.html').resolve().as_uri()}")
    print(f"  or {page.resolve().as_uri()}")
