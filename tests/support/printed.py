"""What the commands print of a result."""

from __future__ import annotations

import re
from typing import Any

from cartstiff import (
    CompensatedPath,
    Equilibrium,
    LoadCurve,
    OptimisedPath,
    PostureStiffness,
    Workspace,
)
from cartstiff.identify import Identification
from tests.inner import (
    SENTENCES,
    answer_at,
    answer_of_compensation,
    answer_of_curve,
    answer_of_identification,
    answer_of_path,
    answer_of_workspace,
    answer_sentences,
    answer_text,
    describe,
    describe_equilibrium,
    summary_text,
)
from tests.inner import TITLES as TITLES
from tests.inner import VERDICTS as VERDICTS

#: What makes the text of each kind of result, or its answer.
TEXTS = {PostureStiffness: describe, Equilibrium: describe_equilibrium, dict: summary_text}
ANSWERS = {
    LoadCurve: answer_of_curve,
    CompensatedPath: answer_of_compensation,
    OptimisedPath: answer_of_path,
    Workspace: answer_of_workspace,
    Identification: answer_of_identification,
}


def text_of(result: Any, *more: Any, **how: Any) -> str:
    """The text of a posture, an equilibrium, a path, ..., or of an analysis as plain data."""
    for kind, answer in ANSWERS.items():
        if isinstance(result, kind):
            return str(answer_text(answer(result, *more, **how)))
    (text,) = (text for kind, text in TEXTS.items() if isinstance(result, kind))
    return str(text(result, *more, **how))


def sentences_of(result: PostureStiffness) -> list[str]:
    """The sentences of a posture's answer."""
    return list(answer_sentences(answer_at(result)))


def fixed_words(code: str) -> list[str]:
    """What a statement's sentence says whatever its numbers are."""
    parts = re.split(r"\{[^}]*\}", SENTENCES[code])
    return [words.strip() for words in parts if words.strip()]
