"""Why a path cannot be followed, and where."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from cartstiff.errors import UndefinedError
from cartstiff.geometry.se3 import Array
from cartstiff.mechanisms.elastic import ElasticMechanism
from cartstiff.mechanisms.other_units import shown_factors
from cartstiff.toolpaths.choices import Choices, PathSolver
from cartstiff.toolpaths.dynamic_programming import Steps, best_way

#: Characteristic lengths beyond which no robot reaches: the unit is another.
_FAR = 50.0


def colliding(point: int, count: int) -> UndefinedError:
    """The error for a point (counted from 0) that is reached in colliding postures only."""
    return UndefinedError(
        f"point {point + 1} of the path is reached only in postures in which links collide "
        f"({count} were compared)",
        code="path-colliding",
        values={"point": point + 1, "candidates": count},
    )


def impossible(
    elastic: ElasticMechanism,
    solver: PathSolver,
    point: int,
    pose: Array,
    grid: Choices,
    ratios: Array,
    singular: float,
) -> UndefinedError:
    """The error for a point (counted from 0) without any usable candidate."""
    values: dict[str, Any] = {"point": point + 1, "candidates": len(ratios)}
    here = f"point {point + 1} of the path"
    if not len(ratios):
        excess = solver.beyond_limits(grid.targets(pose), grid.task)
        if excess is None:
            away = float(np.linalg.norm(pose[:3, 3]))
            far = f": it is {away:.4g} away. Millimetres? Say --units mm, or x [mm] in the head"
            words = far if away > _FAR * solver.length else ""
            return UndefinedError(
                f"{here} is out of reach{words}", code="path-unreachable", values=values
            )
        name, amount = excess
        size = shown_factors(elastic).get(name, 1.0)
        units = dict(zip(elastic.names, elastic.names_with_units, strict=True))
        label = units.get(name, f"{name} [{elastic.units.length}]")
        return UndefinedError(
            f"{here} is reached only beyond the limits: {label} by {amount / size:.3g}",
            code="path-beyond-limits",
            values={**values, "limit_of": name, "beyond": amount},
        )
    best = float(ratios.max())
    if best < singular:
        return UndefinedError(
            f"{here} is reached only near singularities: smallest over largest singular value "
            f"{best:.3g}, and {singular:g} is asked for",
            code="path-near-singular",
            values={**values, "ratio": best, "threshold": singular},
        )
    return UndefinedError(
        f"{here}: the criterion exists in no posture that reaches it",
        code="path-without-stiffness",
        values={**values, "ratio": best},
    )


def broken(
    costs: list[Array], steps: Steps, bounds: Array, wound: Sequence[str] = ()
) -> UndefinedError:
    """The error for a path whose points all have candidates, but no continuous way through them.

    `wound` are joints that would follow if they could turn on beyond their limits.
    """
    _, reached = best_way(costs, steps, "mean")
    # The last layer that a way leads to; the next is reached by none of its candidates.
    i = len(reached) - 2
    a, b = reached[i], np.flatnonzero(np.isfinite(costs[i + 1]))
    share = np.where(steps.crosses(i, a, b), np.inf, steps.share(i, a, b))
    factor = float(share.min())
    if wound:
        reason = f"{', '.join(wound)} would have to turn on beyond the limits"
    elif not np.isfinite(factor):
        reason = "every step would pass through a singularity"
    else:
        reason = (
            f"a joint would have to make a step {factor:.3g} times as large as allowed; a finer "
            "path or a larger step may help"
        )
    return UndefinedError(
        f"no continuous way leads from point {i + 1} of the path to point {i + 2}: {reason}",
        code="path-discontinuous",
        values={
            "point": i + 2,
            "factor": factor if np.isfinite(factor) else None,
            "largest_step": bounds.tolist(),
            "wound": list(wound),
        },
    )
