"""What the commands print of a result."""

from __future__ import annotations

import re
from typing import Any

from cartstiff import (
    CompensatedPath,
    ElasticMechanism,
    Equilibrium,
    LoadCurve,
    OptimisedPath,
    PostureStiffness,
    Workspace,
)
from cartstiff.identify import Identification
from tests.doors import SI, Units
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
    better_posture,
    better_statements,
    describe,
    describe_equilibrium,
    report_page,
    summary_text,
    words_of,
)
from tests.inner import TITLES as TITLES
from tests.inner import VERDICTS as VERDICTS


def _of_posture(result: PostureStiffness, **how: Any) -> str:
    return str(describe(result, answer_at(result), **how))


def _of_analysis(result: Any, units: Units = SI) -> str:
    return str(summary_text(result, units))


#: What makes the text of each kind of result, or its answer.
TEXTS = {PostureStiffness: _of_posture, Equilibrium: describe_equilibrium, dict: _of_analysis}
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


def answer_of(result: PostureStiffness, **load: Any) -> Any:
    """A posture's answer as plain data."""
    return answer_at(result, **load).to_dict()


def report_of(elastic: ElasticMechanism, *more: Any, **options: Any) -> str:
    """A report of a posture as the text of one file."""
    return str(report_page(elastic, *more, **options))


def better_of(elastic: ElasticMechanism, *more: Any, **load: Any) -> Any:
    """A better posture under a load, None where none is worth it."""
    return better_posture(elastic, *more, **load)


def words_of_better(found: Any, elastic: ElasticMechanism) -> list[str]:
    """What is said of a better posture."""
    return list(words_of(better_statements(found, elastic)))
