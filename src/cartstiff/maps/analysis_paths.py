"""Any number of the analysis of one posture as a quantity of many, by its path."""

from __future__ import annotations

from typing import Any

import numpy as np

from cartstiff.analysis.posture import summarise
from cartstiff.analysis.sections import unit_of
from cartstiff.arrays import plain
from cartstiff.errors import InputError, UnknownNameError
from cartstiff.geometry.se3 import Array
from cartstiff.maps.quantity import Quantity, Stacks
from cartstiff.matrix_names import OF_MANY


def path_quantity(path: str) -> Quantity:
    """The quantity of a dotted path: keys and, in lists, positions counted from 0.

    Raises
    ------
    InputError
        If the analysis of a stiffness has no number at this path.
    """
    _check(path)

    def function(s: Stacks) -> Array:
        rows = s.once("analyses", lambda: _analyses(s))
        return np.array([_number(row, path) for row in rows])

    return Quantity(
        path,
        f"{path} of the analysis",
        unit_of(path),
        function,
        (*(f"stiffness_{c}" for c in OF_MANY), "inverse", "compliance_{connection}", "wrench"),
        "length",
        None,
    )


def _check(path: str) -> None:
    """Refuse a path that leads to no number where everything exists."""
    model = summarise({"B": np.diag([3.0, 2.0, 4.0, 50.0, 60.0, 70.0])}, np.zeros(6), 0.2)
    node: Any = model
    for key in path.split("."):
        if isinstance(node, dict) and key not in node:
            raise UnknownNameError("part of the analysis", key, [str(k) for k in node])
        node = _step(node, key)
    if isinstance(node, bool) or not isinstance(node, (int, float)):
        shown = "a group" if isinstance(node, dict) else "a list" if isinstance(node, list) else ""
        raise InputError(
            f"{path} is not a number of the analysis",
            expected="a path to one number",
            got=shown or repr(node),
        )


def _step(node: Any, key: str) -> Any:
    if isinstance(node, dict):
        return node.get(key)
    if isinstance(node, list) and key.isdigit() and int(key) < len(node):
        return node[int(key)]
    return None


def _number(tree: Any, path: str) -> float:
    for key in path.split("."):
        tree = _step(tree, key)
    return float(tree) if isinstance(tree, (int, float)) else np.nan


def _analyses(s: Stacks) -> list[dict[str, Any]]:
    settings, rows = s.settings, []
    wrenches = np.nan_to_num(s.arrays["wrench"])
    for i, W in enumerate(wrenches):
        matrices = {c: _or_none(s.arrays[f"stiffness_{c}"][i]) for c in OF_MANY}
        compliance = _or_none(s.arrays[f"compliance_{settings.connection}"][i])
        rows.append(
            plain(
                summarise(
                    matrices,
                    W,
                    settings.length,
                    connection=settings.connection,
                    compliance=compliance,
                    inverse=_or_none(s.C[i]),
                    springs=False,
                )
            )
        )
    return rows


def _or_none(matrix: Array) -> Array | None:
    return matrix if np.isfinite(matrix).all() else None
