"""One question, asked of every command, has one answer.

Arms are generated with their set-up: base, tool, weight, payload, load at a point, units; loops
with their motor named in three ways. What every command should say is computed here from matrices:
poses by products of exponentials, forces by virtual work, their derivatives by differences.
"""

from __future__ import annotations

import html
import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.optimize import fsolve
from scipy.spatial.transform import Rotation
from tests.support.commands import answer, run
from tests.support.generated import EARTH, Arm, FourBar, close, frame, numbers
from tests.support.oracles import cross_matrix
from tests.support.pages import page_answer, source_of

import cartstiff

#: Seven turning joints; four and six of which one slides.
SEEDS = pytest.mark.parametrize("seed", [0, 1, 3])


@pytest.fixture
def arm(seed, tmp_path):
    one = Arm.generated(seed)
    return one, one.written(tmp_path)


@SEEDS
def test_analyse(arm):
    one, file = arm
    found = answer("analyse", file, *one.load_words)
    T = one.pose(one.q)
    close(found["pose"], T, 1e-12)
    close(found["load"]["compliance"], one.compliance(one.q))
    W = one.W.copy()
    W[:3] += np.cross(T[:3, :3] @ one.at, W[3:])  # about M's origin
    close(found["wrench"], np.concatenate([T[:3, :3].T @ W[:3], T[:3, :3].T @ W[3:]]), 1e-12)
    close(found["gravity"], EARTH, 1e-15)


@SEEDS
def test_equilibrium(arm):
    """From rest positions that balance weight and load at q, it comes to rest at q, and nearby."""
    one, file = arm
    words = ["--rest", numbers(one.rest()), "--q", numbers(one.rest())]
    found = answer("equilibrium", file, *words, *one.load_words)
    rest = fsolve(lambda q: one.k * (q - one.rest()) - one.outer(q), one.q, xtol=1e-12)
    close(found["q"], rest, 1e-8)
    close(found["pose"], one.pose(rest), 1e-8)
    assert found["stable"] is True


@SEEDS
def test_map(arm, tmp_path):
    one, file = arm
    pytest.importorskip("zarr")
    elastic = cartstiff.load(file)
    C = one.compliance(one.q)
    T = one.pose(one.q)
    R = T[:3, :3]
    force = R.T @ np.array([0.0, 0.0, -10.0])
    motion = C @ np.concatenate([np.zeros(3), force])
    postures = cartstiff.maps.Trajectory(np.stack([one.q, one.q + 0.01]))
    found = cartstiff.maps.compute_map(
        elastic,
        postures,
        ["deflection"],
        tmp_path / "map.zarr",
        deflect=[0, 0, 0, 0, 0, -10.0],
        world=True,
        **one.load,
    )
    values = np.asarray(found["deflection"])
    close(values[0], np.linalg.norm(motion[3:]))


@SEEDS
@pytest.mark.parametrize("columns", ["displacement", "position"])
def test_identify(arm, tmp_path, columns):
    """Springs from made measurements, all along the robot's own base axes."""
    one, file = arm
    rng = np.random.default_rng(17)
    R_F_B = frame(*one.base)[:3, :3]
    T_B_F = np.linalg.inv(frame(*one.base))
    what = ["dx", "dy", "dz"] if columns == "displacement" else ["x", "y", "z"]
    rows = [[*(f"j{i}" for i in range(one.n)), "mx", "my", "mz", "fx", "fy", "fz", *what]]
    for _ in range(20):
        q = one.q + rng.uniform(-0.5, 0.5, one.n) * np.where(one.slides, 0.1, 1.0)
        force = rng.uniform(-100, 100, 3)  # along the base's axes
        T, J = one.pose(q), one.body_jacobian(q)
        R = T[:3, :3]
        W = np.concatenate([np.zeros(3), R.T @ R_F_B @ force])
        torques = J.T @ W
        if columns == "position":  # where the arm is, its own weight has moved it, too
            torques += _weight(one, q)
        motion = R_F_B.T @ R @ (J @ (torques / one.k))[3:]
        position = (T_B_F @ T)[:3, 3]
        value = motion if columns == "displacement" else position + motion
        rows.append([*q, 0, 0, 0, *force, *value])
    table = tmp_path / "data.csv"
    table.write_text("\n".join(",".join(str(v) for v in row) for row in rows) + "\n")
    found = answer(f"identify {file} {table} --offsets none")
    for parameter, k in zip(found["parameters"], one.k, strict=True):
        assert parameter["identifiable"], parameter
        assert parameter["stiffness"] == pytest.approx(k, rel=1e-5)


