"""The display of a posture in a notebook: its answer, with a small picture."""

from __future__ import annotations

from html import escape

import numpy as np

from cartstiff.answer.posture import answer_at
from cartstiff.core.errors import joined
from cartstiff.core.stiffness.compute import PostureStiffness
from cartstiff.shown.page.report_drawing import drawing
from cartstiff.shown.report.answer import answer_lines


def displayed(result: PostureStiffness) -> str:
    """A posture's answer under its name as HTML, and the mechanism with its load,
    and its pose under it.
    """
    with np.errstate(all="ignore"):
        answer = answer_at(result)
        picture = drawing(result, answer)
    name = f"Stiffness of {answer.subject} ({answer.kind}) at {answer.frame}"
    return f"<pre>{escape(joined([name, *answer_lines(answer)]))}</pre>{picture}"
