"""Springs found into a mechanism, and into a mechanism file that carries their covariance."""

from __future__ import annotations

import datetime
import io
import os
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from cartstiff import numerics
from cartstiff.arrays import Array
from cartstiff.errors import InputError, one_line
from cartstiff.geometry import se3
from cartstiff.loading.catalogue import bundled
from cartstiff.loading.mechanism_file import place_of
from cartstiff.loading.parameters import with_parameters
from cartstiff.loading.schema import FlexibleModel
from cartstiff.loading.yaml_file import read_yaml
from cartstiff.mechanisms.contract import SI
from cartstiff.mechanisms.elements import CompliancePattern, Elements
from cartstiff.mechanisms.identified import Identified
from cartstiff.mechanisms.other_units import in_units
from cartstiff.potentials.beams import Beam
from cartstiff.potentials.springs import CoupledSprings, JointSprings, PolynomialLaw

if TYPE_CHECKING:
    from cartstiff.identify.result import Identification
    from cartstiff.mechanisms.elastic import ElasticMechanism

_ROBOTS = (".urdf", ".xml", ".mjcf")


def written_values(result: Identification) -> Array:
    """Compliances (P,) that a mechanism can have: estimates; the file's where nothing is known.

    A compliance of which only the upper end is known, and whose estimate is zero, is put into the
    middle of its interval.
    """
    values = result.unknowns.nominal.copy()
    for p, e in enumerate(result.estimates):
        if e.compliance is None or e.verdict == "negative":
            continue
        middle = 0.5 * sum(e.interval) if e.interval is not None else 0.0
        bounded = e.unknown.has_stiffness
        values[p] = e.compliance if e.compliance > 0.0 or not bounded else middle
    return values


def with_result(
    result: Identification, date: str | None = None, source: str = ""
) -> ElasticMechanism:
    """The mechanism with the springs found, and their covariance."""
    values = written_values(result)
    elastic = result.unknowns.mechanism(values)
    known = [
        p
        for p, e in enumerate(result.estimates)
        if e.compliance is not None and e.verdict != "negative"
    ]
    factor = np.ones(len(values))
    patterns = []
    for p in known:
        unknown = result.estimates[p].unknown
        pattern = unknown.pattern
        if unknown.is_scale:  # the file written holds the beam that was found
            factor[p] = values[p]
            pattern = CompliancePattern(
                pattern.name, tuple((a, b, float(w * values[p])) for a, b, w in pattern.entries)
            )
        patterns.append(pattern)
    covariance = (result.covariance / np.multiply.outer(factor, factor))[np.ix_(known, known)]
    lost = [
        n
        for p, u in enumerate(result.unknowns.parameters)
        if p not in known
        for n in u.name.split(" = ")
    ]
    least = {
        e.name: e.stiffness_interval[0]
        for e in result.estimates
        if e.verdict == "at-least" and e.stiffness_interval[0] is not None
    }
    identified = Identified(
        tuple(patterns),
        (values / factor)[known],
        covariance,
        None if np.isinf(result.degrees) else result.degrees,
        result.level,
        len(result.measured),
        date or datetime.date.today().isoformat(),
        source,
        tuple(lost),
        least,
    )
    notes = tuple(n for n in elastic.notes if n.code != "stiffness-assumed" or lost)
    return replace(elastic, identified=identified, notes=notes)


def mechanism_file(
    result: Identification, mechanism: str, frame: str | None, to: Path, source: str
) -> bytes:
    """Text of a mechanism file with the springs found, their covariance, source, date and count.

    Parameters
    ----------
    result : Identification
        What was found.
    mechanism : str
        Name or path the mechanism was loaded from.
    frame : str, optional
        The frame of interest that was named.
    to : Path
        Where the file will stand: paths in it are relative to that.
    source : str
        What the numbers come from, for readers.

    Raises
    ------
    InputError
        If the mechanism does not come from a file that could be written again.
    """
    data = _data(result, mechanism, frame, to)
    elastic = with_result(result, source=source)
    length = data.get("units", {}).get("length", SI.length)
    if elastic.units.length != length:  # --units are of what was given and shown
        elastic = in_units(elastic, length)
    _put_springs(data, elastic, to.parent)
    identified = elastic.identified
    if identified is None:
        raise TypeError("a result without findings")
    entries = []
    for pattern, value in zip(identified.patterns, identified.values.tolist(), strict=True):
        entry: dict[str, Any] = {"name": pattern.name, "value": value}
        if pattern.law is not None:
            entry["polynomial"] = list(pattern.law)
        elif pattern.entries != ((pattern.name, pattern.name, 1.0),):
            entry["elements"] = [list(e) for e in pattern.entries]
        entries.append(entry)
    about = {
        "compliances": entries,
        "covariance": identified.covariance.tolist(),
        "degrees": identified.degrees,
        "level": identified.level,
        "rows": identified.rows,
        "date": identified.date,
        "source": identified.source,
        "undetermined": list(identified.undetermined),
        "at_least": dict(identified.at_least or {}),
    }
    data["identified"] = {k: v for k, v in about.items() if v not in (None, [], {}, "")}
    data["identified"]["compliances"] = entries
    data["identified"]["covariance"] = identified.covariance.tolist()
    return _yaml(data)


