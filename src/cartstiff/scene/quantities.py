"""What a picture is drawn from: the stiffness in the frame of its reference point, and the load."""

from __future__ import annotations

from functools import lru_cache
from typing import Literal

from cartstiff.analysis.ellipsoids import Ellipsoid, Freedom, Others, ellipsoid_of_pair
from cartstiff.arrays import Array
from cartstiff.geometry import se3
from cartstiff.scene.look import Look
from cartstiff.stiffness.compute import PostureStiffness
from cartstiff.stiffness.in_frame import StiffnessInFrame


def reference(result: PostureStiffness, look: Look) -> StiffnessInFrame:
    """The stiffness at the reference point, along the axes of M."""
    return result.at(se3.pose(translation=look.point) if any(look.point) else None)


def why_missing(result: PostureStiffness, look: Look) -> str | None:
    """Why there is no stiffness of the shown connection; None where there is one."""
    if result.at().matrices[look.connection] is not None:
        return None
    states = [note.message for note in result.notes if note.code in _STATES]
    return states[-1] if states else f"K^{look.connection} does not exist here"


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
    is_stiffness = quantity == "stiffness"
    how: Others = ("held" if is_stiffness else "free") if others == "block" else others
    K, C = here.pair(connection, how)
    if (K if is_stiffness else C) is None:
        return None
    return ellipsoid_of_pair(K, C, here.root(connection, how), freedom, quantity, how)


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
