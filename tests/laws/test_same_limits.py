"""The same limits, by the same names, with the same values, wherever a posture is looked at."""

from __future__ import annotations

import json
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.doors import Margins, checked_load
from tests.inputs.test_every_key import SPRINGS
from tests.mechanisms.machines import write_file
from tests.support.pages import message_of, source_of, tab_of
from tests.view.conftest import NoPicture

import cartstiff
from cartstiff import ConvergenceError
from cartstiff.geometry import se3
from cartstiff.maps import RandomPostures, Trajectory, compute_map, open_map

AXES = ("x", "y", "z", "roll", "pitch", "yaw")
LIMITED = {"beyond-limits", "force-limits"}
LOAD = [0.0, 3.0, 0.0, 40.0, 0.0, -600.0]
COUNT, SEED = 24, 5
LAYOUT = {
    "kind": "stewart-gough",
    "layout": {
        "base": {"radius": 0.4, "half_angle": 0.5},
        "platform": {"radius": 0.25, "half_angle": 0.5},
        "height": 0.6,
        "turn": 0.6,
    },
}
CONES = {
    "base_joints": {"axis": [0, 0, 1], "angle": 0.55},
    "platform_joints": {"axis": [0, 0, -1], "angle": 0.68},
}
SIX = LAYOUT | {
    "legs": CONES
    | {
        "stiffness": "=k",
        "limits": [0.52, 0.76],
        "diameter": 0.213,
        "force": [-1e4, 1e4],
    }
}
# What a leg of these carries is said by rest lengths alone.
GIVEN = LAYOUT | {
    "legs": CONES
    | {
        "stiffness": "=k/100",
        "rest_length": 0.65,
        "limits": [0.5, 0.78],
        "force": [-9000, 8000],
    }
}
EIGHT = SPRINGS | {
    "unilateral": True,
    "pose": {"xyz": [0, 0, 0.6]},
    "legs": {"stiffness": "=k/100", "preload": 60.0, "force": [20.0, 67.0]},
}
RODS = {
    "kind": "parallel",
    "pose": {"xyz": [0, 0, 0.55]},
    "legs": {
        "chain": "PUS",
        "rail": "vertical",
        "rod": 0.5,
        "stiffness": "=k",
        "limits": [-0.07, 0.14],
        "base": {"radius": 0.35, "half_angle": 0.2},
        "turns": {"u1": [-0.16, 0.16]},
        "diameter": 0.055,
        "platform": {"radius": 0.15, "half_angle": 0.2},
    },
}
# How far poses are from the first one, and the load that is carried.
MACHINES: dict[str, tuple[dict[str, Any], list[float], list[float] | None]] = {
    "six": (SIX, [0.1, 0.1, 0.1, 0.2, 0.2, 0.4], LOAD),
    "given": (GIVEN, [0.1, 0.1, 0.1, 0.2, 0.2, 0.4], None),
    "eight": (EIGHT, [0.01, 0.01, 0.01, 0.02, 0.02, 0.02], [0.0, 1.0, 0.0, 10.0, 0.0, -60.0]),
    "rods": (RODS, [0.06, 0.06, 0.06, 0.12, 0.12, 0.12], None),
}


@dataclass
class Machine:
    path: Path
    elastic: cartstiff.ElasticMechanism
    load: list[float] | None
    ranges: dict[str, list[float]]
    poses: np.ndarray
    q: np.ndarray
    said: list[dict[str, Any]]
    """By name what `analyse` says to be beyond its limits, pose by pose."""


def _told(notes: Any) -> dict[str, Any]:
    """Every limit that notes say is passed, with its numbers."""
    every = [note for note in notes if note.code in LIMITED]
    return {name: dict(numbers) for note in every for name, numbers in note.values.items()}


@pytest.fixture(scope="module", params=list(MACHINES))
def machine(request, tmp_path_factory):
    return machine_of(request.param, tmp_path_factory.mktemp(request.param))


def machine_of(name: str, folder: Path) -> Machine:
    """A machine of this file, at poses of which some are beyond its limits."""
    given, spread, load = MACHINES[name]
    if given is EIGHT:
        robot = cartstiff.load("cable-robot").mechanism
        given = given | {"base": robot.anchors.tolist(), "platform": robot.points.tolist()}
    path = write_file(folder, **given, parameters={"k": 1e7})
    elastic = cartstiff.load(path)
    home = elastic.mechanism.at(elastic.q).pose
    start = np.concatenate([home[:3, 3], se3.roll_pitch_yaw(home)])
    around = np.array(spread)
    drawn = RandomPostures(COUNT, SEED, start - around, start + around)
    poses = drawn.postures((slice(0, COUNT),))
    ranges = {
        name: [low, high]
        for name, low, high in zip(AXES, start - around, start + around, strict=True)
    }
    q = poses
    if given is RODS:
        q = np.array([cartstiff.at_pose(elastic, pose)[0] for pose in poses])
    said = [_told(cartstiff.analyse(elastic, one, wrench=load).notes) for one in q]
    assert 4 <= sum(map(bool, said)) <= COUNT - 4, [len(one) for one in said]
    return Machine(path, elastic, load, ranges, poses, q, said)


