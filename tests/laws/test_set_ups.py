"""One set-up, whoever states it, has one answer: displacement, stiffness and forces.

Arms are generated with base, tool, weight, payload, load at a point and, with a preload, rest
positions. Each part is typed, in the file, an argument of `load`, in the page's messages, or in a
study. What they should answer is computed here from matrices: forces by virtual work, their
derivatives by differences, the rest by a root.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from tests.support.commands import answer
from tests.support.generated import EARTH, Arm, close, frame, numbers
from tests.support.oracles import exp_reference
from tests.support.pages import page_answer, source_of

import cartstiff


def later(*seeds: int) -> list[Any]:
    """Seeds of `make thorough` and of this file when it is named."""
    return [pytest.param(seed, marks=pytest.mark.thorough) for seed in seeds]


#: Six joints of which one slides; seven that turn.
SEEDS = [3, *later(0, *range(4, 24))]
DOORS = ("typed", "in the file", "in Python", "on the page")


@dataclass(frozen=True)
class SetUp:
    """A generated arm, the file without what is typed, and which axes its load is in."""

    arm: Arm
    folder: Path
    axes: str
    rest: np.ndarray | None

    def file(self, *left_out: str) -> Path:
        """The mechanism file without some of its keys."""
        path = self.arm.written(self.folder)
        data = yaml.safe_load(path.read_text())
        data["parameters"] = {"k0": float(self.arm.k[0])}
        data["springs"]["j0"]["stiffness"] = "=k0"
        for i, x in enumerate([] if self.rest is None else self.rest):
            data["springs"][f"j{i}"]["rest"] = float(x)
        for key in left_out:
            del data[key]
        path = self.folder / f"without-{'-'.join(left_out)}.yaml"
        path.write_text(yaml.safe_dump(data))
        return path

    @property
    def payload(self) -> list[float]:
        mass, centre = self.arm.payload
        return [mass, *centre.tolist()]

    @property
    def tool(self) -> list[float]:
        return [*self.arm.tool[0].tolist(), *self.arm.tool[1].tolist()]

    def wrench(self, q: np.ndarray) -> np.ndarray:
        """The load's components at q along its axes."""
        R = self.arm.pose(q)[:3, :3] if self.axes == "body" else np.eye(3)
        return np.concatenate([R.T @ self.arm.W[:3], R.T @ self.arm.W[3:]])

    def words(self, q: np.ndarray) -> list[str]:
        """The load as options."""
        given = ["--load", numbers(self.wrench(q)), "--load-at", numbers(self.arm.at)]
        return [*given, *["--world"] * (self.axes == "world")]

    def load(self, q: np.ndarray) -> dict[str, Any]:
        """The load as arguments."""
        return {"wrench": self.wrench(q), "load_axes": self.axes, "load_at": self.arm.at}

    # -- what is right -------------------------------------------------------------------------

    def weight(self, q: np.ndarray) -> np.ndarray:
        return replace(self.arm, W=np.zeros(6)).outer(q)

    def before(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Rest positions, and the rest before the load."""
        one = self.arm
        if self.rest is None:  # the springs balance the weight at q
            return q - self.weight(q) / one.k, q

        return self.rest, self.settled(self.rest, self.weight)

    def under_load(self, q: np.ndarray) -> np.ndarray:
        """The rest under the load."""
        return self.settled(self.before(q)[0], self.arm.outer)

    def settled(self, rest: np.ndarray, forces: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
        """Where springs with these rest positions balance forces: a contraction, as k is large."""
        q, before = rest, np.full_like(rest, np.inf)
        for _ in range(60):
            if np.abs(q - before).max() < 1e-15:
                break
            q, before = rest + forces(q) / self.arm.k, q
        return q

    def force(self, q: np.ndarray) -> np.ndarray:
        """The load about M's origin along M's axes."""
        R, W = self.arm.pose(q)[:3, :3], self.arm.W
        moment = W[:3] + np.cross(R @ self.arm.at, W[3:])
        return np.concatenate([R.T @ moment, R.T @ W[3:]])


@pytest.fixture(params=["world", "body"])
def axes(request):
    return request.param


@pytest.fixture(params=["at the file's pose", "elsewhere"])
def place(request):
    return request.param


def posture(arm: Arm, place: str) -> np.ndarray:
    away = np.where(arm.slides, 0.02, 0.3) * np.cos(np.arange(arm.n))
    return arm.q if place == "at the file's pose" else arm.q + away


def answered(door: str, one: SetUp, q: np.ndarray) -> dict[str, Any]:
    """What `analyse` says by a door."""
    typed = ["payload", "offset", "gravity", "q"]
    if door == "typed":
        options = ["--payload", numbers(one.payload), "--tcp", numbers(one.tool)]
        options += ["--gravity", numbers(EARTH), "--q", numbers(q)]
        return answer("analyse", one.file(*typed), options, one.words(q))
    if door == "in the file":
        return answer("analyse", one.file(), ["--q", numbers(q)], one.words(q))
    if door == "in Python":
        elastic = cartstiff.load(one.file(*typed), payload=one.payload, tcp=one.tool, gravity=EARTH)
        return cartstiff.analyse(elastic, q, **one.load(q)).to_dict()
    state = {
        "q": q.tolist(),
        "payload": one.payload,
        "gravity": EARTH.tolist(),
        "load": one.wrench(q).tolist(),
        "load_axes": one.axes,
        "load_at": one.arm.at.tolist(),
    }
    elastic = cartstiff.load(one.file("payload", "gravity"))
    return page_answer(source_of(elastic), "result", state)["result"]


@pytest.mark.parametrize("door", DOORS)
@pytest.mark.parametrize("seed", SEEDS)
def test_stiffness_and_forces(seed, door, axes, place, tmp_path):
    """The load is balanced at the posture; the weight and the payload act before it."""
    one = SetUp(Arm.generated(seed), tmp_path, axes, None)
    q = posture(one.arm, place)
    found = answered(door, one, q)
    close(found["pose"], one.arm.pose(q), 1e-11)
    close(found["wrench"], one.force(q), 1e-11)
    C = one.arm.compliance(q)
    close(found["load"]["compliance"], C)
    assert found["before_load"] == "balanced"
    assert sum(part["mass"] for part in found["weighed"]) == pytest.approx(
        one.arm.masses.sum() + one.arm.payload[0]
    )


@pytest.mark.parametrize("preloaded", [False, True])
@pytest.mark.parametrize("door", ["typed", "in the file", "in Python"])
@pytest.mark.parametrize("seed", SEEDS)
def test_displacements(seed, door, axes, place, preloaded, tmp_path):
    """Two displacements: to the rest before the load, and by the load from there."""
    arm = Arm.generated(seed)
    q = posture(arm, place)
    rest = q + np.where(arm.slides, 1e-3, 0.01) * np.sin(1.0 + np.arange(arm.n))
    one = SetUp(arm, tmp_path, axes, rest if preloaded else None)
    typed = ["payload", "offset", "gravity", "q"]
    if door == "typed":
        options = ["--payload", numbers(one.payload), "--tcp", numbers(one.tool)]
        options += ["--gravity", numbers(EARTH), "--q", numbers(q)]
        if preloaded:
            options += ["--rest", numbers(rest)]
            one = replace(one, rest=None)
        found = answer("equilibrium", one.file(*typed), options, one.words(q))
        one = replace(one, rest=rest if preloaded else None)
    elif door == "in the file":
        found = answer("equilibrium", one.file(), ["--q", numbers(q)], one.words(q))
    else:
        file = replace(one, rest=None).file(*typed)
        elastic = cartstiff.load(
            file, payload=one.payload, tcp=one.tool, gravity=EARTH, rest=one.rest
        )
        found = cartstiff.equilibrium(elastic, q, **one.load(q)).to_dict()
    start, before = one.arm.pose(q), one.arm.pose(one.before(q)[1])
    after = one.arm.pose(one.under_load(q))
    close(found["pose"], after, 1e-8)
    size = np.abs((after - start)[:3, 3]).max()
    assert found["relaxation"][3:] == pytest.approx((before - start)[:3, 3], abs=1e-6 * size)
    by_load = (after - before)[:3, 3]
    assert found["displacement_by_load"][3:] == pytest.approx(by_load, abs=1e-6 * size)
    assert found["displacement"][3:] == pytest.approx((after - start)[:3, 3], abs=1e-6 * size)
    assert found["before_load"] == ("given" if preloaded else "balanced")


@pytest.mark.parametrize("door", ["in the study", "in the file"])
@pytest.mark.parametrize("seed", SEEDS)
def test_a_study(seed, door, axes, tmp_path):
    one = SetUp(Arm.generated(seed), tmp_path, axes, None)
    q = one.arm.q
    keys: dict[str, Any] = {}
    left_out: tuple[str, ...] = ()
    if door == "in the study":
        left_out = ("payload", "offset", "gravity")
        keys = {"payload": one.payload, "tcp": one.tool, "gravity": EARTH.tolist()}
    case = {name: np.asarray(value).tolist() for name, value in one.load(q).items()}
    found = cartstiff.design(
        {
            "mechanism": str(one.file(*left_out)),
            "variables": {"k0": {"values": [float(one.arm.k[0]), 2.0 * float(one.arm.k[0])]}},
            "cases": {"only": case},
            "objectives": {"moved": {"quantity": "deflection"}},
            **keys,
        }
    )
    motion = one.arm.compliance(q) @ one.force(q)
    assert found.designs[0].values["moved"] == pytest.approx(np.linalg.norm(motion[3:]), rel=1e-6)


@pytest.mark.parametrize("door", ["typed", "in the file", "in Python"])
@pytest.mark.parametrize("seed", SEEDS)
def test_commands_along_a_path(seed, door, axes, tmp_path):
    """A command undoes the load's deflection from a program taught under weight and payload."""
    one = SetUp(Arm.generated(seed), tmp_path, axes, None)
    postures = [posture(one.arm, place) for place in ("at the file's pose", "elsewhere")]
    rows = [[*q, *one.wrench(q)[3:]] for q in postures]
    heads = [f"f{c}_world" if axes == "world" else f"f{c}" for c in "xyz"]
    table = tmp_path / "path.csv"
    names = ",".join([*(f"j{i}" for i in range(one.arm.n)), *heads])
    table.write_text("\n".join([names, *map(numbers, rows)]))
    one = replace(one, arm=one.arm.at_origin)
    typed = ["payload", "offset", "gravity"]
    if door == "in Python":
        elastic = cartstiff.load(one.file(*typed), payload=one.payload, tcp=one.tool, gravity=EARTH)
        wrenches = [one.wrench(q) for q in postures]
        found = cartstiff.compensate(elastic, postures, wrenches, load_axes=axes).to_dict()
    else:
        options = ["--payload", numbers(one.payload), "--tcp", numbers(one.tool)]
        options += ["--gravity", numbers(EARTH)]
        file = one.file(*typed) if door == "typed" else one.file()
        more = options if door == "typed" else []
        found = answer("equilibrium", file, more, f"--path {table}")
    assert found["load_axes"] == axes
    for i, q in enumerate(postures):
        taught = q - one.weight(q) / one.arm.k
        close(found["taught"][i], taught, 1e-9)
        close(found["commands"][i], q - one.arm.outer(q) / one.arm.k, 1e-9)
        moved = one.arm.pose(one.under_load(q))[:3, 3] - one.arm.pose(q)[:3, 3]
        close(found["error_before"][i][3:], moved, 1e-6)


@pytest.mark.parametrize("door", ["analyse", "on the page", "many postures"])
@pytest.mark.parametrize("away", [False, True])
@pytest.mark.parametrize("seed", SEEDS)
def test_a_platform_s_preload(seed, away, door, tmp_path):
    """At every pose the driven legs have the tension of the file: wrench and K^A by differences."""
    rng = np.random.default_rng(seed)
    base, top = rng.uniform(-0.6, 0.6, (6, 3)), rng.uniform(-0.3, 0.3, (6, 3))
    base[:, 2] *= 0.2
    top[:, 2] *= 0.2
    k, preload = rng.uniform(1e5, 1e6, 6), rng.uniform(50.0, 400.0, 6)
    pose = np.array([*rng.uniform(-0.1, 0.1, 2), 0.8, *rng.uniform(-0.2, 0.2, 3)])
    file = tmp_path / "platform.yaml"
    data = {
        "kind": "stewart-gough",
        "base": base.tolist(),
        "platform": top.tolist(),
        "pose": {"xyz": pose[:3].tolist(), "rpy": pose[3:].tolist()},
        "legs": {"stiffness": k.tolist(), "preload": preload.tolist()},
    }
    file.write_text(yaml.safe_dump(data))
    q = pose + away * np.array([0.05, -0.04, 0.03, 0.05, 0.1, -0.08])
    T = frame(q[:3], q[3:])

    def legs(T: np.ndarray) -> np.ndarray:
        return top @ T[:3, :3].T + T[:3, 3] - base

    rest = np.linalg.norm(legs(T), axis=1) - preload / k

    def wrench(T: np.ndarray) -> np.ndarray:
        """About M's origin along its axes: what holds the body."""
        along = legs(T)
        lengths = np.linalg.norm(along, axis=1)
        forces = (k * (lengths - rest) / lengths)[:, None] * (along @ T[:3, :3])
        return np.concatenate([np.cross(top, forces).sum(axis=0), forces.sum(axis=0)])

    h = 1e-5
    slopes = [
        (wrench(T @ exp_reference(h * e)) - wrench(T @ exp_reference(-h * e))) / (2 * h)
        for e in np.eye(6)
    ]
    elastic = cartstiff.load(file)
    if door == "many postures":
        found = cartstiff.analyse_many(elastic, q[None], outputs=("wrench", "stiffness_A"))
        W, K = np.asarray(found["wrench"])[0], np.asarray(found["stiffness_A"])[0]
    elif door == "analyse":
        answered = answer("analyse", file, ["--pose", numbers(q)])
        W, K = answered["wrench"], answered["stiffness"]["A"]
    else:
        data = page_answer(source_of(elastic), "result", {"q": q.tolist()})["result"]
        W, K = data["wrench"], data["stiffness"]["A"]
    close(W, wrench(T), 1e-9)
    close(K, np.array(slopes).T, 1e-6)
