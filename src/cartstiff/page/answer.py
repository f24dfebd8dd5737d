"""One message to a tab: numbers and picture of the same posture, in one piece."""

from __future__ import annotations

import json
import struct
from dataclasses import dataclass, field
from typing import Any

from cartstiff.errors import InputError

__all__ = ["Answer"]


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
        try:
            text = json.dumps(self.data, allow_nan=False, separators=(",", ":")).encode()
        except ValueError:
            raise InputError(
                "the result leaves the range of double precision",
                expected="numbers of moderate size",
            ) from None
        parts = []
        for chunk in (text, *self.commands):
            parts += [struct.pack(">I", len(chunk)), chunk]
        return b"".join(parts)
