"""Check the bundled mechanism files and keep what they hold: ``python -m tools.checked_files``.

Writes ``robots/checked.json``, from which these files are read without pydantic.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any
from zlib import crc32

from cartstiff.loading.catalogue import bundled_files, bundled_folder
from cartstiff.loading.keys.checked import CHECKED, packed
from cartstiff.loading.mechanism_file import checked_file
from cartstiff.loading.schema import SerialFile
from cartstiff.loading.yaml_file import read_yaml


def plainly_built(path: Path) -> dict[str, Any] | None:
    """What is kept of a file; None where building it takes more than the values of its keys."""
    file, parameters = checked_file(*read_yaml(path), path)
    if file.kind == "parallel" or getattr(file, "flexible", None) or file.identified:
        return None
    kept = packed(file)
    return {"crc": crc32(path.read_bytes()), "parameters": parameters.values, "file": kept}


def checked_files() -> str:
    """Text of the file."""
    kept = {name: plainly_built(path) for name, path in bundled_files().items()}
    alone = SerialFile.model_construct(kind="serial", model="")
    every = {"": {"file": packed(alone)}} | {name: one for name, one in kept.items() if one}
    lines = (f"{json.dumps(name)}: {json.dumps(one)}" for name, one in every.items())
    return "{\n" + ",\n".join(lines) + "\n}\n"


if __name__ == "__main__":
    (bundled_folder() / CHECKED).write_text(checked_files(), encoding="utf-8")
