"""Options about damping and milling: of ``modes --lobes``, of maps and of paths."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cartstiff.cli.types import ANGLE, DIRECTION, POINT, Numbers, only_with, option, option_group
from cartstiff.errors import InputError
from cartstiff.parsing import parse_numbers

if TYPE_CHECKING:
    from cartstiff.vibration.chatter import Milling
    from cartstiff.vibration.modes import Modes
    from cartstiff.vibration.response import Damping

cutting_options = option_group(
    option(
        "--milling",
        Numbers("KT,KR,TEETH,ENTRY,EXIT", 5, powers=(-2, 0, 0, ANGLE)),
        "Force law of a mill: tangential force per area, radial over tangential, teeth, and "
        "angles (rad) at which a tooth enters and leaves (slot 0,3.1416; half up 0,1.5708).",
    ),
    option("--feed", DIRECTION, "Direction of the feed of --milling, in M; default x."),
    option("--normal", DIRECTION, "Normal to the feed, in M; default y."),
    option("--tip", POINT, "Tip of the mill, in M; default its origin."),
)

_damping_options = option_group(
    option(
        "--damping", Numbers("RATIO[,RATIO...]"), "Damping ratio of every mode, or one for each."
    ),
    option(
        "--rayleigh",
        Numbers("ALPHA,BETA", 2),
        "Damping alpha M + beta K [1/s, s]. Dampers of the mechanism always act.",
    ),
)


def vibration_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """Options about damping and milling, given to a command as one mapping `vibration`."""

    @wraps(command)
    def run(*arguments: Any, **given: Any) -> Any:
        taken = {name: given.pop(name) for name in ("milling", "feed", "normal", "tip")}
        damping = damping_of(given.pop("damping"), given.pop("rayleigh"))
        vibration = {"damping": damping, "milling": cutter(**taken)}
        return command(*arguments, **given, vibration=vibration)

    return cutting_options(_damping_options(run))


# Number of speeds by default, and at most.
_COUNT, _MOST = 12, 2000


def damping_of(damping: list[float] | None, rayleigh: list[float] | None) -> Damping:
    """What damps.

    Raises
    ------
    InputError
        For negative numbers.
    """
    from cartstiff.vibration.response import Damping

    for name, value in (("damping", damping), ("rayleigh", rayleigh)):
        if value is not None and min(value) < 0.0:
            raise InputError(
                "cannot be used", where=f"--{name}", expected="zero or more", got=value
            )
    alpha, beta = rayleigh or (0.0, 0.0)
    ratios = 0.0 if damping is None else damping[0] if len(damping) == 1 else tuple(damping)
    return Damping(ratios, alpha, beta)


def cutter(
    milling: list[float] | None,
    feed: list[float] | None,
    normal: list[float] | None,
    tip: list[float] | None,
) -> Milling | None:
    """The cutter of --milling; None without it.

    Raises
    ------
    InputError
        For numbers that cannot be used, or other options without --milling.
    """
    if milling is None:
        only_with("milling", feed=feed, normal=normal, tip=tip)
        return None
    from cartstiff.vibration.chatter import Milling

    kt, kr, teeth, entry, exit_ = milling
    more: dict[str, Any] = {"feed": feed, "normal": normal, "at": tip}
    more = {key: tuple(value) for key, value in more.items() if value is not None}
    count = int(teeth) if teeth == int(teeth) else teeth
    return Milling(kt, kr, count, entry, exit_, **more)  # type: ignore[arg-type]


@dataclass(frozen=True)
class LobesRequest:
    """``--lobes`` of ``cartstiff modes``, checked."""

    lobes: str | None
    milling: list[float] | None
    feed: list[float] | None
    normal: list[float] | None
    tip: list[float] | None
    csv: Path | None = None
    plot: Path | None = None

    def __post_init__(self) -> None:
        if self.lobes is None:
            of_milling = {"feed": self.feed, "normal": self.normal, "tip": self.tip}
            only_with("lobes", milling=self.milling, **of_milling)
            return
        if self.milling is None:
            raise InputError("needs a force law", where="--lobes", expected="--milling")
        self._speeds()

    def _speeds(self) -> tuple[float, float, int]:
        parts = (self.lobes or "").split(":")
        numbers = [parse_numbers(part, "--lobes", 1)[0] for part in parts if len(parts) in (2, 3)]
        low, high, count = [*numbers, _COUNT][:3] if numbers else (0.0, 0.0, 0.0)
        if not (0.0 < low < high and count == int(count) and 2 <= count <= _MOST):
            raise InputError(
                "speeds cannot be used",
                where="--lobes",
                got=self.lobes,
                expected=f"LOW:HIGH[:COUNT], 0 < LOW < HIGH in rev/min, COUNT from 2 to {_MOST}",
            )
        return low, high, int(count)

    def run(self, modes: Modes, damping: Damping, data: dict[str, Any]) -> list[str]:
        """Computes, adds to the JSON object; lines for people."""
        milling = cutter(self.milling, self.feed, self.normal, self.tip)
        if self.lobes is None or milling is None:
            return []
        from dataclasses import asdict

        import numpy as np

        from cartstiff.report.modes import describe_lobes, lobes_csv
        from cartstiff.vibration.chatter import lobes

        if not damping.acts_on(modes.elastic):
            raise InputError("needs damping", where="--lobes", expected="--damping or --rayleigh")
        low, high, count = self._speeds()
        curve = lobes(modes, milling, np.linspace(low, high, count), damping)
        data["lobes"] = {
            **curve.as_dict(),
            "milling": asdict(milling),
            "unit": modes.elastic.units.length,
        }
        from cartstiff.report.modes import draw_lobes
        from cartstiff.report.output import write_files

        unit = modes.elastic.units.length
        write_files(
            (self.csv, lambda: lobes_csv(curve, unit)),
            (self.plot, lambda: draw_lobes(curve, unit)),
        )
        return describe_lobes(curve, modes.elastic.units)
