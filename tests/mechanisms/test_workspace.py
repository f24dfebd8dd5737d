"""Workspaces: volumes against grids, boundaries against `analyse`, cables against linprog."""

import csv
import json
from dataclasses import replace
from pathlib import Path

import jsonschema
import numpy as np
import pytest
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation
from tests.doors import DEAD_AT_ORIGIN, Margins, lines_at
from tests.inputs.test_every_key import PLATFORM
from tests.mechanisms.machines import write_file
from tests.mechanisms.test_assembly_modes import FICHTER, MA_ANGELES
from tests.support import refused
from tests.support.commands import answer, refuses, run
from tests.support.printed import text_of

import cartstiff
from cartstiff.extend import json_schema

LEGS = {
    "limits": [[0.85, 1.25]] * 6,
    "base_joints": {"axis": [0, 0, 1], "angle": 0.9},
}


@pytest.fixture(scope="module")
def machine(tmp_path_factory):
    folder = tmp_path_factory.mktemp("machine")
    legs = {"stiffness": 1e5} | LEGS
    return cartstiff.load(write_file(folder, **(PLATFORM | {"legs": legs})))


@pytest.fixture(scope="module")
def found(machine):
    return cartstiff.workspace(machine, directions=200, scan=24)


def _allowed(elastic, places, pose):
    """Whether positions keep all limits and the sign of the determinant, from first principles."""
    platform = elastic.mechanism
    ends = places[:, None] + platform.points @ pose[:3, :3].T
    along = ends - platform.anchors
    lengths = np.linalg.norm(along, axis=2)
    good = ((lengths >= 0.85) & (lengths <= 1.25)).all(axis=1)
    good &= (along[..., 2] / lengths >= np.cos(0.9)).all(axis=1)
    poses = np.tile(pose, (len(places), 1, 1))
    poses[:, :3, 3] = places
    lines = lines_at(platform, np.vstack([pose[None], poses]))[1]
    signs = np.sign(np.linalg.det(lines))
    return good & (signs[1:] == signs[0])


def test_volume_is_that_of_a_fine_grid(machine, found):
    """At a tenth of its poses, and closer than the error that is told."""
    low, high = found.boundary.min(axis=0) - 0.02, found.boundary.max(axis=0) + 0.02
    n = 70
    axes = [low[i] + (np.arange(n) + 0.5) * (high[i] - low[i]) / n for i in range(3)]
    count = 0
    for z in axes[2]:
        xy = np.stack(np.meshgrid(axes[0], axes[1]), axis=-1).reshape(-1, 2)
        places = np.column_stack([xy, np.full(len(xy), z)])
        count += int(_allowed(machine, places, found.pose).sum())
    volume = count * np.prod(high - low) / n**3
    assert abs(found.volume - volume) < 0.01 * volume
    assert abs(found.volume - volume) < found.volume_error < 0.1 * volume
    assert found.columns.poses + found.positions.poses < 0.1 * n**3


def test_the_least_ratio_is_that_of_the_whole_workspace(machine, found):
    """Not only of the poses on rays: against a fine grid of positions within the limits."""
    low, high = found.boundary.min(axis=0), found.boundary.max(axis=0)
    axes = [np.linspace(a, b, 36) for a, b in zip(low, high, strict=True)]
    places = np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 3)
    places = places[_allowed(machine, places, found.pose)]
    poses = np.tile(found.pose, (len(places), 1, 1))
    poses[:, :3, 3] = places
    values = np.linalg.svd(lines_at(machine.mechanism, poses)[1], compute_uv=False)
    on_grid = (values[:, -1] / values[:, 0]).min()
    aside = cartstiff.workspace(
        machine, machine.q + np.array([0.2, -0.2, 0, 0, 0, 0]), directions=100, fits=False
    )
    ratio, place = aside.singularity
    assert 0.0 < ratio <= on_grid
    assert ratio == pytest.approx(found.singularity[0], rel=0.01)
    assert ratio > 0.8 * on_grid  # the grid's poses are a 36th apart
    assert _allowed(machine, place[None], found.pose).all()


