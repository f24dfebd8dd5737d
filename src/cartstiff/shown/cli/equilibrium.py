"""``cartstiff equilibrium``."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, Literal

from cartstiff.core.errors import InputError, one_line
from cartstiff.core.notes import Note
from cartstiff.shown.cli.declare import Overrides
from cartstiff.shown.cli.options import (
    PICTURES,
    Files,
    Number,
    OutputFiles,
    Pairs,
    Parameters,
    Printed,
    Setup,
    Vector,
    declared,
    only_endings,
)
from cartstiff.shown.cli.output import say_unused

_COMPONENTS = ("rx", "ry", "rz", "x", "y", "z")


@declared(
    "equilibrium",
    api=(
        "core/statics/continuation.py load_curve curve=to",
        "wings/toolpaths/compensation.py compensate",
        "core/statics/equilibrium.py equilibrium",
    ),
    needs={
        "world": "load hold path",
        "load_at load_kind": "load path",
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
    ),
    rare="lengths rest sensitivities tolerance",
)
def command(
    setup: Annotated[
        Setup,
        Overrides(
            load="Wrench on the body: moment about and force at the point --load-at, in "
            "the axes of the unloaded body frame; see --load-kind."
        ),
    ],
    parameters: Parameters,
    out: Printed,
    *,
    output: Annotated[Files, OutputFiles(".csv", *PICTURES)] = None,
    hold: Annotated[dict[str, float] | None, Pairs("NAME=VALUE,...", _COMPONENTS)] = None,
    no_limits: bool = False,
    curve: Annotated[float | None, Number("FACTOR", some=True)] = None,
    path: Path | None = None,
    against: Literal["load", "all"] | None = None,
    against_gravity: Vector = None,
) -> None:
    """Where MECHANISM comes to rest under a load, whether it is stable,
    and its stiffness there.

    Before the load the mechanism carries its weight and the payload. Springs without a
    rest position balance them at the posture, and the displacement counts from there.
    With given rest positions the mechanism first moves from the posture to its rest; the
    displacement by the load counts from that rest. A dead load keeps its direction in the
    room while the body moves. A dead moment has no energy; then stability depends on the
    masses.

    Parameters
    ----------
    setup
        The mechanism at its posture, with tool, weight and load.
    parameters
        Derivatives by the parameters, and their deviations.
    out
        Output.
    output
        Write the answer (.json), or the curve or path as a table or a picture.
    hold
        Prescribed displacement of the body: rx, ry, rz, x, y, z (rad, length), along the
        axes of the unloaded body, or with --world those of the room.
    no_limits
        Ignore joint and leg limits.
    path : FILE.csv
        Compensate along a path: one posture a line, or posture and wrench, under a line
        of names if wanted. A wrench is in the axes of the body at that posture, as for
        --load, of the room with --world, or in those that its columns name (fx_world);
        fx,fy,fz are enough. The answer has the commands that put the loaded body there.

    Examples
    --------
    cartstiff equilibrium ur5 --load 0,0,0,0,0,-100
    cartstiff equilibrium stewart-gough --load 0,0,0,0,0,-50 --world --json
    cartstiff equilibrium ur5 --load 0,0,0,0,0,-100 --world --load-at 0,0,0.1
    cartstiff equilibrium ur5 --load 0,0,5,0,0,-100 --load-kind follower
    cartstiff equilibrium panda --payload 3,0,0,0.1 --load 0,0,0,0,0,-50 --world
    cartstiff equilibrium stewart-gough --load 0,0,0,0,0,-50 --tolerance 0.05,0.01
    cartstiff equilibrium cubic --payload 20 --gravity 0,-9.81,0 --against-gravity 0,0,-9.81
    cartstiff equilibrium ur5 --hold z=-0.002
    cartstiff equilibrium 6-pus --load 0,0,0,0,0,-500 --actuate leg1/slide=0.001
    cartstiff equilibrium five-bar --load 0,0,0,0,-2000,0 --curve 3 -o curve.png
    cartstiff equilibrium ur5 --load 0,0,0,0,0,-80 --path postures.csv -o commands.csv
    """  # noqa: E501
    # One state of rest.
    if curve is None and path is None:
        only_endings(output, ".json", others="--curve or --path")
    # The mechanism at its posture, before and after the drives move.
    elastic, q = setup.read()

    from cartstiff.answer.commanded import commanded

    elastic, posture = elastic.placed(q, "--q")
    q = posture.q

    def moved(elastic: Any) -> tuple[Any, Any]:
        """Return the mechanism and its posture after the drives have moved."""
        if setup.actuate is None:
            return elastic, q
        return commanded(elastic, setup.command(elastic), q)

    elastic, start = moved(elastic)
    # A path is compensated point by point: another answer.
    if path is not None:
        _compensate(elastic, path, setup, against, out, output)
        return
    acting: dict[str, Any] = {} if setup.load is None else setup.keywords
    if hold is not None:
        from cartstiff.core.statics.held import Held

        acting["held"] = Held(hold, axes=setup.axes)
    if curve is None:
        from cartstiff.core.statics.equilibrium import equilibrium
        from cartstiff.shown.report.analysis import describe_equilibrium
        from cartstiff.shown.report.answer import tables_lines

        if against_gravity is not None:
            _check_gravity(elastic, setup)
        state = equilibrium(
            elastic,
            start,
            against_gravity=against_gravity,
            limits=not no_limits,
            **acting,
        )
        if not acting and against_gravity is None:
            state = _with_payload_noted(state, setup.payload)
        from cartstiff.answer.equilibrium import answer_of_equilibrium

        data = state.to_dict() | {"answer": answer_of_equilibrium(state).to_dict()}
        more = parameters.add(state, setup, data, lambda e: moved(e)[0])
        out.show(
            data,
            elastic.name,
            lambda: "\n".join([describe_equilibrium(state), *tables_lines(more)]),
            output,
        )
        return
    # A curve: the states from no load to a multiple of this one.
    _check_load(elastic, setup)

    from cartstiff.core.statics.continuation import load_curve
    from cartstiff.wings.toolpaths.answer import answer_of_curve

    result = load_curve(elastic, start, to=curve, **acting)
    out.answer(
        result.to_dict(),
        answer_of_curve(result),
        output,
        csv=result.to_csv,
        picture=result.plot,
    )


def _check_gravity(elastic: Any, setup: Setup) -> None:
    """Refuse a comparison with another gravity where there is none."""
    if elastic.gravity is None and setup.gravity is None:
        raise InputError(
            "there is no other gravity to compare with",
            where="--against-gravity",
            expected="--gravity as well, or gravity in the file",
        )


def _check_load(elastic: Any, setup: Setup) -> None:
    """Refuse a curve without a load."""
    if setup.load is None:
        options = _as_load(elastic, setup.payload)
        expected = (
            f"--load; the payload's own weight is {options}" if options else "--load"
        )
        raise InputError("a curve needs a load", expected=expected)


def _check_without_load(
    elastic: Any, setup: Setup, against: Literal["load", "all"] | None
) -> None:
    """Refuse options of a load on a path without one, and a path that needs one."""
    if setup.load_at:
        raise InputError("is for --load", where="--load-at")
    if setup.load_kind != "dead":
        raise InputError("is for --load", where="--load-kind")
    if against == "load" or (against is None and elastic.before_load != "given"):
        raise InputError(
            "a path needs a load",
            where="--path",
            expected="--load, columns fx,fy,fz in the file, or --against all",
        )


def _as_load(elastic: Any, payload: list[float] | None) -> str:
    """The options that make a load of a payload's weight; empty without one."""
    if payload is None or elastic.gravity is None or not elastic.gravity.any():
        return ""
    weight = ",".join(
        f"{w:g}" for w in payload[0] / elastic.units.newtons * elastic.gravity
    )
    at = ",".join(f"{x:g}" for x in payload[1:])
    return f"--load 0,0,0,{weight} --world" + (f" --load-at {at}" if at else "")


