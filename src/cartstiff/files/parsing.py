"""Text to numbers."""

from __future__ import annotations

import math
from collections.abc import Callable

from cartstiff.core.choices import LARGEST_INPUT
from cartstiff.core.errors import InputError


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
        Their place: an option, a line of a file.
    count : int, optional
        Required count.
    word : callable
        Number of a word such as "rigid", or None, from the word and `where`.

    Raises
    ------
    InputError
        With `where`, the expected and the given text.
    """
    parts = [part.strip() for part in text.split(",")]
    numbers = []
    for part in parts:
        if (number_of_word := word(part, where)) is not None:
            numbers.append(number_of_word)
            continue
        try:
            number = float(part)
        except ValueError:
            number = math.nan
        if not math.isfinite(number) or "_" in part:
            if count is None:
                expected = "numbers separated by commas"
            elif count == 1:
                expected = "a number"
            else:
                expected = f"{count} numbers separated by commas"
            raise InputError(
                "not a finite number", where=where, expected=expected, got=repr(part)
            )
        if abs(number) > LARGEST_INPUT:
            raise InputError(
                "number is too large",
                where=where,
                expected=f"at most {LARGEST_INPUT:g}",
                got=part,
            )
        numbers.append(number)
    if count is not None and len(numbers) != count:
        raise InputError(
            "wrong count", where=where, expected=f"{count} numbers", got=str(len(numbers))
        )
    return numbers
