"""A map that is begun: its parts one by one, in this process or as a worker computes them."""

from __future__ import annotations

from typing import Any

import pytest

from cartstiff.maps import summary
from tests.inner import (
    CHECKSUM,
    MapFile,
    packed,
    part_elsewhere,
    planned,
    prepare_map,
    run_map,
    store,
    version,
)


class BegunMap:
    """The file of a map, with as many of its parts as were computed."""

    def __init__(
        self, elastic: Any, sampling: Any, quantities: Any, where: Any, **asked: Any
    ) -> None:
        self.job, self.file = prepare_map(elastic, sampling, quantities, where, **asked)
        self.where = where

    def compute(self, *parts: int) -> None:
        """Compute and write some parts."""
        for part in parts:
            self.file.write(part, self.job.compute(self.file.parts.box(part)))

    def go_on(self, *, anew: bool = False) -> int:
        """Compute what is missing, as the file was or is found `anew`; how many parts it was."""
        return run_map(self.job, MapFile.at(self.where) if anew else self.file)

    def in_worker(
        self, part: int = 0, *, at: Any = None, identity: str | None = None, versions: Any = ()
    ) -> int:
        """Compute a part as a worker does, which is told where the map is and of what."""
        told = self.file.attributes[CHECKSUM] if identity is None else identity
        return part_elsewhere(self.sent(), versions, str(at or self.file.address), told, part)

    def sent(self) -> bytes:
        """What a worker gets."""
        return packed(self.job)


def summary_of_file(where: Any) -> dict[str, Any]:
    """The summary by what is known of the parts, without their numbers."""
    return summary(MapFile.at(where))


def job_of(elastic: Any, sampling: Any, quantities: Any) -> Any:
    """How the parts of a map would be computed."""
    return planned(elastic, sampling, quantities)[0]


def layout_of(elastic: Any, sampling: Any, quantities: Any, **asked: Any) -> Any:
    """How a map would be divided and stored."""
    return planned(elastic, sampling, quantities, **asked)[1]


def small_pieces(monkeypatch: pytest.MonkeyPatch, postures: int) -> None:
    """Let parts be stored in pieces of so many postures."""
    monkeypatch.setattr(store, "INNER", postures)


def older_version(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let this be a release before."""
    monkeypatch.setattr(version, "__version__", "0.0.9")
