"""Commands that end while they write: what is there is old or whole, and the next run clears up.

    python tools/fuzz_kills.py COUNT SEED [COMMAND...]

Each trial starts one of `LINES` in a folder with old files, without, or with what the trial before
has left, and ends its process

- after a random part of the time that it takes, by SIGKILL or by Ctrl-C (SIGINT),
- just before the n-th time that it opens, locks, renames or removes something in the folder,
- or as soon as a file becomes longer than a random number of bytes.

Then each file must be what it was, or whole; of a map, the parts that are there are those of an
undisturbed run. Ctrl-C must leave no other file and print no traceback. After the same command has
run to its end, the folder has the files of an undisturbed run, and nothing else.
"""

from __future__ import annotations

import importlib
import json
import os
import pkgutil
import random
import resource
import shutil
import signal
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from tools.compare_commands import write_inputs  # noqa: E402
from tools.fuzz_common import FaultError  # noqa: E402

import cartstiff  # noqa: E402

#: Commands that write, each with every kind of file that it writes.
LINES = """
analyse 3-rrr -o out.json
export cubic -o out.html
report cubic --load 0,0,0,0,0,-100 -o out.html
map cubic --grid x=-0.01:0.01:6,y=-0.01:0.01:5 --quantity translation_free_min --chunk 5 \
 -o out.zarr -o out.png -o out.json
path arm.yaml reach.csv --free-rotation --samples 3 --load 0,0,0,0,0,-10 \
 -o out.csv -o out.png -o out.json
identify arm.yaml measured.csv --sd dx=0.02mm --sd dy=0.02mm --sd dz=0.02mm \
 -o out.yaml -o out.png -o out.json
design front.yaml -o out.csv -o out.png -o out.json
compare cubic hexapod --load 0,0,0,0,0,-100 --world -o out.png -o out.json
equilibrium arm.yaml --load 0,0,0,0,0,-8 --path arm.csv -o out.csv -o out.json
modes stewart-simscape --response 5:100:20 --damping 0.02 --direction 0,0,1 -o out.csv -o out.png
assemble five-bar --all -o out.csv -o out.json
workspace hexapod --directions 8 --scan 2 -o out.csv -o out.png -o out.json
modes panda --impedance target.json --ratio 0.7 -o out.yaml -o out.json
identify arm.yaml --plan 3 --force 80 --sd dx=0.02mm --sd dy=0.02mm --sd dz=0.02mm -o out.csv
"""

#: What commands import besides.
_OTHERS = ("matplotlib.figure", "matplotlib.backends.backend_agg", "xarray", "zarr", "yaml")
_OLD = b"an old file\n"

_EVENTS = {"os.rename", "os.remove", "os.rmdir", "os.mkdir", "os.truncate", "fcntl.flock"}
# Exit code of a child whose command was interrupted when it had ended.
_LATE = 130


@dataclass
class Line:
    """A command, what it writes undisturbed, and how long that takes."""

    words: list[str]
    folder: Path
    inputs: set[str]
    whole: dict[str, bytes]
    #: Files that are not the same in each run, such as pages with times.
    varying: set[str]
    seconds: float
    events: int

    @property
    def targets(self) -> list[str]:
        """Names of the files that it writes."""
        return [word for before, word in pairwise(self.words) if before == "-o"]


def contents(folder: Path) -> Iterator[tuple[str, bytes]]:
    """Files of a folder and of those in it, by name."""
    for path in sorted(folder.rglob("*")):
        if path.is_file():
            yield str(path.relative_to(folder)), path.read_bytes()


def started(words: list[str], folder: Path, at: int = 0, most: int = 0) -> int:
    """Start a process of the command line, which ends at an event or a byte if they are not 0.

    It is forked from this one, which has imported what the commands need.
    """
    child = os.fork()
    if child:
        return child
    code = 99
    try:
        os.chdir(folder)
        for number, name in ((1, os.devnull), (2, f"../{folder.name}.err")):
            os.dup2(os.open(name, os.O_WRONLY | os.O_CREAT | os.O_TRUNC), number)
        watch(at, most)
        code = run_command(words)
        for stream in (sys.stdout, sys.stderr):
            stream.flush()
    except KeyboardInterrupt:
        code = _LATE
    finally:
        os._exit(code)


def watch(at: int, most: int) -> None:
    """Count the events of this process in its folder; end it at one of them, or at a byte."""
    folder, count = str(Path.cwd()), 0
    log = os.open(f"{folder}.events", os.O_WRONLY | os.O_CREAT | os.O_TRUNC)

    def seen(name: str, args: tuple[Any, ...]) -> None:
        nonlocal count
        if name == "open" and not (isinstance(args[2], int) and args[2] & 3):
            return  # to be read
        if name != "open" and name not in _EVENTS:
            return
        if name != "fcntl.flock":
            is_path = isinstance(args[0], (str, bytes, os.PathLike))
            place = str(Path(os.fsdecode(args[0])).absolute()) if is_path else "/"
            if not place.startswith(f"{folder}/"):
                return
        count += 1
        os.write(log, b".")
        if count == at:
            os.kill(os.getpid(), signal.SIGKILL)

    sys.addaudithook(seen)
    if most:
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        signal.signal(signal.SIGXFSZ, signal.SIG_DFL)
        resource.setrlimit(resource.RLIMIT_FSIZE, (most, most))


