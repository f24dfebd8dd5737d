"""Many points in colour: maps over a workspace, and trajectories."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cartstiff.core.arrays import Array, checked_array
from cartstiff.core.errors import InputError
from cartstiff.shown.scene import objects, theme
from cartstiff.shown.scene.viewer import ViewerNode

# Kinds of points that a legend lists; rarer ones are "others".
_MOST_KINDS = len(theme.KINDS)

# Values over more than this ratio, all of one sign, are coloured by their logarithm.
_WIDE = 50.0


# Shares of the colours, from dark to light, of what is outside and inside of a limit.
_OUTSIDE, _INSIDE = (0.0, 0.25), (0.6, 1.0)


def colours_of(
    values: NDArray[Any],
    better: str | None = None,
    allowed: tuple[float, str] | None = None,
) -> tuple[NDArray[np.uint8], dict[str, Any]]:
    """Colours (n, 3) of values, and the facts of the colour bar.

    Values of one sign run from dark to light, by their logarithm where they spread far:
    from bad to good if "larger" or "smaller" ones are `better`. A value that is `allowed`
    (and its words) divides smaller ones, all light, from larger ones, all dark. Values of
    both signs run from red over pale to blue. Values that are not finite are grey,
    and counted. Each word has its own colour; the rarest of many are grey.
    """
    if values.dtype.kind == "U":
        return _colours_of_kinds(values)
    good = np.isfinite(values)
    colours = np.empty((len(values), 3), np.uint8)
    colours[:] = [theme.NO_VALUE >> s & 0xFF for s in (16, 8, 0)]
    facts: dict[str, Any] = {
        "without_value": int(np.sum(~good)),
        "lower": None,
        "upper": None,
        "kind": "none",
        "log": False,
    }
    if not good.any():
        return colours, facts
    # Diverging or sequential colours.
    v = values[good]
    low, high = float(v.min()), float(v.max())
    if low < 0.0 < high:
        limit = max(-low, high)
        colours[good] = theme.diverging(v / limit)
        facts |= {"lower": -limit, "upper": limit, "kind": "diverging"}
        stops = theme.diverging(np.linspace(-1, 1, 9))
    else:
        log = low > 0.0 and high > _WIDE * low
        x = np.log10(v) if log else v
        spread = float(np.ptp(x))
        share = (x - x.min()) / spread if spread > 0.0 else np.full(len(x), 0.5)
        along = np.linspace(0, 1, 9)
        if better == "smaller":
            share, along = 1.0 - share, along[::-1]
        if allowed is not None:
            inside = v <= allowed[0]
            ends = np.where(inside[:, None], _INSIDE, _OUTSIDE)
            share = ends[:, 0] + share * (ends[:, 1] - ends[:, 0])
            facts["kinds"] = _divided(allowed[1], int(inside.sum()), len(v))
        colours[good] = theme.sequential(share)
        facts |= {"lower": low, "upper": high, "kind": "sequential", "log": bool(log)}
        facts["better"] = better
        stops = theme.sequential(along)
    facts["stops"] = [f"#{theme.hex_of(stop):06x}" for stop in stops]
    return colours, facts


def _divided(limit: str, inside: int, count: int) -> list[dict[str, Any]]:
    """What the colours inside and outside of a limit are called."""
    return [
        {
            "name": f"{word} {limit}",
            "colour": f"#{theme.hex_of(theme.sequential(share)):06x}",
            "count": number,
        }
        for word, share, number in (
            ("within", _INSIDE[0], inside),
            ("beyond", _OUTSIDE[1], count - inside),
        )
    ]


def _colours_of_kinds(
    words: NDArray[np.str_],
) -> tuple[NDArray[np.uint8], dict[str, Any]]:
    """Colours (n, 3) of words, and which colour each of the commonest has."""
    kinds, kind, counts = np.unique(words, return_inverse=True, return_counts=True)
    listed = np.sort(np.argsort(-counts, kind="stable")[:_MOST_KINDS])
    table = np.full(len(kinds), theme.NO_VALUE)
    table[listed] = theme.KINDS[: len(listed)]
    facts = [
        {"name": str(kinds[i]), "colour": f"#{table[i]:06x}", "count": int(counts[i])}
        for i in listed
    ]
    if rest := len(words) - int(counts[listed].sum()):
        others = f"{len(kinds) - len(listed)} others"
        facts.append({"name": others, "colour": f"#{theme.NO_VALUE:06x}", "count": rest})
    colours = np.stack([table >> shift & 0xFF for shift in (16, 8, 0)], axis=1)[kind]
    return colours.astype(np.uint8), {"kind": "kinds", "kinds": facts}


def _checked(
    positions: ArrayLike, values: ArrayLike | None
) -> tuple[Array, NDArray[Any] | None]:
    p = checked_array(positions, ("N", 3), "array of positions", copy=False)
    if values is None:
        return p, None
    if (words := np.asarray(values)).dtype.kind == "U" and words.shape == p.shape[:1]:
        return p, words
    return p, checked_array(
        values, (len(p),), "array of values", copy=False, finite=False
    )


def add_points(
    visualizer: Any,
    positions: ArrayLike,
    values: ArrayLike,
    *,
    label: str = "",
    unit: str = "",
    size: float | None = None,
    carried: Mapping[str, Array] = MappingProxyType({}),
    better: str | None = None,
    allowed: tuple[float, str] | None = None,
) -> dict[str, Any]:
    """Draw points coloured by a value in any meshcat scene.

    Parameters
    ----------
    visualizer : meshcat.Visualizer
        Where: ``vis["path"]``. A later call at the same path replaces them.
    positions : array_like, shape (n, 3)
        In units of `visualizer`.
    values : array_like, shape (n,)
        NaN where there is none: such points are grey. Or words, each kind in its own
        colour.
    label, unit : str
        Name and unit of the values.
    size : float, optional
        Size of a point, in units of `visualizer`; default from the spread of the points
        and their number.
    carried : mapping of str to ndarray (n, k), optional
        Numbers that travel with the points, for whoever points at one: attributes of the
        geometry.
    better : {"larger", "smaller"}, optional
        Which values are good: these are bright.
    allowed : tuple of float and str, optional
        A value up to which all is good, and how that is written.

    Returns
    -------
    dict
        "label", "unit", "count", "without_value", "lower", "upper", "kind" ("sequential"
        or "diverging"), "log", and "stops", the bar's colours at equal steps. For words:
        "label", "unit", "count", "kind" ("kinds") and "kinds", a list of "name", "colour"
        and "count".

    Raises
    ------
    InputError
        For wrong shapes or positions that are not finite.
    """
    p, v = _checked(positions, values)
    node = ViewerNode.of(visualizer)
    facts: dict[str, Any] = {"label": label, "unit": unit, "count": len(p)}
    if v is None or not len(p):
        node.delete()
        return facts | colours_of(np.zeros(0))[1]
    colours, bar = colours_of(v, better, allowed)
    if size is None:
        spread = float(np.linalg.norm(np.ptp(p, axis=0))) or 1.0
        size = float(
            np.clip(0.5 * spread / np.sqrt(len(p)), 0.004 * spread, 0.03 * spread)
        )
    # The viewer draws points in units of its scene.
    node.set_object(objects.points(p, colours, size * node.enlarged, carried))
    return facts | bar


def add_path(
    visualizer: Any,
    positions: ArrayLike,
    values: ArrayLike | None = None,
    *,
    colour: int = theme.COLOURS["deflection"],
    label: str = "",
    unit: str = "",
) -> dict[str, Any]:
    """Draw a line through points (n, 3), in one colour or coloured by values (n,).

    Arguments as in `add_points`.

    Returns
    -------
    dict
        As `add_points`; without values only "label", "unit" and "count".

    Raises
    ------
    InputError
        For wrong shapes, positions that are not finite, or fewer than two points.
    """
    p, v = _checked(positions, values)
    if len(p) < 2:
        raise InputError("a path has at least two points", got=str(len(p)))
    facts: dict[str, Any] = {"label": label, "unit": unit, "count": len(p)}
    if v is None:
        ViewerNode.of(visualizer).set_object(objects.lines(p, colour, joined=True))
        return facts
    colours, bar = colours_of(v)
    ViewerNode.of(visualizer).set_object(
        objects.lines(p, colours.astype(float), joined=True)
    )
    return facts | bar
