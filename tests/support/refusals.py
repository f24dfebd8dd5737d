"""What is refused, in which words."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

from cartstiff import InputError


def refused(
    words: str, call: Callable[..., Any], *given: Any, kind: Any = InputError, **named: Any
) -> Any:
    """The error of a call that is refused in these words (a regular expression)."""
    with pytest.raises(kind, match=words) as caught:
        call(*given, **named)
    return caught.value
