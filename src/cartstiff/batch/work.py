"""Profile of a computation: which code computed, for how long, and the limits of the machine."""

from __future__ import annotations

import ctypes
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from cartstiff.batch.arguments import aligned_empty
from cartstiff.batch.execution import _binding, lanes
from cartstiff.batch.tape import Program
from cartstiff.numerics.threads import process_lock

#: Name of the share of `cartstiff.analyse`.
BY_REFERENCE = "engine, one posture after the other"
#: Name of the share of recording and compiling, once for a mechanism and its outputs.
MAKING = "making of machine code"
# Independent chains of multiply-adds, which hide the latency of each.
_CHAINS = 12
# The best of so many measurements counts, as the machine may be busy.
_TRIES = 4
_watching: list[Work] = []
_lock, _thread = process_lock(), threading.local()


@dataclass
class Share:
    """Share of one kind of code.

    Attributes
    ----------
    postures : int
        Number of postures; 0 where it computes none.
    seconds : float
        Processor time of its threads.
    operations, bytes : int
        Operations and bytes written for each posture, of recorded arithmetic.
    """

    postures: int = 0
    seconds: float = 0.0
    operations: int = 0
    bytes: int = 0


@dataclass
class Work:
    """Shares by name, in the order of their first use."""

    shares: dict[str, Share] = field(default_factory=dict)


@contextmanager
def watched() -> Iterator[Work]:
    """Collect the shares of everything that this process computes in the meantime."""
    work = Work()
    _watching.append(work)
    try:
        yield work
    finally:
        _watching.remove(work)


@contextmanager
def timed(what: str, postures: int = 0, program: Program | None = None) -> Iterator[None]:
    """Add the time spent inside to a share if `watched`; shares timed inside are subtracted."""
    if not _watching:
        yield
        return
    outer, _thread.inside = getattr(_thread, "inside", 0.0), 0.0
    start = time.thread_time()
    try:
        yield
    finally:
        seconds = time.thread_time() - start
        with _lock:
            for work in _watching:
                share = work.shares.setdefault(what, Share())
                share.postures += postures
                share.seconds += seconds - _thread.inside
                if program is not None and not share.operations:
                    share.operations = program.size
                    share.bytes = 8 * sum(map(len, program.outputs.values()))
        _thread.inside = outer + seconds


def explained(work: Work, seconds: float, spent: float) -> dict[str, Any]:
    """The shares and the limits of this machine, measured now, as plain data.

    Parameters
    ----------
    work : Work
        The shares.
    seconds, spent : float
        Wall time, and processor time of the process.

    Returns
    -------
    dict
        "seconds", "processor_seconds", "processor", "lanes", "machine" (operations and bytes
        written a second by one thread, null without llvmlite), "shares" (with the least time that
        operations and bytes take on this machine, "arithmetic" and "writing"), "limit".
    """
    machine: dict[str, float] | None = None
    hardware: dict[str, Any] = {"processor": None, "lanes": None}
    try:
        limits = Machine(1 << 22)
    except ImportError:
        pass
    else:
        measured = limits.flops, limits.bytes_written
        rates = (max(rate(1) for _ in range(_TRIES)) for rate in measured)
        machine = dict(zip(("operations", "bytes_written"), rates, strict=True))
        hardware = {"processor": _binding().get_host_cpu_name(), "lanes": limits.width}
    shares = []
    for what, share in work.shares.items():
        row: dict[str, Any] = {"what": what, **vars(share), "arithmetic": None, "writing": None}
        if machine is not None and share.operations:
            row["arithmetic"] = share.postures * share.operations / machine["operations"]
            row["writing"] = share.postures * share.bytes / machine["bytes_written"]
        shares.append(row)
    known = sum(share.seconds for share in work.shares.values())
    shares.append(
        {
            "what": "all else",
            **vars(Share(0, max(spent - known, 0.0))),
            "arithmetic": None,
            "writing": None,
        }
    )
    largest = max(shares, key=lambda row: row["seconds"])
    return {
        "seconds": seconds,
        "processor_seconds": spent,
        **hardware,
        "machine": machine,
        "shares": shares,
        "limit": _limit(largest),
    }


def _limit(largest: dict[str, Any]) -> str:
    """The share that takes longest, in words."""
    what, seconds = largest["what"], largest["seconds"]
    if largest["arithmetic"] is None or not seconds:
        return str(what)
    kind = max(("arithmetic", "writing"), key=lambda name: largest[name])
    return f"{what}: {kind}, which alone takes {100.0 * largest[kind] / seconds:.0f} % of its time"


def describe(facts: dict[str, Any]) -> list[str]:
    """Lines of text for the data of `explained`."""
    lines = [
        "",
        f"How it was computed: {facts['seconds']:.3g} s, "
        f"{facts['processor_seconds']:.3g} s of processor time",
    ]
    for row in facts["shares"]:
        line = f"  {row['what']}: {round(row['seconds'], 9):.3g} s"
        if row["postures"]:
            each = 10**6 * row["seconds"] / row["postures"]
            line += f", {row['postures']} postures, {each:.3g} us each"
        if row["arithmetic"] is not None:
            line += (
                f"; {row['operations']} operations and {row['bytes']} bytes a posture take "
                f"{row['arithmetic']:.2g} s and {row['writing']:.2g} s at least"
            )
        lines.append(line)
    if (machine := facts["machine"]) is not None:
        flops, written = (machine[key] / 10**9 for key in ("operations", "bytes_written"))
        lines.append(
            f"  this machine ({facts['processor']}, vectors of {facts['lanes']}): "
            f"{flops:.3g} Gflop/s, {written:.3g} GB/s written, on one thread"
        )
    return [*lines, f"  what limits: {facts['limit']}"]


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
