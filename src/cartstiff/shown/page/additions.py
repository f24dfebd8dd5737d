"""What a user's code adds to a live page: sliders, arrows, and functions that follow it.

Functions are called in a thread of their own, one after another: the page goes on
meanwhile. Of the calls of a function that wait only the newest is made.
"""

from __future__ import annotations

import threading
import traceback
from collections.abc import Callable
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from cartstiff.core.arrays import checked_number, checked_vector
from cartstiff.core.errors import InputError
from cartstiff.core.stiffness.compute import PostureStiffness
from cartstiff.shown.scene import objects
from cartstiff.shown.scene.viewer import RecordingWindow, ViewerNode

_F = TypeVar("_F", bound=Callable[..., object])
#: Kinds of commands in an order in which a viewer can take them.
_ORDER = ("set_object", "set_transform", "set_property")
#: Characters of a slider's name.
_LONGEST_NAME = 200


class Worker:
    """Calls functions in a thread, which begins with the first call."""

    def __init__(self) -> None:
        self._waiting: dict[int, tuple[Callable[[Any], object], Any]] = {}
        self._wake = threading.Condition()
        self._begun = self._ended = False

    def call(self, function: Callable[[Any], object], argument: Any) -> None:
        """Call it soon, instead of a call of it that waits."""
        with self._wake:
            self._waiting[id(function)] = function, argument
            if not self._begun:
                self._begun = True
                threading.Thread(target=self._run, daemon=True).start()
            self._wake.notify()

    def end(self) -> None:
        """Call nothing any more."""
        with self._wake:
            self._ended = True
            self._wake.notify()

    def _run(self) -> None:
        while True:
            with self._wake:
                self._wake.wait_for(lambda: self._waiting or self._ended)
                if self._ended:
                    return
                function, argument = self._waiting.pop(next(iter(self._waiting)))
            try:
                function(argument)
            except Exception:
                traceback.print_exc()  # as in a notebook: the page goes on


class Slider:
    """A slider on the page.

    Attributes
    ----------
    name : str
        What stands beside it.
    lower, upper : float
        Its ends.
    """

    def __init__(self, additions: Additions, name: str, ends: tuple[float, float]):
        self.name, (self.lower, self.upper) = name, ends
        self._additions = additions
        self._value = self.lower
        self._functions: list[Callable[[float], object]] = []

    @property
    def value(self) -> float:
        """Where it is; set it to move it in every tab."""
        return self._value

    @value.setter
    def value(self, value: float) -> None:
        """Move it in every tab."""
        self.take(checked_number(value, "value"))
        self._additions.changed()

    def on_change(self, function: _F) -> _F:
        """Call a function with the value whenever somebody moves the slider."""
        self._functions.append(function)
        return function

    def take(self, value: float) -> None:
        """Be there, within the ends, and call what follows."""
        self._value = min(max(value, self.lower), self.upper)
        for function in self._functions:
            self._additions.worker.call(function, self._value)

    def to_dict(self) -> dict[str, Any]:
        """What a tab needs."""
        keys = ("name", "lower", "upper", "value")
        return {key: getattr(self, key) for key in keys}


class Additions:
    """All that a user's code has added to one page.

    Parameters
    ----------
    changed : callable
        Has every tab shown what there is; may be called in any thread.
    """

    def __init__(self, changed: Callable[[], object]) -> None:
        self.changed, self.worker = changed, Worker()
        self.sliders: dict[str, Slider] = {}
        self._window = RecordingWindow(writes=True)
        self._node = ViewerNode(self._window, "/meshcat/cartstiff/own")
        self._arrows: dict[str, ViewerNode] = {}
        self._lock = threading.Lock()
        self._functions: list[Callable[[PostureStiffness], object]] = []
        self._last: PostureStiffness | None = None

    def slider(
        self, name: str, lower: float, upper: float, value: float | None
    ) -> Slider:
        """Add one, or replace that of the same name; InputError for ends that
        do not fit.
        """
        if not 0 < len(name) <= _LONGEST_NAME:
            raise InputError("a slider needs a name", where="name", got=name)
        ends = checked_number(lower, "lower"), checked_number(upper, "upper")
        if not ends[0] < ends[1]:
            raise InputError(
                "ends of a slider do not fit", expected="lower < upper", got=ends
            )
        made = Slider(self, name, ends)
        made.take(ends[0] if value is None else checked_number(value, "value"))
        self.sliders[name] = made
        self.changed()
        return made

    def arrow(self, name: str, start: ArrayLike, vector: ArrayLike, colour: int) -> None:
        """Draw one from a point along a vector of F, or move that of the same name."""
        point, way = (
            checked_vector(start, 3, "start"),
            checked_vector(vector, 3, "vector"),
        )
        size = float(np.linalg.norm(way))
        with self._lock:
            node = self._arrows.get(name)
            if node is None:  # its path holds none of the user's words
                node = self._arrows[name] = self._node[str(len(self._arrows))]
                objects.arrow(node, colour)
            node.show(size > 0.0)
            if size > 0.0:
                a, b, c = way.tolist()
                along = objects.axes_along(a, b, c, size)
                x, y, z = ([size * e for e in axis] for axis in along)
                node.set_columns(x, y, z, point.tolist())
        self.changed()

    def on_move(self, function: _F) -> _F:
        """Call a function with each posture that a tab shows."""
        self._functions.append(function)
        if self._last is not None:
            self.worker.call(function, self._last)
        return function

    def moved(self, result: PostureStiffness) -> None:
        """A tab shows a posture."""
        last, self._last = self._last, result
        if last is not None and all(
            np.array_equal(getattr(last, key), getattr(result, key))
            for key in ("q", "pose", "wrench", "tangent")
        ):
            return
        for function in self._functions:
            self.worker.call(function, result)

    @property
    def is_empty(self) -> bool:
        """Whether there is nothing to show."""
        return not self.sliders and not self._arrows

    def to_dict(self) -> dict[str, Any]:
        """The sliders."""
        return {"sliders": [one.to_dict() for one in self.sliders.values()]}

    def commands(self, known: dict[Any, bytes]) -> list[bytes]:
        """Commands that a viewer does not have yet; they are then in `known`."""
        with self._lock:
            now = self._window.by_path()
        new = [key for key in now if known.get(key) != now[key]]
        known |= now
        return [now[key] for key in sorted(new, key=lambda key: _ORDER.index(key[0]))]
