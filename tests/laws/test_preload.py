"""Preload of driven and passive legs, and tensions of cables, at poses other than the file's."""

import numpy as np
import pytest
from scipy.optimize import LinearConstraint, linprog, minimize
from tests.mechanisms.machines import codes, note, write_file

import cartstiff
from cartstiff import InputError, analyse, analyse_many, compensate, equilibrium, load
from cartstiff.geometry import se3
from cartstiff.maps import Trajectory, compute_map, open_map

BASE = [[91.41, 40.7], [-10.45, 99.52], [-80.96, 58.82], [-80.96, -58.82], [-10.45, -99.52]]
TOP = [[59.75, 5.23], [-25.34, 54.36], [-34.41, 49.15], [-34.41, -49.15], [-25.34, -54.36]]
HEXAPOD = {
    "units": {"length": "mm", "force": "N"},
    "base": [[*p, 0.0] for p in (*BASE, [91.41, -40.7])],
    "platform": [[*p, -10.0] for p in (*TOP, [59.75, -5.23])],
}
HOME, AWAY = [0.0, 0.0, 120.0, 0.0, 0.0, 0.0], [5.0, -8.0, 125.0, 0.05, 0.1, -0.08]
K, PRELOAD = 15e3, 200.0


def hexapod(tmp_path, name="hexapod", pose=HOME, kind="stewart-gough", **legs):
    place = {"xyz": pose[:3], "rpy": pose[3:]}
    legs = {"stiffness": K, "preload": PRELOAD} | legs
    return load(write_file(tmp_path, name=name, kind=kind, pose=place, legs=legs, **HEXAPOD))


def tensions_of(result):
    return result.elastic.springs.tensions(result.posture.lines.lengths)


def stiffness_of_lines(q, tension):
    """K^B of lines with a tension, from the energy's second differences: W by differences."""
    T = se3.from_roll_pitch_yaw(np.array(q[:3]), np.array(q[3:]))
    anchors, points = np.array(HEXAPOD["base"]), np.array(HEXAPOD["platform"])

    def lengths(step):
        at = T @ se3.exp(step)
        return np.linalg.norm(points @ at[:3, :3].T + at[:3, 3] - anchors, axis=1)

    rest = lengths(np.zeros(6)) - tension / K
    sizes, h = np.repeat([1e-3, 5e-2], 3), np.eye(6)

    def energy(step):
        return 0.5 * K * float(((lengths(step * sizes) - rest) ** 2).sum())

    H = [
        [(energy(a + b) - energy(a - b) - energy(b - a) + energy(-a - b)) / 4.0 for b in h]
        for a in h
    ]
    return np.array(H) / np.outer(sizes, sizes)


@pytest.mark.parametrize("pose", [HOME, AWAY])
def test_drives_hold_the_preload_at_every_commanded_pose(tmp_path, pose):
    result = analyse(hexapod(tmp_path), pose)
    assert tensions_of(result) == pytest.approx(np.full(6, PRELOAD), rel=1e-12)
    expected = stiffness_of_lines(pose, PRELOAD)
    sizes = np.repeat([59.0, 1.0], 3)
    scale = np.outer(sizes, sizes)
    assert np.abs((result.B.matrix - expected) / scale).max() < 1e-4 * K
    lines = result.posture.lines.lines
    assert result.wrench == pytest.approx(PRELOAD * lines.sum(axis=0), rel=1e-9, abs=1e-6)
    assert note(result, "preload-held").values["preload"]["leg3"] == PRELOAD


def test_the_same_by_the_files_pose_and_by_any_door(tmp_path):
    """A pose that is typed, in the file, in an array, or mapped: one preload, one stiffness."""
    typed = analyse(hexapod(tmp_path), AWAY)
    filed = analyse(hexapod(tmp_path, "filed", AWAY))
    assert filed.B.matrix == pytest.approx(typed.B.matrix, rel=1e-9, abs=1e-6)
    for path in ("auto", "engine"):
        many = analyse_many(
            hexapod(tmp_path), [HOME, AWAY], outputs=("B", "wrench", "tensions"), path=path
        )
        assert many.arrays["stiffness_B"][1] == pytest.approx(typed.B.matrix, rel=1e-9, abs=1e-6)
        assert many.arrays["wrench"][1] == pytest.approx(typed.wrench, rel=1e-9, abs=1e-6)
        assert many.arrays["tensions"] == pytest.approx(np.full((2, 6), PRELOAD), rel=1e-9)
    still = equilibrium(hexapod(tmp_path), AWAY, wrench=typed.wrench, load_axes="body")
    assert np.abs(still.displacement).max() < 1e-6
    assert tensions_of(still.stiffness) == pytest.approx(np.full(6, PRELOAD), rel=1e-6)


