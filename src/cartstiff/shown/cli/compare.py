"""``cartstiff compare``."""

from __future__ import annotations

from dataclasses import replace
from typing import Annotated, Any

from cartstiff.core.errors import InputError
from cartstiff.shown.cli.declare import Overrides
from cartstiff.shown.cli.options import (
    ONE_POSTURE,
    PICTURES,
    BalancedSetup,
    Files,
    OutputFiles,
    Pairs,
    Printed,
    declared,
)


@declared("compare", rare="lengths pose rest load_at load_kind")
def command(
    setup: Annotated[BalancedSetup, Overrides("actuate", because=ONE_POSTURE)],
    out: Printed,
    other: str | None = None,
    *,
    changed: Annotated[dict[str, float] | None, Pairs("NAME=VALUE"), "--with"] = None,
    output: Annotated[Files, OutputFiles(*PICTURES)] = None,
) -> None:
    """MECHANISM and OTHER side by side under the same load, with ratios.

    Every option holds for both, in the units of MECHANISM. Without OTHER, MECHANISM is
    compared with itself under --with. Ratios are the second over the first. What only one
    of them has is named.

    `cartstiff view MECHANISM OTHER` with the same options shows both on a page, side by
    side at one scale.

    Parameters
    ----------
    setup
        The mechanisms, with tool, weight and load.
    out
        Output.
    other : [OTHER]
        A second name or file.
    changed
        Parameters of the second mechanism's file, besides those of --set.
    output
        Write the answer (.json) or a picture of both.

    Examples
    --------
    cartstiff compare ur5 ur10 --load 0,0,0,0,0,-100 --world
    cartstiff compare inclined-hexapod --with sz=0.6 --load 0,0,0,0,0,-500
    cartstiff compare hexapod cubic --load 0,0,0,100,0,0 --world -o both.png
    cartstiff compare delta hexapod --json
    cartstiff compare ur5 panda --payload 3 --load 0,0,0,0,0,-50 --world -o both.svg -o
    both.json
    """
    if other is None and changed is None:
        raise InputError(
            "there is nothing to compare with",
            where=setup.mechanism,
            expected="a second mechanism, or --with NAME=VALUE",
        )
    second = replace(
        setup,
        mechanism=setup.mechanism if other is None else other,
        parameters={**(setup.parameters or {}), **(changed or {})} or None,
    )
    elastic, q = setup.read()
    against, q_against = second.read(elastic.units)

    import numpy as np

    from cartstiff.answer.comparison import compare
    from cartstiff.core.stiffness.compute import analyse

    with np.errstate(all="ignore"):  # what is not finite is refused as a whole
        found = compare(
            analyse(elastic, q, **setup.keywords),
            analyse(against, q_against, **setup.keywords),
            labels=_labels(elastic, against, changed or {}),
        )

    from cartstiff.answer.compared import answer_of_comparison

    out.answer(
        found.to_dict(),
        answer_of_comparison(found),
        output,
        picture=found.plot,
    )


def _labels(first: Any, second: Any, changed: dict[str, float]) -> tuple[str, str] | None:
    """Values of the changed parameters, after the names where these differ."""
    if not changed:
        return None
    alike = first.name == second.name
    a, b = (
        ", ".join(
            [
                *([] if alike else [x.name]),
                *(
                    f"{name}={x.parameters[name]:g}"
                    for name in changed
                    if name in x.parameters
                ),
            ]
        )
        for x in (first, second)
    )
    return (a, b) if a != b else None
