"""Tool, weight, load and units on the commands that judge many poses: each acts."""

import json
from dataclasses import replace

import click
import numpy as np
import pytest
from scipy.optimize import linprog
from tests.doors import LegLimits, lines_at
from tests.support.commands import COMMANDS, answer
from tests.support.commands import command as cartstiff_command

import cartstiff
from cartstiff import InputError
from cartstiff.geometry import se3

TOOL = {"--tcp", "--gravity", "--payload"}
LOAD = {"--load", "--load-at", "--world", "--load-kind"}
#: What has no meaning, and why, stands in docs/howto/urdf.md.
LACKS = {
    "models": TOOL | LOAD,
    "frames": LOAD,
    "identify": {"--world", "--load-kind"},
}


@pytest.mark.parametrize("name", list(COMMANDS))
def test_the_same_options_on_every_command(name):
    command = cartstiff_command.get_command(click.Context(cartstiff_command), name)
    options = {word for parameter in command.params for word in parameter.opts}
    assert (TOOL | LOAD) - options == LACKS.get(name, set())


def test_assembly_modes_under_a_load():
    """K of each mode is that of `analyse` there under the same load."""
    elastic = cartstiff.load("hexapod", payload=3.0)
    load = {"wrench": [10, 0, 5, 100, 0, -9e4], "load_at": [0.1, 0, 0.2], "load_axes": "world"}
    modes = cartstiff.assemble(elastic, **load, load_kind="follower")
    assert len(modes) > 1
    for mode in modes:
        expected = cartstiff.analyse(elastic, mode.q, **load, load_kind="follower")
        assert np.array_equal(mode.result.tangent, expected.tangent)
    bare = cartstiff.assemble(elastic)
    assert abs(modes[0].eigenvalue / bare[0].eigenvalue - 1) > 1e-3
    told = answer(
        "assemble hexapod --payload 3 --load 10,0,5,100,0,-9e4 --load-at 0.1,0,0.2 --world "
        "--load-kind follower --all",
    )
    assert told["modes"][0]["smallest_eigenvalue"] == modes[0].eigenvalue
    assert told["weighed"] == [{"name": "platform", "mass": 3.0}]


@pytest.mark.parametrize("kind", ["dead", "follower"])
def test_a_workspace_under_a_load_is_that_of_linprog(kind):
    """Boundaries of cables: tensions within limits carry the load just inside, and not outside."""
    elastic = cartstiff.load("cable-robot")
    tensions, platform = (1.0, 100.0), elastic.mechanism
    with_limits = platform.as_one_of_many()
    with_limits.leg_limits = LegLimits(forces=np.tile(tensions, (len(platform.points), 1)))
    elastic = replace(elastic, mechanism=with_limits)
    q = [0.1, 0.0, 0.6, 0.0, 0.05, 0.02]
    W, at = np.array([0.5, 0.0, 0.2, 10.0, 0.0, -30.0]), np.array([0.1, 0.05, 0.0])
    found = cartstiff.workspace(
        elastic,
        q,
        wrench=W,
        load_at=at,
        load_kind=kind,
        directions=14,
        scan=8,
        radius=1.5,
        fits=False,
    )
    start = with_limits.pose_of(np.array(q))

    def carries(T):
        R = np.eye(3) if kind == "follower" else T[:3, :3].T @ start[:3, :3]
        m, f = R @ W[:3], R @ W[3:]
        asked = np.concatenate([m + np.cross(at, f), f])
        _, lines = lines_at(with_limits, T[None])
        A = lines[0].T * np.repeat([with_limits.length, 1.0], 3)[:, None]
        return (
            linprog(
                np.zeros(A.shape[1]),
                A_eq=A,
                b_eq=asked,
                bounds=[tensions] * A.shape[1],
                method="highs",
            ).status
            == 0
        )

    checked = 0
    for rays, turning in ((found.positions, False), (found.turns, True)):
        for r, x, name in zip(rays.ray, rays.distance, rays.limit, strict=True):
            if name != "tensions" or (turning and x > 3.14):  # a half turn is no boundary
                continue
            sides = []
            for share in (0.999, 1.001):
                T = start.copy()
                if turning:
                    step = share * x * rays.directions[r]
                    T[:3, :3] = T[:3, :3] @ se3.exp(np.append(step, np.zeros(3)))[:3, :3]
                else:
                    T[:3, 3] += share * x * rays.directions[r]
                sides.append(carries(T))
            assert sides[0] != sides[1]
            checked += 1
    assert checked > 20


def test_a_load_where_nothing_limits_forces_is_refused():
    with pytest.raises(InputError, match="nothing limits forces"):
        cartstiff.workspace(cartstiff.load("hexapod"), wrench=[0, 0, 0, 0, 0, -1])
    with pytest.raises(InputError, match="expected dead or follower"):
        cartstiff.workspace(
            cartstiff.load("cable-robot"),
            wrench=[0, 0, 1, 0, 0, -1],
            radius=1.0,
            load_kind="conservative",
        )


STUDY = {
    "mechanism": "inclined-hexapod",
    "variables": {"sz": {"values": [0.5, 0.8]}},
    "objectives": {"moves": {"quantity": "deflection"}},
}


def test_designs_carry_tool_weight_and_load(tmp_path):
    """Each design's number is that of its mechanism by `load` and `analyse`; in mm, a thousand."""
    path = tmp_path / "study.yaml"
    path.write_text(json.dumps(STUDY))
    words = (
        "--tcp 0,0,0.1,0.2,0,0 --payload 400,0,0,0.2 --load 0,0,0,50,0,-9000 --world "
        "--load-at 0,0.1,0"
    )
    told = answer("design", str(path), words)
    assert told["weighed"] == [{"name": "platform", "mass": 400.0}]
    for one in told["designs"]:
        elastic = cartstiff.load(
            "inclined-hexapod",
            parameters=one["parameters"],
            tcp=[0, 0, 0.1, 0.2, 0, 0],
            payload=[400, 0, 0, 0.2],
        )
        result = cartstiff.analyse(
            elastic, wrench=[0, 0, 0, 50, 0, -9000], load_axes="world", load_at=[0, 0.1, 0]
        )
        at = np.eye(4)
        at[:3, 3] = [0, 0.1, 0]
        R = result.pose[:3, :3].T
        force = R @ [50, 0, -9000]
        W = np.append(np.cross([0, 0.1, 0], force), force)
        moved = (result.tangent_compliance @ W)[3:]
        assert one["values"]["moves"] == pytest.approx(np.linalg.norm(moved), rel=1e-9)