@SEEDS
def test_page(arm):
    """The page's numbers are those of the arm's matrices, too."""
    one, file = arm
    T = one.pose(one.q)
    state = {"load": one.W.tolist(), "load_axes": "world", "load_at": one.at.tolist()}
    found = page_answer(source_of(cartstiff.load(file)), "result", state)["result"]
    close(found["pose"], T, 1e-12)
    close(found["load"]["compliance"], one.compliance(one.q))


@SEEDS
def test_report(arm, tmp_path):
    """The first sentence: how far the load moves M from where weight and springs balance."""
    one, file = arm
    page = tmp_path / "report.html"
    run("report", file, *one.load_words, f"-o {page}")
    size = _said_to_move(page)
    start = one.pose(one.q)[:3, 3]
    rest = fsolve(
        lambda q: one.k * (q - one.q) - one.outer(q) + _weight(one, one.q), one.q, xtol=1e-12
    )
    assert size == pytest.approx(np.linalg.norm(one.pose(rest)[:3, 3] - start), rel=0.02)


def _said_to_move(page: Path) -> float:
    """In metres: the first number of a report's answer."""
    text = re.sub(r"<(style|svg|iframe|script).*?</\1>", " ", page.read_text("utf-8"), flags=re.S)
    said = html.unescape(re.sub(r"<[^>]+>", " ", text))
    moved = re.search(r"moves ([\d.e-]+) (µm|mm|m)\b", said)
    assert moved, said[:500]
    return float(moved[1]) * {"µm": 1e-6, "mm": 1e-3, "m": 1.0}[moved[2]]


def _weight(one: Arm, q: np.ndarray) -> np.ndarray:
    return replace(one, W=np.zeros(6)).outer(q)


@pytest.mark.parametrize("loaded", [False, True])
@pytest.mark.parametrize("named", ["in the file", "as actuated", "by the spring"])
@SEEDS
def test_a_loop(tmp_path, seed, named, loaded):
    """The motor stays where it was put; its spring alone resists, whoever named it."""
    one = FourBar.generated(seed)
    keys: dict[str, Any] = {} if named == "by the spring" else {"actuated": ["motor"]}
    words = ["--stiffness", repr(one.k if named == "as actuated" else f"motor={one.k!r}")]
    if named == "in the file":
        keys["springs"], words = {"motor": {"stiffness": one.k}}, []
    file = one.written(tmp_path, **keys)
    words = [w.strip("'") for w in words]
    if loaded:
        words += ["--load", numbers(one.W), "--world", "--load-at", numbers(one.at)]
    found = answer(f"analyse {file} --q motor={one.turn!r}", *words)
    q = dict(zip(found["mechanism"]["joints"], found["q"], strict=True))
    assert q["motor"] == one.turn
    close(found["pose"], one.pose(one.turn), 1e-9)
    C = found["load"]["compliance"] if loaded else found["compliance"]["K"]
    close(C, one.compliance(loaded))
    if named == "by the spring":
        return
    rest = float(one.turn - one.twist(one.turn) @ _on_coupler(one, loaded) / one.k)
    at_rest = f"--rest motor={rest!r} --q motor={rest!r}"
    lying = answer("equilibrium", file, *words, at_rest)
    close(lying["pose"], one.pose(one.turn), 1e-6)


@pytest.mark.parametrize("seed", range(2))
def test_a_platform_s_legs_and_workspace(seed, tmp_path):
    """A generated platform under gravity, a payload and a load at a point: force of each leg.

    `analyse` gives the tensions by the springs' lengths; `workspace` finds the pose within a limit
    that is a little above one of these forces, and outside of a limit a little below.
    """
    rng = np.random.default_rng(seed)
    base, top = rng.uniform(-0.6, 0.6, (6, 3)), rng.uniform(-0.3, 0.3, (6, 3))
    base[:, 2] *= 0.2
    top[:, 2] *= 0.2
    rpy, p = rng.uniform(-0.3, 0.3, 3), np.array([*rng.uniform(-0.1, 0.1, 2), 0.8])
    R = Rotation.from_euler("xyz", rpy).as_matrix()
    mass, payload = rng.uniform(1, 20, 2)
    com, hung, at = rng.uniform(-0.1, 0.1, (3, 3))
    gravity, W = rng.uniform(-9, 9, 3), rng.normal(size=6) * [3, 3, 3, 60, 60, 60]
    on_top = top @ R.T
    along = on_top + p - base
    u = along / np.linalg.norm(along, axis=1)[:, None]
    force = W[3:] + (mass + payload) * gravity
    moment = W[:3] + np.cross(R @ at, W[3:])
    moment += np.cross(R @ (mass * com + payload * hung), gravity)
    tension = np.linalg.solve(np.vstack([np.cross(on_top, u).T, u.T]), [*moment, *force])

    def file(limits):
        data = {
            "kind": "stewart-gough",
            "base": base.tolist(),
            "platform": top.tolist(),
            "pose": {"xyz": p.tolist(), "rpy": rpy.tolist()},
            "legs": {"stiffness": 1e6, "force": limits},
            "body": {"mass": mass, "com": com.tolist(), "inertia": np.eye(3).tolist()},
            "gravity": gravity.tolist(),
        }
        path = tmp_path / "platform.yaml"
        path.write_text(json.dumps(data))
        return path

    words = ["--payload", numbers([payload, *hung]), "--load", numbers(W), "--world"]
    words += ["--load-at", numbers(at), "--json"]
    wide = float(20.0 * np.abs(tension).max())
    free = file([-wide, wide])
    found = json.loads(run("analyse", free, *words))
    close(found["wrench"][3:], R.T @ W[3:], 1e-12)
    elastic = cartstiff.load(free).with_payload(payload, hung)
    result = cartstiff.analyse(elastic, wrench=W, load_axes="world", load_at=at)
    close(result.elastic.springs.tensions(result.posture.lines.lengths), tension, 1e-9)
    leg, little = int(rng.integers(6)), 0.02 * np.abs(tension).max()
    for side, within in ((little, True), (-little, False)):
        limits = [[-wide, wide] for _ in range(6)]
        limits[leg][1] = float(tension[leg] + side)
        rays = "--directions 8 --scan 2 --radius 0.05"  # the note is of the centre alone
        answer = json.loads(run("workspace", file(limits), *words, rays))
        outside = "centre-outside" in [note["code"] for note in answer["notes"]]
        assert outside is not within


