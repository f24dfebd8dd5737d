"""Run every example and write its picture to docs/images, or to another folder.

Usage: ``python examples/make_gallery.py [FOLDER] [NAME ...]``
"""

import runpy
import sys
import time
from pathlib import Path

HERE = Path(__file__).resolve().parent
NAMES = sorted(path.stem for path in HERE.glob("*.py") if path.stem != "make_gallery")


def main(folder: Path, names: list[str]) -> dict[str, Path]:
    """Pictures by example name."""
    folder.mkdir(parents=True, exist_ok=True)
    pictures = {}
    for name in names:
        start = time.perf_counter()
        pictures[name] = folder / f"{name}.png"
        runpy.run_path(str(HERE / f"{name}.py"))["main"](pictures[name])
        size = pictures[name].stat().st_size
        print(f"{name:<26} {size:>8} bytes {time.perf_counter() - start:6.1f} s")
    return pictures


if __name__ == "__main__":
    target = Path(sys.argv[1]) if sys.argv[1:] else HERE.parent / "docs" / "images"
    main(target, sys.argv[2:] or NAMES)
