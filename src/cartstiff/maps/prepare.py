"""A map before it is computed: everything checked, the file made or recognised."""

from __future__ import annotations

import json
import platform
from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from cartstiff.analysis.metrics import characteristic_length
from cartstiff.arrays import checked_input, checked_unit, checked_vector
from cartstiff.errors import InputError, UnknownNameError, checked_kind, one_line
from cartstiff.geometry.se3 import Array
from cartstiff.many.kernels import WORTH_READING, Backend, lasting_path
from cartstiff.maps.cartesian import CartesianGrid
from cartstiff.maps.commanded import CommandedJob, CommandGrid
from cartstiff.maps.job import STATES, MapJob
from cartstiff.maps.quantities import QUANTITIES, Quantity, Settings, choose_quantities
from cartstiff.maps.sampling import Sampling, dimension_name
from cartstiff.maps.store import NOT_COMPUTED, SCHEMA, MapFile
from cartstiff.matrix_names import OF_MANY
from cartstiff.mechanisms.elastic import ElasticMechanism
from cartstiff.mechanisms.identity import identity_of, require_same
from cartstiff.statics.command import checked_command
from cartstiff.stiffness.applied_load import checked_load
from cartstiff.stiffness.compute import analyse
from cartstiff.version import __version__
from cartstiff.vibration.chatter import Milling
from cartstiff.vibration.response import Damping


def default_connection(elastic: ElasticMechanism, wrench: Array | None = None) -> str:
    """The matrix that is read: "load", the tangent under the load, where one can act; else "B"."""
    if wrench is not None:
        return "load" if wrench.any() else "B"
    springs = elastic.springs
    if springs is None or elastic.potentials:
        return "load"
    return "load" if np.any(~np.isnan(springs.rest) & (springs.stiffness > 0.0)) else "B"


def default_length(elastic: ElasticMechanism, connection: str = "B", **load: Any) -> float:
    """Characteristic length of a map: the natural length at the default posture, or one unit.

    `load` as `wrench` and its kind in `cartstiff.analyse`.
    """
    here = analyse(elastic, **load).at()
    length = characteristic_length(*here.pair(connection, "held")).value
    return float(f"{length:.6g}")  # the same digits on every processor


def map_job(
    elastic: ElasticMechanism,
    sampling: Sampling,
    quantities: Sequence[str],
    *,
    connection: str | None = None,
    length: float | None = None,
    direction: ArrayLike | None = None,
    deflect: ArrayLike | None = None,
    deflect_at: ArrayLike = (0.0, 0.0, 0.0),
    world: bool = False,
    wrench: ArrayLike | None = None,
    load_kind: Literal["dead", "follower", "conservative"] = "dead",
    load_at: ArrayLike = (0.0, 0.0, 0.0),
    load_axes: Literal["body", "world"] = "body",
    damping: Damping | float = 0.0,
    milling: Milling | None = None,
    told: Mapping[str, float] | None = None,
) -> MapJob:
    """What is computed for a map, checked; without any file.

    Arguments as in `compute_map`.

    Raises
    ------
    InputError
        For what cannot be used.
    """
    load = None if wrench is None else checked_input(wrench, (6,), "wrench")
    kind = checked_load(load_kind, load_at, load_axes, load is not None, elastic.may_be_loaded)
    asked = None if deflect is None else checked_vector(deflect, 6, "wrench of the deflection")
    if connection is None:
        connection = default_connection(elastic, load)
    if connection not in OF_MANY:
        raise UnknownNameError("connection", connection, OF_MANY)
    acting: dict[str, Any] = {
        "wrench": load,
        "load_kind": kind.kind,
        "load_at": kind.at,
        "load_axes": load_axes,
    }
    settings = Settings(
        connection,
        default_length(elastic, connection, **acting) if length is None else _positive(length),
        None if direction is None else _direction(direction),
        None if asked is None else tuple(asked.tolist()),
        world,
        kind,
        tuple(checked_vector(deflect_at, 3, "point of the deflection").tolist()),
        load is not None,
        damping if isinstance(damping, Damping) else Damping(damping),
        milling,
    )
    names = [quantities] if isinstance(quantities, str) else list(quantities)
    chosen = choose_quantities(names, settings, elastic)
    _check_used(settings, chosen)
    row = None if load is None else tuple(load.tolist())
    own = elastic, sampling, tuple(q.name for q in chosen), settings, row, load_axes
    if not told and not isinstance(sampling, CommandGrid):
        return MapJob(*own)
    if isinstance(sampling, CartesianGrid) and sampling.redundancy == "best":
        raise InputError(
            "is chosen before drives are told",
            where="redundancy",
            expected="the nearest posture",
            got="best",
        )
    steps = checked_command(elastic, told) if told else {}
    if isinstance(sampling, CommandGrid) and (both := set(steps) & set(sampling.names)):
        raise InputError("is told twice", where="command", got=", ".join(sorted(both)))
    return CommandedJob(*own, told=steps)


