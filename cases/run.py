"""Cases through tools: which value each tool gives, and whether it is the printed one."""

from __future__ import annotations

import importlib.util
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from cartstiff import InputError
from cartstiff.core.errors import one_line
from cases.case import Asked, Case

#: Name of an asked value to what the tool gives for it; what it does not offer is left out.
Tool = Callable[[dict[str, Any], Path], Mapping[str, Any]]

#: The files in a case's folder that answer it, and who answers there.
OWN = {"answer.py": "cartstiff", "derivation.py": "derivation"}


@dataclass(frozen=True)
class Outcome:
    """What one tool makes of one asked value.

    Attributes
    ----------
    case, tool : str
        Which.
    asked : Asked
        What was printed, and whether it should agree.
    value : object or None
        What the tool gave; None if it does not offer it.
    error : str
        What it raised instead.
    """

    case: str
    tool: str
    asked: Asked
    value: Any
    error: str = ""

    @property
    def meets(self) -> bool:
        """Whether the value is the printed one."""
        return self.value is not None and self.asked.meets(self.value)

    @property
    def as_said(self) -> bool:
        """Whether the value agrees, or differs, as the case says, and is the stored one.

        Other tools, and derivations, need not come to our last digits: the printed ones are asked.
        """
        if self.error or self.value is None:
            return not self.error and self.tool != "cartstiff"
        same = self.tool != "cartstiff" or self.asked.is_ours(self.value)
        return self.meets == self.asked.agrees and same

    @property
    def words(self) -> str:
        """The outcome in a word or two."""
        if self.error:
            return f"error: {self.error}"
        if self.value is None:
            return "not offered"
        if not self.as_said:
            return "WRONG"
        return "printed digits" if self.meets else "differs, as said"


def tool(path: Path) -> Tool:
    """The function ``answers(inputs, folder)`` of a Python file.

    Raises
    ------
    InputError
        If the file cannot be imported or has no such function.
    """
    where = one_line(str(path))
    spec = importlib.util.spec_from_file_location(f"case_{path.parent.name}_{path.stem}", path)
    if spec is None or spec.loader is None or not path.is_file():
        raise InputError("not a Python file", where=where)
    module = importlib.util.module_from_spec(spec)
    try:
        spec.loader.exec_module(module)
    except Exception as error:
        raise InputError("cannot be imported", where=where, got=one_line(repr(error))) from error
    answers = getattr(module, "answers", None)
    if not callable(answers):
        raise InputError("has no function answers(inputs, folder)", where=where)
    return answers


def own_tools(folder: Path, case: Case) -> dict[str, Tool]:
    """The case's own tools: cartstiff's answer, and the derivation if there is one.

    Raises
    ------
    InputError
        If something is asked and there is no answer.
    """
    home = folder.parent / case.answered_as if case.answered_as else folder
    tools = {name: tool(home / file) for file, name in OWN.items() if (home / file).is_file()}
    if case.asked and "cartstiff" not in tools:
        raise InputError(
            "case has no answer",
            where=one_line(str(folder)),
            expected=one_line(str(home / "answer.py")),
        )
    return tools


def run_case(folder: Path, case: Case, others: Mapping[str, Tool] | None = None) -> list[Outcome]:
    """One case through its own tools, and through others.

    Parameters
    ----------
    folder : Path
        The case's folder; the tools find its files there.
    case : Case
        Its contents.
    others : mapping of name to tool, optional
        Each is called as ``tool(inputs, folder)``; ``inputs`` has, besides the case's inputs, the
        asked names under "asked", each with its quantity and order.
    """
    inputs = dict(case.inputs)
    inputs["asked"] = {a.name: {"quantity": a.quantity, "order": a.order} for a in case.asked}
    outcomes = []
    for name, answers in {**own_tools(folder, case), **(others or {})}.items():
        error, values = "", {}
        try:
            values = dict(answers(dict(inputs), folder))
        except Exception as problem:  # a tool may raise anything; the table says what
            error = one_line(repr(problem))
        outcomes += [
            Outcome(folder.name, name, asked, values.get(asked.name), error) for asked in case.asked
        ]
    return outcomes


def table(cases: Iterable[tuple[Path, Case]], outcomes: Iterable[Outcome]) -> str:
    """The outcomes as text: a line a value, a column a tool."""
    by_case: dict[str, dict[str, dict[str, str]]] = {}
    tools: dict[str, None] = {}
    for outcome in outcomes:
        tools.setdefault(outcome.tool)
        values = by_case.setdefault(outcome.case, {})
        values.setdefault(outcome.asked.name, {})[outcome.tool] = outcome.words
    lines = [["case, value", *tools]]
    for folder, case in cases:
        digits = ", to the printed digit" if case.to_the_digit else ""
        lines.append([f"{folder.name}: {case.verdict}{digits}"])
        for name, words in by_case.get(folder.name, {}).items():
            lines.append(["  " + name, *(words.get(tool, "-") for tool in tools)])
    widths = [
        max((len(line[k]) for line in lines if len(line) > max(k, 1)), default=0)
        for k in range(len(tools) + 1)
    ]
    return "\n".join(
        "  ".join(
            cell.ljust(width) if len(line) > 1 else cell
            for cell, width in zip(line, widths, strict=False)
        ).rstrip()
        for line in lines
    )
