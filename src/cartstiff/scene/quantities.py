"""What a picture is drawn from: the stiffness in the frame of its reference point, and the load."""

from __future__ import annotations

from functools import lru_cache
from typing import Literal

from cartstiff.analysis.ellipsoids import (
    Ellipsoid,
    Freedom,
    Others,
    compliance_ellipsoid,
    stiffness_ellipsoid,
)
from cartstiff.analysis.matrices import symmetric_part
from cartstiff.arrays import Array
from cartstiff.geometry import se3
from cartstiff.scene.look import Look
from cartstiff.stiffness.compute import PostureStiffness
from cartstiff.stiffness.in_frame import StiffnessInFrame


def reference(result: PostureStiffness, look: Look) -> StiffnessInFrame:
    """The stiffness at the reference point, along the axes of M."""
    return result.at(se3.pose(translation=look.point) if any(look.point) else None)


def matrices_at(
    result: PostureStiffness, look: Look
) -> tuple[Array | None, Array | None, str | None]:
    """Symmetric parts of stiffness and compliance at the reference point, or why there are none."""
    name, here = look.connection, reference(result, look)
    K, C = here.matrices[name], here.compliances[name]
    reason = None
    if K is None:
        states = [note.message for note in result.notes if note.code in _STATES]
        reason = states[-1] if states else f"K^{name} does not exist here"
    return (
        None if K is None else symmetric_part(K),
        None if C is None else symmetric_part(C),
        reason,
    )


@lru_cache(maxsize=16)  # numbers and picture of a page are about the same
def block_ellipsoid(
    here: StiffnessInFrame,
    connection: str,
    quantity: Literal["stiffness", "compliance"],
    freedom: Freedom,
    others: Literal["block", "free", "held"],
) -> Ellipsoid | None:
    """Ellipsoid of a 3x3 block, or with the other freedoms free or held; None without a matrix.

    Stiffness and compliance each give what the other has no digits for.

    Raises
    ------
    UndefinedError
        See `cartstiff.analysis.ellipsoids`.
    """
    if quantity == "stiffness":
        how: Others = "held" if others == "block" else others
        K, C = here.pair(connection, how)
        root = here.root(connection, how)
        return None if K is None else stiffness_ellipsoid(K, freedom, how, None, C, root)
    how = "free" if others == "block" else others
    K, C = here.pair(connection, how)
    root = here.root(connection, how)
    return None if C is None else compliance_ellipsoid(C, freedom, how, None, K, root)


#: Notes that say why a stiffness does not exist.
_STATES = {
    "deficient", "serial-singularity", "type-2-singularity", "constraint-singularity",
    "non-regular-redundancy", "unbalanced", "buckled", "strut-buckled",
    "strut-not-found", "no-chart",
}  # fmt: skip


def load_at(result: PostureStiffness, look: Look) -> Array | None:
    """The load (moment, force) about the reference point; None in an unbalanced posture."""
    W = reference(result, look).wrench
    return None if W is None else result.shown_wrench(W)
