"""``cartstiff modes``."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

import click

from cartstiff.core.choices import RESPONSES, Axes, Order
from cartstiff.core.errors import UndefinedError
from cartstiff.shown.cli.declare import Overrides
from cartstiff.shown.cli.options import (
    ONE_POSTURE,
    PICTURES,
    BalancedSetup,
    Direction,
    Files,
    Numbers,
    OutputFiles,
    Parameters,
    Point,
    Printed,
    Rayleigh,
    Sweep,
    declared,
    only_endings,
)

if TYPE_CHECKING:
    from cartstiff.answer.data import Table
    from cartstiff.answer.vibration.modes import Modes
    from cartstiff.core.mechanisms.elastic import ElasticMechanism


_Range = tuple[float, float, int] | None


@dataclass(frozen=True)
class Controller:
    """Impedance controller.

    Parameters
    ----------
    impedance : FILE
        Controller's stiffness at the body frame. A 6x6 matrix in a .json, .csv or .npy
        file. The answer has the damping by double diagonalisation with the masses at the
        posture, in the order and along the axes of the file, and joint-space gains.
    order
        Order of the rows of --impedance; default what its file says, else angular-linear.
    """

    API: ClassVar = (
        "core/stiffness/tensor.py StiffnessTensor.from_controller",
        "answer/vibration/controllers.py impedance ratio=ratios",
    )
    NEEDS: ClassVar = {"order axes ratio": "impedance"}
    RARE: ClassVar = "order axes ratio"

    impedance: Path | None = None
    order: Order | None = None
    axes: Axes = "body"
    ratio: Annotated[list[float] | None, Numbers("RATIO[,RATIO...]", 1, 6, low=0)] = None

    def run(self, modes: Modes, data: dict[str, Any]) -> list[Table]:
        """Compute the controller, add it to the JSON object; return its tables."""
        if self.impedance is None:
            return []
        from cartstiff.answer.vibration.answer import impedance_tables
        from cartstiff.answer.vibration.controllers import impedance
        from cartstiff.core.stiffness.tensor import StiffnessTensor
        from cartstiff.shown.cli.tables import read_target

        elastic = modes.elastic
        target = read_target(self.impedance, self.order, "--impedance")
        wanted = StiffnessTensor.from_controller(
            target.in_units_of(elastic.mechanism),
            order=target.order,  # type: ignore[arg-type]
            axes=self.axes,
            pose=modes.posture.pose,
            base=elastic.mechanism.base_pose,
            frame=elastic.mechanism.frame,
            units=elastic.units,
        )
        ratios = self.ratio or [0.7]
        answer = impedance(modes, wanted, self.ratio or 0.7)
        shown = answer.for_controller(target.order, self.axes)  # type: ignore[arg-type]
        data["impedance"] = {
            "given": {"order": target.order, "axes": self.axes, "ratios": ratios},
            "q": dict(zip(elastic.names, modes.q.tolist(), strict=True)),
            "units": elastic.units.to_dict(),
            "for_controller": shown,
            **answer.to_dict(),
        }
        return impedance_tables(answer, shown, elastic.units)


def _without_load(elastic: ElasticMechanism, q: Any) -> Modes:
    """Return the modes without the load; weight may need rest positions of its own."""
    from cartstiff.answer.vibration.modes import modes

    try:
        return modes(elastic, q)
    except UndefinedError:
        return modes(elastic, q, wrench=[0.0] * 6)


def _as_yaml(gains: dict[str, Any]) -> str:
    """Format as YAML with one key per line and rows of matrices in brackets."""
    import yaml

    endless: Any = float("inf")
    return str(
        yaml.safe_dump(gains, default_flow_style=None, sort_keys=False, width=endless)
    )


@dataclass(frozen=True)
class Response:
    """Response.

    Parameters
    ----------
    response
        Response to a force on the body, at COUNT frequencies [Hz], 400 by default: in
        equal ratios, or in equal steps if LOW is 0.
    kind
        Displacement, velocity or acceleration per force; or motion of the body per motion
        of the ground.
    direction
        Direction for --response, along the body's axes (the room's for a
        transmissibility); default x, y and z.
    """

    API: ClassVar = ("answer/vibration/response.py frequency_response point=at",)
    NEEDS: ClassVar = {"kind point direction": "response"}
    RARE: ClassVar = "kind point"

    response: Annotated[_Range, Sweep(400, 1_000_000, "Hz")] = None
    kind: Annotated[Any, click.Choice([*RESPONSES, "transmissibility"])] = "receptance"
    point: Point = None
    direction: Direction = None

    def run(
        self, modes: Modes, vibration: Rayleigh, data: dict[str, Any]
    ) -> tuple[list[Table], dict[str, Any]]:
        """Compute, add to the JSON object.

        Return its table, and functions that make the files.
        """
        if self.response is None:
            return [], {}
        import numpy as np

        from cartstiff.answer.vibration.answer import response_table
        from cartstiff.answer.vibration.response import (
            frequency_response,
            transmissibility,
        )

        low, high, count = self.response
        hertz = (
            np.geomspace(low, high, count) if low > 0.0 else np.linspace(low, high, count)
        )
        asked = modes, hertz, vibration.damped
        at = self.point or (0.0, 0.0, 0.0)
        answer: Any
        if self.kind == "transmissibility":
            answer = transmissibility(*asked, at=at)
        else:
            answer = frequency_response(*asked, kind=self.kind, at=at)
        data["response"] = answer.to_dict(self.direction)
        return [response_table(answer, self.direction)], {
            "csv": lambda: answer.to_csv(self.direction),
            "picture": lambda: answer.plot(self.direction, modes),
        }


@declared(
    "modes",
    needs={
        "world": "load",
        "damping rayleigh": "response",
    },
    rare="lengths rest load_at sensitivities tolerance",
)
def command(
    setup: Annotated[
        BalancedSetup,
        Overrides(
            "actuate",
            because=ONE_POSTURE,
            load="Wrench on the body: moment about and force at the point --load-at, in "
            "the body's axes; rest positions are chosen so that the springs balance it. "
            "The modes without the load are printed beside them.",
        ),
    ],
    response: Response,
    vibration: Rayleigh,
    controller: Controller,
    parameters: Annotated[
        Parameters,
        Overrides(
            tolerance="Standard deviations: relative of every spring stiffness, absolute "
            "of every length and rotation (rad) of the geometry. The answer has an "
            "interval for each frequency (measured springs have one without this option) "
            "and what contributes most to it."
        ),
    ],
    out: Printed,
    *,
    output: Annotated[Files, OutputFiles(".csv", ".yaml", *PICTURES)] = None,
    strict: bool = False,
) -> None:
    r"""Natural frequencies and modes of MECHANISM at a posture, under its load.

    Small undamped motions about the rest state: K phi = omega^2 M phi with the second
    derivative K of all energies and the masses' matrix M, on the motions that keep the
    closures. A load moves the frequencies; every table says which load it belongs to.

    Parameters
    ----------
    setup
        The mechanism at its posture, with tool, weight and load.
    response
        The response to a force.
    vibration
        Damping.
    controller
        An impedance controller.
    parameters
        Derivatives by the parameters, and their deviations.
    out
        Output.
    output
        Write the answer (.json); the response as a table (.csv) or a picture (.png, .svg,
        .pdf); the controller of --impedance (.yaml).
    strict
        Exit with code 3 if there are no modes.

    Examples
    --------
    cartstiff modes stewart-simscape
    cartstiff modes ur5 --load 0,0,0,0,0,-500 --world
    cartstiff modes panda --payload 2,0,0,0.1 --json
    cartstiff modes ur5 --response 5:100 --damping 0.02 --direction 0,0,1 -o bode.png
    cartstiff modes panda --impedance wanted.json --ratio 0.7 -o controller.yaml
    cartstiff modes stewart-simscape --sensitivities --tolerance 0.05,0.0001
    """
    endings = [".csv", *PICTURES] * (response.response is not None)
    endings += [".yaml"] * (controller.impedance is not None)
    only_endings(output, ".json", *endings, others="--response or --impedance")
    elastic, q = setup.read()

    import numpy as np

    from cartstiff.answer.vibration.answer import answer_of_modes
    from cartstiff.answer.vibration.modes import modes
    from cartstiff.shown.report.sentences import BALANCING

    try:
        with np.errstate(all="ignore"):
            swinging = modes(elastic, q, **setup.keywords)
            is_loaded = setup.load is not None and any(setup.load)
            bare = _without_load(elastic, q) if is_loaded else None
    except UndefinedError as error:
        if strict or {*(output or {})} - {".json"}:
            raise
        note = {"code": error.code, "message": str(error), "values": dict(error.values)}
        data: dict[str, Any] = {
            "schema": "cartstiff-modes/1",
            "frequencies": [],
            "notes": [note],
        }
        words = f"{elastic.name}: no modes\n  [{error.code}] {error}"
        if error.code == "unbalanced":
            words += f"\n  {BALANCING}"
        out.show(data, setup.mechanism, lambda: words, output)
        return
    # Modes without the load, derivatives, response and controller.
    data = swinging.to_dict()
    if bare is not None:
        unloaded = bare.to_dict()
        data["unloaded"] = {
            key: unloaded[key] for key in ("frequencies", "eigenvalues", "load")
        }
    tables = parameters.add(swinging, setup, data)
    more, made = response.run(swinging, vibration, data)
    tables += [*more, *controller.run(swinging, data)]
    if controller.impedance is not None:
        made["yaml"] = lambda: _as_yaml(data["impedance"])
    out.answer(
        data,
        answer_of_modes(swinging, bare, tables),
        output,
        **made,
    )
