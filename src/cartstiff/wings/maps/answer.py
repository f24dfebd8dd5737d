"""The answer on maps."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from cartstiff.answer.data import Answer, Column, Quantity, Statement, Table, said, table
from cartstiff.core.arrays import plain
from cartstiff.core.mechanisms.elastic import ElasticMechanism
from cartstiff.core.stiffness.applied_load import LoadKind
from cartstiff.wings.maps.reading import best, state_names
from cartstiff.wings.maps.store import MapFile


def map_data(
    file: MapFile, place: str, summed: dict[str, Any], computed: int | None = None
) -> dict[str, Any]:
    """The object for JSON on the file of a map, with what was summed of it; `computed` is
    the number of parts that were computed just now, None where none was asked for.
    """
    about, total = file.attributes, math.prod(file.parts.shape)
    return {
        "schema": about["schema"],
        "file": place,
        "mechanism": about["mechanism"],
        "frame": about["frame"],
        **{
            key: [about[key][i : i + 4] for i in range(0, 16, 4)]
            for key in ("frame_offset", "base_pose")
        },
        "connection": about["connection"],
        "load": {key: about[f"load_{key}"] for key in ("kind", "at", "meaning")},
        "characteristic_length": about["characteristic_length"],
        "units": {k: about[f"{k}_unit"] for k in ("length", "force", "angle")},
        "postures": total,
        "parts": {
            "total": len(file.parts),
            "computed": computed,
            "found": len(file.parts) - (computed or 0),
        },
        **summed,
    }


def answer_of_map(
    data: Mapping[str, Any], elastic: ElasticMechanism, *, is_loaded: bool
) -> Answer:
    """States, ranges of quantities, and the best postures, from the object for JSON.

    With `is_loaded` a load was given, so that rest positions were chosen.
    """
    length = Quantity(data["characteristic_length"], elastic.units.length)
    # What was computed, and where: the whole map or a slice, its branches, the load.
    about = [
        said("map", count=data["postures"], connection=data["connection"], length=length),
    ]
    if data["parts"]["computed"] is not None:
        about.append(said("parts", file=data["file"], **data["parts"]))
    if places := data.get("slice"):
        own = (f"{name} {p['value']:g} {p['unit']}" for name, p in places.items())
        about.append(said("slice", places=list(own)))
    if branches := data.get("branches"):
        code = ("branches", "branches-of-legs")[bool(branches["legs"])]
        about.append(said(code, **branches))
    if data["connection"] == "load":
        load = LoadKind(data["load"]["kind"], tuple(data["load"]["at"]))
        about.append(said("map-load", load=load))
    # The tables: states, ranges, and the best postures of what has a better end.
    quantities = [{"name": name, **q} for name, q in data["quantities"].items()]
    ranges = "quantity = name | unit | smallest | mean | largest | undefined"
    unbalanced = [said("balancing")] * ("unbalanced" in data["states"] and not is_loaded)
    return Answer.about_mechanism(
        "map",
        elastic,
        elastic.notes,
        said("postures", count=data["postures"], states=data["states"]),
        *map(_range, quantities),
        about=about,
        tables=[
            table("states", "state | postures", data["states"].items(), *unbalanced),
            table("quantities", ranges, quantities),
            *(
                _best(name, rows, data["quantities"][name]["unit"], elastic)
                for name, rows in data.get("best", {}).items()
            ),
        ],
    )


def _range(quantity: Mapping[str, Any]) -> Statement:
    """Both ends of a quantity."""
    ends = {end: quantity[end] for end in ("smallest", "largest")}
    if quantity["unit"] not in ("", "1"):
        ends = {end: Quantity(x, quantity["unit"]) for end, x in ends.items()}
    return said("range", name=quantity["name"], **ends)


def _best(
    name: str, rows: list[dict[str, Any]], unit: str, elastic: ElasticMechanism
) -> Table:
    """The best postures of a quantity, and where they put the body."""
    units = elastic.units
    heads = [
        Column("value"),
        *(
            Column(c.name, units.coordinate(c.is_length))
            for c in elastic.mechanism.coordinates
        ),
        *(Column(axis, units.length) for axis in "xyz"),
    ]
    cells = ((row["value"], *row["q"].values(), *row["position"]) for row in rows)
    return table("best", heads, cells, name=name, unit=unit)


def ranked(dataset: Any, name: str, count: int) -> list[dict[str, Any]]:
    """Return the best postures as rows of a table, for JSON."""
    rows, names = best(dataset, name, count), state_names(dataset)
    joints = [str(j) for j in dataset["joint"].values]
    return [
        {
            "value": plain(rows[name].values[i]),
            "q": dict(zip(joints, plain(rows["q"].values[i]), strict=True)),
            "position": plain(rows["position"].values[i]),
            "state": names[int(rows["state"].values[i])],
        }
        for i in range(rows.sizes["rank"])
    ]
