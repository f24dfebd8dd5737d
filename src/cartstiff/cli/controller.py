"""``--impedance`` of ``cartstiff modes``: a controller's stiffness and damping at a posture."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cartstiff.cli.requests.target_file import read_target
from cartstiff.cli.types import only_with
from cartstiff.errors import InputError

if TYPE_CHECKING:
    from cartstiff.vibration.mode_set import Modes


@dataclass(frozen=True)
class ControllerRequest:
    """The options about the controller, checked."""

    impedance: Path | None
    order: str | None
    axes: str
    ratio: list[float] | None
    output: Path | None

    def __post_init__(self) -> None:
        if self.impedance is None:
            axes = None if self.axes == "body" else self.axes
            only_with(
                "impedance", order=self.order, axes=axes, ratio=self.ratio, output=self.output
            )
        elif self.ratio is not None and min(self.ratio) < 0.0:
            raise InputError(
                "cannot be used", where="--ratio", expected="zero or more", got=self.ratio
            )

    def run(self, modes: Modes, data: dict[str, Any]) -> list[str]:
        """Computes, adds to the JSON object, writes the file; lines for people."""
        if self.impedance is None:
            return []
        from cartstiff.report.modes import describe_impedance
        from cartstiff.stiffness.tensor import StiffnessTensor
        from cartstiff.vibration.controllers import impedance

        target = read_target(self.impedance, self.order)
        wanted = StiffnessTensor.from_controller(
            target.in_units_of(modes.elastic.mechanism),
            order=target.order,  # type: ignore[arg-type]
            axes=self.axes,  # type: ignore[arg-type]
            pose=modes.posture.pose,
            base=modes.elastic.mechanism.base_pose,
            frame=modes.elastic.mechanism.frame,
            units=modes.elastic.units,
        )
        answer = impedance(modes, wanted, self.ratio or 0.7)
        gains = {
            "given": {"order": target.order, "axes": self.axes, "ratios": self.ratio or [0.7]},
            "q": dict(zip(modes.elastic.names, modes.q.tolist(), strict=True)),
            "units": modes.elastic.units.as_dict(),
            "for_controller": answer.for_controller(target.order, self.axes),  # type: ignore[arg-type]
            **answer.as_dict(),
        }
        data["impedance"] = gains
        if self.output is not None:
            from cartstiff.report.output import write_whole

            write_whole(self.output, _text(gains, self.output.suffix).encode())
        shown = gains["for_controller"]
        return describe_impedance(answer, shown, modes.elastic.units)


def _text(gains: dict[str, Any], ending: str) -> str:
    """JSON, or the same as YAML: one key a line, rows of matrices in brackets."""
    if ending == ".json":
        return json.dumps(gains, allow_nan=False, indent=1) + "\n"
    lines = []
    for key, value in gains.items():
        if isinstance(value, dict):
            lines.append(f"{key}:")
            lines += [f"  {json.dumps(k)}: {json.dumps(v)}" for k, v in value.items()]
        elif value and isinstance(value, list) and isinstance(value[0], list):
            lines += [f"{key}:", *(f"  - {json.dumps(row)}" for row in value)]
        else:
            lines.append(f"{key}: {json.dumps(value)}")
    return "\n".join(lines) + "\n"