def test_the_page(machine):
    load = machine.load
    session = tab_of(source_of(machine.elastic), NoPicture)
    for q, expected in zip(machine.q, machine.said, strict=True):
        state = session.start.model_dump() | {"q": q.tolist(), "load": load, "load_axes": "body"}
        answer = session.answer(
            message_of(json.dumps({"id": 1, "do": "result", "state": state}))
        ).data["result"]
        found = [note for note in answer["notes"] if note["code"] in LIMITED]
        assert {n: x for note in found for n, x in note["values"].items()} == expected


def test_a_map(machine, tmp_path):
    compute_map(
        machine.elastic,
        Trajectory(machine.q),
        ["translation_held_min"],
        tmp_path / "m.zarr",
        wrench=machine.load,
    )
    state = open_map(tmp_path / "m.zarr").load()["state"]
    known = state.attrs["flag_meanings"].split()
    beyond = [known[int(x)] == "beyond-limits" for x in state.values.ravel()]
    assert beyond == [bool(one) for one in machine.said]


def test_a_study(machine):
    found = cartstiff.design(
        {
            "mechanism": str(machine.path),
            "variables": {"k": {"values": [1e7]}},
            "poses": {
                "outside": "leave-out",
                "random": {"ranges": machine.ranges, "count": COUNT, "seed": SEED},
            },
            "cases": {"its": {} if machine.load is None else {"wrench": machine.load}},
            "objectives": {
                "kept": {"quantity": "translation_held_min", "of": "reached", "case": "its"}
            },
        }
    )
    kept = np.mean([not one for one in machine.said])
    assert found.table("kept").tolist() == [pytest.approx(kept)]


def same_limits(names: Any, found: Any, said: Any) -> None:
    """Margins of poses are negative where `analyse` says so; cables may carry a load anyhow."""
    for row, expected in zip(found, said, strict=True):
        beyond = {
            name.rpartition(", ")[0] or name: x
            for name, x in zip(names, row, strict=True)
            if x < 0.0
        }
        if "tensions" in names:
            assert bool(expected) is bool(beyond)  # a set within the limits is found wherever it is
            continue
        assert set(beyond) == set(expected)
        for name, x in beyond.items():
            is_at = expected[name]
            past = [is_at["value"] - is_at["upper"]] if is_at["upper"] is not None else []
            past += [is_at["lower"] - is_at["value"]] if is_at["lower"] is not None else []
            assert -x == pytest.approx(max(past), rel=1e-9, abs=1e-9)


def test_a_workspace(machine):
    """Which margins are negative; cables count where any tensions carry the load."""
    if machine.elastic.mechanism.kind == "parallel":
        pytest.skip("margins of legs made of joints: tests/rooms/reach")
    found, kind = [], checked_load("dead", (0, 0, 0), "body", machine.load is not None)
    for q in machine.q:  # `workspace` has the axes of M at its start for those of the load
        pose, load = machine.elastic.mechanism.at(q).pose, None
        if machine.load is not None:
            load = kind, np.kron(np.eye(2), pose[:3, :3]) @ machine.load, "world"
        margins = Margins(machine.elastic, load)
        found.append(margins.at(pose[None])[0])
    same_limits(margins.names, found, machine.said)


def test_assembly_modes(machine):
    if machine.elastic.mechanism.kind != "stewart-gough":
        pytest.skip("modes of closed chains are found from random starts")
    for i in (0, 1, 2, 3):
        nearest = cartstiff.assemble(
            machine.elastic, q=machine.q[i], wrench=machine.load, every=False
        ).modes[0]
        assert np.allclose(nearest.q, machine.q[i], atol=1e-9)
        expected = machine.said[i]
        found = _told(nearest.notes)
        assert set(found) == set(expected)
        for name, numbers in found.items():
            assert numbers["value"] == pytest.approx(expected[name]["value"], rel=1e-8)


def test_equilibria(machine):
    """Where it rests: lengths are held within their limits, all else is named as by `analyse`."""
    seen = 0
    for q in machine.q[:8]:
        try:
            rest = cartstiff.equilibrium(machine.elastic, q=q, wrench=machine.load, limits=False)
        except ConvergenceError:
            continue
        seen += bool(rest.notes)
        found = [n for n in rest.notes if not n.message.startswith("at the start: ")]
        # Under its own wrench the tensions of the rest lengths stay as they are.
        again = cartstiff.analyse(rest.elastic, rest.q, wrench=rest.elastic_stiffness.wrench)
        there = _told(again.notes)
        assert set(_told(found)) == set(there)
        for name, numbers in _told(found).items():
            assert numbers["value"] == pytest.approx(there[name]["value"], rel=1e-7)
    assert seen >= 3


def test_every_kind_of_limit_is_among_these(machine):
    kinds = {re.sub(r"\d", "", name) for one in machine.said for name in one}
    assert kinds == {
        "stewart-gough": {
            "leg",
            "angle of leg at the base",
            "angle of leg at the platform",
            "distance of leg and leg",
            "force of leg",
        },
        "springs": {"force of leg"},
        "parallel": {"leg/slide", "leg/u"},
    }[machine.elastic.mechanism.kind] - (set() if machine.load else {"distance of leg and leg"})
