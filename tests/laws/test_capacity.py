"""Which loads are held: linear programmes, other polytopes, and bisections of the equilibrium."""

from __future__ import annotations

import re
import time
from pathlib import Path

import numpy as np
import pytest
import yaml
from scipy.optimize import linprog
from tests.laws.test_balance_of_bodies import EARTH, MAKERS, lines_file
from tests.support.commands import answer, run
from tests.support.printed import text_of

import cartstiff as cs

LIMIT = 40.0
ROBOTS = Path(__file__).parents[2] / "robots"


def loaded(kind: str, seed: int, folder, **more):
    """A random mechanism whose drives have limits, under weight and a load."""
    folder.mkdir(exist_ok=True)
    rng = np.random.default_rng([seed, len(kind), 7])
    file = MAKERS[kind](folder, rng)
    (folder / "m.yaml").write_text(yaml.safe_dump(file | more))
    elastic = cs.load(str(folder / "m.yaml")).with_gravity(EARTH)
    return cs.analyse(elastic, wrench=rng.uniform(-30.0, 30.0, 6)), rng


def platform(seed: int, cables: bool):
    """Six legs, or eight cables from all around, by their lines; and what holds the weight."""
    rng = np.random.default_rng([seed, cables])
    m = 8 if cables else 6
    if cables:
        base = np.array([[x, y, z] for x in (-2, 2) for y in (-2, 2) for z in (0, 3)], float)
        top = base * [0.15, -0.15, 0.1] + rng.uniform(-0.05, 0.05, (m, 3)) - [0, 0, 0.2]
    else:
        angles = np.repeat([0.3, 2.4, 4.5], 2) + np.tile([-0.25, 0.25], 3)
        base = np.column_stack([np.cos(angles), np.sin(angles), rng.uniform(-0.1, 0.1, m)])
        turned = np.roll(angles, 1)
        top = 0.5 * np.column_stack([np.cos(turned), np.sin(turned), rng.uniform(-0.1, 0.1, m)])
    low, high = (20.0, 900.0) if cables else (-600.0, 500.0)
    legs = {"stiffness": 1e6, "force": [low, high]}
    if cables:
        legs["preload"] = 200.0
    file = lines_file(base, top, legs, cables)
    return file, base, top + np.array([0.1, 0.0, 1.0])


@pytest.mark.parametrize("cables", [False, True])
def test_polytopes_of_platforms_are_those_of_a_linear_programme(cables, tmp_path):
    rng = np.random.default_rng(5)
    for seed in range(2):
        file, base, ends = platform(seed, cables)
        (tmp_path / "p.yaml").write_text(yaml.safe_dump(file))
        elastic = cs.load(str(tmp_path / "p.yaml")).with_gravity(EARTH)
        found = cs.capacity(elastic, wrench=[0, 0, 0, 0, 0, 1.0]).polytope
        along = (base - ends) / np.linalg.norm(base - ends, axis=1)[:, None]
        at = ends - np.array([0.1, 0.0, 1.0])
        pulls = np.vstack([np.cross(at, along).T, along.T])  # on the body, about M
        weight = 4.0 * EARTH
        own = np.concatenate([np.cross([0.02, 0.01, 0.1], weight), weight])
        bounds = file["legs"]["force"]
        # The pulls balance weight and a force on the body: pulls t + own + (0, f) = 0.
        to_wrench = -np.vstack([np.zeros((3, 3)), np.eye(3)])
        for direction in rng.normal(size=(500, 3)):
            u = direction / np.linalg.norm(direction)
            m = len(base)
            c = np.concatenate([np.zeros(m), -u])
            A = np.column_stack([pulls, -to_wrench])
            free = [(None, None)] * 3
            best = linprog(c, A_eq=A, b_eq=-own, bounds=[tuple(bounds)] * m + free)
            assert (found @ u).max() == pytest.approx(-best.fun, rel=1e-6)