LOOPS = pytest.mark.parametrize(
    ("slides", "is_heavy"), [(False, True), (True, False), (True, True)]
)


@pytest.fixture
def loop(seed, slides, is_heavy, tmp_path):
    one = replace(FourBar.generated(seed), slides=slides, is_heavy=is_heavy)
    springs = {"motor": {"stiffness": one.k}}
    return one, one.written(tmp_path, actuated=["motor"], springs=springs, q={"motor": one.turn})


@LOOPS
@SEEDS
def test_a_loop_with_weight_or_a_slider(loop):
    """analyse and equilibrium."""
    one, file = loop
    load = ["--load", numbers(one.W), "--world", "--load-at", numbers(one.at)]
    found = answer("analyse", file, *load)
    close(found["pose"], one.pose(one.turn), 1e-9)
    close(found["load"]["compliance"], one.compliance(True), 1e-6)
    lying = answer("equilibrium", file, *load)
    close(lying["pose"], one.pose(one.at_rest()), 1e-7)


@LOOPS
@pytest.mark.parametrize("seed", range(2))
def test_a_loop_in_maps_and_reports(loop, tmp_path):
    one, file = loop
    pytest.importorskip("zarr")
    elastic = cartstiff.load(file)
    load = {"wrench": one.W, "load_axes": "world", "load_at": one.at}
    found = cartstiff.maps.compute_map(
        elastic,
        cartstiff.maps.Trajectory(elastic.mechanism.closed(elastic.q).q[None]),
        ["deflection"],
        tmp_path / "map.zarr",
        deflect=[0, 0, 0, 0, 0, -10.0],
        world=True,
        **load,
    )
    R = one.pose(one.turn)[:3, :3]
    motion = one.compliance(True) @ np.concatenate([np.zeros(3), R.T @ [0.0, 0.0, -10.0]])
    close(np.asarray(found["deflection"])[0], np.linalg.norm(motion[3:]), 1e-6)
    page = tmp_path / "report.html"
    words = ["--load", numbers(one.W), "--world", "--load-at", numbers(one.at)]
    run("report", file, *words, f"-o {page}")
    moved = one.pose(one.at_rest())[:3, 3] - one.pose(one.turn)[:3, 3]
    assert _said_to_move(page) == pytest.approx(np.linalg.norm(moved), rel=0.02)


def _on_coupler(one: FourBar, loaded: bool) -> np.ndarray:
    """The load about M's origin, in its axes."""
    T = one.pose(one.turn)
    force = T[:3, :3].T @ one.W[3:] * loaded
    return np.concatenate([np.cross(one.at, force), force])


# -- the reference itself ----------------------------------------------------------------------


def test_the_reference_differentiates_its_own_poses():
    """The arm's Jacobian is the derivative of its pose."""
    one = Arm.generated(3)
    h = 1e-5
    T = one.pose(one.q)
    for i, column in enumerate(one.body_jacobian(one.q).T):
        e = h * np.eye(one.n)[i]
        X = np.linalg.solve(T, one.pose(one.q + e) - one.pose(one.q - e)) / (2 * h)
        close(X[:3, :3], cross_matrix(column[:3]), 1e-8)
        close(X[:3, 3], column[3:], 1e-8)
