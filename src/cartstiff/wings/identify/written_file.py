"""The mechanism file of an identification: springs with their covariance, zeros,
tool and base.
"""

from __future__ import annotations

import math
import os
from pathlib import Path
from typing import Any

import numpy as np

from cartstiff.core.arrays import Array
from cartstiff.core.errors import InputError, one_line
from cartstiff.core.geometry import se3
from cartstiff.core.mechanisms.elastic import ElasticMechanism
from cartstiff.core.units import SI, convert_length
from cartstiff.files.bare import place_of, pose_of
from cartstiff.files.catalogue import bundled
from cartstiff.files.mechanism_file import with_parameters
from cartstiff.files.other_units import in_units
from cartstiff.files.schema import PoseModel
from cartstiff.files.yaml_file import read_yaml, with_scalars
from cartstiff.wings.identify.identification import Identification, with_result
from cartstiff.wings.identify.unknowns import (
    ZERO,
    Unknowns,
    placement_of,
    polynomials,
)

_ROBOTS = (".urdf", ".xml", ".mjcf")


def mechanism_file(result: Identification, data: dict[str, Any], source: str) -> bytes:
    """Text of a mechanism file with the springs found, their covariance, source,
    date and count.

    Parameters
    ----------
    result : Identification
        The springs found.
    data : dict
        From `keys_to_write`; changed.
    source : str
        Origin of the numbers, for readers.

    Raises
    ------
    InputError
        If springs found have no place in the file.
    """
    elastic = with_result(result, source=f"{source}, {result.fit} fit")
    length = data.get("units", {}).get("length", SI.length)
    if elastic.units.length != length:
        elastic = in_units(elastic, length)
    _put_springs(data, elastic)
    _put_geometry(data, result)
    identified = elastic.identified
    if identified is None:
        raise TypeError("a result without findings")
    # The estimates with their covariance.
    entries = []
    for pattern, value in zip(
        identified.patterns, identified.values.tolist(), strict=True
    ):
        entry: dict[str, Any] = {"name": pattern.name, "value": value}
        ((key, _), *_) = pattern.keys
        joint, _, power = key.partition(" x^")
        if joint in polynomials(elastic):
            entry["polynomial"] = [joint, int(power or 1)]
        elif not pattern.is_share and (len(pattern.keys) > 1 or "*" in key):
            entry["elements"] = [
                [one, f"{one.rpartition('.')[0]}.{axis}" if axis else one, weight]
                for key, weight in pattern.keys
                for one, _, axis in [key.partition("*")]
            ]
        entries.append(entry)
    about = identified.to_dict() | {"compliances": entries}
    needed = ("compliances", "covariance")
    data["identified"] = {
        k: v for k, v in about.items() if k in needed or v not in (None, [], {}, "")
    }
    return _yaml(data)


def _yaml(data: dict[str, Any]) -> bytes:
    import yaml

    class Dumper(yaml.SafeDumper):  # type: ignore[misc]
        """Puts text in quotes that YAML 1.2 reads as a number."""

    # A text that is folded at a hyphen comes back with a blank.
    text: str = yaml.dump(
        data,
        Dumper=with_scalars(Dumper),
        default_flow_style=None,
        width=math.inf,
        sort_keys=False,
        allow_unicode=True,
    )
    return text.encode()