def _check_used(settings: Settings, chosen: Sequence[Quantity]) -> None:
    """Refuse what is given for quantities that are not among those of the map."""
    asked = {quantity.asks for quantity in chosen}
    for what, is_given, of in (
        ("direction", settings.direction is not None, ("direction",)),
        ("wrench of the deflection", settings.deflect is not None, ("deflect",)),
        ("milling", settings.milling is not None, ("milling",)),
        ("damping", settings.damping != Damping(), ("damping", "milling")),
    ):
        if is_given and asked.isdisjoint(of):
            names = [q.name for q in QUANTITIES.values() if q.asks in of]
            raise InputError(
                "is given, and no quantity needs it",
                where=what,
                expected="one of " + ", ".join(names[:4]) + ", ..." * (len(names) > 4),
                got=", ".join(q.name for q in chosen),
            )


def prepare_map(
    elastic: ElasticMechanism,
    sampling: Sampling,
    quantities: Sequence[str],
    file: str | Path,
    *,
    single: bool = False,
    chunk: int | None = None,
    command: str = "",
    **asked: Any,
) -> tuple[MapJob, MapFile]:
    """Check everything and make the file, or open the one that holds the same map.

    Arguments as in `compute_map`; `asked` goes to `map_job`.
    """
    if not isinstance(sampling, Sampling):
        raise InputError(
            "not a choice of postures",
            where="sampling",
            got=type(sampling).__name__,
            expected="a Grid, RandomPostures, Trajectory or CartesianGrid",
        )
    path = Path(checked_kind(file, (str, Path), "name of a map", "a path"))
    if path.suffix != ".zarr":
        raise InputError("unknown file ending", where=one_line(str(file)), expected=".zarr")
    if not path.absolute().parent.is_dir():
        raise InputError("map cannot be written", where=one_line(str(file)), got="no such folder")
    if path.exists() and not path.is_dir():
        raise InputError("is a file", where=one_line(str(file)), expected="a map, or nothing")
    if chunk is not None and chunk < 1:
        raise InputError("size of chunks cannot be used", expected="1 or more", got=chunk)
    job = map_job(elastic, sampling, quantities, **asked)
    settings, kind, chosen = job.settings, job.settings.load, job.quantities
    cartesian = sampling if isinstance(sampling, CartesianGrid) else None
    if cartesian and cartesian.redundancy == "best" and chosen[0].better is None:
        raise InputError(
            f"neither end of {chosen[0].name} is better",
            where="redundancy",
            expected="another first quantity, or the nearest posture",
        )
    options = {
        "joints": list(elastic.names),
        "sampling": sampling.as_dict(),
        "quantities": list(job.names),
        "connection": settings.connection,
        "length": settings.length,
        "direction": settings.direction,
        "deflect": settings.deflect,
        "deflect_at": settings.deflect_at,
        "world": settings.world,
        "load": job.wrench,
        "load_kind": kind.kind,
        "load_at": kind.at,
        "load_axes": job.load_axes,
        **_vibration(settings),
        "told": job.told if isinstance(job, CommandedJob) and job.told else None,
        "single": single,
        "states": list(STATES),
    }
    if elastic.identified is not None:
        options["identified"] = elastic.identified.as_dict()
    description = identity_of(elastic, options)
    if path.exists():
        existing = MapFile.at(path)
        there = json.loads(existing.attributes["description"])
        require_same(there, description, path, "map")
        return replace(job, path=there["path"], by_kernel=there.get("by_kernel", False)), existing
    postures = int(np.prod(sampling.shape, dtype=object))
    load: Literal["none", "shared", "each"]
    load = "none" if job.wrench is None else "shared" if job.load_axes == "body" else "each"
    path_taken: Backend = "engine"
    if not isinstance(job, CommandedJob):
        path_taken = lasting_path(elastic, load, job.outputs, postures)
    reads = path_taken == "compiled" and postures >= WORTH_READING
    job = replace(job, path=path_taken, by_kernel=reads)
    description |= {"path": job.path, "by_kernel": reads}
    units, mechanism = elastic.units, elastic.mechanism
    attributes = {
        "schema": SCHEMA,
        "title": f"stiffness map of {elastic.name}",
        "mechanism": elastic.name,
        "kind": mechanism.kind,
        **mechanism.frames_as_dict(),
        "connection": settings.connection,
        "load_kind": kind.kind,
        "load_at": list(kind.at),
        "load_meaning": kind.words,
        "characteristic_length": settings.length,
        "length_unit": units.length,
        "force_unit": units.force,
        "angle_unit": "rad",
        "order": "angular-linear",
        "numerical_path": job.path,
        "command": command,
        **_about_command(job),
        **_versions(),
        "description": json.dumps(description),
    }
    variables: dict[str, dict[str, Any]] = {
        q.name: {"units": q.unit_in(units), "long_name": q.description}
        | ({} if q.better is None else {"better": q.better})
        for q in chosen
    }
    variables["state"] = {
        "long_name": "state of the mechanism",
        "flag_values": [*range(len(STATES)), NOT_COMPUTED],
        "flag_meanings": " ".join([*STATES, "not-computed"]),
    }
    variables["position"] = {
        "units": units.length,
        "long_name": "position of the body frame's origin in F",
    }
    if job.stores_q:
        variables["q"] = {"long_name": "coordinates of the posture"}
    if cartesian:
        variables["branches"] = {"long_name": "number of branches found at the place"}
    axis_units = {
        dimension_name(c.name): units.coordinate(c.is_length) for c in mechanism.coordinates
    } | dict.fromkeys(cartesian.axes if cartesian else (), units.length)
    if isinstance(sampling, CommandGrid):
        axis_units = {
            name: axis_units.get(name.removeprefix("command_"), units.length)
            for name in sampling.dims
        }
    return job, MapFile.create(
        path,
        sampling,
        variables,
        attributes,
        units=axis_units,
        coordinates=len(elastic.names),
        single=single,
        postures_per_chunk=chunk or job.usual_chunk,
    )


def _about_command(job: MapJob) -> dict[str, str]:
    """What is said of drives that are told the same everywhere."""
    if not isinstance(job, CommandedJob) or not job.told:
        return {}
    return {"told": ", ".join(f"{name} by {x:+g}" for name, x in job.told.items())}


def _vibration(settings: Settings) -> dict[str, Any]:
    """What the vibrations depend on, as plain data; None where nothing was said."""
    own, milling = settings.damping, settings.milling
    damping = None
    if own != Damping():
        ratios = np.ravel(np.asarray(own.ratios, float)).tolist()
        damping = [*ratios, own.mass, own.stiffness, float(own.dampers)]
    return {"damping": damping, "milling": None if milling is None else asdict(milling)}


def _positive(length: float) -> float:
    return characteristic_length(given=length).value


def _direction(direction: ArrayLike) -> tuple[float, ...]:
    checked_unit(direction)
    return tuple(checked_vector(direction, 3, "direction").tolist())


def _versions() -> dict[str, str]:
    versions = {"cartstiff_version": __version__, "python_version": platform.python_version()}
    for package in ("numpy", "pin", "zarr"):
        try:
            versions[f"{package}_version"] = version(package)
        except PackageNotFoundError:
            continue
    return versions
