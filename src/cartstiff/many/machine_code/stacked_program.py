"""A program that is run again and again, on stacks of any length."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping
from typing import Any

import numpy as np

from cartstiff.geometry.se3 import Array
from cartstiff.many.arguments import aligned_empty
from cartstiff.many.portable import CHUNK, PortableKernel
from cartstiff.many.tape import Program

#: Least rows that buffers of NumPy's calls are made for.
_LEAST = 64


_ROWS, _COLUMNS = np.tril_indices(6)


def lower_triangle(matrix: Array) -> Array:
    """Of a symmetric matrix (6, 6), row by row."""
    return np.asarray(matrix[_ROWS, _COLUMNS])


def from_triangles(rows: Array) -> Array:
    """Symmetric matrices (N, 6, 6) from rows that begin with `lower_triangle`."""
    matrices = np.empty((len(rows), 6, 6))
    matrices[:, _ROWS, _COLUMNS] = matrices[:, _COLUMNS, _ROWS] = rows[:, : len(_ROWS)]
    return matrices


class StackedProgram:
    """A program as machine code, or over NumPy's arrays, with the memory that it works in.

    Memory is taken and given back, so that threads do not share any while they work.
    """

    def __init__(self, program: Program, compiled: bool) -> None:
        self._compiled = compiled
        self._widths = {name: len(own) for name, own in program.outputs.items()}
        self._free: dict[int, list[Any]] = defaultdict(list)
        if compiled:
            from cartstiff.many.compiled import CompiledKernel

            self._kernel: Any = CompiledKernel(program)
        else:
            self._kernel = PortableKernel(program)

    def __call__(self, inputs: Mapping[str, Array]) -> dict[str, Array]:
        """Outputs (N, ...) of rows of inputs (N, ...)."""
        count = len(next(iter(inputs.values())))
        outputs = {name: aligned_empty(count, width) for name, width in self._widths.items()}
        size = count
        if not self._compiled:  # buffers are made in few sizes: that takes longer than one run
            size = min(CHUNK, max(_LEAST, 1 << (count - 1).bit_length()))
        kept = self._free[0 if self._compiled else size]
        try:
            workspace = kept.pop()
        except IndexError:
            workspace = self._kernel.workspace(size)
        for start in range(0, count, max(size, 1)):
            part = slice(start, min(start + size, count))
            workspace.run(
                {name: np.ascontiguousarray(array[part]) for name, array in inputs.items()},
                {name: array[part] for name, array in outputs.items()},
                part.stop - start,
            )
        kept.append(workspace)
        return outputs
