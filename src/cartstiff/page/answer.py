"""One message to a tab: numbers and picture of the same posture, in one piece."""

from __future__ import annotations

import json
import re
import struct
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any

from pydantic import ConfigDict, TypeAdapter

from cartstiff.errors import InputError, printable

# Characters as JSON writes them: in two halves, as \uXXXX, behind a backslash.
_UNSEEN = re.compile(r"\\ud[89ab]..\\ud[c-f]..|\\u([0-9a-f]{4})|\\.|\x7f")


# Numbers as text: ten times as fast as by the standard library.
_PLAIN = TypeAdapter[Any](Any, config=ConfigDict(ser_json_inf_nan="constants"))


def _shown(match: re.Match[str]) -> str:
    """What `printable` makes of an escaped character."""
    code = match.group(1)
    if code is None:
        return r"\\x7f" if match.group() == "\x7f" else match.group()
    shown = printable(chr(int(code, 16)))
    return match.group() if len(shown) == 1 else shown.replace("\\", r"\\")


@dataclass(frozen=True)
class Answer:
    """A JSON object and commands for the viewer.

    Attributes
    ----------
    data : dict
        For the page.
    commands : list of bytes
        Packed commands for the viewer, in order.
    """

    data: dict[str, Any]
    commands: list[bytes] = field(default_factory=list)

    def pack(self) -> bytes:
        """Chunks one after the other, each behind its length (uint32, big endian).

        The first is the JSON text, the others are commands.

        Raises
        ------
        InputError
            If a number is not finite.
        """
        text, parts = self._text(), list[bytes]()
        for chunk in (text, *self.commands):
            parts += [struct.pack(">I", len(chunk)), chunk]
        return b"".join(parts)

    def _text(self) -> bytes:
        with suppress(ValueError):
            text = _PLAIN.dump_json(self.data)
            # All of it is seen as it is, and no number is beyond what JSON has.
            others = (b"\\", b"\x7f", b"NaN", b"Infinity")
            is_plain = text.isascii() or text.decode().isprintable()
            if is_plain and not any(other in text for other in others):
                return text
        try:
            plain = json.dumps(self.data, allow_nan=False, separators=(",", ":"))
        except ValueError:
            raise InputError(
                "the result leaves the range of double precision",
                expected="numbers of moderate size",
            ) from None
        return _UNSEEN.sub(_shown, plain).encode()