def _with_payload_noted(state: Any, payload: list[float] | None) -> Any:
    """Add a note if a payload was given that moves nothing, as the springs balance it."""
    options = _as_load(state.elastic, payload)
    if not options or state.iterations:
        return state
    message = (
        "the payload acts before the load, as the own weight does, and the springs "
        f"balance both at the posture; its own sag is that of {options}"
    )
    note = Note("payload-before-load", message, {"payload": payload})
    return replace(state, _own_notes=(*state._own_notes, note))


def _compensate(
    elastic: Any,
    path: Path,
    setup: Setup,
    against: Literal["load", "all"] | None,
    out: Printed,
    output: Files,
) -> None:
    from cartstiff.files.tables import FORCE, MOMENT, WRENCH, along_axes, read_rows
    from cartstiff.shown.cli.tables import (
        along_world,
        once,
        one_of_axes,
        wrench_columns,
    )
    from cartstiff.wings.toolpaths.answer import answer_of_compensation
    from cartstiff.wings.toolpaths.compensation import compensate

    mechanism, axes = elastic.mechanism, None
    # Columns of the file: joints, then a wrench or a half of one.
    rows = read_rows(path, "postures", units=elastic.units, joints=elastic.names)
    joints = dict.fromkeys((elastic.names, mechanism.joint_names))
    parts: list[tuple[str, ...]] = [WRENCH]
    if rows.names is not None:
        names, axes = along_axes(rows.names, rows.place)
        rows, parts = rows._replace(names=names), [WRENCH, FORCE, MOMENT]
    columns, table, unused = rows.arranged(
        *joints, *((*own, *part) for own in joints for part in parts)
    )
    say_unused(path, unused)
    by_name = dict(zip(columns, table.T, strict=True))
    own = next(
        own for own in joints if set(own) <= set(columns) and own == columns[: len(own)]
    )
    named_wrenches = wrench_columns({n: by_name[n] for n in columns[len(own) :]})
    wrenches = once("--load", setup.load, named_wrenches, one_line(str(path)))
    # The path without and with wrenches.
    if wrenches is None:
        _check_without_load(elastic, setup, against)
        result = compensate(elastic, mechanism.undeflected(table), against=against)
    else:
        named = one_of_axes("world" if setup.world else None, axes, rows.place) or "body"
        if named == "base":
            wrenches, named = along_world(wrenches, mechanism.base_pose), "world"
        postures = mechanism.undeflected(table[:, : len(own)])
        result = compensate(
            elastic, postures, wrenches, load_axes=named, against=against, **setup.manner
        )
    out.answer(
        result.to_dict(),
        answer_of_compensation(result),
        output,
        csv=result.to_csv,
        picture=result.plot,
    )
