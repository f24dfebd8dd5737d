"""Drawn platforms with driven and passive legs, and arms: every door gives one K and wrench.

The expected forces are found by an own computation from the geometry; K^A is their derivative.
"""

from __future__ import annotations

import json
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import yaml
from tests.doors import LoadKind, Margins
from tests.mechanisms.machines import write_file
from tests.support.generated import Arm
from tests.support.pages import message_of, source_of, tab_of

import cartstiff
from cartstiff import ToolPath, analyse, analyse_many, equilibrium, load, modes
from cartstiff.geometry import se3
from cartstiff.maps import Trajectory, compute_map, open_map

HOME = np.array([0.02, -0.01, 0.8, 0.05, -0.1, 0.08])
AWAY = HOME + np.array([0.05, -0.04, 0.03, 0.05, 0.1, -0.08])
MASS, CENTRE, FIELD = 30.0, np.array([0.02, 0.01, 0.05]), np.array([0.0, 0.0, -9.81])
W = np.array([3.0, -2.0, 1.0, 60.0, -40.0, -80.0])


class Drawn:
    """A platform with six driven legs, or also a passive spring, and what its legs should bear."""

    def __init__(self, seed: int, kind: str) -> None:
        rng = np.random.default_rng(seed)
        self.kind, self.m = kind, 7 if kind == "mixed" else 6
        angles = np.repeat([0.0, 2.1, 4.2], 2) + np.tile([0.2, 0.9], 3)
        turned = np.roll(angles, 1) - 0.1
        base = np.column_stack([0.5 * np.cos(angles), 0.5 * np.sin(angles), np.zeros(6)])
        top = np.column_stack([0.25 * np.cos(turned), 0.25 * np.sin(turned), np.zeros(6)])
        self.base = np.vstack([base, [[0.1, 0.05, 0.0]]])[: self.m]
        self.top = np.vstack([top, [[0.02, 0.0, 0.0]]])[: self.m]
        self.base += 0.04 * rng.normal(size=self.base.shape)
        self.top += 0.03 * rng.normal(size=self.top.shape)
        self.k = rng.uniform(1e5, 1e6, self.m)
        self.preload = rng.uniform(50.0, 400.0, self.m)
        self.driven = np.arange(self.m) < 6
        if kind == "passive":
            self.driven[:] = False

    def written(self, tmp_path: Any, q: np.ndarray, weighs: bool, force: Any = None) -> Any:
        keys: dict[str, Any] = {
            "kind": "springs",
            "base": self.base.tolist(),
            "platform": self.top.tolist(),
            "pose": {"xyz": q[:3].tolist(), "rpy": q[3:].tolist()},
            "body": {"mass": 5.0, "inertia": np.diag([0.4, 0.5, 0.6]).tolist()},
            "parameters": {"k": 1.0},
            "legs": {
                "stiffness": [f"={x}*k" for x in self.k.tolist()],
                "preload": self.preload.tolist(),
                "driven": self.driven.tolist(),
            },
        }
        if force is not None:
            keys["legs"]["force"] = force
        if weighs:
            keys |= {"gravity": FIELD.tolist()}
            keys |= {"payload": {"mass": MASS, "com": CENTRE.tolist()}}
        tmp_path.mkdir(exist_ok=True)
        return write_file(tmp_path, name=f"at{q[0]:.3f}", **keys)

    def lines(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        T = se3.from_roll_pitch_yaw(q[:3], q[3:])
        along = self.top @ T[:3, :3].T + T[:3, 3] - self.base
        lengths = np.linalg.norm(along, axis=1)
        u = (along / lengths[:, None]) @ T[:3, :3]
        return lengths, np.hstack([np.cross(self.top, u), u])

    def forces(self, q: np.ndarray, loaded: bool, weight: np.ndarray) -> np.ndarray:
        """Forces of the legs at a commanded pose of a file written at HOME."""
        lengths, lines = self.lines(q)
        kept = self.preload + self.k * (lengths - self.lines(HOME)[0])
        t = np.where(self.driven, self.preload, kept)
        chosen = np.ones(self.m, bool) if self.kind == "passive" else self.driven
        if loaded:
            t[chosen] = np.linalg.solve(lines[chosen].T, W - weight - lines[~chosen].T @ t[~chosen])
        return t


def at_every_door(
    elastic: Any, path: Any, one: Any, q: np.ndarray, wrench: Any, tmp_path: Any
) -> list[np.ndarray]:
    """Compare one posture with what other doors say of it; tensions of many postures."""
    K = one.matrices["B"]
    close: dict[str, Any] = {"rel": 1e-8, "abs": 1e-8 * np.abs(K).max()}
    # Many postures, by the program and one by one.
    tensions = []
    for backend in ("auto", "engine"):
        many = analyse_many(
            elastic, q[None], wrench=wrench, outputs=("B", "wrench", "tensions"), path=backend
        ).arrays
        assert many["stiffness_B"][0] == pytest.approx(K, **close)
        assert many["wrench"][0] == pytest.approx(one.wrench, rel=1e-8, abs=1e-6)
        tensions.append(many["tensions"][0])
    # The page.
    session = tab_of(source_of(elastic))
    state = {"q": q.tolist(), "load": None if wrench is None else W.tolist()}
    state = session.start.model_dump() | state | {"load_axes": "body"}
    answer = session.answer(message_of(json.dumps({"id": 1, "do": "result", "state": state}))).data[
        "result"
    ]
    assert answer["stiffness"]["B"] == pytest.approx(K, **close)
    assert answer["wrench"] == pytest.approx(one.wrench, rel=1e-8, abs=1e-6)
    # Modes, with the tangent under the load.
    found = modes(elastic, q, wrench=wrench).frequencies
    direct = modes(one).frequencies
    assert found == pytest.approx(direct, rel=1e-9, nan_ok=True)
    # A map, a study and a path at the same poses.
    softest = float(np.linalg.eigvalsh(K[3:, 3:])[0])
    place = tmp_path / f"{q[0]:.3f}.zarr"
    compute_map(elastic, Trajectory(q[None]), ["translation_held_min"], place, wrench=wrench)
    mapped = open_map(place).load()["translation_held_min"].values
    assert mapped.ravel() == pytest.approx([softest], rel=1e-7)
    ranges = {n: [x - 1e-12, x + 1e-12] for n, x in zip(elastic.names, q.tolist(), strict=True)}
    study = {
        "mechanism": str(path),
        "variables": {"k": {"values": [1.0]}},
        "poses": {"random": {"ranges": ranges, "count": 1, "seed": 1}},
        "cases": {"its": {} if wrench is None else {"wrench": W.tolist()}},
        "objectives": {"soft": {"quantity": "translation_held_min", "case": "its"}},
    }
    assert cartstiff.design(study).table("soft").tolist() == pytest.approx([softest], rel=1e-6)
    wrenches = None if wrench is None else np.array([wrench])
    taken = cartstiff.optimise_path(
        elastic,
        ToolPath(one.pose[None], wrenches, axes="body"),
        criterion="translation_held_min",
        connection="B",
        loaded=wrench is not None,
        singular=0.0,
        **({} if one.posture.coordinates_are_pose else {"near": q}),
    )
    if np.allclose(taken.q[0], q, atol=1e-6):  # an arm may take another posture there
        assert taken.values == pytest.approx([softest], rel=1e-6)
    there = analyse(elastic, taken.q[0], wrench=wrench).matrices["B"][3:, 3:]
    assert taken.values == pytest.approx([np.linalg.eigvalsh(there)[0]], rel=1e-7)
    return tensions


def carried_by(wrench):
    """The load of a workspace, along the axes of the body."""
    return None if wrench is None else (LoadKind("follower", np.zeros(3)), wrench, "body")


@pytest.mark.parametrize("weighs", [False, True])
@pytest.mark.parametrize("loaded", [False, True])
@pytest.mark.parametrize("seed", [3, 5])
def test_every_door_of_an_arm(seed, loaded, weighs, tmp_path):
    """Rest positions in the file are those of drives and springs at every posture."""
    arm = Arm.generated(seed)
    file = arm.written(tmp_path)
    keys = yaml.safe_load(file.read_text())
    keys["parameters"] = {"k": 1.0}
    for i, k in enumerate(arm.k.tolist()):
        rest = float(arm.q[i] + 0.02 * np.cos(i) * (0.1 if arm.slides[i] else 1.0))
        keys["springs"][f"j{i}"] = {"stiffness": f"={k}*k", "rest": rest}
    if not weighs:
        del keys["gravity"], keys["payload"]
    file.write_text(yaml.safe_dump(keys))
    elastic = load(file)
    wrench = W if loaded else None
    for away in (0.0, 0.02):
        q = arm.q + away * np.where(arm.slides, 0.1, 1.0)
        one = analyse(elastic, q, wrench=wrench)
        spring = arm.k * (q - elastic.springs.rest)
        own = replace(arm, W=np.zeros(6)).outer(q) * weighs
        if loaded:  # replaces the rest positions
            assert one.wrench == pytest.approx(W, rel=1e-9)
        else:
            assert one.jacobian.T @ one.wrench == pytest.approx(spring - own, rel=1e-8, abs=1e-7)
        at_every_door(elastic, file, one, q, wrench, tmp_path)


@pytest.mark.parametrize("weighs", [False, True])
@pytest.mark.parametrize("loaded", [False, True])
@pytest.mark.parametrize("kind", ["driven", "passive", "mixed"])
@pytest.mark.parametrize("seed", [3])
def test_every_door(seed, kind, loaded, weighs, tmp_path):
    drawn = Drawn(seed, kind)
    path = drawn.written(tmp_path, HOME, weighs)
    elastic = load(path)
    wrench = W if loaded else None
    for q in (HOME, AWAY):
        weight = np.zeros(6)
        if weighs:  # gradient of the energy: what has to be exerted against it
            R = se3.from_roll_pitch_yaw(q[:3], q[3:])[:3, :3]
            total = [(MASS, CENTRE), (5.0, np.zeros(3))]
            for mass, point in total:
                f = -mass * R.T @ FIELD
                weight += np.concatenate([np.cross(point, f), f])
        t = drawn.forces(q, loaded, weight)
        _, lines = drawn.lines(q)
        expected = t @ lines + weight
        one = analyse(elastic, q, wrench=wrench)
        here = one.elastic.springs.tensions(one.posture.lines.lengths)
        assert here == pytest.approx(t, rel=1e-9, abs=1e-7)
        assert one.wrench == pytest.approx(expected, rel=1e-9, abs=1e-6)
        many = at_every_door(elastic, path, one, q, wrench, tmp_path)
        for tensions in many:
            assert tensions == pytest.approx(t, rel=1e-8, abs=1e-6)
        # A workspace: this pose is within limits that hold these forces, and only then.
        for low, inside in ((t - 1.0, True), (t + 0.5, False)):
            limits = [[x, x + 2.0] for x in low.tolist()]
            bounded = load(drawn.written(tmp_path / f"{q[0]:.3f}{inside}", HOME, weighs, limits))
            margins = Margins(bounded, carried_by(wrench))
            pose = bounded.mechanism.pose_of(q)[None]
            assert margins.inside(pose).tolist() == [inside]
        # At rest under the wrench that holds it the body stays where it is; a load that replaced
        # rest lengths needs the new ones.
        held = one.elastic if loaded else elastic
        still = equilibrium(held, q, wrench=one.wrench, load_axes="body")
        assert np.abs(still.displacement).max() < 1e-7
        own = still.elastic.springs.tensions(still.posture.lines.lengths)
        assert own == pytest.approx(t, rel=1e-5)
