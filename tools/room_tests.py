"""Test files nearest to a room, for `make test ROOM=statics`.

    python tools/room_tests.py ROOM [--most N]

A file is near by the names that it imports, publicly or through `tests/inner.py`, which live in the
room: by their share, and by their number. A folder of tests with the room's name comes first.
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


def homes() -> dict[str, str]:
    """The room of each name that tests import."""
    found = {}
    for stub in [PACKAGE / "__init__.pyi", *PACKAGE.glob("*/__init__.pyi")]:
        own = "" if stub.parent == PACKAGE else stub.parent.name
        for module, name in _imports(stub):
            found[name] = own or module.lstrip(".").partition(".")[0]
    sys.path.insert(0, str(ROOT))
    from tests.inner import HOMES

    for module, names in HOMES.items():
        for name in names.split():
            found[name.partition("=")[0]] = module.partition(".")[0] or name
    return found


def nearest(room: str, most: int) -> list[Path]:
    """Test files, the nearest first."""
    at, near = homes(), []
    for path in sorted((ROOT / "tests").rglob("test_*.py")):
        ours = ("cartstiff", "tests")
        names = [name for module, name in _imports(path) if module.partition(".")[0] in ours]
        own = sum(at.get(name) == room for name in names)
        is_home = path.parent.name == room
        if own or is_home:
            near.append((not is_home, -own * own / max(len(names), 1), path))
    return [path.relative_to(ROOT) for *_, path in sorted(near)[:most]]


def main() -> None:
    """Print them on one line."""
    rooms = sorted(path.parent.name for path in PACKAGE.glob("*/__init__.py"))
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("room", choices=rooms)
    parser.add_argument("--most", type=int, default=20)
    options = parser.parse_args()
    print(*nearest(options.room, options.most))


if __name__ == "__main__":
    main()
