"""Accepted values of arguments, options and page fields; this module imports no other."""

from __future__ import annotations

from typing import Final, Literal, get_args

#: Largest accepted coordinate, load or stiffness: products of larger ones exceed the
#: range of double precision.
LARGEST_INPUT: Final = 1e30
#: Behaviour of each kind of load while the body moves, in words.
LOAD_KINDS: Final = {
    "dead": "its force and moment keep their direction in the room",
    "follower": "it turns with the body",
    "conservative": "its force keeps its direction in the room, its moment turns by half",
}
Order = Literal["angular-linear", "linear-angular"]
ORDERS: Final[tuple[Order, ...]] = get_args(Order)
#: Axes of components: those of the robot's own base B, of M, or of the room F.
Axes = Literal["base", "body", "world"]
AXES: Final[tuple[Axes, ...]] = get_args(Axes)
AXES_WORDS: Final = {
    "base": "axes of the robot's base",
    "body": "axes of the body frame",
    "world": "axes of the room",
}
#: Accepted tensions of cables: any within their limits, or those of a stated
#: distribution.
Distribution = Literal["any", "closed-form"]
#: Level of detail of the printed analysis.
Level = Literal["full", "short", "none"]
#: Frequency responses, and the order of the derivative of the displacement in each.
RESPONSES: Final = {"receptance": 0, "mobility": 1, "accelerance": 2}
