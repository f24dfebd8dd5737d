"""Run the gallery's scripts: their pictures into docs/images, what they print beside them.

python docs/gallery [NAME ...]
"""

import contextlib
import io
import os
import runpy
import sys
import tempfile
from pathlib import Path

from PIL import Image

HERE = Path(__file__).resolve().parent
IMAGES = HERE.parent / "images"
NAMES = sorted(path.stem for path in HERE.glob("*.py") if path.stem != "__main__")


def main(names: list[str]) -> None:
    """One after another, each in an empty folder."""
    os.environ.setdefault("MPLBACKEND", "Agg")  # no window
    for name in names:
        with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder):
            printed = io.StringIO()
            with contextlib.redirect_stdout(printed):
                runpy.run_path(str(HERE / f"{name}.py"))
            (HERE / f"{name}.txt").write_text(printed.getvalue(), encoding="utf-8")
            few = Image.open(f"{name}.png").convert("RGB").quantize(64)  # colours: a small file
            few.save(IMAGES / f"{name}.png", optimize=True)
        print(name)


if __name__ == "__main__":
    main(sys.argv[1:] or NAMES)