def run_command(words: list[str]) -> int:
    """Exit code of the command line."""
    from cartstiff.shown.cli.main import main as command_line

    try:
        command_line(words)
    except SystemExit as end:
        return int(end.code or 0)
    return 0


def ended(child: int, seconds: float | None = None) -> int | None:
    """Exit code of a process when it has ended; None if it takes longer."""
    begun = time.perf_counter()
    while True:
        found, status = os.waitpid(child, 0 if seconds is None else os.WNOHANG)
        if found:
            return os.waitstatus_to_exitcode(status)
        if time.perf_counter() - begun > (seconds or 0.0):
            return None
        time.sleep(0.001)


def said(folder: Path) -> str:
    """What the last command of a folder said on standard error."""
    return folder.with_name(f"{folder.name}.err").read_text(errors="replace")


def finished(words: list[str], folder: Path) -> tuple[float, int]:
    """Run a command to its end; its seconds, and the number of its events."""
    begun = time.perf_counter()
    if code := ended(started(words, folder)):
        raise FaultError(f"exit {code}: {said(folder)[-300:]}")
    events = folder.with_name(f"{folder.name}.events").stat().st_size
    return time.perf_counter() - begun, events


def prepared(words: list[str], folder: Path) -> Line:
    """Run a command undisturbed."""
    write_inputs(folder)
    (folder / "arm.csv").write_text("turn,lift,bow\n0,0.2,0.5\n0.1,0.3,0.4\n")
    inputs = {name for name, _ in contents(folder)}
    seconds, events = finished(words, folder)
    line = Line(words, folder, inputs, dict(contents(folder)), set(), seconds, events)
    # Pages hold the time at which they were made, answers of maps how long they took.
    endings = (".html", ".json") if words[0] == "map" else (".html",)
    line.varying = {n for n in set(line.whole) - inputs if n.endswith(endings) and ".zarr" not in n}
    return line


def clear(line: Line) -> None:
    """Remove everything but the inputs."""
    for path in line.folder.iterdir():
        if path.is_dir() and path.suffix == ".zarr":
            shutil.rmtree(path)
        elif path.is_file() and path.name not in line.inputs:
            path.unlink()


def is_whole(line: Line, name: str, data: bytes) -> bool:
    """Whether a file is what an undisturbed run writes, or looks like it where runs differ."""
    whole = line.whole[name]
    if name not in line.varying:
        return data == whole
    if name.endswith(".json"):
        try:
            return bool(json.loads(data).keys() == json.loads(whole).keys())
        except ValueError:
            return False
    return len(data) > 0.9 * len(whole) and data[-16:] == whole[-16:]


def check_interrupted(line: Line, before: dict[str, bytes]) -> set[str]:
    """Check what an ended process has left; the names that no run writes."""
    found = dict(contents(line.folder))
    if changed := {n for n in line.inputs if found.get(n) != line.whole[n]}:
        raise FaultError(f"inputs were changed: {changed}")
    for name in line.targets:
        if name.endswith(".zarr"):
            in_a_child(partial(check_map, line, name))
        elif name not in found and name in before:
            raise FaultError(f"{name} is gone")
        elif name in found and found[name] == before.get(name):
            pass
        elif name in found and not is_whole(line, name, found[name]):
            raise FaultError(f"{name} is half written: {len(found[name])} bytes")
    return {name for name in found if name not in line.whole}


def in_a_child(check: Callable[[], None]) -> None:
    """Check in a forked process: a thread of Zarr stays in it."""
    ends = os.pipe()
    child = os.fork()
    if not child:
        fault = ""
        try:
            check()
        except BaseException as error:
            fault = f"{type(error).__name__}: {error}"
        os.write(ends[1], fault.encode())
        os._exit(bool(fault))
    os.close(ends[1])
    with os.fdopen(ends[0], "rb") as pipe:
        fault = pipe.read().decode()
    if ended(child):
        raise FaultError(fault)


def check_map(line: Line, name: str) -> None:
    """What a map has computed is what an undisturbed run computes."""
    import numpy as np

    from cartstiff.maps import open_map

    place = line.folder / name
    if not place.exists():
        return
    there, whole = open_map(place).load(), open_map(line.folder / f"whole/{name}").load()
    is_done = there["state"].values != 255
    for variable in whole.data_vars:
        a, b = (data[variable].values[is_done] for data in (there, whole))
        if not np.array_equal(a, b, equal_nan=a.dtype.kind == "f"):
            raise FaultError(f"{name}: other numbers of {variable}")


