"""Text to numbers."""

from __future__ import annotations

import math
from collections.abc import Callable

from cartstiff.choices import LARGEST_INPUT
from cartstiff.errors import InputError


def parse_numbers(
    text: str,
    where: str,
    count: int | None = None,
    *,
    word: Callable[[str, str], float | None] = lambda *_: None,
) -> list[float]:
    """Comma-separated finite numbers.

    Parameters
    ----------
    text : str
        The numbers.
    where : str
        What they were given as: an option, a line of a file.
    count : int, optional
        How many there must be.
    word : callable
        The number that a text stands for which is none, such as "rigid"; from the text and `where`.

    Raises
    ------
    InputError
        With `where`, what was expected, and what was given.
    """
    parts = [part.strip() for part in text.split(",")]
    numbers = []
    for part in parts:
        if (stands_for := word(part, where)) is not None:
            numbers.append(stands_for)
            continue
        try:
            number = float(part)
        except ValueError:
            number = math.nan
        if not math.isfinite(number) or "_" in part:
            expected = (
                "numbers separated by commas"
                if count is None
                else "a number"
                if count == 1
                else f"{count} numbers separated by commas"
            )
            raise InputError("not a finite number", where=where, expected=expected, got=repr(part))
        if abs(number) > LARGEST_INPUT:
            raise InputError(
                "number is too large", where=where, expected=f"at most {LARGEST_INPUT:g}", got=part
            )
        numbers.append(number)
    if count is not None and len(numbers) != count:
        raise InputError(
            "wrong count", where=where, expected=f"{count} numbers", got=str(len(numbers))
        )
    return numbers
