"""``--response`` of ``cartstiff modes``: what is asked, and how it is written."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cartstiff.choices import RESPONSES
from cartstiff.errors import InputError
from cartstiff.parsing import parse_numbers

if TYPE_CHECKING:
    from cartstiff.vibration.damping import Damping
    from cartstiff.vibration.mode_set import Modes

#: Responses that can be asked for: to a force, and to a motion of the base.
KINDS = (*RESPONSES, "transmissibility")

_COUNT, _MOST = 400, 1_000_000


@dataclass(frozen=True)
class ResponseRequest:
    """The options about the response, checked."""

    response: str | None
    kind: str
    point: list[float] | None
    direction: list[float] | None
    damping: list[float] | None
    rayleigh: list[float] | None
    csv: Path | None = None
    plot: Path | None = None
    lobes: bool = False

    def __post_init__(self) -> None:
        if self.response is None:
            for name in ("point", "direction", "damping", "rayleigh", "csv", "plot"):
                if getattr(self, name) is not None and not (
                    self.lobes and name in ("damping", "rayleigh")
                ):
                    raise InputError("is for --response", where=f"--{name}")
            if self.kind != KINDS[0]:
                raise InputError("is for --response", where="--kind")
            return
        self._range()
        if self.direction is not None and not any(self.direction):
            raise InputError("must not be zero", where="--direction", got=self.direction)

    @property
    def damped(self) -> Damping:
        """What damps."""
        from cartstiff.cli.milling import damping_of

        return damping_of(self.damping, self.rayleigh)

    def _range(self) -> tuple[float, float, int]:
        parts = (self.response or "").split(":")
        if len(parts) not in (2, 3):
            raise InputError(
                "cannot be used", where="--response", expected="LOW:HIGH[:COUNT]", got=self.response
            )
        numbers = [parse_numbers(part, "--response", 1)[0] for part in parts]
        low, high = numbers[:2]
        count = numbers[2] if len(numbers) == 3 else _COUNT
        if not 0.0 <= low < high:
            raise InputError(
                "frequencies cannot be used",
                where="--response",
                expected="0 <= LOW < HIGH, in Hz",
                got=self.response,
            )
        if not (count == int(count) and 2 <= count <= _MOST):
            raise InputError(
                "count cannot be used",
                where="--response",
                expected=f"a whole number from 2 to {_MOST}",
                got=count,
            )
        return low, high, int(count)

    def run(self, modes: Modes, data: dict[str, Any]) -> list[str]:
        """Computes, adds to the JSON object, writes the files; lines for people."""
        if self.response is None:
            return []
        import numpy as np

        from cartstiff.report.modes import describe_response
        from cartstiff.vibration.response import frequency_response, transmissibility

        low, high, count = self._range()
        hertz = np.geomspace(low, high, count) if low > 0.0 else np.linspace(low, high, count)
        damping = self.damped
        at = self.point or (0.0, 0.0, 0.0)
        answer: Any = (
            transmissibility(modes, hertz, damping, at=at)
            if self.kind == "transmissibility"
            else frequency_response(modes, hertz, damping, kind=self.kind, at=at)  # type: ignore[arg-type]
        )
        data["response"] = answer.as_dict(self.direction)
        from cartstiff.report.modes import draw_response
        from cartstiff.report.output import write_files

        write_files(
            (self.csv, lambda: answer.as_csv(self.direction)),
            (self.plot, lambda: draw_response(answer, self.direction, modes)),
        )
        return describe_response(answer, self.direction)
