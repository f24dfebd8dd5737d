"""Which matrices a picture is drawn from, at its reference point, and which load."""

from __future__ import annotations

import numpy as np

from cartstiff.analysis.matrices import move_compliance, symmetric_part
from cartstiff.geometry import se3
from cartstiff.geometry.se3 import Array
from cartstiff.scene.look import Look
from cartstiff.stiffness.compute import PostureStiffness

__all__ = ["load_at", "matrices_at"]


def matrices_at(
    result: PostureStiffness, look: Look
) -> tuple[Array | None, Array | None, str | None]:
    """Symmetric parts of stiffness and compliance at the reference point, or why there are none."""
    name = look.connection
    base = "A" if name == "+" else name
    K = result.matrices[base]
    reason = None
    if K is None:
        states = [note.message for note in result.notes if note.code in _STATES]
        reason = states[-1] if states else f"K^{name} does not exist here"
    if any(look.point):
        T = se3.pose(translation=look.point)
        if K is not None:
            K = result.tensor(base).to_frame(T).matrix
            C = _inverse(K)
        else:
            C = result.compliances[base]
            C = None if C is None else move_compliance(C, T)
    else:
        C = result.compliances[base]
    return (
        None if K is None else symmetric_part(K),
        None if C is None else symmetric_part(C),
        reason,
    )


def _inverse(K: Array) -> Array | None:
    if np.linalg.cond(K) > 1e14:
        return None
    inverse: Array = np.linalg.inv(K)
    return inverse


#: Notes that say why a stiffness does not exist.
_STATES = {
    "deficient", "serial-singularity", "type-2-singularity", "constraint-singularity",
    "non-regular-redundancy", "unbalanced", "buckled", "no-chart",
}  # fmt: skip


def load_at(result: PostureStiffness, look: Look) -> Array | None:
    """The load (moment, force) about the reference point; None in an unbalanced posture.

    Force or moment is zero where it is rounding beside what the springs' stiffness would exert.
    """
    W, posture = result.wrench, result.posture
    if W is None:
        return None
    at = np.array(W)
    if any(look.point):
        at[:3] -= np.cross(look.point, W[3:])
    sizes = posture.coordinate_lengths
    stiffest = np.abs(result.evaluation.hessian * sizes * sizes[:, None]).max(initial=0.0)
    small = _ROUNDING * float(stiffest)
    if np.abs(at[:3]).max() <= small:
        at[:3] = 0.0
    if np.abs(at[3:]).max() * posture.length <= small:
        at[3:] = 0.0
    return at


# A load below what the springs exert over this turn (rad) is rounding.
_ROUNDING = 1e-11