def test_polytopes_of_arms_are_those_of_their_corners(tmp_path):
    """Every vertex has as many torques at their limits as it needs, and none beyond."""
    for seed in range(5):
        result, _ = loaded("arm", seed, tmp_path / str(seed))
        elastic = result.elastic_as_given
        vertices = cs.capacity(elastic, result.q, wrench=result.wrench).polytope
        if vertices is None:
            continue
        J, R = result.jacobian, result.pose[:3, :3]
        now = {one.name: one.force for one in result.forces}
        t_0 = np.array([now[name] for name in elastic.names])
        for vertex in vertices:
            W = np.concatenate([np.zeros(3), R.T @ vertex])
            t = t_0 - J.T @ (W - result.wrench)
            used = np.abs(t) / LIMIT
            assert used.max() <= 1.0 + 1e-9
            assert np.count_nonzero(used > 1.0 - 1e-7) >= np.linalg.matrix_rank(J[3:])


def is_held(result, s: float, limits) -> bool:
    """Whether all forces are within their limits at the equilibrium under s loads."""
    low, high = limits
    acting = result.load.acting(s * result.wrench, result.pose)
    start = np.array(result.q)
    start[sorted(result.mechanism.virtual)] = 0.0  # links are straight before the load
    try:
        state = cs.equilibrium(result.elastic_as_given, start, acting, limits=False)
    except cs.CartstiffError:
        return False
    return all(low <= one.force <= high for one in state.stiffness.forces)


def of_kind(kind: str, seed: int, folder):
    """A loaded mechanism, and the least and largest force that each of its drives holds."""
    if kind in MAKERS:
        return loaded(kind, seed, folder)[0], (-LIMIT, LIMIT)
    folder.mkdir()
    if kind == "delta":  # closed chains with compliant links
        given = yaml.safe_load((ROBOTS / "delta.yaml").read_text())
        for leg in given["legs"]:
            leg |= {"effort": {"motor": 12.0}, "model": str(ROBOTS / leg["model"])}
        (folder / "d.yaml").write_text(yaml.safe_dump(given))
        wrench = np.random.default_rng(seed).uniform(-30.0, 30.0, 6) * [0, 0, 0, 1, 1, 1]
        return cs.analyse(cs.load(str(folder / "d.yaml")), wrench=wrench), (-12.0, 12.0)
    file, *_ = platform(seed, cables=kind != "legs")
    limits = tuple(file["legs"]["force"])
    if kind == "slack":  # a cable holds what it pulls
        del file["legs"]["force"]
        limits = (1e-9, np.inf)
    (folder / "p.yaml").write_text(yaml.safe_dump(file))
    elastic = cs.load(str(folder / "p.yaml")).with_gravity(EARTH)
    wrench = np.random.default_rng([seed, 3]).uniform(-1.0, 1.0, 6)
    return cs.analyse(elastic, wrench=wrench), limits


@pytest.mark.parametrize("kind", ["arm", "beams", "loop", "delta", "legs", "cables", "slack"])
def test_the_largest_load_is_that_of_a_bisection(kind, tmp_path):
    # Closed chains with compliant links need seconds for each rest.
    checked, wanted, width = 0, *((1, 5e-7) if kind == "delta" else (5, 0.02))
    for seed in range(16):
        try:
            result, limits = of_kind(kind, seed, tmp_path / str(seed))
            elastic, W = result.elastic_as_given, result.wrench
            own = cs.capacity(elastic, result.q, wrench=W)
        except cs.CartstiffError:
            continue
        first = own.by_equilibrium
        if first.kind not in ("force", "slack") or not 0.0 < first.factor < np.inf:
            continue

        low, high = (1.0 - width) * first.factor, (1.0 + width) * first.factor
        assert is_held(result, low, limits)
        assert not is_held(result, high, limits)
        while width > 1e-6 and high - low > 1e-7 * high:
            middle = 0.5 * (low + high)
            low, high = (middle, high) if is_held(result, middle, limits) else (low, middle)
        assert first.factor == pytest.approx(low, rel=1e-6)
        checked += 1
        if checked == wanted:
            return
    pytest.fail(f"only {checked} cases")


