"""A base and a platform that give, from the mechanism file."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from cartstiff import numerics
from cartstiff.errors import InputError
from cartstiff.geometry import se3
from cartstiff.geometry.se3 import Array
from cartstiff.loading.keys.words import pose_of
from cartstiff.potentials.flexure_struts import Flexure, FlexureStruts
from cartstiff.potentials.line_springs import LineSprings
from cartstiff.potentials.mounted_struts import Mount, MountedStruts

if TYPE_CHECKING:
    from cartstiff.loading.keys.springs import FlexibleModel
    from cartstiff.loading.schema import PlatformFile, SpringsFile


def on_springs(
    springs: LineSprings, file: PlatformFile | SpringsFile, T_F_M: Array, where: str
) -> MountedStruts:
    """The legs between what the file's `flexible` says of base and platform.

    Raises
    ------
    InputError
        For cables, and for springs that are not symmetric and positive definite, are beams, or have
        a mass.
    """
    where = f"{where}, key flexible"
    if springs.unilateral:
        raise InputError(
            "cables hang from what does not give", where=where, expected="no key flexible"
        )
    if not isinstance(springs, FlexureStruts):
        ball = Flexure(math.inf, math.inf, 0.0, 0.0)
        springs = FlexureStruts.between(
            springs.anchors,
            springs.points,
            T_F_M,
            springs.stiffness,
            ball,
            ball._replace(torsion=math.inf),
            springs.rest_length,
        )
    to_body = se3.inverse(pose_of(file.frame))
    base = _mount(file.flexible.get("base"), np.eye(4), f"{where}.base")
    tip = _mount(file.flexible.get("platform"), to_body, f"{where}.platform")
    return MountedStruts.of(springs, base, tip)


def _mount(entry: FlexibleModel | None, T: Array, where: str) -> Mount | None:
    """A spring, its place moved by T; None where nothing gives."""
    if entry is None:
        return None
    if entry.stiffness is None or entry.mass is not None:
        got = "a beam" if entry.stiffness is None else "a superelement with M"
        raise InputError(
            "base and platform give as a spring without mass",
            where=where,
            expected="stiffness, or superelement without M",
            got=got,
        )
    K = np.array(entry.stiffness, float)
    sizes = np.sqrt(np.abs(np.diag(K)))
    if np.any(np.abs(K - K.T) > numerics.SYMMETRY * np.outer(sizes, sizes)):
        raise InputError("stiffness must be symmetric", where=where)
    least = float(np.linalg.eigvalsh(K / np.outer(sizes, sizes))[0]) if sizes.all() else 0.0
    if not least > numerics.RANK:
        raise InputError(
            "stiffness must hold the body in every direction",
            where=where,
            expected="a positive definite matrix",
            got=f"eigenvalue {least:.2g} of the diagonal's",
        )
    return Mount(T @ pose_of(entry.offset), K[np.ix_(se3.SWAP, se3.SWAP)])
