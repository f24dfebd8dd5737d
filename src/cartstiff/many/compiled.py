"""Running a program as machine code made by llvmlite."""

from __future__ import annotations

import ctypes
import os
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from functools import cache, lru_cache
from typing import Any

import numpy as np

from cartstiff.geometry.se3 import Array
from cartstiff.many.arguments import address_of, aligned_empty
from cartstiff.many.machine_code.vector_code import LONGEST, input_arrays, scratch_size, vector_code
from cartstiff.many.tape import Program

#: Bytes of output beyond which writing past the cache pays.
STREAMED = 1 << 23

_SIGNATURE = ctypes.CFUNCTYPE(None, ctypes.c_int64, *[ctypes.c_void_p] * 4)


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

    def entry(self, stream: bool) -> Any:
        """The function that writes through the cache or, with `stream`, past it."""
        if stream not in self._made:  # of two threads that compile it at once one is kept
            self._made.setdefault(stream, self._compile(stream))
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

    def workspace(self, length: int, threads: int = 1) -> Buffers:  # noqa: ARG002
        """Scratch memory for some threads."""
        return Buffers(self, threads)


@lru_cache(maxsize=4)
def _pool(threads: int) -> ThreadPoolExecutor:
    return ThreadPoolExecutor(threads, thread_name_prefix="cartstiff-many")


if hasattr(os, "register_at_fork"):
    # A forked process has none of its parent's threads.
    os.register_at_fork(after_in_child=_pool.cache_clear)


class Buffers:
    """A kernel with scratch memory for each thread."""

    def __init__(self, kernel: CompiledKernel, threads: int) -> None:
        self._kernel = kernel
        self._scratch = [aligned_empty(kernel.scratch) for _ in range(threads)]
        for scratch in self._scratch:
            # The first round works on what is here: no surprises for the processor.
            scratch[:] = 0.0

    def run(
        self,
        inputs: Mapping[str, Array],
        outputs: Mapping[str, Array],
        count: int,
        stream: bool = False,
    ) -> None:
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
            arrays = {name: aligned_empty(block, len(s)) for name, s in program.outputs.items()}
            self._run(padded, arrays, 1, stream)
            for name, rows in arrays.items():
                outputs[name][whole:count] = rows[: count - whole]

    def _run(
        self, inputs: Mapping[str, Array], outputs: Mapping[str, Array], blocks: int, stream: bool
    ) -> None:
        read = [address_of(inputs[name]) for name in self._kernel.arrays]
        written = [address_of(outputs[name]) for name in self._kernel.program.outputs]
        entry = self._kernel.entry(stream and not any(address % 64 for address in written))
        pointers = (ctypes.c_void_p * len(read))(*read), (ctypes.c_void_p * len(written))(*written)
        progress = (ctypes.c_int64 * 2)()

        def share(scratch: Array, held: object = (inputs, outputs)) -> None:  # noqa: ARG001
            # An interrupt may end this thread's call: what the others write to is held until then.
            entry(blocks, *pointers, address_of(scratch), progress)

        own, *others = self._scratch[:blocks]
        shares = [_pool(len(others)).submit(share, scratch) for scratch in others]
        share(own)
        for other in shares:
            if progress[1] < blocks:
                other.result()
            other.cancel()  # one that has not begun would find nothing left
