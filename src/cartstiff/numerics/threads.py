"""One thread for linear algebra on matrices so small that several only wait for each other."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from threading import Lock
from typing import Any

#: Below so many rows BLAS takes one thread by itself; from so many on, several are worth it.
_FROM, _TO = 16, 300


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
    """Work on matrices of so many rows with one thread of BLAS; without rows, on many matrices.

    A thread of BLAS that has been woken looks for more work for a while, on a processor that the
    threads of a map need. The number of threads belongs to the process: it comes back once nobody
    is inside any more. Begin many matrices in the main thread: once that has set the number,
    OpenBLAS 0.3.30 and 0.3.31 do not listen to other threads.
    """
    global _inside
    if rows is not None and not _FROM <= rows < _TO:
        yield
        return
    if rows is None:
        import scipy.linalg  # noqa: F401 - its BLAS, before it is needed in another thread
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
    """The BLAS libraries of this process; SciPy brings its own when it is first imported."""
    with_scipy = "scipy.linalg" in sys.modules
    if with_scipy not in _libraries:
        from threadpoolctl import ThreadpoolController

        controllers = ThreadpoolController().lib_controllers
        _libraries[with_scipy] = [c for c in controllers if c.user_api == "blas"]
    return _libraries[with_scipy]