def _yaml(data: dict[str, Any]) -> bytes:
    from ruamel.yaml import YAML

    yaml = YAML(typ="safe", pure=True)
    yaml.default_flow_style = None
    yaml.width = 100_000  # a text that is folded at a hyphen comes back with a blank
    yaml.sort_base_mapping_type_on_output = False  # type: ignore[assignment]
    out = io.StringIO()
    yaml.dump(data, out)
    return out.getvalue().encode()


def _data(result: Identification, mechanism: str, frame: str | None, to: Path) -> dict[str, Any]:
    """Keys of the mechanism's own file, its paths made to hold elsewhere."""
    path = bundled(mechanism) or Path(mechanism).expanduser()
    elastic = result.elastic
    if path.suffix.lower() in (".yaml", ".yml"):
        read, lines = read_yaml(path)
        # Numbers are written anew: none of them may follow from a parameter any more.
        data, _ = with_parameters(
            read, lambda at: place_of(path, lines, at), result.elastic.parameters
        )
        data.pop("identified", None)
        if frame is not None and data["kind"] in ("serial", "closed-chain"):
            data["frame"] = frame
            data.pop("offset", None)
        for holder in (data, *(data["legs"] if data["kind"] == "parallel" else ())):
            for entry in holder.get("flexible", {}).values():
                files = entry.get("superelement", {})
                for key in {"K", "M"} & files.keys():
                    files[key] = _relative(path.parent / files[key], to)
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
    """A path as seen from the folder of a file; absolute where that is on another drive."""
    try:
        return Path(os.path.relpath(path.resolve(), to.resolve().parent)).as_posix()
    except ValueError:
        return str(path.resolve())


def _put_springs(data: dict[str, Any], elastic: ElasticMechanism, folder: Path) -> None:
    """The file's springs, legs, lines and links that give with the numbers of a mechanism."""
    springs, kind = elastic.springs, data["kind"]
    if springs is None:
        return
    if kind in ("stewart-gough", "springs"):
        data["legs"]["stiffness"] = springs.stiffness.tolist()
    elif kind == "parallel":
        for i, leg in enumerate(data["legs"]):
            _put_joints(leg, elastic, f"leg{i + 1}/")
            _put_links(leg, elastic, f"leg{i + 1}/", folder)
    else:
        _put_joints(data, elastic, "")
        _put_links(data, elastic, "", folder)
    names = Elements(elastic)
    for i, line in enumerate(data.get("lines", ())):
        at = names.index(f"line{i + 1}")
        line["stiffness"] = float(names.stiffness[at, at])


def _put_joints(holder: dict[str, Any], elastic: ElasticMechanism, prefix: str) -> None:
    elements = Elements(elastic)
    springs = holder.setdefault("springs", {})
    virtual: frozenset[int] = getattr(elastic.mechanism, "virtual", frozenset())
    laws = elastic.springs.laws if isinstance(elastic.springs, JointSprings) else {}
    for j, law in laws.items():
        entry = springs.get(elastic.names[j].removeprefix(prefix))
        if isinstance(law, PolynomialLaw) and isinstance(entry, dict):
            entry["polynomial"] = list(law.coefficients)
    for j, name in enumerate(elastic.names):
        short = name.removeprefix(prefix)
        if not name.startswith(prefix) or j in virtual or name not in elements.names:
            continue
        at = elements.index(name)
        entry = springs.get(short)
        if isinstance(entry, dict) and not {"polynomial", "table"} & set(entry):
            entry["stiffness"] = float(elements.stiffness[at, at])
        elif entry is None:
            springs[short] = {"stiffness": float(elements.stiffness[at, at])}
    if not springs:
        del holder["springs"]


def _put_links(
    holder: dict[str, Any], elastic: ElasticMechanism, prefix: str, folder: Path
) -> None:
    for potential in elastic.potentials:
        if not isinstance(potential, (CoupledSprings, Beam)):
            continue
        link = potential.link.removeprefix(prefix)
        entry = holder.get("flexible", {}).get(link)
        if entry is None or not potential.link.startswith(prefix):
            continue
        if isinstance(potential, CoupledSprings):
            K: Array = potential.matrix[se3.SWAP][:, se3.SWAP]
            if "superelement" in entry:
                spring = FlexibleModel.model_validate(entry, context={"folder": folder})
                if np.allclose(K, spring.stiffness or K, rtol=numerics.REPORTED_ERROR):
                    continue  # the files still hold
                if spring.mass is not None:
                    raise InputError(
                        "the stiffness found for a superelement with a mass matrix has no place in "
                        "a mechanism file",
                        where=link,
                        expected="the link given without M",
                    )
                del entry["superelement"]
                entry["offset"] = spring.offset.model_dump()
            entry["stiffness"] = K.tolist()
        else:
            beam = entry["beam"]
            factor = potential.section.torsion / (beam["G"] * beam["J"])
            beam["E"], beam["G"] = beam["E"] * factor, beam["G"] * factor