def kill(line: Line, rng: random.Random) -> str:
    """End one process of a command, and look at what is there."""
    before = dict(contents(line.folder))
    way = rng.choice(["time", "time", "Ctrl-C", "event", "event", "bytes"])
    sizes = [len(line.whole[n]) for n in line.whole if n not in line.inputs]
    child = started(
        line.words,
        line.folder,
        at=rng.randint(1, line.events) if way == "event" else 0,
        most=rng.randint(1, max(sizes)) if way == "bytes" else 0,
    )
    code = None
    if way in ("time", "Ctrl-C"):
        code = ended(child, line.seconds * rng.uniform(0.02, 1.05) ** 0.5)
        if code is None:
            os.kill(child, signal.SIGKILL if way == "time" else signal.SIGINT)
    if code is None:
        code = ended(child)
    error = said(line.folder)
    left = check_interrupted(line, before)
    if way == "Ctrl-C" and (code not in (0, 130) or "Traceback" in error):
        raise FaultError(f"Ctrl-C: exit {code}: {error[-300:]}")
    if way == "Ctrl-C" and left - set(before):
        raise FaultError(f"Ctrl-C has left {left}")
    state = "had ended" if code == 0 else "left parts" if left else "left no part"
    return f"{way}: {state}"


def check_next_run(line: Line) -> None:
    """Run a command to its end: the folder is that of an undisturbed run."""
    finished(line.words, line.folder)
    found = dict(contents(line.folder))
    if set(found) != set(line.whole):
        raise FaultError(f"after the next run: {sorted(set(found) ^ set(line.whole))}")
    for name in set(found) - line.inputs:
        if ".zarr" not in name and not is_whole(line, name, found[name]):
            raise FaultError(f"after the next run {name} is not whole")
    for name in line.targets:
        if name.endswith(".zarr"):
            in_a_child(partial(check_map, line, name))


def trials(line: Line, seed: str, count: int) -> Iterator[str]:
    """How as many kills ended; after three at most the command runs to its end."""
    for index in range(count):
        rng = random.Random(f"{seed} {index}")
        try:
            if index % 3 == 0:
                clear(line)
                for name in line.targets:
                    if not name.endswith(".zarr") and rng.random() < 0.5:
                        (line.folder / name).write_bytes(_OLD)
            state = kill(line, rng)
            if index % 3 == 2 or index == count - 1:
                check_next_run(line)
        except FaultError as error:
            state = "FAULT"
            print(f"{seed} {index}: {' '.join(line.words)}: {error}", flush=True)
        yield state


def main(count: int, seed: int, only: list[str]) -> None:
    """Print the faults, and how the trials ended by command."""
    for module in (*_OTHERS, *pkgutil.walk_packages(cartstiff.__path__, "cartstiff.")):
        name = module if isinstance(module, str) else module.name
        if not name.endswith("__main__") and "worker" not in name:
            importlib.import_module(name)
    lines = [text.split() for text in LINES.replace("\\\n", "").strip().splitlines()]
    lines = [words for words in lines if not only or words[0] in only]
    tally = Counter[str]()
    with tempfile.TemporaryDirectory() as folder:
        prepared_lines = list[Line]()
        for at, words in enumerate(lines):
            line = prepared(words, Path(folder) / str(at))
            for name in line.targets:
                if name.endswith(".zarr"):
                    keep(line, name)
            prepared_lines.append(line)
            print(f"{words[0]}: {line.seconds:.1f} s, {line.events} events", flush=True)
        each = -(-count // len(lines))
        for begun in range(0, each, 3):
            for at, line in enumerate(prepared_lines):
                for state in trials(line, f"{seed} {at} {begun}", min(3, each - begun)):
                    tally[f"{line.words[0]}, {state}"] += 1
            print(f"{tally.total()} kills", flush=True)
    faults = sum(number for name, number in tally.items() if name.endswith("FAULT"))
    for name, number in sorted(tally.items()):
        print(f"{number:4d}  {name}")
    print(f"{tally.total()} kills, {faults} faults")
    sys.exit(bool(faults))


def keep(line: Line, name: str) -> None:
    """Keep the map of an undisturbed run, to compare with."""
    place = line.folder / "whole" / name
    shutil.copytree(line.folder / name, place)
    kept = {str(Path("whole") / k): v for k, v in line.whole.items() if k.startswith(name)}
    line.inputs |= set(kept)
    line.whole |= kept


if __name__ == "__main__":
    os.environ |= {"OMP_NUM_THREADS": "1", "PYTHONHASHSEED": "0"}
    main(int(sys.argv[1]), int(sys.argv[2]), sys.argv[3:])