def test_a_load_that_grows_ends_where_its_curve_turns():
    """Beyond that there are equilibria, to which it does not lead; and it is soon found."""
    elastic, unit = cs.load("hexapod"), [0, 0, 0, 0, 0, -1e5]
    fine = cs.load_curve(elastic, wrench=unit, to=10.0, resolution=0.02, points=80)
    turn = fine.critical[0]
    assert turn.kind == "limit"
    assert cs.equilibrium(elastic, wrench=np.array(unit) * 1.01 * turn.factor).stable
    began = time.process_time()
    found = cs.capacity(elastic, wrench=unit).by_equilibrium
    assert time.process_time() - began < 3.0
    assert found.kind == "buckling"
    assert found.factor == pytest.approx(turn.factor, rel=1e-9)
    # However small the load is that grows.
    small = cs.capacity(elastic, wrench=[0, 0, 0, 0, 0, -1.0]).by_equilibrium
    assert small.factor == pytest.approx(1e5 * turn.factor, rel=1e-9)


def test_a_link_buckles_at_its_load(tmp_path):
    """Two rigid links of length l on springs k under an axial force: P l / k = (3 - sqrt 5) / 2."""
    k, length = 50.0, 0.4
    links = "".join(f'<link name="{n}"/>' for n in ("g", "a", "b", "tip"))

    def hinge(name, parent, child, x, kind="revolute"):
        limit = '<axis xyz="0 1 0"/><limit lower="-3" upper="3" velocity="1"/>'
        ends = f'<parent link="{parent}"/><child link="{child}"/><origin xyz="{x} 0 0"/>'
        more = limit * (kind == "revolute")
        return f'<joint name="{name}" type="{kind}">{ends}{more}</joint>'

    joints = hinge("s", "g", "a", 0) + hinge("e", "a", "b", length)
    joints += hinge("t", "b", "tip", length, "fixed")
    (tmp_path / "two.urdf").write_text(f'<robot name="two">{links}{joints}</robot>')
    elastic = cs.load(str(tmp_path / "two.urdf"), frame="tip", stiffness=k)
    own = cs.capacity(elastic, [0.0, 0.0], wrench=[0, 0, 0, -1.0, 0, 0])
    critical = k / length * (3.0 - np.sqrt(5.0)) / 2.0
    assert own.linear.kind == "buckling"
    assert own.linear.factor == pytest.approx(critical, rel=1e-9)


def test_cables_that_get_slack_travel_and_displacement_limit_a_load(tmp_path):
    file, *_ = platform(0, cables=True)
    del file["legs"]["force"]
    (tmp_path / "c.yaml").write_text(yaml.safe_dump(file))
    elastic = cs.load(str(tmp_path / "c.yaml")).with_gravity(EARTH)
    own = cs.capacity(elastic, wrench=[0, 0, 0, 0, 0, 100.0], load_axes="world")
    assert own.linear.kind == "slack"
    assert own.linear.factor == pytest.approx(own.factor, rel=0.02)
    assert own.by_equilibrium.kind == "slack"
    allowed = 1e-5
    near = cs.capacity(elastic, wrench=[0, 0, 0, 10.0, 0, 0], displacement=allowed)
    assert near.linear.kind == near.by_equilibrium.kind == "displacement"
    state = cs.equilibrium(elastic, wrench=[0, 0, 0, 10.0 * near.factor, 0, 0])
    assert np.linalg.norm(state.displacement_by_load[3:]) == pytest.approx(allowed, rel=1e-6)