def test_passive_springs_keep_the_rest_length_of_the_files_pose(tmp_path):
    passive = hexapod(tmp_path, driven=False)
    lengths = [passive.mechanism.leg_lengths(q) for q in (HOME, AWAY)]
    expected = PRELOAD + K * (lengths[1] - lengths[0])
    assert tensions_of(analyse(passive, AWAY)) == pytest.approx(expected, rel=1e-9)
    springs = hexapod(tmp_path, "springs", kind="springs")
    assert tensions_of(analyse(springs, AWAY)) == pytest.approx(expected, rel=1e-9)
    assert "preload-held" not in codes(analyse(springs, AWAY))


def test_rest_lengths_are_fixed_numbers(tmp_path):
    fixed = hexapod(tmp_path, preload=None, rest_length=130.0)
    lengths = fixed.mechanism.leg_lengths(AWAY)
    assert tensions_of(analyse(fixed, AWAY)) == pytest.approx(K * (lengths - 130.0), rel=1e-9)


def test_a_load_that_replaces_what_the_file_says_is_named(tmp_path):
    W = [0.0, 0.0, 0.0, 0.0, 0.0, -100.0]
    plain = analyse(hexapod(tmp_path, preload=None), AWAY, wrench=W)
    for name, legs in (("p", {}), ("r", {"preload": None, "rest_length": 130.0})):
        loaded = analyse(hexapod(tmp_path, name, **legs), AWAY, wrench=W)
        assert tensions_of(loaded) == pytest.approx(tensions_of(plain), rel=1e-9)
        assert len(note(loaded, "load-replaces-rest").values["springs"]) == 6
        assert "preload-held" not in codes(loaded)
    assert "load-replaces-rest" not in codes(plain)


def seven(folder, preload):
    """Six driven legs and a passive spring from base to platform."""
    base, platform = ([*HEXAPOD[key], [0.0, 0.0, z]] for key, z in (("base", 0), ("platform", -10)))
    keys = HEXAPOD | {"base": base, "platform": platform}
    legs = {"stiffness": [K] * 6 + [5.0], "preload": preload, "driven": [True] * 6 + [False]}
    place = {"xyz": HOME[:3], "rpy": HOME[3:]}
    return load(write_file(folder, kind="springs", pose=place, legs=legs, **keys))


def test_springs_that_nothing_drives_keep_their_rest_lengths_under_a_load(tmp_path):
    """A seventh, passive spring beside six driven legs: these balance the load and its force."""
    both = seven(tmp_path, 50.0)
    W = np.array([0.0, 0.0, 0.0, 0.0, 0.0, -100.0])
    result = analyse(both, AWAY, wrench=W)
    stretched = both.mechanism.leg_lengths(AWAY)[6] - both.mechanism.leg_lengths(HOME)[6]
    t = tensions_of(result)
    assert t[6] == pytest.approx(50.0 + 5.0 * stretched, rel=1e-9)
    assert t @ result.posture.lines.lines == pytest.approx(W, abs=1e-6)


def least_kept(G, w, given):
    """Least tension by the rule, from linear programs and a search along the null space."""
    m = G.shape[1]
    d = 0.1 * given.mean()
    edge = projected(G, w, given, 0.0)
    most = 2.0 * max(given.max(), edge.max(), np.abs(nearest(G, w, given)).max())
    goal = np.append(np.zeros(m), -1.0)
    found = linprog(
        goal,
        A_ub=np.column_stack([-np.eye(m), np.full(m, d)]),
        b_ub=np.zeros(m),
        A_eq=np.column_stack([G, np.zeros(6)]),
        b_eq=w,
        bounds=[(None, most)] * m + [(None, 1.0)],
    )
    s = found.x[-1]
    return 0.5 * s * (1.0 + s) * d


def nearest(G, w, given):
    return given + np.linalg.pinv(G) @ (w - G @ given)


def projected(G, w, given, least):
    """The nearest balancing tensions above a bound, by a general solver in the null space."""
    p, N = nearest(G, w, given), np.linalg.svd(G)[2][6:].T
    inside = linprog(
        np.append(np.zeros(N.shape[1]), -1.0),
        A_ub=np.column_stack([-N, np.ones(len(p))]),
        b_ub=p - least,
        bounds=[(None, None)] * N.shape[1] + [(None, 1e3)],
    )
    found = minimize(
        lambda y: float(y @ y),
        inside.x[:-1],
        jac=lambda y: 2.0 * y,
        constraints=[LinearConstraint(N, least - p, np.inf)],
        method="SLSQP",
        options={"maxiter": 500, "ftol": 1e-14},
    )
    return p + N @ found.x


