"""Reading an untrusted file in a separate process: both ends of the communication.

A worker is a script that calls `serve` with a function. It receives its arguments as JSON
on standard input and prints one line of JSON, after which bytes may follow. It has no
environment of the user, no open files, limited time and memory, and cannot write files
or, if the kernel supports that, start programs or use the network.
"""

from __future__ import annotations

import errno
import json
import os
import signal
import stat
import sys
import sysconfig
from collections.abc import Callable, Mapping
from contextlib import suppress
from typing import TYPE_CHECKING, Any

from cartstiff.core.errors import InputError

if TYPE_CHECKING:
    from subprocess import CompletedProcess

# Longest time [s], also for a process that waits.
_LONGEST = 60.0
_MEGABYTE = 1024 * 1024


def answer_of(
    worker: str,
    arguments: list[Any],
    where: str,
    who: str,
    more: Mapping[str, str] | None = None,
) -> dict[str, Any]:
    """The JSON object that a worker prints; bytes after it under "payload".

    Parameters
    ----------
    worker : str
        Path of the script.
    arguments : list
        Arguments of its function, as for JSON.
    where, who : str
        Place and reader ("MuJoCo"), for messages.
    more : mapping of str to str, optional
        Environment variables.

    Raises
    ------
    InputError
        If it does not end in time, or crashes.
    """
    import subprocess

    # Python's own modules before files of the same name beside the user's script.
    places = [*(sysconfig.get_path(kind) for kind in ("stdlib", "platstdlib")), *sys.path]
    # One thread only: a process with several cannot enter a network namespace.
    alone = {"OMP_NUM_THREADS": "1", "PYTHONPATH": os.pathsep.join(filter(None, places))}
    environment = {**(more or {}), **alone}
    command = [sys.executable, "-P", "-B", worker]
    try:
        # In the root folder, where libraries cannot write log files.
        done = subprocess.run(
            command,
            env=environment,
            cwd="/",
            input=json.dumps(arguments).encode(),
            capture_output=True,
            timeout=_LONGEST,
            check=False,
        )
    except subprocess.TimeoutExpired:
        raise InputError(f"{who} does not come to an end with it", where=where) from None
    except (OSError, ValueError) as error:
        got = getattr(error, "strerror", None) or str(error)
        raise InputError(
            "no process could be started to read it", where=where, got=got
        ) from None
    head, _, payload = done.stdout.partition(b"\n")
    try:
        data: dict[str, Any] = json.loads(head)
    except ValueError:
        raise InputError(
            f"{who} broke down on it", where=where, got=_end_of(done)
        ) from None
    return {**data, "payload": payload} if payload else data


def _end_of(done: CompletedProcess[bytes]) -> str:
    if done.returncode in (-signal.SIGXCPU, -signal.SIGKILL):
        return "it took too long"
    if done.returncode < 0:
        return f"signal {signal.Signals(-done.returncode).name}"
    lines = done.stderr.decode("utf-8", "replace").split("\n")
    return next(
        (line for line in reversed(lines) if line.strip()), f"exit {done.returncode}"
    )


def serve(answer: Callable[..., dict[str, Any]], megabytes: int, seconds: int) -> None:
    """Run a function once, within limits, and print its result; for the worker.

    Parameters
    ----------
    answer : callable
        Function of the arguments. Its result is printed, bytes under "payload" after the
        rest; an exception is printed under "error", the name of a missing package under
        "missing".
    megabytes, seconds : int
        Limits of memory and processor time.
    """
    import resource

    for limit, value in (
        (resource.RLIMIT_AS, megabytes * _MEGABYTE),
        (resource.RLIMIT_CORE, 0),
        (resource.RLIMIT_FSIZE, 0),
    ):
        resource.setrlimit(limit, (value, value))
    resource.setrlimit(
        resource.RLIMIT_CPU, (seconds, seconds + 1)
    )  # a signal, then termination
    arguments = json.load(sys.stdin)
    out = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # for output of libraries
    for refuse in (_leave_the_network, _confine) if sys.platform == "linux" else ():
        with suppress(OSError, AttributeError):
            refuse()
    try:
        data = answer(*arguments)
    except ModuleNotFoundError as error:
        data = {"missing": error.name}
    except (MemoryError, RecursionError):
        data = {"error": "too much memory is needed"}
    except Exception as error:
        data = {"error": str(error) or type(error).__name__}
    payload = data.pop("payload", b"")
    with out:
        out.write(json.dumps(data).encode() + b"\n" + payload)


def read_regular(path: str, largest: int) -> bytes:
    """Contents of a regular file of limited size; for the worker.

    A pipe or a device is refused without waiting for it.

    Raises
    ------
    OSError
        If it cannot be read, is not regular, or too large.
    """
    handle = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    with os.fdopen(handle, "rb") as file:
        if not stat.S_ISREG(os.fstat(handle).st_mode):
            raise OSError(errno.EINVAL, "not a regular file", path)
        data = file.read(largest + 1)
    if len(data) > largest:
        raise OSError(errno.EFBIG, f"more than {largest} bytes", path)
    return data


def _leave_the_network() -> None:
    """Enter a new network namespace, without any connection;
    root needs no user namespace.

    Source: the manual pages unshare(2) and user_namespaces(7).
    """
    import ctypes

    network, users = 0x40000000, 0x10000000
    ctypes.CDLL(None).unshare(network if os.geteuid() == 0 else network | users)


def _confine() -> None:
    """Forbid writing, new programs and TCP from now on, by Linux's Landlock if available.

    Rights that are handled and not granted anywhere are refused. Source: the manual pages
    landlock(7) and landlock_create_ruleset(2), whose numbers are the same on every
    processor.
    """
    import ctypes

    create, restrict, version, no_new_privileges = 444, 446, 1, 38
    # Rights of files by the version that brought them; 2 and 3, to read, are not handled.
    rights = {1: (0, 1, *range(4, 13)), 2: (13,), 3: (14,), 5: (15,)}
    libc = ctypes.CDLL(None, use_errno=True)
    known = libc.syscall(create, None, 0, version)
    if known < 1:
        return
    files = sum(
        1 << bit for since, bits in rights.items() if since <= known for bit in bits
    )
    handled = (ctypes.c_uint64 * 3)(
        files, 0b11, 0b11
    )  # TCP; signals and abstract sockets
    size = 8 * (3 if known >= 6 else 2 if known >= 4 else 1)
    ruleset = libc.syscall(create, ctypes.byref(handled), size, 0)
    if ruleset >= 0:
        libc.prctl(no_new_privileges, 1, 0, 0, 0)
        libc.syscall(restrict, ruleset, 0)
        os.close(ruleset)
