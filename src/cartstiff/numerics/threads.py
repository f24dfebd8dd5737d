"""One thread for linear algebra on matrices so small that several only wait for each other."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from threading import Lock
from typing import Any

#: Below so many rows BLAS takes one thread by itself; from so many on, several are worth it.
_FROM, _TO = 16, 300

_lock = Lock()
_inside = 0
_libraries: dict[bool, list[Any]] = {}
_before: list[tuple[Any, int]] = []


@contextmanager
def one_thread(rows: int) -> Iterator[None]:
    """Work on matrices of so many rows with one thread of BLAS.

    The number of threads belongs to the process: it comes back once nobody is inside any more.
    """
    global _inside
    if not _FROM <= rows < _TO:
        yield
        return
    with _lock:
        if _inside == 0:
            _before[:] = [(library, library.get_num_threads()) for library in _blas()]
            for library, _ in _before:
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


def _blas() -> list[Any]:
    """The BLAS libraries of this process; SciPy brings its own when it is first imported."""
    with_scipy = "scipy.linalg" in sys.modules
    if with_scipy not in _libraries:
        from threadpoolctl import ThreadpoolController

        controllers = ThreadpoolController().lib_controllers
        _libraries[with_scipy] = [c for c in controllers if c.user_api == "blas"]
    return _libraries[with_scipy]