def keys_to_write(
    unknowns: Unknowns, mechanism: str, frame: str | None, to: Path
) -> dict[str, Any]:
    """Keys of the mechanism's own file, its paths relative to the new file.

    Parameters
    ----------
    unknowns : Unknowns
        The parameters that will be found.
    mechanism : str
        Name or path the mechanism was loaded from.
    frame : str, optional
        The frame of interest that was named.
    to : Path
        Path of the new file.

    Raises
    ------
    InputError
        If the mechanism does not come from a file that could be written again, or its
        kind of file has no key for what will be found.
    """
    elastic = unknowns.elastic
    if unknowns.geometry and elastic.mechanism.kind != "serial":
        raise InputError(
            f"{', '.join(unknowns.geometry)} found has no place in a file of kind "
            f"{elastic.mechanism.kind}",
            where="-o",
            expected="-o without it in --unknown",
        )
    path = bundled(mechanism) or Path(mechanism).expanduser()
    if path.suffix.lower() in (".yaml", ".yml"):
        read, lines = read_yaml(path)
        # Numbers are written anew: none may depend on a parameter any more.
        data, _ = with_parameters(
            read, lambda at: place_of(path, lines, at), elastic.parameters
        )
        data.pop("identified", None)
        if frame is not None and data["kind"] in ("serial", "closed-chain"):
            moves = frame != data.get("frame") or "offset" in data
            if moves and data.get("payload", {}).get("mass"):
                raise InputError(
                    "the payload of a file is at its own frame, and another one is to be "
                    "written",
                    where="-o",
                    expected="no --frame",
                    got=frame,
                )
            data["frame"] = frame
            data.pop("offset", None)
        for holder in (data, *_legs(data)):
            model = holder.get("model")
            if isinstance(model, str) and not Path(model).expanduser().is_absolute():
                beside = path.parent / model
                if beside.suffix.lower() in _ROBOTS or beside.is_file():
                    holder["model"] = _relative(beside, to)
        if elastic.gravity is not None:
            data["gravity"] = elastic.gravity.tolist()
        return data
    kind = elastic.mechanism.kind
    if kind not in ("serial", "closed-chain"):
        raise InputError(
            "the mechanism does not come from a file that could be written again",
            where=one_line(mechanism),
            expected="a mechanism file or a robot",
        )
    model = _relative(path, to) if path.suffix.lower() in _ROBOTS else mechanism
    data = {"kind": kind, "model": model, "frame": elastic.mechanism.frame}
    if elastic.gravity is not None:
        data["gravity"] = elastic.gravity.tolist()
    return data


def _relative(path: Path, to: Path) -> str:
    """A path relative to the folder of a file; absolute on another drive."""
    try:
        return Path(os.path.relpath(path.resolve(), to.resolve().parent)).as_posix()
    except ValueError:
        return str(path.resolve())


def _put_springs(data: dict[str, Any], elastic: ElasticMechanism) -> None:
    """Write a mechanism's numbers into the file's springs, legs,
    lines and flexible links.
    """
    springs, kind = elastic.springs, data["kind"]
    if springs is None:
        return
    if kind in ("stewart-gough", "springs"):
        data["legs"]["stiffness"] = springs.stiffness.tolist()
    elif kind == "parallel" and any("chain" in leg for leg in _legs(data)):
        _put_equal_legs(data["legs"], elastic)
    elif kind == "parallel":
        for i, leg in enumerate(data["legs"]):
            _put_joints(leg, elastic, f"leg{i + 1}/")
            _put_links(leg, elastic, f"leg{i + 1}/")
    else:
        _put_joints(data, elastic, "")
        _put_links(data, elastic, "")
    for i, line in enumerate(data.get("lines", ())):
        line["stiffness"] = 1.0 / elastic.compliances[f"line{i + 1}"].value


def _legs(data: dict[str, Any]) -> list[dict[str, Any]]:
    """Entries of legs on chains in a file's data; legs by name may be a single one."""
    legs = data["legs"] if data["kind"] == "parallel" else []
    return [legs] if isinstance(legs, dict) else legs


def _put_equal_legs(legs: Any, elastic: ElasticMechanism) -> None:
    """Write the stiffness of the driven joint of each leg into the one entry of
    legs by name.

    Raises
    ------
    InputError
        For springs that such an entry cannot hold: of other joints, unless all legs have
        the same, of links, and of several entries.
    """
    found, bent = dict[str, list[float]](), polynomials(elastic)
    for name in elastic.names:
        if name in elastic.compliances and name not in bent:
            own = 1.0 / elastic.compliances[name].value
            found.setdefault(name.partition("/")[2], []).append(own)
    entry: dict[str, Any] = {"flexible": True} if isinstance(legs, list) else legs
    driven = [joint for joint in found if joint not in entry.get("springs", {})]
    uneven = [
        joint for joint, k in found.items() if joint not in driven and len({*k}) > 1
    ]
    if entry.get("flexible") or len(driven) > 1 or uneven:
        raise InputError(
            "the springs found have no place in an entry of legs by name",
            where="-o",
            expected="one entry without flexible links, in which legs differ in "
            "stiffness alone",
        )
    for joint, k in found.items():
        if joint in driven:
            entry["stiffness"] = k
        else:
            entry["springs"][joint]["stiffness"] = k[0]


