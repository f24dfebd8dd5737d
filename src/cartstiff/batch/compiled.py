"""Running a program as machine code made by llvmlite."""

from __future__ import annotations

import ctypes
from collections.abc import Mapping
from functools import cache
from threading import Lock
from typing import Any

import numpy as np

from cartstiff.batch.given import address_of, aligned_empty
from cartstiff.batch.tape import Program
from cartstiff.batch.vector_code import LONGEST, input_arrays, scratch_size, vector_code
from cartstiff.geometry.se3 import Array

__all__ = ["CompiledKernel", "lanes"]

#: Bytes of output beyond which writing past the cache pays.
STREAMED = 1 << 23

_SIGNATURE = ctypes.CFUNCTYPE(
    None, ctypes.c_int64, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_void_p
)


@cache
def _binding() -> Any:
    import llvmlite.binding as llvm

    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    return llvm


@cache
def lanes() -> int:
    """Doubles per vector of this processor."""
    features = _binding().get_host_cpu_features()
    if features.get("avx512f"):
        return 8
    return 4 if features.get("avx") else 2


class CompiledKernel:
    """A program as machine code; keeps the engines that own it."""

    def __init__(self, program: Program, width: int | None = None, longest: int = LONGEST) -> None:
        self.program = program
        self.block = width or lanes()
        self.arrays = input_arrays(program)
        self.scratch = scratch_size(program, self.block, longest)
        self._longest = longest
        self._made: dict[bool, tuple[Any, Any]] = {}
        self._lock = Lock()

    def entry(self, stream: bool) -> Any:
        """The function that writes through the cache or, with `stream`, past it."""
        with self._lock:
            if stream not in self._made:
                self._made[stream] = self._compile(stream)
            return self._made[stream][1]

    def _compile(self, stream: bool) -> tuple[Any, Any]:
        llvm = _binding()
        machine = llvm.Target.from_default_triple().create_target_machine(
            cpu=llvm.get_host_cpu_name(),
            features=llvm.get_host_cpu_features().flatten(),
            opt=2,
        )
        module = llvm.parse_assembly(vector_code(self.program, self.block, stream, self._longest))
        module.triple = llvm.get_process_triple()
        engine = llvm.create_mcjit_compiler(module, machine)
        engine.finalize_object()
        return engine, _SIGNATURE(engine.get_function_address("kernel"))

    def workspace(self, length: int) -> Workspace:  # noqa: ARG002
        """Scratch memory; one per thread."""
        return Workspace(self)


class Workspace:
    """A kernel with scratch memory."""

    def __init__(self, kernel: CompiledKernel) -> None:
        self._kernel = kernel
        self._scratch = aligned_empty(kernel.scratch)
        # The first round works on what is here: no surprises for the processor.
        self._scratch[:] = 0.0
        self._inputs = (ctypes.c_void_p * max(1, len(kernel.arrays)))()
        self._outputs = (ctypes.c_void_p * len(kernel.program.outputs))()

    def run(
        self, inputs: Mapping[str, Array], outputs: Mapping[str, Array], count: int,
        stream: bool = False,
    ) -> None:  # fmt: skip
        """Compute `count` rows: rows of inputs to rows of outputs, all of them contiguous."""
        block, program = self._kernel.block, self._kernel.program
        whole = count - count % block
        if whole:
            self._run(inputs, outputs, whole // block, stream)
        if whole < count:
            # The last rows, in buffers of a whole block.
            padded = {}
            for name in self._kernel.arrays:
                rows = inputs[name]
                if name not in program.shared:
                    rows = rows[whole:count]
                    rows = np.concatenate([rows, np.repeat(rows[-1:], block - len(rows), axis=0)])
                padded[name] = np.ascontiguousarray(rows)
            found = {name: aligned_empty(block, len(s)) for name, s in program.outputs.items()}
            self._run(padded, found, 1, stream)
            for name, rows in found.items():
                outputs[name][whole:count] = rows[: count - whole]

    def _run(
        self, inputs: Mapping[str, Array], outputs: Mapping[str, Array], blocks: int, stream: bool
    ) -> None:
        for i, name in enumerate(self._kernel.arrays):
            self._inputs[i] = address_of(inputs[name])
        for i, name in enumerate(self._kernel.program.outputs):
            self._outputs[i] = address = address_of(outputs[name])
            stream = stream and address % 64 == 0
        self._kernel.entry(stream)(
            blocks,
            ctypes.addressof(self._inputs),
            ctypes.addressof(self._outputs),
            address_of(self._scratch),
        )
