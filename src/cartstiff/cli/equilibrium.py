"""``cartstiff equilibrium``."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, Literal

from cartstiff.cli.declare import Overrides
from cartstiff.cli.options import (
    Load,
    Number,
    Output,
    Pairs,
    Parameters,
    Robot,
    Vector,
    column_factors,
    declared,
)
from cartstiff.cli.output import say_unused
from cartstiff.cli.tables import WRENCH
from cartstiff.errors import InputError
from cartstiff.notes import Note

_COMPONENTS = ("rx", "ry", "rz", "x", "y", "z")


@declared(
    "equilibrium",
    api=(
        "statics/continuation.py load_curve curve=to",
        "statics/toolpath.py compensate",
    ),
    needs={
        "world": "load hold path",
        "load_at load_kind follower": "load path",
        "csv plot": "curve path",
        "against": "path",
    },
    exclusive=(
        "curve path sensitivities",
        "curve path tolerance",
        "curve path no_limits",
        *(
            f"against_gravity {name}"
            for name in ("curve", "path", "hold", "actuate", "sensitivities", "tolerance")
        ),
        *(f"{name} path" for name in ("hold", "q", "pose", "lengths", "rest", "actuate")),
        "follower load_kind",
    ),
    rare="lengths rest follower sensitivities tolerance",
)
def command(
    robot: Robot,
    load: Annotated[
        Load,
        Overrides(
            load="Wrench on the body: moment about and force at the point --load-at, in the axes "
            "of the unloaded body frame; see --load-kind."
        ),
    ],
    parameters: Parameters,
    out: Annotated[
        Output, Overrides(csv="Write the curve or path.", plot="Draw the curve or path.")
    ],
    *,
    follower: bool = False,
    hold: Annotated[
        dict[str, float] | None, Pairs("NAME=VALUE,...", _COMPONENTS, frame=True)
    ] = None,
    no_limits: bool = False,
    curve: Annotated[float | None, Number("FACTOR", some=True)] = None,
    path: Path | None = None,
    against: Literal["load", "all"] | None = None,
    against_gravity: Vector = None,
) -> None:
    """Where MECHANISM comes to rest under a load, whether it is stable, and its stiffness there.

    Without the load the mechanism is at rest at the posture: springs without a rest position carry
    its weight there. The displacement counts from this posture. A dead load keeps its direction in
    the room while the body moves. A dead moment has no energy; then stability depends on the
    masses.

    Parameters
    ----------
    robot
        The mechanism at its posture.
    load
        The load there.
    parameters
        Derivatives by the parameters, and their deviations.
    out
        Output.
    follower
        The same as --load-kind follower.
    hold
        Prescribed displacement of the body: rx, ry, rz, x, y, z (rad, length), along the axes of
        the unloaded body, or with --world those of the room.
    no_limits
        Ignore joint and leg limits.
    path : FILE.csv
        Compensate along a path: one posture a line, or posture and wrench (as for --load, in the
        axes of the body at that posture), under a line of names if wanted. The answer has the
        commands that put the loaded body there.
    against_gravity
        Gravity at the start, in F [m/s^2]. Under it the mechanism is at rest at the posture; the
        displacement is that from there to the rest under the gravity of --gravity or the file.

    Examples
    --------
    cartstiff equilibrium ur5 --load 0,0,0,0,0,-100
    cartstiff equilibrium stewart-gough --load 0,0,0,0,0,-50 --world --json
    cartstiff equilibrium ur5 --load 0,0,0,0,0,-100 --world --load-at 0,0,0.1
    cartstiff equilibrium ur5 --load 0,0,5,0,0,-100 --load-kind follower
    cartstiff equilibrium panda --payload 3,0,0,0.1
    cartstiff equilibrium stewart-gough --load 0,0,0,0,0,-50 --tolerance 0.05,0.01
    cartstiff equilibrium cubic --payload 20 --gravity 0,-9.81,0 --against-gravity 0,0,-9.81
    cartstiff equilibrium ur5 --hold z=-0.002
    cartstiff equilibrium 6-pus --load 0,0,0,0,0,-500 --actuate leg1/slide=0.001
    cartstiff equilibrium five-bar --load 0,0,0,0,-2000,0 --curve 3 --plot curve.png
    cartstiff equilibrium ur5 --load 0,0,0,0,0,-80 --path postures.csv --csv commands.csv
    """
    if follower:
        load = replace(load, load_kind="follower")
    # A payload is a load here: it deflects the mechanism, which is at rest without it.
    bare, hung = replace(robot, payload=None), robot.payload
    elastic, q = bare.load()

    from cartstiff.mechanisms.elastic import with_default_gravity
    from cartstiff.statics.command import commanded
    from cartstiff.statics.held import Held
    from cartstiff.stiffness.applied_load import LoadKind

    def weighing(elastic: Any) -> Any:
        """Return the mechanism with the gravity that acts on its payload."""
        weighs = hung and (robot.gravity is None or any(robot.gravity))
        return with_default_gravity(elastic, hung[0]) if hung and weighs else elastic

    elastic, posture = weighing(elastic).placed(q, "--q")
    q = posture.q
    weight = _weight(elastic, hung)
    kind = LoadKind(load.load_kind, load.manner["load_at"])

    def loads_at(q: Any, wrench: Any) -> tuple[Any, ...]:
        """Return the loads on a body that shall be at q."""
        if wrench is None:
            return weight
        return (kind.acting(wrench, elastic.mechanism.at(q).pose, load.axes), *weight)

    def moved(elastic: Any) -> tuple[Any, Any]:
        """Return the mechanism and its posture after the drives have moved."""
        return (
            (elastic, q) if robot.actuate is None else commanded(elastic, robot.command(elastic), q)
        )

    elastic, start = moved(elastic)
    held = None if hold is None else Held(hold, axes=load.axes)
    if path is not None:
        _compensate(elastic, path, load, loads_at, against, out)
        return
    loads = loads_at(start, load.load)
    if curve is None:
        from cartstiff.report.statics import describe_equilibrium
        from cartstiff.statics.equilibrium import equilibrium

        if against_gravity is not None:
            if elastic.gravity is None and robot.gravity is None:
                raise InputError(
                    "there is no other gravity to compare with",
                    where="--against-gravity",
                    expected="--gravity as well, or gravity in the file",
                )
            first = elastic.with_gravity(against_gravity, where="--against-gravity")
            under = (*loads[: len(loads) - len(weight)], *_weight(first, hung))
            before = equilibrium(first, start, *under, limits=not no_limits)
            elastic = weighing(before.elastic.with_gravity(elastic.gravity)).with_notes(
                _reference_note(before, against_gravity),
                *(n for n in before.notes if n.code == "unstable-start"),
            )
            start = before.q
        state = equilibrium(elastic, start, *loads, held=held, limits=not no_limits)
        data = state.to_dict()
        more = parameters.add(state, bare, data, lambda e: moved(weighing(e))[0])
        out.show(data, elastic.name, lambda: "\n".join([describe_equilibrium(state), *more]))
        return
    if not loads:
        raise InputError("a curve needs a load", expected="--load or --payload")

    from cartstiff.report.statics import describe_curve
    from cartstiff.statics.continuation import load_curve

    result = load_curve(elastic, start, *loads, to=curve, held=held)
    out.show(
        result.to_dict(),
        elastic.name,
        lambda: describe_curve(result),
        csv=result.to_csv,
        plot=result.plot,
    )


def _reference_note(before: Any, gravity: list[float]) -> Note:
    """Note that displacements count from an equilibrium under another gravity."""
    place = before.posture.pose[:3, 3].tolist()
    shown = [", ".join(f"{x:.6g}" for x in row) for row in (gravity, place)]
    words = (
        f"the displacement counts from the rest under gravity ({shown[0]}) m/s^2, with the body "
        f"frame at ({shown[1]})"
    )
    return Note("against-gravity", words, {"gravity": gravity, "q": before.q.tolist()})


def _weight(elastic: Any, numbers: list[float] | None) -> tuple[Any, ...]:
    """Return the load of --payload."""
    from cartstiff.potentials.loads import payload

    if numbers is None:
        return ()
    gravity = (0.0, 0.0, 0.0) if elastic.gravity is None else elastic.gravity
    mass = numbers[0] / elastic.units.newtons  # weights are in the unit of force
    return (payload(mass, gravity, numbers[1:] or (0.0, 0.0, 0.0)),)


def _compensate(
    elastic: Any,
    path: Path,
    load: Load,
    loads_at: Callable[[Any, Any], tuple[Any, ...]],
    against: Literal["load", "all"] | None,
    out: Output,
) -> None:
    from cartstiff.loading.tables import read_rows
    from cartstiff.report.statics import describe_path
    from cartstiff.statics.toolpath import compensate

    mechanism, wrench = elastic.mechanism, load.load
    rows = read_rows(
        path, "postures", units=elastic.units, factors=column_factors(elastic), joints=elastic.names
    )
    joints = dict.fromkeys((elastic.names, mechanism.joint_names))
    columns, table, unused = rows.arranged(*joints, *((*own, *WRENCH) for own in joints))
    say_unused(path, unused)
    n = len(columns) if columns in joints else len(columns) - len(WRENCH)
    postures, wrenches = mechanism.undeflected(table[:, :n]), [wrench] * len(table)
    if table.shape[1] > n:
        if wrench is not None:
            raise InputError("give wrenches by --load or in the path file, not both")
        wrenches = list(table[:, n:])
    if wrenches[0] is None and (load.load_at is not None or load.load_kind != "dead"):
        name = "--load-kind" if load.load_at is None else "--load-at"
        raise InputError("is for --load", where=name)
    loads = [list(loads_at(q, w)) for q, w in zip(postures, wrenches, strict=True)]
    if not loads[0] and against != "all":
        raise InputError(
            "a path needs a load",
            where="--path",
            expected="--load, --payload, six more columns in the file, or --against all",
        )
    result = compensate(elastic, postures, loads, against=against)
    out.show(
        result.to_dict(),
        elastic.name,
        lambda: describe_path(result, is_written=out.csv is not None),
        csv=result.to_csv,
        plot=result.plot,
    )
