"""Test files nearest to a room, for `make test ROOM=statics`.

    python tools/room_tests.py ROOM [--most N]

A room is a folder of src/cartstiff at any depth, by its name: statics, or core with all its rooms.
A file is near by the names that it imports, publicly, by doors or through `tests/inner.py`, which
live in the room: by their share, and by their number. A folder of tests with its name comes first.
"""

from __future__ import annotations

import argparse
import ast
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = ROOT / "src" / "cartstiff"


def _imports(path: Path) -> list[tuple[str, str]]:
    """Module and name of each import; relative ones have their dots."""
    nodes = ast.walk(ast.parse(path.read_text(encoding="utf-8")))
    found = [node for node in nodes if isinstance(node, ast.ImportFrom)]
    return [("." * n.level + (n.module or ""), a.name) for n in found for a in n.names]


def homes() -> dict[str, set[str]]:
    """The rooms, from the outermost on, of each name that tests import."""
    found = {}
    for stub in PACKAGE.glob("*.pyi"):
        found |= {name: set(module.lstrip(".").split(".")) for module, name in _imports(stub)}
    sys.path.insert(0, str(ROOT))
    from tests import doors, inner

    listed = {module: names.split() for module, names in inner.HOMES.items()}
    for module, names in [*doors.table().items(), *listed.items()]:
        for name in names:
            word = name.partition("=")[0]
            found[word] = {*module.split("."), word}
    return found


def nearest(room: str, most: int) -> list[Path]:
    """Test files, the nearest first."""
    at, near = homes(), []
    for path in sorted((ROOT / "tests").rglob("test_*.py")):
        ours = ("cartstiff", "tests")
        names = [name for module, name in _imports(path) if module.partition(".")[0] in ours]
        own = sum(room in at.get(name, ()) for name in names)
        is_home = path.parent.name == room
        if own or is_home:
            near.append((not is_home, -own * own / max(len(names), 1), path))
    return [path.relative_to(ROOT) for *_, path in sorted(near)[:most]]


def main() -> None:
    """Print them on one line."""
    rooms = sorted({path.parent.name for path in PACKAGE.rglob("*/*.py")})
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("room", choices=rooms)
    # Eight run in half a minute on two cores; the ninth to twelfth of maps open browsers.
    parser.add_argument("--most", type=int, default=8)
    options = parser.parse_args()
    print(*nearest(options.room, options.most))


if __name__ == "__main__":
    main()
