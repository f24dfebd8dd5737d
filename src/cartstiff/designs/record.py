"""Finished designs in a file of JSON lines, so that a study goes on where it was."""

from __future__ import annotations

import json
import zlib
from collections.abc import Mapping
from hashlib import sha256
from pathlib import Path
from typing import Any

from cartstiff.designs.evaluation import Design
from cartstiff.designs.study import Study
from cartstiff.errors import InputError, one_line
from cartstiff.loading.catalogue import bundled
from cartstiff.loading.yaml_file import read_yaml

SCHEMA = "cartstiff-designs/1"
#: Bytes of the file: ten million designs.
LARGEST = 1 << 32


def digest_of(study: Study, folder: Path) -> str:
    """What tells a study's numbers from another's: all but how designs are chosen and named."""
    beside = folder / study.mechanism
    path = beside if beside.is_file() else bundled(study.mechanism) or beside
    digest = sha256(path.read_bytes())
    for model in _models(read_yaml(path)[0]):
        file = path.parent / model
        digest.update(file.read_bytes() if file.is_file() else model.encode())
    data = study.model_dump(mode="json", exclude={"method", "description", "mechanism"})
    data = {key: value for key, value in data.items() if value is not None}
    # Ends of a range do not change the numbers of a design within it.
    data["variables"] = sorted(data["variables"])
    digest.update(json.dumps(data, sort_keys=True).encode())
    return digest.hexdigest()


def _models(data: Any) -> list[str]:
    if isinstance(data, dict):
        own = [data["model"]] if isinstance(data.get("model"), str) else []
        return own + [name for value in data.values() for name in _models(value)]
    return [name for value in data for name in _models(value)] if isinstance(data, list) else []


def key_of(parameters: Mapping[str, float]) -> tuple[tuple[str, float], ...]:
    """Parameters as what a design is found by."""
    return tuple(sorted(parameters.items()))


class Record:
    """Designs by their parameters, in memory and, with a path, in a file.

    Parameters
    ----------
    path : Path, optional
        Where they are kept; one that exists is gone on with.
    digest : str
        Of the study, from `digest_of`.

    Attributes
    ----------
    damaged : int
        Lines of the file that could not be read; their designs are computed again.

    Raises
    ------
    InputError
        If the file belongs to another study or cannot be used.
    """

    def __init__(self, path: Path | None, digest: str) -> None:
        self.path, self.damaged = path, 0
        self._known: dict[tuple[tuple[str, float], ...], Design] = {}
        head = {"schema": SCHEMA, "study": digest}
        if path is None:
            return
        if path.exists():
            self._read(path, head)
        else:
            self._append(head)

    def _read(self, path: Path, head: Mapping[str, str]) -> None:
        where = one_line(str(path))
        try:
            first, *lines = path.read_bytes().split(b"\n")
        except OSError as error:
            raise InputError("file cannot be read", where=where, got=error.strerror) from None
        try:
            there = json.loads(first)
        except ValueError:
            there = None
        if not isinstance(there, dict) or there.get("schema") != SCHEMA:
            raise InputError("file holds no designs", where=where, expected=f"schema {SCHEMA}")
        if there != head:
            raise InputError(
                "the file holds the designs of another study",
                where=where,
                expected="the same mechanism, poses, cases, objectives and constraints, or another "
                "file name",
            )
        for line in lines:
            if not line:
                continue
            try:
                entry = json.loads(line)
                if entry.pop("sum") != _sum(entry):
                    raise ValueError("damaged")
                design = Design(**entry)
            except (ValueError, TypeError, KeyError, AttributeError):
                self.damaged += 1
                continue
            self._known[key_of(design.parameters)] = design
        if lines and lines[-1]:  # a line that was not finished
            self._write(b"\n")

    def __contains__(self, parameters: Mapping[str, float]) -> bool:
        return key_of(parameters) in self._known

    def __getitem__(self, parameters: Mapping[str, float]) -> Design:
        return self._known[key_of(parameters)]

    def add(self, design: Design) -> None:
        """Keep a design."""
        self._known[key_of(design.parameters)] = design
        entry = design.as_dict()
        self._append({**entry, "sum": _sum(entry)})

    def _append(self, entry: Mapping[str, Any]) -> None:
        self._write(json.dumps(entry, allow_nan=False).encode() + b"\n")

    def _write(self, data: bytes) -> None:
        if self.path is None:
            return
        try:
            with self.path.open("ab") as file:
                file.write(data)
        except OSError as error:
            raise InputError(
                "file cannot be written", where=one_line(str(self.path)), got=error.strerror
            ) from None


def _sum(entry: Mapping[str, Any]) -> int:
    return zlib.crc32(json.dumps(entry, sort_keys=True).encode())
