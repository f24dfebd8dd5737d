"""Results as plain values for JSON, the numbers among them, reasons of what does not exist."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np

from cartstiff.errors import UndefinedError
from cartstiff.geometry.se3 import Array

__all__ = ["Notes", "numbers", "plain"]


def plain(value: object) -> Any:
    """JSON-able copy: arrays to lists, results to dicts, NaN and infinities to None."""
    if is_dataclass(value) and not isinstance(value, type):
        return {f.name: plain(getattr(value, f.name)) for f in fields(value)}
    if isinstance(value, Mapping):
        return {str(k): plain(v) for k, v in value.items()}
    if isinstance(value, (list, tuple, np.ndarray)):
        return [plain(v) for v in value]
    if isinstance(value, (bool, np.bool_)):
        return bool(value)
    if isinstance(value, (int, np.integer)):
        return int(value)
    if isinstance(value, (float, np.floating)):
        return float(value) if np.isfinite(value) else None
    return value


class Notes:
    """Collects the reasons of what does not exist."""

    def __init__(self) -> None:
        self.entries: list[dict[str, Any]] = []

    def add(self, error: UndefinedError, what: str) -> None:
        """Note an error once."""
        note = {"code": error.code, "message": f"{what}: {error}", "values": plain(error.values)}
        if note not in self.entries:
            self.entries.append(note)

    def attempt(self, what: str, function: Callable[..., Any], *arguments: Any) -> Any:
        """Call the function; None, with a note, where it says that its result does not exist."""
        try:
            return function(*arguments)
        except UndefinedError as error:
            self.add(error, what)
            return None


_SCALARS = (
    "indices.condition_number",
    "indices.isotropy",
    "indices.minimum_stiffness",
    "indices.determinant",
    "indices.translational_condition",
    "indices.rotational_condition",
    "indices.best_length",
    "indices.condition_at_best_length",
    "indices.eigenvalues",
    "length.value",
    "stiffness",
    "compliance",
    "centres.stiffness",
    "centres.compliance",
    "centres.elasticity",
    "centres.least_coupling",
    "normal_form.coupling",
    "decoupling_frame.coupling",
    "decoupling_frame.coupling_before",
    "modes.eigenvalues",
    "modes.frequencies",
    "synthesis.trace",
    "asymmetry.size",
    "deflection.twist",
    "deflection.displacement",
    "deflection.energy",
    *(
        f"ellipsoids.{quantity}.{freedom}.{others}.eigenvalues"
        for quantity in ("stiffness", "compliance")
        for freedom in ("translation", "rotation")
        for others in ("held", "free")
    ),
)
_OF_SCREWS = {
    "eigenscrews.screws": (
        "eigenvalue",
        "pitch",
        "rotational_stiffness",
        "translational_stiffness",
    ),
    "wrench_compliant_axes": ("stiffness", "pitch"),
    "twist_compliant_axes": ("stiffness", "pitch"),
    "directions": ("along.held", "along.free", "about.held", "about.free"),
    "connections.rows": ("change",),
}


# Vectors whose sign means nothing, as (path, axis along which the components run).
_AXES = (
    ("indices.minimum_twist", 0),
    ("modes.twists", 0),
    *(
        (f"ellipsoids.{quantity}.{freedom}.{others}.axes", 0)
        for quantity in ("stiffness", "compliance")
        for freedom in ("translation", "rotation")
        for others in ("held", "free")
    ),
)
_SCREWS = ("eigenscrews.screws", "wrench_compliant_axes", "twist_compliant_axes")


def _look_up(tree: Any, path: str) -> Any:
    for key in path.split("."):
        tree = tree.get(key) if isinstance(tree, Mapping) else None
    return tree


def numbers(analysis: Mapping[str, Any], like: Mapping[str, Any] | None = None) -> dict[str, Array]:
    """All numbers of an analysis that depend on the parameters, by dotted name.

    What does not exist is NaN or missing. Principal values are sorted and their axes and screws
    stand in the same order, with the signs of `like`: where two principal values cross, these
    vectors change place, and their spread says so.

    Parameters
    ----------
    analysis : mapping
        From `cartstiff.analysis.summary.summarise` or `cartstiff.analysis.posture`.
    like : mapping, optional
        The analysis whose signs of axes are taken.
    """
    found: dict[str, Any] = {path: _look_up(analysis, path) for path in _SCALARS}
    for path, keys in _OF_SCREWS.items():
        rows = _look_up(analysis, path)
        for key in keys:
            if rows:
                found[f"{path}.{key}"] = [_look_up(row, key) for row in rows]
    like = analysis if like is None else like
    for path, along in _AXES:
        value = _look_up(analysis, path)
        if value is not None:
            found[path] = _signed(value, _look_up(like, path), along)
    for path in _SCREWS:
        rows, models = _look_up(analysis, path), _look_up(like, path)
        if rows and all(row["point"] is not None for row in rows):
            found[f"{path}.point"] = [row["point"] for row in rows]
        if rows:
            directions = [row["direction"] for row in rows]
            model = [row["direction"] for row in models] if models else None
            found[f"{path}.direction"] = _signed(directions, model, 1)
    return {
        name: np.array(value, dtype=float) for name, value in found.items() if value is not None
    }


def _signed(value: Any, model: Any, along: int) -> Array:
    """Vectors turned to the side of their models."""
    vectors = np.array(value, dtype=float)
    if model is None or np.shape(model) != vectors.shape:
        return vectors
    products = np.sum(vectors * np.array(model, dtype=float), axis=along, keepdims=True)
    return np.where(products < 0.0, -vectors, vectors)
