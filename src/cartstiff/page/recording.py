"""Many pictures of one mechanism, each reachable from any other by few commands."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from cartstiff.scene.canvas import Node
from cartstiff.scene.window import RecordingWindow

#: Kind of a command, path, property.
Key = tuple[str, str, str]

_VISIBLE = ("set_property", "visible")
_ORDER = {"delete": 0, "set_object": 1, "set_transform": 2, "set_property": 3, "set_animation": 4}


class Pictures:
    """What a viewer would show after each of a sequence of changes.

    A scene sends what has changed; a page jumps between frames. Here changes are merged into the
    whole state of the viewer, and states are kept as numbers of distinct commands.
    """

    def __init__(self) -> None:
        self.commands: dict[int, tuple[Key, bytes]] = {}
        self._numbers: dict[bytes, int] = {}
        self._state: dict[Key, int] = {}

    def merge(self, changes: Mapping[Key, bytes]) -> None:
        """Take over what has changed."""
        for key, packed in changes.items():
            kind, path, _ = key
            if kind == "delete":
                below = path + "/"
                for known in [k for k in self._state if k[1] == path or k[1].startswith(below)]:
                    del self._state[known]
            elif kind == "set_object":
                self._state.pop(("delete", path, ""), None)
            self._state[key] = self.number(key, packed)

    def number(self, key: Key, packed: bytes) -> int:
        """The number of a command."""
        number = self._numbers.get(packed)
        if number is None:
            number = self._numbers[packed] = len(self.commands)
            self.commands[number] = (key, packed)
        return number

    def state(self) -> dict[Key, int]:
        """The viewer's state now: numbers of commands."""
        return dict(self._state)


def common_part(states: list[dict[Key, int]]) -> set[Key]:
    """Keys that have the same command in every state."""
    if not states:
        return set()
    same = set(states[0].items())
    for state in states[1:]:
        same &= state.items()
    return {key for key, _ in same}


def complete(states: list[dict[Key, int]], pictures: Pictures) -> None:
    """Make every state say everything that any of them says, so that none depends on another.

    What is made in a later state is hidden in those without it; what is hidden, moved or set for
    the first time in a later state is visible and in its place before.
    """
    keys = dict.fromkeys(key for state in states for key in state)
    objects = [path for kind, path, _ in keys if kind == "set_object"]
    late = [path for path in objects if any(("set_object", path, "") not in s for s in states)]
    settable = dict.fromkeys(path for kind, path, name in keys if (kind, name) == _VISIBLE)
    for path in dict.fromkeys([*settable, *late]):
        key = ("set_property", path, "visible")
        for state in states:
            hidden = path in late and ("set_object", path, "") not in state
            if hidden or key not in state:
                state[key] = pictures.number(key, _shown(path, not hidden))
    for key in keys:
        if key[0] == "set_transform":
            for state in states:
                if key not in state:
                    state[key] = pictures.number(key, _in_place(key[1]))


def _shown(path: str, visible: bool) -> bytes:
    window = RecordingWindow()
    Node(window, path).set_property("visible", visible)
    return window.take()[0]


def _in_place(path: str) -> bytes:
    window = RecordingWindow()
    Node(window, path).set_transform(np.eye(4))
    return window.take()[0]


def in_order(state: Mapping[Key, int], keys: set[Key]) -> list[int]:
    """Numbers of the commands of some keys, in an order in which a viewer can take them."""
    chosen = [key for key in state if key in keys]
    chosen.sort(key=lambda key: _ORDER.get(key[0], 9))
    return [state[key] for key in chosen]