def _put_geometry(data: dict[str, Any], result: Identification) -> None:
    """Write the zeros, the tool and the base that were found.

    The payload stays on its link, and gravity and the lines' points in F stay where they
    are to the arm: so the fit takes them.
    """
    placed, elastic = result.placed, result.elastic
    lengths, _ = convert_length(elastic.units, SI)
    tool, base = placement_of(placed, "tool"), placement_of(placed, "base")
    point = (
        np.asarray(result.measured.point) - tool[:3, 3]
    )  # it keeps its numbers in the new M
    tool[:3, 3] += point - tool[:3, :3] @ point
    for word, key, T in (("tool", "offset", tool), ("base", "base", base)):
        if word not in result.unknowns.geometry:
            continue
        T[:3, 3] *= lengths
        own = pose_of(PoseModel.model_validate(data.get(key, {})))
        place = own @ T
        data[key] = {
            "xyz": place[:3, 3].tolist(),
            "rpy": se3.roll_pitch_yaw(place).tolist(),
        }
        if word == "tool" and "payload" in data:
            com = data["payload"].get("com", [0.0, 0.0, 0.0])
            data["payload"]["com"] = _moved(se3.inverse(T), com)
        if word == "base":
            moved = place @ se3.inverse(own)
            if elastic.gravity is not None:
                data["gravity"] = (moved[:3, :3] @ elastic.gravity).tolist()
            for line in data.get("lines", ()):
                for i, frame in enumerate(line["frames"]):
                    if frame == "world":
                        line["points"][i] = _moved(moved, line["points"][i])
    for j, name in enumerate(elastic.names):
        if f"{name}{ZERO}" in placed:
            size = lengths if elastic.mechanism.coordinates[j].is_length else 1.0
            zeros = data.setdefault("zeros", {})
            zeros[name] = zeros.get(name, 0.0) + size * placed[f"{name}{ZERO}"]


def _moved(T: Array, point: Any) -> list[float]:
    moved: Array = se3.placed(T, point)
    return moved.tolist()


def _put_joints(holder: dict[str, Any], elastic: ElasticMechanism, prefix: str) -> None:
    if isinstance(
        holder.get("springs"), str
    ):  # of a published set: written joint by joint
        holder["springs"] = {}
    springs = holder.setdefault("springs", {})
    bent = polynomials(elastic)
    for name, powers in bent.items():
        entry = springs.get(name.removeprefix(prefix))
        if isinstance(entry, dict):
            entry["polynomial"] = list(powers)
    for j, name in enumerate(elastic.names):
        short = name.removeprefix(prefix)
        if (
            not name.startswith(prefix)
            or j in elastic.mechanism.virtual
            or name not in elastic.compliances
            or name in bent
        ):
            continue
        k = 1.0 / elastic.compliances[name].value
        if _put_contact(holder, short, k):
            continue
        entry = springs.get(short)
        if isinstance(entry, dict) and not {"polynomial", "table"} & set(entry):
            entry["stiffness"] = k
        elif entry is None:
            springs[short] = {"stiffness": k}
    if not springs:
        del holder["springs"]


def _put_contact(holder: dict[str, Any], joint: str, stiffness: float) -> bool:
    """Write the spring of a soft contact where the leg has it; False for other joints."""
    contact = holder.get("contact_stiffness")
    if contact is None:
        return False
    if joint in ("contact.tx", "contact.ty"):
        given = contact["tangential"]
        both = given if isinstance(given, list) else [given, given]
        found = [
            stiffness if joint[-1] == a else k for a, k in zip("xy", both, strict=True)
        ]
        holder["contact_stiffness"] = {**contact, "tangential": found}
        return True
    key = {"contact.tz": "normal", "contact.z": "spin"}.get(joint)
    if key not in contact:
        return False
    holder["contact_stiffness"] = {**contact, key: stiffness}  # legs may share the entry
    return True


def _put_links(holder: dict[str, Any], elastic: ElasticMechanism, prefix: str) -> None:
    for potential in elastic.potentials:
        if not potential.members:
            continue
        link = potential.link.removeprefix(prefix)
        entry = holder.get("flexible", {}).get(link)
        if entry is None or not potential.link.startswith(prefix):
            continue
        entry |= potential.in_file(entry)