def test_the_answer_says_how_many_times_the_load_is_held(tmp_path):
    from tests.laws.test_drive_forces import TWO

    (tmp_path / "two.urdf").write_text(TWO)
    asked = f" {tmp_path}/two.urdf --frame tip --q 0.2,0.5 --stiffness 3000"
    asked += " --load 0,0,0,0,0,-80 --world --gravity 0,0,-9.81"
    words, held = "analyse" + asked, "Holds 0.278 times this load (by the equilibrium), until s is"
    assert held in run(words)
    assert "until the allowed displacement is reached" in run(words + " --allowed-displacement 1mm")
    said = {one["code"]: one["values"] for one in answer(words)["answer"]["statements"]}
    # Weight takes 12.38 N m of 30, the load 63.68 N m: by lever arms.
    x = 0.5 * np.cos(0.2) + 0.4 * np.cos(0.7)
    own = 2 * 9.81 * 0.25 * np.cos(0.2) + 1.2 * 9.81 * (0.5 * np.cos(0.2) + 0.2 * np.cos(0.7))
    assert said["capacity"]["linear"] == pytest.approx((30.0 - own) / (80.0 * x), rel=1e-9)
    assert said["greatest-payload"]["payload"] == pytest.approx((30.0 - own) / (9.81 * x), rel=1e-9)
    # So does the answer at the rest under it, whose posture is another.
    assert held in run("equilibrium" + asked)
    rest = answer("equilibrium" + asked)["answer"]["statements"]
    there = {one["code"]: one["values"] for one in rest}
    assert there["capacity"]["factor"] == pytest.approx(said["capacity"]["factor"], rel=1e-3)
    assert there["greatest-payload"]["payload"] == pytest.approx(
        said["greatest-payload"]["payload"], rel=1e-9
    )


def times(state) -> float | None:
    """How many times its load a rest says to be held."""
    found = re.search(r"Holds (\S+) times", text_of(state))
    return None if found is None else float(found[1])


@pytest.mark.parametrize("kind", ["arm", "loop", "legs", "cables", "slack"])
def test_a_rest_holds_as_many_times_its_load_as_growing_it_shows(kind, tmp_path):
    checked = 0
    for seed in range(16):
        try:
            result, limits = of_kind(kind, seed, tmp_path / str(seed))
            acting = result.load.acting(result.wrench, result.pose)
            state = cs.equilibrium(result.elastic_as_given, result.q, acting, limits=False)
        except cs.CartstiffError:
            continue
        factor = times(state)
        if not factor or "is lost" in text_of(state):
            continue
        assert is_held(result, 0.993 * factor, limits)
        assert not is_held(result, 1.007 * factor, limits)
        checked += 1
        if checked == 3:
            return
    pytest.fail(f"only {checked} cases")


def test_loads_at_several_places_of_a_rest_grow_together():
    arm = cs.load("ur5").with_gravity()

    def under(s: float, *more, **keys):
        loads = (
            cs.DeadForce([0, 0, -60.0 * s], [0, 0, 0.1]),
            cs.DeadForce([20.0 * s, 0, -150.0 * s], [0.1, 0, 0], "forearm_link"),
        )
        return cs.equilibrium(arm, None, *loads, *more, **keys)

    factor = times(under(1.0))
    used = [under(x * factor).stiffness.forces[0].used for x in (0.995, 1.005)]
    assert used[0] < 1.0 < used[1]
    assert times(under(2.0)) == pytest.approx(0.5 * factor, rel=0.01)
    # Nothing is said where the load alone does not decide.
    assert times(cs.equilibrium(arm)) is None
    assert times(under(1.0, held={"z": -0.001})) is None
    assert times(cs.equilibrium(cs.load("five-bar"), wrench=[0, 0, 0, 0, 0, -100.0])) is None


def test_a_picture_shows_the_corners_of_the_polytope_or_the_factors():
    held = cs.capacity(cs.load("ur5"), wrench=[0, 0, 0, 0, 0, -100])
    for axes, plane in zip(held.plot().axes, ([0, 2], [0, 1]), strict=True):
        corners, shown = held.polytope[:, plane], axes.lines[0].get_xydata()
        for way in np.random.default_rng(1).normal(size=(20, 2)):
            assert (shown @ way).max() == pytest.approx((corners @ way).max())
        assert shown[0] == pytest.approx(shown[-1])
    free = cs.capacity(cs.load("five-bar"), wrench=[0, 0, 0, 0, 0, -100])
    assert free.polytope is None
    (axes,) = free.plot().axes
    assert [label.get_text() for label in axes.get_yticklabels()] == [
        "to first order: no limit",
        "by the equilibrium: no limit",
    ]
    held = cs.capacity(cs.load("hexapod"), wrench=[0, 0, 0, 0, 0, -100])
    (axes,) = held.plot().axes
    shown = [bar.get_width() for bar in axes.patches]
    assert shown == [held.linear.factor, held.by_equilibrium.factor]
