"""A program as machine code for one posture at a time."""

from __future__ import annotations

import ctypes
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from cartstiff.geometry.se3 import Array
from cartstiff.many.arguments import address_of, aligned_empty
from cartstiff.many.compiled import CompiledKernel
from cartstiff.many.tape import Program


class OnePosture:
    """All outputs of a program, one after the other.

    Attributes
    ----------
    at : dict of str to slice
        Where in a record each output stands.
    """

    def __init__(self, program: Program, shared: Mapping[str, Array]) -> None:
        steps, self.at = list[int](), dict[str, slice]()
        for name, own in program.outputs.items():
            self.at[name] = slice(len(steps), len(steps) + len(own))
            steps += own
        steps += steps[-1:] * (len(steps) % 2)  # records are written by pairs
        self._kernel = CompiledKernel(replace(program, outputs={"record": tuple(steps)}), width=2)
        self._entry, self._shared = self._kernel.entry(False), shared
        self._free: list[_Memory] = []

    def record(self, **given: Array) -> Array:
        """What the program finds from inputs (n,), or (1, n), by name; those it does not read."""
        try:
            memory = self._free.pop()
        except IndexError:
            memory = _Memory(self._kernel, self._shared)
        for name, place in memory.inputs.items():
            place[:] = given[name]
        memory.progress[:] = [0, 0]
        self._entry(*memory.arguments)
        record = memory.record.copy()
        self._free.append(memory)
        return record

    def run(self, inputs: Mapping[str, Array], outputs: Mapping[str, Array], count: int) -> None:
        """`record` as rows (1, ...) of outputs, as what computes many postures gives them."""
        if count != 1:
            raise ValueError("one posture at a time")
        record = self.record(**inputs)
        for name, row in outputs.items():
            row[0] = record[self.at[name]]


class _Memory:
    """What one call reads and writes; as many are made as are used at the same time."""

    def __init__(self, kernel: Any, shared: Mapping[str, Array]) -> None:
        program = kernel.program
        widths = dict.fromkeys(kernel.arrays, 0)
        for array, component in program.inputs:
            widths[array] = max(widths.get(array, 0), component + 1)
        self.inputs = {
            name: np.empty((1 if name in program.shared else kernel.block, widths[name]))
            for name in kernel.arrays
            if name not in shared
        }
        written = aligned_empty(kernel.block, len(program.outputs["record"]))
        scratch = aligned_empty(kernel.scratch)
        scratch[:] = 0.0
        self.record = written[0]
        self.progress = (ctypes.c_int64 * 2)()
        inputs = {**shared, **self.inputs}
        read = [address_of(inputs[name]) for name in kernel.arrays]
        self.arguments = (
            1,
            (ctypes.c_void_p * len(read))(*read),
            (ctypes.c_void_p * 1)(address_of(written)),
            address_of(scratch),
            self.progress,
        )
        self._held = inputs, written, scratch