def test_cables_have_the_tensions_nearest_to_the_preload():
    robot = load("cable-robot")
    at = analyse(robot, [0.1, 0.0, 0.6, 0.0, 0.0, 0.0])
    assert sorted(tensions_of(at).round(1)) == [185.9] * 4 + [212.3] * 4
    rng = np.random.default_rng(4)
    given, bounded = np.full(8, 200.0), 0
    for _ in range(25):
        q = robot.q + rng.uniform(-1, 1, 6) * [0.2, 0.15, 0.15, 0.2, 0.2, 0.2]
        W = np.array([1.0, 2.0, 3.0, 10.0, -20.0, -30.0])
        G = robot.mechanism.at(q).lines.lines.T
        top = linprog(
            np.append(np.zeros(8), -1.0),
            A_ub=np.column_stack([-np.eye(8), np.ones(8)]),
            b_ub=np.zeros(8),
            A_eq=np.column_stack([G, np.zeros(6)]),
            b_eq=W,
            bounds=[(None, None)] * 8 + [(None, 1e3)],
        )
        if top.status != 0 or top.x[-1] <= 1e-3:
            if top.status != 0 or top.x[-1] < -1e-3:
                with pytest.raises(InputError, match="cables cannot balance"):
                    analyse(robot, q, wrench=W)
            continue
        t = tensions_of(analyse(robot, q, wrench=W))
        expected = projected(G, W, given, least_kept(G, W, given))
        assert t == pytest.approx(expected, abs=2e-2)
        bounded += bool(t.min() < 20.0 + 1e-6)
        many = analyse_many(robot, [q], wrench=W, outputs=("tensions",)).arrays["tensions"][0]
        assert many == pytest.approx(t, abs=1e-6)
    assert bounded > 3  # poses at which the bound counts


def test_tensions_and_stiffness_have_no_cliffs_along_a_line():
    robot = load("cable-robot")
    Q = [[0.02, 0.01, z, 0.0, 0.02, 0.0] for z in np.linspace(0.4, 0.8, 201)]
    many = analyse_many(robot, Q, outputs=("B", "tensions")).arrays
    assert np.abs(np.diff(many["tensions"], axis=0)).max() < 3.0
    stiffness = many["stiffness_B"][:, 3, 3]
    assert np.abs(np.diff(stiffness) / stiffness[:-1]).max() < 0.01
    # Beyond the bound of a tenth, too.
    W = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    tensions = []
    for pull in np.linspace(0.0, 2000.0, 101):
        W[3] = pull
        tensions.append(tensions_of(analyse(robot, wrench=W)))
    tensions = np.array(tensions)
    assert tensions.min() == pytest.approx(20.0)
    assert np.abs(np.diff(tensions, axis=0)).max() < 15.0


def eight(folder, moved=0.0, **legs):
    """The bundled cable robot, its anchors moved, with other cables."""
    p = load("cable-robot").mechanism
    keys = {"base": p.anchors + moved, "platform": p.points, "pose": {"xyz": [0.0, 0.0, 0.6]}}
    keys |= {"kind": "springs", "unilateral": True, "legs": {"stiffness": 5e4, **legs}}
    return load(write_file(folder, **keys))


def test_a_rope_of_fixed_length_is_a_passive_cable(tmp_path):
    robot = load("cable-robot")
    p, ropes = robot.mechanism, eight(tmp_path, preload=200.0, driven=False)
    q = [0.003, 0.0, 0.6, 0.0, 0.0, 0.0]
    expected = 200.0 + 5e4 * (p.leg_lengths(q) - p.leg_lengths(robot.q))
    assert tensions_of(analyse(ropes, q)) == pytest.approx(np.maximum(expected, 0.0), rel=1e-9)
    assert cartstiff.analyse(ropes, q).wrench[3] > 1.0


@pytest.mark.parametrize("load_is_given", [False, True])
@pytest.mark.parametrize("limits", [None, [30.0, 260.0]])
def test_tensions_are_continuous_along_drawn_lines(tmp_path, limits, load_is_given):
    """Around the largest step of a grid, finer ones have steps as much smaller."""
    rng = np.random.default_rng(11)
    moved = 0.05 * rng.normal(size=(8, 3))
    legs = {"preload": rng.uniform(100.0, 250.0, 8)} | ({"force": limits} if limits else {})
    drawn = eight(tmp_path, moved, **legs)
    W = [1.0, 2.0, -1.0, 60.0, -40.0, -80.0] if load_is_given else None
    seen = 0
    for _ in range(4):
        ends = drawn.q + rng.uniform(-1, 1, (2, 6)) * [0.3, 0.2, 0.15, 0.1, 0.1, 0.1]
        low, high, steps = 0.0, 1.0, []
        for _ in range(4):
            x = np.linspace(low, high, 25)
            Q = ends[0] + x[:, None] * (ends[1] - ends[0])
            t = analyse_many(drawn, Q, wrench=W, outputs=("tensions",)).arrays["tensions"]
            if not t.min() > 0.0:  # no taut set balances the load, or without one itself
                break
            sizes = np.abs(np.diff(t, axis=0)).max(axis=1)
            k = int(np.argmax(sizes))
            low, high = x[max(k - 1, 0)], x[min(k + 2, 24)]
            steps.append(sizes[k])
        else:
            seen += 1
            assert steps[3] < 0.02 * steps[0]
    assert seen >= 1


