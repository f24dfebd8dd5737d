"""Make docstrings written for the terminal safe to read as reStructuredText.

Formulas stand there as indented blocks, and bars mean absolute values. An indented block of the
introductory text becomes a literal block, and bars outside literals are escaped.
"""

from __future__ import annotations

import re
from typing import Any

from sphinx.application import Sphinx
from sphinx.domains.python import PythonDomain

_UNDERLINE = re.compile(r"^\s*-{3,}\s*$")
# Several names with one description: each gets a line of its own.
_SEVERAL = re.compile(r"^(\s*)(\w+(?:, \w+)+) : (.*)$")
_LITERAL = re.compile(r"(``.*?``|`[^`]*`_?)")


# The star of ``*names``, no emphasis: nothing closes it.
_STAR = re.compile(r"(?<![\w*\\])(\*{1,2})(?=\w[^*]*$)")


def _escaped(line: str) -> str:
    parts = _LITERAL.split(line)
    for i in range(0, len(parts), 2):
        parts[i] = re.sub(r"(?<!\\)\|", r"\\|", parts[i])
        parts[i] = _STAR.sub(lambda m: "\\*" * len(m[1]), parts[i])
    return "".join(parts)


def clean(*arguments: Any) -> None:
    """Rewrite the lines, the last argument, in place; runs before napoleon reads the sections."""
    lines: list[str] = arguments[-1]
    found: list[str] = []
    sections = False
    literal = False
    for i, line in enumerate(lines):
        following = lines[i + 1] if i + 1 < len(lines) else ""
        sections = sections or bool(line.strip() and _UNDERLINE.match(following))
        if sections:
            if several := _SEVERAL.match(line):
                names, rest = several[2].split(", "), several[3]
                found += [f"{several[1]}{name} : {rest}" for name in names]
            else:
                found.append(line if _UNDERLINE.match(line) else _escaped(line))
            continue
        indented = line.startswith("  ")
        if literal and line.strip() and not indented:
            literal = False
        if indented and not literal and (not found or not found[-1].strip()):
            before = next((x for x in reversed(found) if x.strip()), "")
            if not before.endswith("::") and not re.match(r"\s*([-*]|\d+\.) ", before):
                found += ["::", ""]
            literal = True
        found.append(line if literal else _escaped(line))
    lines[:] = found


class QuickDomain(PythonDomain):
    """Answers at once where no object has a name, as with most words of a parameter's type.

    Sphinx compares such a word with every object there is: a seventh of the build.
    """

    _known = 0
    _ends: frozenset[str] | set[str] = frozenset()

    def find_obj(self, env: Any, modname: str, classname: str, name: str, *rest: Any) -> Any:
        """As Sphinx."""
        if self._known != len(self.objects):  # pages are read before they are written
            self._known = len(self.objects)
            self._ends = {full.rpartition(".")[2] for full in self.objects}
        if name.removesuffix("()").rpartition(".")[2] not in self._ends:
            return []
        return super().find_obj(env, modname, classname, name, *rest)


def setup(app: Sphinx) -> dict[str, Any]:
    """Run before napoleon, whose priority is the default 500."""
    app.add_domain(QuickDomain, override=True)
    app.connect("autodoc-process-docstring", clean, priority=100)
    return {"version": "1", "parallel_read_safe": True, "parallel_write_safe": True}
