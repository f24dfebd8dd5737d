"""Stiffness matrices of a posture as people read them: each block in the unit of
its largest entry.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from cartstiff.answer.analysis.asymmetry import is_roundoff
from cartstiff.core import numerics
from cartstiff.core.arrays import Array
from cartstiff.core.matrix_names import MATRICES
from cartstiff.core.stiffness.compute import PostureStiffness
from cartstiff.core.units import sized

# Components of motions, and of the wrenches beside them.
_SIX = ("rx", "ry", "rz", "x", "y", "z")


@dataclass(frozen=True)
class ShownMatrix:
    """A matrix as cells.

    Attributes
    ----------
    caption : str
        Its names and meaning.
    heads : list of str
        Heads of the columns: components of motions, and units.
    rows : list of list of str
        Component of the wrench, entries, and units of the blocks.
    """

    caption: str
    heads: list[str]
    rows: list[list[str]]


def matrices_of(
    result: PostureStiffness,
    digits: int,
    *,
    only: str | None,
    at_rest: bool = False,
) -> Iterator[ShownMatrix]:
    """The distinct stiffness matrices along the axes of M; without one that along the
    motions that the body has, or the compliance.

    Parameters
    ----------
    result : PostureStiffness
        The posture.
    digits : int
        Significant digits of the entries.
    only : str or None
        Letter of the one matrix that is wanted.
    at_rest : bool
        Whether the stiffness includes the loads, so that K^load is no other matrix.
    """
    blocks = result.units.blocks
    found = _distinct(result, at_rest)
    for names, K in found:
        if only is None or only in names:
            yield _shown(_caption(names, K), K, _SIX, blocks, digits)
    if found:
        return
    if result.reduction.reachable is not None:
        for caption, axes, K in _along_motions(result, only, at_rest):
            yield _shown(caption, K, axes, blocks, digits)
    elif (C := result.at().compliances["B"]) is not None:
        of = result.units.blocks_of_compliance
        yield _shown("No stiffness exists here; the compliance", C, _SIX, of, digits)


def _distinct(result: PostureStiffness, at_rest: bool) -> list[tuple[list[str], Array]]:
    """The distinct matrices that exist, each with all its names."""
    matrices = dict(result.matrices)
    if result.is_loaded and not at_rest:
        matrices["load"] = result.tangent
    kinds: list[tuple[list[str], Array]] = []
    for name, K in matrices.items():
        if K is None:
            continue
        for names, other in kinds:
            if is_roundoff(K - other, K):
                names.append(name)
                break
        else:
            kinds.append(([name], K))
    return kinds


def _caption(names: Sequence[str], K: Array) -> str:
    """Names and meaning of a matrix, and whether it is symmetric."""
    symmetry, skew = "symmetric", K - K.T
    if not is_roundoff(skew, K):
        symmetry = f"asymmetric, |K - K^T| up to {skew.max():.4g}"
    meaning = MATRICES[names[-1]].words
    if names[-1] != "load" and len(names) > 1:
        meaning = "they are the same here"
    return f"{' = '.join(f'K^{name}' for name in names)}  {meaning}; {symmetry}"


def _along_motions(
    result: PostureStiffness, only: str | None, at_rest: bool
) -> Iterator[tuple[str, Sequence[str], Array]]:
    """Caption, axes and matrix of the stiffness along the motions of a body of fewer
    than six freedoms, without and with the load.
    """
    found = result.task_axes
    if found is None:
        return
    others = "all motions that exist"
    if not found.is_pure:
        others = "the body's other motions follow from these"
    caption = f"Stiffness along {', '.join(found.names)} of {found.axes}; {others}"
    change = found.tangent - found.stiffness
    most = numerics.SYMMETRY * np.abs(found.stiffness).max()
    is_other = result.is_loaded and not at_rest and np.abs(change).max() > most
    if only != "load" or not is_other:
        yield caption, found.names, found.stiffness
    if only in (None, "load") and is_other:
        yield (
            f"{caption}; K^load {MATRICES['load'].words}",
            found.names,
            found.tangent,
        )


def _shown(
    caption: str,
    matrix: Array,
    names: Sequence[str],
    blocks: Mapping[str, str],
    digits: int,
) -> ShownMatrix:
    """A matrix, each block in the unit in which people read its largest entry."""
    kinds = np.array(["rt"[name in ("x", "y", "z")] for name in names])
    small = numerics.PRINTED_AS_ZERO * np.abs(matrix).max()
    shown, units = np.where(np.abs(matrix) < small, 0.0, matrix), {}
    for row, column in product("rt", repeat=2):
        block = np.ix_(kinds == row, kinds == column)
        if matrix[block].size:
            largest = float(np.abs(shown[block]).max())
            size, units[row, column] = sized(largest, blocks[row + column])
            shown[block] /= size
    rows = [
        [
            name,
            *(f"{x + 0.0:.{digits}g}" for x in line),
            " | ".join(units[kind, c].removeprefix("1") or "1" for c in sorted({*kinds})),
        ]
        for name, kind, line in zip(names, kinds, shown, strict=True)
    ]
    of = " | ".join({"r": "turns", "t": "translations"}[c] for c in sorted({*kinds}))
    return ShownMatrix(caption, ["", *names, f"unit by {of}"], rows)