def test_largest_forces_bound_the_tensions(tmp_path):
    """The nearest set within [least, largest], by a general solver; beyond them by one share."""
    limited = eight(tmp_path, preload=60.0, force=[20.0, 70.0])
    W, bound = np.array([0.0, 1.0, 0.0, 10.0, 0.0, -60.0]), 0
    rng = np.random.default_rng(2)
    for _ in range(12):
        q = limited.q + rng.uniform(-1, 1, 6) * [0.01, 0.01, 0.01, 0.02, 0.02, 0.02]
        G = limited.mechanism.at(q).lines.lines.T
        given = np.full(8, 60.0)
        inside = linprog(np.zeros(8), A_eq=G, b_eq=W, bounds=[(20.0, 70.0)] * 8)
        result = analyse(limited, q, wrench=W)
        t = tensions_of(result)
        assert G @ t == pytest.approx(W, abs=1e-6)
        if inside.status:
            assert "force-limits" in codes(result)
            continue
        p0, N = nearest(G, W, given), np.linalg.svd(G)[2][6:].T
        found = minimize(
            lambda y: float(y @ y),
            np.linalg.lstsq(N, inside.x - p0, rcond=None)[0],
            jac=lambda y: 2.0 * y,
            constraints=[LinearConstraint(N, 20.0 - p0, 70.0 - p0)],
            method="SLSQP",
            options={"maxiter": 500, "ftol": 1e-14},
        )
        assert "force-limits" not in codes(result)
        assert t == pytest.approx(p0 + N @ found.x, abs=1e-3)
        bound += bool(t.max() > 70.0 - 1e-6)
    assert bound > 2


def test_what_nothing_drives_is_no_command_of_a_path(tmp_path):
    """A seventh spring keeps its rest length; rest lengths of passive legs alone are named."""
    both, W = seven(tmp_path, 5.0), np.array([0.0, 0.0, 0.0, 0.0, 0.0, -10.0])
    found = compensate(both, [HOME, AWAY], W)
    assert found.springs == tuple(f"leg{i}" for i in range(1, 7))
    assert found.commands.shape == (2, 6)
    assert np.abs(found.after[:, 3:]).max() < 1e-9
    assert "commands-of-springs" not in codes(found)
    legs = {"stiffness": K, "driven": False}
    place = {"xyz": HOME[:3], "rpy": HOME[3:]}
    alone = load(write_file(tmp_path, kind="springs", pose=place, legs=legs, **HEXAPOD))
    passive = compensate(alone, [HOME, AWAY], W)
    assert note(passive, "commands-of-springs").values["springs"] == list(found.springs)
    assert "nothing drives leg1, leg2" in note(passive, "commands-of-springs").message


def test_the_mean_of_a_map_is_that_of_commanded_legs(tmp_path):
    """Over +-30 mm: 3215.3 N/mm without a preload; rest lengths of the first pose gave 4872."""
    steps = np.linspace(-30.0, 30.0, 7)
    poses = np.array([[x, y, *HOME[2:]] for x in steps for y in steps])
    means = []
    for preload in (0.0, PRELOAD):
        machine = hexapod(tmp_path, name=f"with{preload:g}", preload=preload)
        place = tmp_path / f"{preload:g}.zarr"
        compute_map(machine, Trajectory(poses), ["translation_free_min"], place, connection="B")
        means.append(float(open_map(place).load()["translation_free_min"].mean()))
        own = []
        for pose in poses:
            K = stiffness_of_lines(pose, preload)
            K = 0.5 * (K + K.T)
            reduced = K[3:, 3:] - K[3:, :3] @ np.linalg.solve(K[:3, :3], K[:3, 3:])
            own.append(np.linalg.eigvalsh(reduced)[0])
        assert means[-1] == pytest.approx(np.mean(own), rel=1e-4)
    assert means == pytest.approx([3215.3, 3231.9], abs=0.1)
