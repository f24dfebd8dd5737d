r"""Line springs and cables between bodies of a chain, on recording numbers.

With u the direction of a line of length l, D_a the velocity of its end in b less that of its end in
a per rate of joint a, and t the tension,

    dl/dq_a = u . D_a,
    d2l/dq_a dq_b = (D_a . D_b - (u . D_a) (u . D_b)) / l + (u x omega_a) . D_b    for b behind a.

Joints that move both ends do not change it. A slack cable has neither tension nor stiffness.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from cartstiff import numerics
from cartstiff.geometry.se3 import Array
from cartstiff.many.algebra import cross, norm_squared, zeros
from cartstiff.many.arithmetic import ENGINE, PLAIN, taut_stiffness
from cartstiff.many.tape import Scalar, larger, pick, square_root


@dataclass(frozen=True)
class Line:
    """Where a line spring is fastened.

    Attributes
    ----------
    joints : bodies of its ends a and b, by the joints that carry them, counted from 1; 0 is F.
    points : its ends in the frames of these joints (2, 3).
    unilateral : whether it goes slack instead of pushing.
    """

    joints: tuple[int, int]
    points: tuple[tuple[float, ...], tuple[float, ...]]
    unilateral: bool


def line_terms(
    line: Line, stiffness: Scalar, rest: Scalar, kinematics: Any
) -> tuple[Scalar, Array, Array, Scalar]:
    """Energy, gradient and Hessian in the joint positions, and the verdict on the length."""
    J, outward = kinematics.J, kinematics.outward
    ends = [_end(kinematics, *end) for end in zip(line.joints, line.points, strict=True)]
    along = ends[1] - ends[0]
    length = square_root(norm_squared(along))
    u = along * (1.0 / length)
    stretch = length - rest
    taut = taut_stiffness(stiffness, stretch) if line.unilateral else stiffness
    tension = taut * stretch
    per_length = tension / length

    speeds: dict[int, Array] = {}
    for a, behind in enumerate(outward):
        moves = [bool(joint) and joint - 1 in behind for joint in line.joints]
        if moves[0] != moves[1]:
            speed = cross(J[:3, a], ends[moves[1]]) + J[3:, a]
            speeds[a] = speed if moves[1] else -speed
    rates: dict[int, Any] = {a: u @ speed for a, speed in speeds.items()}
    across = {a: cross(u, J[:3, a]) * tension for a in speeds}
    gradient, hessian = zeros(len(outward)), zeros(len(outward), len(outward))
    for a, D_a in speeds.items():
        gradient[a] = rates[a] * tension
        for b in (b for b in speeds if b >= a):
            D_b = speeds[b]
            entry = (rates[a] * rates[b]) * (taut - per_length) + (D_a @ D_b) * per_length
            if b in outward[a]:
                entry = entry + across[a] @ D_b
            hessian[a, b] = hessian[b, a] = entry
    least = numerics.SHORTEST * kinematics.size
    size = larger(norm_squared(ends[0]), norm_squared(ends[1])) * numerics.SHORTEST**2
    verdict = pick(larger(size, least * least), length * length, PLAIN, ENGINE)
    return tension * stretch * 0.5, gradient, hessian, verdict


def _end(kinematics: Any, joint: int, point: tuple[float, ...]) -> Array:
    """A point of a joint's body, or of F, in the frame of the twists."""
    if not joint:
        R, p = kinematics.R_C_F, kinematics.p_C_F
    else:
        R, p = kinematics.behind(joint - 1)
    end: Array = R @ np.array(point) + p
    return end
