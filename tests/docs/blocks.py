"""Run the code blocks of README and docs, and compare what they print with the block below.

In a page, in order: a YAML or XML block with a caption becomes a file of that name; a ``python``
block is run, all of a page in one namespace; a ``text`` block after it is what it prints; in a
``console`` block the lines after ``$ cartstiff ...`` are what the command prints. A line "..."
stands for any number of lines, "..." inside a line for any text.

    python tests/docs/blocks.py --write FILE ...     puts what is printed into the text blocks
"""

from __future__ import annotations

import contextlib
import io
import math
import os
import re
import shlex
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
_FENCE = re.compile(r"^```(.*)$")
_NUMBER = re.compile(r"(?<![\w.^])[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?(?![\w^])")
# Printed numbers have six digits at most; the last may be rounded the other way elsewhere.
RELATIVE = 2e-5
# Smaller numbers than this are rounding noise wherever they are printed.
NOISE = 1e-9


@dataclass
class Block:
    """A fenced block: language, caption, text, and the line it starts on (from 1)."""

    language: str
    caption: str
    text: str
    line: int


def pages():
    """README, and the pages of the documentation."""
    docs = sorted(p for p in (ROOT / "docs").rglob("*.md") if "_build" not in p.parts)
    return [ROOT / "README.md", *docs]


def blocks_of(text):
    """Fenced blocks of a page."""
    found = []
    inside = None
    for number, line in enumerate(text.splitlines(), start=1):
        fence = _FENCE.match(line)
        if inside is None and fence:
            language, start, inside = fence[1].strip(), number, []
        elif inside is not None and fence and not fence[1].strip():
            caption = ""
            if language.startswith("{code-block}"):
                language = language.split()[-1]
                while inside and inside[0].startswith(":"):
                    option = inside.pop(0)
                    if option.startswith(":caption:"):
                        caption = option.removeprefix(":caption:").strip()
            found.append(Block(language, caption, "\n".join(inside), start))
            inside = None
        elif inside is not None:
            inside.append(line)
    return found


def _same_line(expected, got):
    if "..." in expected:
        pattern = ".*".join(re.escape(part) for part in expected.split("..."))
        return re.fullmatch(pattern, got, re.DOTALL) is not None
    wanted, found = _NUMBER.findall(expected), _NUMBER.findall(got)
    shape = [" ".join(_NUMBER.sub(" # ", s).split()) for s in (expected, got)]
    if shape[0] != shape[1] or len(wanted) != len(found):
        return False
    return all(
        math.isclose(float(a), float(b), rel_tol=RELATIVE, abs_tol=NOISE)
        for a, b in zip(wanted, found, strict=True)
    )


def agree(expected, got):
    """Whether text agrees line by line, numbers up to the last printed digit."""
    lines, rest = expected.rstrip().splitlines(), got.rstrip().splitlines()
    skipping = False
    for line in lines:
        if line.strip() == "...":
            skipping = True
            continue
        while skipping and rest and not _same_line(line, rest[0]):
            rest.pop(0)
        if not rest or not _same_line(line, rest.pop(0)):
            return False
        skipping = False
    return skipping or not rest


def _command(line):
    """What `cartstiff ...` prints, on standard output and then on standard error."""
    from cartstiff.__main__ import main

    out, err = io.StringIO(), io.StringIO()
    streams = contextlib.redirect_stdout(out), contextlib.redirect_stderr(err)
    with streams[0], streams[1], contextlib.suppress(SystemExit):
        main(shlex.split(line)[1:])
    return out.getvalue() + err.getvalue()


def run_page(page):
    """Run a page in the current directory; each block with expected text, and what was printed."""
    results = []
    names = {"__name__": "__page__", "examples": str(ROOT / "examples")}
    printed = ""
    for block in blocks_of(page.read_text(encoding="utf-8")):
        if block.caption:
            file = Path(block.caption)
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_text(block.text + "\n", encoding="utf-8")
        elif block.language == "python":
            out = io.StringIO()
            # Line numbers of errors are those of the page.
            code = compile("\n" * block.line + block.text, str(page), "exec")
            with contextlib.redirect_stdout(out):
                exec(code, names)
            printed = out.getvalue()
        elif block.language == "text":
            results.append((block, printed))
            printed = ""
        elif block.language == "console":
            for part in re.split(r"^\$ ", block.text, flags=re.MULTILINE)[1:]:
                command, _, expected = part.partition("\n")
                if command.startswith("cartstiff "):
                    shown = Block("console", "", expected, block.line)
                    results.append((shown, _command(command)))
    return results


def _write(page):
    """Put what is printed into the text blocks of a page."""
    text = page.read_text(encoding="utf-8").splitlines()
    here = Path.cwd()
    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)
        try:
            results = run_page(page)
        finally:
            os.chdir(here)
    for block, printed in reversed(results):
        if block.language != "text":
            continue
        count = len(block.text.splitlines())
        lines = [line.rstrip() for line in printed.rstrip().splitlines()]
        text[block.line : block.line + count] = lines
    page.write_text("\n".join(text) + "\n", encoding="utf-8")


if __name__ == "__main__":
    if len(sys.argv) < 3 or sys.argv[1] != "--write":
        sys.exit("usage: python tests/docs/blocks.py --write FILE ...")
    for name in sys.argv[2:]:
        _write(Path(name).resolve())
