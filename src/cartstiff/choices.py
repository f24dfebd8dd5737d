"""Words that arguments, options and pages choose from, each list once; it loads nothing."""

from __future__ import annotations

from typing import Final, Literal, get_args

#: Largest coordinate, load or stiffness that can be given: products of larger ones leave the range
#: of double precision.
LARGEST_INPUT: Final = 1e30
#: What a load does while the body moves, in words.
LOAD_KINDS: Final = {
    "dead": "its force and moment keep their direction in the room",
    "follower": "it turns with the body",
    "conservative": "its force keeps its direction in the room, its moment turns by half",
}
Order = Literal["angular-linear", "linear-angular"]
ORDERS: Final[tuple[Order, ...]] = get_args(Order)
#: Frames along whose axes components are given: of the robot's own base B, M, or the room F.
Axes = Literal["base", "body", "world"]
AXES: Final[tuple[Axes, ...]] = get_args(Axes)
AXES_WORDS: Final = {
    "base": "axes of the robot's base",
    "body": "axes of the body frame",
    "world": "axes of the room",
}
#: Which tensions of cables count: any within their limits, or those of a stated distribution.
Distribution = Literal["any", "closed-form"]
TENSIONS: Final[tuple[Distribution, ...]] = get_args(Distribution)
#: How much of the analysis is printed.
Level = Literal["full", "short", "none"]
LEVELS: Final[tuple[Level, ...]] = get_args(Level)
#: Responses to a force, and how often the displacement is differentiated for each.
RESPONSES: Final = {"receptance": 0, "mobility": 1, "accelerance": 2}
