"""Robot descriptions: a Pinocchio model and the facts beside it.

Pinocchio's parsers answer some malformed files with messages on the terminal, silence, or worse.
A URDF is therefore checked before Pinocchio sees it (`urdf`); MJCF is MuJoCo's to read (`mjcf`).
"""

from __future__ import annotations

import os
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from threading import Lock
from typing import Any

import pinocchio as pin

from cartstiff.errors import InputError, one_line
from cartstiff.loading.mjcf import read_mjcf
from cartstiff.loading.mjcf_facts import MjcfFacts
from cartstiff.loading.urdf import Mimic, UrdfFacts, prepare_urdf
from cartstiff.loading.yaml_file import read_text
from cartstiff.mechanisms.shapes import Piece

__all__ = ["RobotDescription", "parse_xml", "quiet", "read_robot_description"]

_LARGEST = 64 * 1024 * 1024


@dataclass(frozen=True)
class RobotDescription:
    """A Pinocchio model and what its file says beside it.

    Attributes
    ----------
    path : Path or None
        The file, if there is one.
    model : pinocchio.Model
        As Pinocchio reads it, all joints free.
    urdf : UrdfFacts
        Following joints, planes and notes of a URDF.
    mjcf : MjcfFacts or None
        Springs, closures, couplings, gravity, posture of an MJCF file.
    pieces : tuple of Piece or None
        What the links look like, where that is not read from the file.
    held : frozenset of str
        Joints that stay at their neutral position.
    """

    path: Path | None
    model: Any
    urdf: UrdfFacts = field(default_factory=UrdfFacts)
    mjcf: MjcfFacts | None = None
    pieces: tuple[Piece, ...] | None = None
    held: frozenset[str] = frozenset()

    @property
    def facts(self) -> MjcfFacts:
        """What an MJCF file says; nothing for other sources."""
        return self.mjcf or MjcfFacts()

    @property
    def mimics(self) -> dict[str, Mimic]:
        """Joints that follow others."""
        return self.urdf.mimics | {n: Mimic(*rule) for n, rule in self.facts.followers.items()}


def read_robot_description(path: Path, floating: bool = False) -> RobotDescription:
    """Read a URDF or MJCF file; with `floating` the root of a URDF is free in F.

    Raises
    ------
    InputError
        One line with the file and the element that is wrong.
    """
    where = one_line(str(path))
    root = parse_xml(path)
    if root.tag == "robot":
        facts = prepare_urdf(root, where)
        text = ET.tostring(root, encoding="unicode")
        with quiet():
            try:
                root_joint = (pin.JointModelFreeFlyer(), "root") if floating else ()
                model = pin.buildModelFromXML(text, *root_joint)
            except Exception as error:
                raise InputError("not a usable URDF", where=where, got=str(error)) from None
        return RobotDescription(path, model, facts)
    if root.tag == "mujoco":
        model, mjcf, pieces = read_mjcf(path)
        return RobotDescription(path, model, mjcf=mjcf, pieces=pieces)
    hint = " (SDF is not supported: convert it to URDF)" if root.tag == "sdf" else ""
    raise InputError(
        f"not a robot description{hint}", where=where, expected="<robot> (URDF) or <mujoco> (MJCF)",
        got=f"<{one_line(root.tag, 40)}>",
    )  # fmt: skip


def parse_xml(path: Path) -> ET.Element:
    """Root element of an XML file without document type (no entities, no outside files)."""
    where = one_line(str(path))
    text = read_text(path, _LARGEST)
    if "<!DOCTYPE" in text or "<!ENTITY" in text:
        raise InputError("XML document types and entities are not supported", where=where)
    try:
        root = ET.fromstring(text)
    except ET.ParseError as error:
        raise InputError("not valid XML", where=where, got=str(error)) from None
    except (ValueError, RecursionError) as error:
        raise InputError("not valid XML", where=where, got=str(error)) from None
    return root


@contextmanager
def quiet() -> Iterator[None]:
    """Keep the C++ parsers' own messages off the terminal; errors come as exceptions.

    The streams belong to the process: the first thread in turns them off, the last one out on.
    """
    with _QUIET.lock:
        if not _QUIET.threads:
            _QUIET.begin()
        _QUIET.threads += 1
    try:
        yield
    finally:
        with _QUIET.lock:
            _QUIET.threads -= 1
            if not _QUIET.threads:
                _QUIET.end()


class _Quiet:
    """Standard output and error of the process on the null device, and where they were."""

    def __init__(self) -> None:
        self.lock, self.threads = Lock(), 0
        self.saved: list[tuple[int, int]] = []

    def begin(self) -> None:
        null = os.open(os.devnull, os.O_WRONLY)
        try:
            for target in (1, 2):
                with suppress(OSError):  # a stream that the caller has closed
                    self.saved.append((target, os.dup(target)))
                    os.dup2(null, target)
        finally:
            os.close(null)

    def end(self) -> None:
        while self.saved:
            target, copy = self.saved.pop()
            os.dup2(copy, target)
            os.close(copy)


_QUIET = _Quiet()
