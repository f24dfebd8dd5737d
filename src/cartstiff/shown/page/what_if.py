"""How far the load moves the point if one spring has another stiffness."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from cartstiff.core.arrays import plain
from cartstiff.core.errors import CartstiffError
from cartstiff.core.stiffness.compute import PostureStiffness
from cartstiff.recorded.gradients.gradient import gradient
from cartstiff.shown.page.messages import ViewState
from cartstiff.shown.page.shown import displacement_under_load

#: Springs that are tried; of more, those whose stiffness matters most to first order.
MOST_TRIED = 12


def what_if(
    analysed: Callable[[ViewState], PostureStiffness],
    state: ViewState,
    to: Sequence[float | None],
) -> dict[str, Any]:
    """Displacements under the load of a state, each with another stiffness of one spring.

    Parameters
    ----------
    analysed : callable
        The posture of a state.
    state : ViewState
        The state.
    to : sequence of float or None
        For each spring its other stiffness; None leaves it out.

    Returns
    -------
    dict
        "here", the displacement of the reference point; "sizes", one for each spring,
        None where none was tried or the load is not resisted; "order", the numbers of the
        springs from the smallest displacement on.
    """
    result = analysed(state)
    now: list[float | None] = state.stiffness or plain(result.elastic.stiffnesses)
    tried = [i for i, k in enumerate(to[: len(now)]) if k is not None]
    if len(tried) > MOST_TRIED:
        tried = _most_promising(result, state, tried)
    here = displacement_under_load(result, state)
    sizes: list[float | None] = [None] * len(to)
    for i in tried:
        springs = [*now[:i], to[i], *now[i + 1 :]]
        one = state.model_copy(update={"stiffness": springs})
        try:
            sizes[i] = displacement_under_load(analysed(one), one)
        except CartstiffError:  # no such posture, and thus no gain
            continue
    found = {i: size for i, size in enumerate(sizes) if size is not None}
    return {"here": here, "sizes": sizes, "order": sorted(found, key=lambda i: found[i])}


def _most_promising(
    result: PostureStiffness, state: ViewState, tried: list[int]
) -> list[int]:
    """The springs by which the displacement of M changes most, for the same change of
    each by a share; all where the derivatives do not exist.
    """
    elastic = result.elastic_as_given
    names = [f"stiffness.{elastic.spring_names[i]}" for i in tried]
    try:
        slopes = gradient(
            elastic,
            result.q,
            of="deflection",
            by=names,
            deflect=result.wrench,
            wrench=state.load,
            load_kind=state.load_kind,
            load_at=state.acts_at,
            load_axes=state.load_axes,
        )
    except CartstiffError:
        return tried
    effects = {slope.name: abs(slope.effect) for slope in slopes}
    ranked = sorted(
        zip(names, tried, strict=True), key=lambda one: -effects.get(one[0], 0)
    )
    return sorted(i for _, i in ranked[:MOST_TRIED])
