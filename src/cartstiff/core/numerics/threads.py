"""One thread for linear algebra on small matrices, for which several are slower."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from threading import Lock
from typing import Any

#: Range of rows in which BLAS would use several threads although one is faster.
_LEAST_ROWS, _LARGEST_ROWS = 16, 300


def process_lock() -> Lock:
    """A lock that is free in a forked child, whichever thread of its parent held it."""
    lock = Lock()
    if hasattr(os, "register_at_fork"):
        os.register_at_fork(after_in_child=lock._at_fork_reinit)  # type: ignore[attr-defined]
    return lock


_lock = process_lock()
_inside = 0
_libraries: dict[bool, list[Any]] = {}
_before: list[tuple[Any, int]] = []


@contextmanager
def one_thread(rows: int | None = None) -> Iterator[None]:
    """Use one thread of BLAS for matrices with `rows` rows, or, without rows,
    for many matrices.

    An active thread of BLAS polls for more work for a while, on a processor that the
    threads of a map need. The number of threads belongs to the process: it is restored
    when the last context ends. Enter the context for many matrices in the main thread:
    once that has set the number, OpenBLAS 0.3.30 and 0.3.31 ignore other threads.
    """
    global _inside
    if rows is not None and not _LEAST_ROWS <= rows < _LARGEST_ROWS:
        yield
        return
    if rows is None:
        import scipy.linalg  # noqa: F401 - loads its BLAS before another thread needs it
    with _lock:
        held = [library.filepath for library, _ in _before]
        for library in _blas():
            if library.filepath not in held:
                _before.append((library, library.get_num_threads()))
                library.set_num_threads(1)
        _inside += 1
    try:
        yield
    finally:
        with _lock:
            _inside -= 1
            if _inside == 0:
                for library, count in _before:
                    library.set_num_threads(count)
                _before.clear()


def _blas() -> list[Any]:
    """The BLAS libraries of this process.

    SciPy loads its own when it is first imported.
    """
    with_scipy = "scipy.linalg" in sys.modules
    if with_scipy not in _libraries:
        from threadpoolctl import ThreadpoolController

        controllers = ThreadpoolController().lib_controllers
        _libraries[with_scipy] = [c for c in controllers if c.user_api == "blas"]
    return _libraries[with_scipy]