def test_a_ray_that_reaches_no_limit_ends_at_the_radius():
    """A ball well within all limits: its volume is known, and no limit cuts its surface."""
    found = cartstiff.workspace(cartstiff.load("hexapod"), radius=0.1, directions=300, fits=False)
    ball = 4 / 3 * np.pi * 0.1**3
    assert found.positions.shares() == {"radius": pytest.approx(1.0)}
    assert found.volume == pytest.approx(ball, rel=5e-3)
    assert abs(found.volume - ball) < 1.01 * found.volume_error < 0.01 * ball


def edges_of(rays):
    """Ray, distance, side and limit of each boundary."""
    columns = (rays.ray, rays.distance, rays.enters, rays.limit)
    return list(zip(*(column.tolist() for column in columns), strict=True))


def test_boundary_poses_agree_with_analyse(machine, found):
    edges = edges_of(found.positions)
    centre = found.pose[:3, 3]
    seen = set()
    for k in range(0, len(edges), max(1, len(edges) // 25)):
        ray, distance, enters, limit = edges[k]
        seen.add(limit)
        for step, inside in ((0.0, True), (-1e-4 if enters else 1e-4, False)):
            place = centre + (distance + step) * found.positions.directions[ray]
            q = np.append(place, machine.q[3:])
            notes = {n.code: n for n in cartstiff.analyse(machine, q).notes}
            assert ("beyond-limits" not in notes) == inside
            if not inside:
                name, _, _ = limit.rpartition(", ")
                assert name in notes["beyond-limits"].values
    assert len(seen) > 3
    assert np.isclose(sum(found.positions.shares().values()), 1.0)


def test_few_rays_reach_as_far_as_many_and_name_forces_as_analyse_does():
    """Some of 100 rays reach farther than a dozen first ones let expect."""
    layout = {
        "base": {"radius": 0.35, "half_angle": 0.2},
        "platform": {"radius": 0.2, "half_angle": 0.2},
        "height": 0.5,
    }
    legs = {"stiffness": 1e7, "limits": [0.4, 0.8], "force": [-260, 400]}
    machine = cartstiff.hexapod(**layout, legs=legs)
    load = [0.0, 0.0, 0.0, 0.0, 0.0, -1000.0]
    reached = cartstiff.workspace(machine, wrench=load, directions=100, fits=False)
    cuts = set()
    for ray, distance, _, limit in edges_of(reached.positions):
        for step, beyond in ((-1e-6, False), (1e-6, True)):
            place = reached.centre + (distance + step) * reached.positions.directions[ray]
            notes = cartstiff.analyse(machine, [*place, 0, 0, 0], wrench=load).notes
            words = " ".join(n.message for n in notes if "limits" in n.code)
            assert (f"{limit.split(',')[0]} is at" in words) is beyond, (limit, words)
        cuts.add(limit.split(" leg")[0])
    assert "force of" in cuts


def test_singular_boundaries_agree_with_analyse(tmp_path):
    """Beside them `analyse` calls the pose nearly singular, and the lines' handedness changes."""
    legs = {"stiffness": 1e5, "limits": [0.3, 3.0]}
    machine = cartstiff.load(write_file(tmp_path, **(PLATFORM | {"legs": legs})))
    found = cartstiff.workspace(machine, directions=50, scan=24, fits=False)
    home = np.linalg.det(machine.mechanism.at(machine.q).actuation)
    edges = [edge for edge in edges_of(found.positions) if edge[3] == "singularity"]
    assert len(edges) >= 8
    for ray, distance, enters, _ in edges[::2]:
        for step, inside in ((0.0, True), (-1e-5 if enters else 1e-5, False)):
            place = found.centre + (distance + step) * found.positions.directions[ray]
            result = cartstiff.analyse(machine, np.append(place, machine.q[3:]))
            codes = {note.code for note in result.notes}
            assert codes & {"near-type-2-singularity", "type-2-singularity"}
            assert (np.linalg.det(result.posture.actuation) * home > 0) == inside


PUS = {
    "chain": "PUS",
    "rail": "vertical",
    "rod": 0.5,
    "stiffness": 2e7,
    "limits": [-0.1, 0.3],
    "base": {"radius": 0.35, "half_angle": 0.2},
    "platform": {"radius": 0.15, "half_angle": 0.2},
}
RPS = {
    "chain": "RPS",
    "stiffness": 1e7,
    "limits": [0.5, 0.75],
    "base": {"radius": 0.3},
    "platform": {"radius": 0.2},
}


@pytest.fixture(scope="module")
def machines():
    return {
        "6-pus": cartstiff.parallel(PUS, [0, 0, 0.55, 0, 0, 0]),
        "3-rps": cartstiff.parallel(RPS, [0, 0, 0.6, 0, 0, 0]),
        "delta": cartstiff.load("delta"),
    }


@pytest.mark.parametrize(("name", "axes"), [("6-pus", "xyz"), ("3-rps", None), ("delta", "xyz")])
def test_boundaries_of_bodies_on_legs_agree_with_analyse(machines, name, axes):
    """Just inside `analyse` finds no limit; just outside it names the one that cuts."""
    elastic = machines[name]
    found = cartstiff.workspace(elastic, directions=8, scan=6, fits=name == "delta")
    assert found.axes == (tuple(axes) if axes else ("z", "roll", "pitch"))
    columns = [["x", "y", "z", "roll", "pitch", "yaw"].index(a) for a in found.axes]
    home = np.append(found.pose[:3, 3], np.zeros(3))
    seen = set()
    edges = edges_of(found.positions)
    for k in range(0, len(edges), max(1, len(edges) // 8)):
        ray, distance, enters, limit = edges[k]
        for step, inside in ((0.0, True), (-1e-4 if enters else 1e-4, False)):
            pose = home.copy()
            offset = (distance + step) * found.positions.directions[ray]
            pose[columns] += found.scales * offset
            if limit == "singularity":
                q = cartstiff.at_pose(elastic, pose)[0]
                notes = {n.code for n in cartstiff.analyse(elastic, q).notes}
                # With fewer than six drives it is the stiffness that tells.
                assert notes & {"near-type-2-singularity", "type-2-singularity", "ill-conditioned"}
            elif limit.startswith("reach") and not inside:
                refused("cannot be reached", cartstiff.at_pose, elastic, pose)
            else:
                q = cartstiff.at_pose(elastic, pose)[0]
                notes = {n.code: n for n in cartstiff.analyse(elastic, q).notes}
                assert ("beyond-limits" not in notes) == inside
                if not inside:
                    assert limit.rpartition(", ")[0] in notes["beyond-limits"].values
            seen.add(limit)
    assert len(seen) > 1
    assert found.volume > 0
    if name == "delta":
        assert found.notes[-1].code == "no-fits"
    json_text = json.dumps(found.to_dict(), allow_nan=False)
    jsonschema.validate(json.loads(json_text), json_schema("workspace"))
    assert found.axes[2] in text_of(found)


def test_turns_of_joints_are_limits_everywhere():
    """Angles of joints that are not driven, one by one."""
    legs = PUS | {"turns": {"u1": [-0.2, 0.2], "s2": [-1.0, 1.0]}}
    elastic = cartstiff.parallel(legs, [0, 0, 0.55, 0, 0, 0])
    q, _ = cartstiff.at_pose(elastic, [0.0, 0.12, 0.55, 0, 0, 0])
    turned = {name: x for name, x in zip(elastic.names, q, strict=True) if name.endswith("u1")}
    beyond = {name for name, x in turned.items() if abs(x) > 0.2}
    (note,) = (n for n in cartstiff.analyse(elastic, q).notes if n.code == "beyond-limits")
    assert set(note.values) == beyond
    sampled = {"directions": 8, "scan": 6, "fits": False}
    found = cartstiff.workspace(elastic, **sampled)
    free = cartstiff.workspace(cartstiff.parallel(PUS, [0, 0, 0.55, 0, 0, 0]), **sampled)
    assert any("/u1, " in name for name in found.positions.shares())
    assert found.volume < free.volume
    for wrong, match in (({"slide": [0, 1]}, "unknown joint"), ({"u1": [1, 0]}, "wrong way")):
        refused(match, cartstiff.parallel, PUS | {"turns": wrong}, [0, 0, 0.55, 0, 0, 0])


def test_volume_of_a_body_on_rails_is_that_of_a_grid(machines):
    """Slides by Pythagoras, the side of singular poses by the lines of the rods."""
    elastic = machines["6-pus"]
    found = cartstiff.workspace(elastic, directions=288, scan=24, fits=False)
    legs = elastic.mechanism.legs
    anchors = np.array([leg.shape.anchor for leg in legs])
    points = np.array([leg.T_M_end[:3, 3] for leg in legs])
    low, high = found.boundary.min(axis=0) - 0.01, found.boundary.max(axis=0) + 0.01
    n = 70
    axes = [low[i] + (np.arange(n) + 0.5) * (high[i] - low[i]) / n for i in range(3)]
    places = np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 3)
    places = np.vstack([found.pose[:3, 3], places])
    B = places[:, None] + points
    across = np.linalg.norm((B - anchors)[..., :2], axis=2)
    with np.errstate(invalid="ignore"):
        slides = (B - anchors)[..., 2] - np.sqrt(0.25 - across**2)
        good = ((slides >= -0.1) & (slides <= 0.3)).all(axis=1)
    C = anchors + slides[..., None] * [0, 0, 1]
    rods = (B - C) / 0.5
    lines = np.concatenate([np.cross(np.broadcast_to(points, rods.shape), rods), rods], axis=2)
    signs = np.sign(np.linalg.det(np.where(good[:, None, None], lines, np.eye(6))))
    inside = good & (signs == signs[0])
    volume = inside[1:].mean() * np.prod(high - low)
    assert abs(found.volume - volume) < 0.01 * volume
    assert abs(found.volume - volume) < found.volume_error
    assert found.columns.poses + found.positions.poses < 0.1 * n**3


def test_the_nearest_singular_pose_is_that_of_a_general_optimiser():
    """Least squares under a constraint, by another method, from many starts."""
    machine = cartstiff.load("hexapod")
    platform, rng = machine.mechanism, np.random.default_rng(0)
    L, pose = platform.length, platform.pose_of(machine.q)
    found = cartstiff.workspace(machine, directions=8, scan=8, fits=False).singular

    def determinant(x):  # x: turn, shift over L
        turn = Rotation.from_rotvec(x[..., :3]).as_matrix()
        arms = platform.points @ np.swapaxes(pose[:3, :3] @ turn, -1, -2)
        ends = pose[:3, 3] + L * x[..., None, 3:] + arms
        along = ends - platform.anchors
        along /= np.linalg.norm(along, axis=-1, keepdims=True)

        return np.linalg.det(np.concatenate([np.cross(arms / L, along), along], axis=-1))

    home = determinant(np.zeros(6))
    best = np.inf
    for start in rng.normal(size=(8, 6)):
        ends = minimize(
            lambda x: x @ x,
            start,
            jac=lambda x: 2.0 * x,
            method="SLSQP",
            constraints={"type": "eq", "fun": lambda x: float(determinant(x)) / home},
            options={"maxiter": 300, "ftol": 1e-14},
        )
        if ends.success and abs(determinant(ends.x)) < 1e-9 * abs(home):
            best = min(best, L * np.sqrt(ends.fun))
    assert np.isclose(found.distance, best, rtol=1e-8)
    assert abs(np.linalg.det(lines_at(platform, found.pose[None])[1])[0]) < 1e-9 * abs(home)
    inner = rng.normal(size=(20_000, 6))
    inner *= 0.999 * found.distance / L / np.linalg.norm(inner, axis=1, keepdims=True)
    assert (determinant(inner) * home > 0).all()
    assert found.shift >= found.distance
    for offset in found.surface[::7]:
        T = pose.copy()
        T[:3, 3] = offset
        assert abs(np.linalg.det(lines_at(platform, T[None])[1])[0]) < 1e-6 * abs(home)


def test_what_fits_inside_is_inside(machine, found):
    rng = np.random.default_rng(0)
    centre, radius = found.sphere
    u = rng.normal(size=(2000, 3))
    u /= np.linalg.norm(u, axis=1)[:, None]
    assert _allowed(machine, centre + 0.96 * radius * u, found.pose).all()
    centre, edge = found.cube
    v = rng.uniform(-0.5, 0.5, size=(2000, 3)) * edge
    assert _allowed(machine, centre + 0.96 * v, found.pose).all()
    assert found.positions.first.min() <= radius * 1.05


def test_rotations_are_a_share_of_all(machine, found):
    rng = np.random.default_rng(1)
    quaternions = rng.normal(size=(20_000, 4))
    quaternions /= np.linalg.norm(quaternions, axis=1)[:, None]
    from scipy.spatial.transform import Rotation
    from tests.doors import Margins

    poses = np.tile(found.pose, (20_000, 1, 1))
    poses[:, :3, :3] = Rotation.from_quat(quaternions).as_matrix()
    sign = float(np.sign(np.linalg.det(lines_at(machine.mechanism, found.pose[None])[1])[0]))
    share = Margins(machine, np.zeros(6), sign).inside(poses).mean()
    assert abs(found.share_of_rotations - share) < 4 * np.sqrt(share / 20_000) + 0.03 * share


def limited_cables(folder):
    """The bundled cable robot with limits of its cables' forces."""
    text = (Path(__file__).parents[2] / "robots/cable-robot.yaml").read_text("utf-8")
    (folder / "cables.yaml").write_text(text + "  force: [5, 120]\n")
    return cartstiff.load(folder / "cables.yaml")


def test_tensions_nearest_to_the_middle_of_their_limits(tmp_path):
    """Against a constrained least-squares solver; their workspace is the smaller one."""
    robot = limited_cables(tmp_path)
    wrench = np.array([0.0, 0, 0, 3.0, 0, -40.0])
    asked = {"wrench": wrench, "directions": 18, "scan": 12, "radius": 2.0, "fits": False}
    every = cartstiff.workspace(robot, **asked)
    middle = cartstiff.workspace(robot, **asked, tensions="closed-form")
    assert 0.0 < middle.volume < every.volume
    assert {name[:5] for name in middle.positions.shares()} == {"force"}
    lines = robot.mechanism.at(robot.q).lines.lines
    best = minimize(
        lambda t: ((t - 62.5) ** 2).sum(),
        np.full(8, 62.5),
        jac=lambda t: 2 * (t - 62.5),
        constraints={"type": "eq", "fun": lambda t: lines.T @ t - wrench, "jac": lambda _: lines.T},
        method="SLSQP",
        options={"ftol": 1e-14},
    )
    assert np.allclose(middle.distribution["at_centre"], best.x, atol=1e-6)
    assert every.distribution["at_centre"] == middle.distribution["at_centre"]
    assert "nearest to the middle" in text_of(middle)
    jsonschema.validate(json.loads(json.dumps(middle.to_dict())), json_schema("workspace"))
    typed = answer(
        f"workspace {tmp_path / 'cables.yaml'} --tensions closed-form --radius 2",
        "--load 0,0,0,3,0,-40 --directions 18 --scan 12",
    )
    assert typed["volume"] == middle.volume
    refused(
        "middle of the limits",
        cartstiff.workspace,
        cartstiff.load("cable-robot"),
        tensions="closed-form",
        radius=2.0,
    )
    refused("unknown distribution", cartstiff.workspace, robot, tensions="least")


def test_what_cables_should_carry_is_known_where_they_cannot(tmp_path):
    """The limits are asked of this wrench, and no search for taut cables comes before."""
    robot = limited_cables(tmp_path)
    wrench = np.array([2.0, 0, 0, 300.0, 0, -40.0])
    load = (DEAD_AT_ORIGIN, wrench, "body")
    margins = Margins(robot, load, tensions="closed-form")
    q = np.random.default_rng(5).uniform(-0.6, 0.6, (20, 6)) * [1, 1, 1, 0.3, 0.3, 0.3]
    poses = np.array([robot.mechanism.pose_of(row + robot.q) for row in q])
    lines = lines_at(robot.mechanism, poses)[1]
    t = margins._tensions(poses)
    assert (t.min(axis=1) < 0.0).any()
    wrench[:3] /= robot.mechanism.length
    carried = np.einsum("nm,nmi->ni", t, lines)
    np.testing.assert_allclose(carried, np.tile(wrench, (20, 1)), atol=1e-9)


def test_cables_without_upper_limit_close_around_the_middle():
    robot = cartstiff.load("cable-robot")
    found = cartstiff.workspace(robot, directions=8, scan=5, radius=2.0, fits=False)
    assert found.margin > 0
    assert 0.1 < found.volume < 2.0 * 1.5 * 1.2
    assert set(found.positions.shares()) == {"tensions"}


@pytest.mark.parametrize(
    ("path", "code"),
    [(MA_ANGELES, "architecture-singularity"), (FICHTER, "orientation-singularity")],
)
def test_what_is_singular_everywhere_is_named_once(path, code):
    found = cartstiff.workspace(cartstiff.load(path))
    assert found.volume is None
    assert found.notes[-1].code == code
    text = json.dumps(found.to_dict(), allow_nan=False)
    jsonschema.validate(json.loads(text), json_schema("workspace"))


def test_what_has_no_workspace_is_refused(machine):
    refuses("three freedoms", cartstiff.workspace, cartstiff.load("five-bar"))
    refuses("platforms", cartstiff.workspace, cartstiff.load("ur5"))
    refuses("slides have no limits", cartstiff.workspace, cartstiff.load("3-rps"))
    refuses(
        "limits of forces", cartstiff.workspace, cartstiff.load("6-pus"), wrench=[0, 0, 0, 0, 0, 1]
    )
    refuses("no limits", cartstiff.workspace, cartstiff.load("stewart-gough"))
    open_ended = replace(machine, mechanism=cartstiff.load("cable-robot").mechanism)
    refused(
        "radius",
        cartstiff.workspace,
        replace(open_ended, springs=cartstiff.load("cable-robot").springs),
    )
    refused("scan", cartstiff.workspace, machine, scan=1)


def test_the_command(tmp_path):
    table, picture = tmp_path / "b.csv", tmp_path / "w.png"
    command = f"workspace hexapod --directions 8 --scan 8 -o {table}"
    data = answer(command, "-o", picture)
    jsonschema.validate(data, json_schema("workspace"))
    rows = list(csv.DictReader(table.read_text("utf-8").splitlines()))
    assert [row["limit"] for row in rows] == data["limits"]
    assert picture.read_bytes().startswith(b"\x89PNG")
    assert "Volume with this orientation" in run(command)


def test_a_start_that_is_singular_to_the_last_digit_is_refused_in_one_line(tmp_path):
    """A 3-RPS in its base's plane: the determinant's rounding is no warning of NumPy's."""
    (tmp_path / "m.yaml").write_text(
        "{kind: parallel, legs: {chain: RPS, base: {radius: 0.40178906190178587}, platform: "
        "{radius: 0.2468105091811488}, stiffness: 1.2e+8}, pose: {xyz: [0, 0, 1.0e-300]}}",
        "utf-8",
    )
    run("workspace", tmp_path / "m.yaml", "--json", code=2)
