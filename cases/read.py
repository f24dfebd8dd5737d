"""Read the cases without cartstiff; run as a program, it lists them."""

from pathlib import Path

import numpy as np
import yaml


def cases(folder=Path(__file__).parent):
    """Name, folder and contents of every case."""
    for path in sorted(Path(folder).glob("*/case.yaml")):
        yield path.parent.name, path.parent, yaml.safe_load(path.read_text(encoding="utf-8"))


def met(asked, value):
    """Whether a value is the printed one, to the printed digit."""
    printed = np.array(asked["printed"], float)
    size = np.where(printed == 0, 1, abs(printed))
    allowed = 0.5 * 10.0 ** (np.floor(np.log10(size)) + 1 - asked.get("digits", 1))
    allowed = np.full(printed.shape, asked["last_digit"] / 2) if "last_digit" in asked else allowed
    allowed = np.where(printed == 0, asked["zero"], allowed) if "zero" in asked else allowed
    allowed = asked.get("tolerance", allowed)
    return bool(np.all(abs(np.asarray(value) - printed) <= allowed * (1 + 1e-9)))


if __name__ == "__main__":
    for name, _, case in cases():
        print(f"{name}: {case['title']} ({case['verdict']})")
