r"""One posture's stiffness in any frame of the body: what is printed, listed and drawn.

With Ad = Ad(T_M_N), everything moves as a tensor:

    K' = Ad^T K Ad,     C' = Ad^-1 C Ad^-T,     W' = Ad^T W

The connections stay what they are in M: K^K is that of M's origin, and the tangent under a load is
that of the point at which the load acts. K^K *recomputed* for N's origin would belong to no load;
`StiffnessTensor.to_frame` gives it for comparison.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from cartstiff import numerics
from cartstiff.arrays import NamedArrays, read_only
from cartstiff.geometry import se3
from cartstiff.geometry.se3 import Array
from cartstiff.lazily import cached_property
from cartstiff.stiffness.applied_load import LoadKind

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from cartstiff.stiffness.posture import PostureStiffness


_BODY = np.eye(4).tolist()


@dataclass(frozen=True, eq=False)
class StiffnessInFrame:
    """Stiffness, compliance and load in a frame N of the body; arrays are read-only.

    Attributes
    ----------
    T_M_N : ndarray (4, 4)
        The frame N in the frame M.
    pose : ndarray (4, 4)
        ``T_F_N``.
    wrench : ndarray (6,) or None
        W about N's origin in N's axes; None in an unbalanced posture.
    load : LoadKind
        How the load behaves, and where it acts, in N.
    matrices, compliances : mapping of str to ndarray (6, 6) or None
        By name: "A", "B", "K", "F", "+", and "load", the tangent under the load.
    """

    T_M_N: Array
    pose: Array
    wrench: Array | None
    load: LoadKind
    matrices: Mapping[str, Array | None]
    compliances: Mapping[str, Array | None]
    _of_symmetric_tangent: Callable[[], Array | None]

    @cached_property
    def is_body_frame(self) -> bool:
        """Whether N is M itself."""
        return _is_body_frame(self.T_M_N)

    def pair(self, name: str, others: str) -> tuple[Array | None, Array | None]:
        """Symmetric matrices K and C, each the other's inverse, that principal values come from.

        With the other freedoms "held" K is the symmetric part of the stiffness: ``u^T K u`` is the
        force along u per motion along u. With them "free" C is the symmetric part of the
        compliance: ``u^T C u`` is the motion along u per force along u. Where the stiffness is
        asymmetric, as the tangent under a dead moment, these are not each other's inverse, and
        each reading has its own pair.

        Parameters
        ----------
        name : str
            A name of `matrices`.
        others : {"held", "free"}
            What the other freedoms do.

        Returns
        -------
        K, C : ndarray (6, 6) or None
            None where there is none.
        """
        K, C = self.matrices[name], self.compliances[name]
        if others == "held":
            symmetric = None if K is None else 0.5 * (K + K.T)
            return symmetric, self.inverse_of_symmetric_part(name)
        return inverse_pair(K, C)

    def inverse_of_symmetric_part(self, name: str) -> Array | None:
        """Inverse (6, 6) of the symmetric part of a stiffness matrix; None if there is none."""
        if name == "load":
            return self._inverse_of_symmetric_tangent
        return self.compliances["B" if name in ("A", "+") else name]

    @cached_property
    def _inverse_of_symmetric_tangent(self) -> Array | None:
        C = self._of_symmetric_tangent()
        if C is None or self.is_body_frame:
            return C
        back = se3.adjoint(se3.inverse(self.T_M_N))
        return np.asarray(back @ C @ back.T)


def inverse_pair(K: Array | None, C: Array | None) -> tuple[Array | None, Array | None]:
    """Symmetric part of a compliance C, and its inverse: that of K unless they are asymmetric."""
    if C is None:
        return (None if K is None else 0.5 * (K + K.T)), None
    flexible = 0.5 * (C + C.T)
    if K is None:
        return None, flexible
    if numerics.is_about_symmetric(K) and numerics.is_about_symmetric(C):
        return 0.5 * (K + K.T), flexible
    inverse = numerics.invert(flexible)
    return (None if inverse is None else inverse.matrix), flexible


def stiffness_in_frame(result: PostureStiffness, T_M_N: Array) -> StiffnessInFrame:
    """The stiffness of a posture in the frame N; see `PostureStiffness.at`."""
    matrices = {**result.matrices, "load": result.tangent}
    compliances = {**result.compliances, "load": result.tangent_compliance}
    W, load, pose = result.wrench, result.load, result.pose
    if not _is_body_frame(T_M_N):
        forth, back = se3.adjoint(T_M_N), se3.adjoint(se3.inverse(T_M_N))
        matrices = {n: None if K is None else forth.T @ K @ forth for n, K in matrices.items()}
        compliances = {n: None if C is None else back @ C @ back.T for n, C in compliances.items()}
        W = None if W is None else read_only(forth.T @ W)
        pose = read_only(pose @ T_M_N)
        load = LoadKind(load.kind, tuple(T_M_N[:3, :3].T @ (load.at - T_M_N[:3, 3])))
    for table in (matrices, compliances):
        minus = table["A"]
        table["+"] = None if minus is None else minus.T
    return StiffnessInFrame(
        read_only(T_M_N),
        pose,
        W,
        load,
        NamedArrays(matrices),
        NamedArrays(compliances),
        partial(getattr, result, "inverse_of_symmetric_tangent"),
    )


def _is_body_frame(T: Array) -> bool:
    return bool(T.tolist() == _BODY)
