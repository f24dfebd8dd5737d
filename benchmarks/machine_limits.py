"""Limits of the machine and sizes of its caches, for what is measured beside them."""

from __future__ import annotations

import ctypes
import threading
import time
from typing import Any

import numpy as np

from cartstiff.recorded.arguments import aligned_empty
from cartstiff.recorded.execution import _binding, lanes

# Independent chains of multiply-adds, which hide the latency of each.
_CHAINS = 12


def cache_size() -> str:
    """Sizes of the caches, where the system tells."""
    from pathlib import Path

    found = []
    for index in sorted(Path("/sys/devices/system/cpu/cpu0/cache").glob("index*")):
        level, size = ((index / name).read_text().strip() for name in ("level", "size"))
        if (index / "type").read_text().strip() != "Instruction":
            found.append(f"L{level} {size}")
    return ", ".join(found)


def _code(width: int) -> str:
    v = f"<{width} x double>"
    arithmetic = [
        "define void @arithmetic(i64 %n, ptr %p) {",
        "entry:",
        *(f"  %a{i} = load {v}, ptr %p" for i in range(_CHAINS)),
        "  br label %again",
        "again:",
        "  %k = phi i64 [0, %entry], [%next, %again]",
        *(f"  %x{i} = phi {v} [%a{i}, %entry], [%y{i}, %again]" for i in range(_CHAINS)),
        *(
            f"  %y{i} = call {v} @llvm.fma.v{width}f64({v} %x{i}, {v} %a0, {v} %a1)"
            for i in range(_CHAINS)
        ),
        "  %next = add i64 %k, 1",
        "  %more = icmp ult i64 %next, %n",
        "  br i1 %more, label %again, label %end",
        "end:",
        *(f"  store volatile {v} %y{i}, ptr %p" for i in range(_CHAINS)),
        "  ret void",
        "}",
        f"declare {v} @llvm.fma.v{width}f64({v}, {v}, {v})",
    ]
    write = [
        "define void @write(i64 %n, ptr %p) {",
        "entry:",
        f"  %x = load {v}, ptr %p",
        "  br label %again",
        "again:",
        "  %k = phi i64 [0, %entry], [%next, %again]",
        f"  %a = getelementptr {v}, ptr %p, i64 %k",
        f"  store {v} %x, ptr %a, align {8 * width}, !nontemporal !0",
        "  %next = add i64 %k, 1",
        "  %more = icmp ult i64 %next, %n",
        "  br i1 %more, label %again, label %end",
        "end:",
        "  ret void",
        "}",
        "!0 = !{i32 1}",
    ]
    return "\n".join([*arithmetic, *write])


class Machine:
    """Limits of the machine: multiply-adds, and bytes written past the cache, per second.

    Some processors write zeros at more than twice the speed of other data (an AMD EPYC, Zen 4: 70
    and 28 GB/s), so that the limit is measured with numbers that are not zero.

    Parameters
    ----------
    size : int
        Count of numbers that each thread writes.
    """

    def __init__(self, size: int = 1 << 24) -> None:
        self._size = size
        llvm = _binding()
        machine = llvm.Target.from_default_triple().create_target_machine(
            cpu=llvm.get_host_cpu_name(),
            features=llvm.get_host_cpu_features().flatten(),
            opt=2,
        )
        self.width = lanes()
        self._engine = llvm.create_mcjit_compiler(llvm.parse_assembly(_code(self.width)), machine)
        self._engine.finalize_object()
        kind = ctypes.CFUNCTYPE(None, ctypes.c_int64, ctypes.c_void_p)
        self._arithmetic = kind(self._engine.get_function_address("arithmetic"))
        self._write = kind(self._engine.get_function_address("write"))
        self._memory = [aligned_empty(size) for _ in range(2)]
        self._fill(zeros=False)

    def _fill(self, zeros: bool) -> None:
        values = np.random.default_rng(0).uniform(size=self.width)
        for block in self._memory:
            block.reshape(-1, self.width)[:] = 0.0 if zeros else values

    def _rate(self, function: Any, count: int, threads: int) -> float:
        """Inner loops per second."""
        workers = [
            threading.Thread(target=function, args=(count, self._memory[i].ctypes.data))
            for i in range(threads)
        ]
        start = time.perf_counter()
        for worker in workers:
            worker.start()
        for worker in workers:
            worker.join()
        return threads * count / (time.perf_counter() - start)

    def flops(self, threads: int) -> float:
        """Floating-point operations per second, a multiply-add being two."""
        return self._rate(self._arithmetic, 2_000_000, threads) * _CHAINS * self.width * 2

    def bytes_written(self, threads: int, zeros: bool = False) -> float:
        """Bytes per second, repeating a few numbers, or zeros."""
        self._fill(zeros)
        return self._rate(self._write, self._size // self.width, threads) * self.width * 8


__all__ = ["Machine", "cache_size"]
