"""Cables: a closed form, slack ones, loads that would need pushing, tensions found."""

import numpy as np
import pytest
from scipy.optimize import lsq_linear
from tests.mechanisms.machines import codes, note, write_file
from tests.mechanisms.oracle import bundled_lines, small_motion
from tests.support import relative_error
from tests.support.commands import refuses

import cartstiff
from cartstiff import DeadForce, InputError, analyse, equilibrium, load

# A closed form against a sum over four cables.
CLOSED_FORM = 1e-13
# Tensions by least squares or by active sets.
TENSIONS = 1e-9

CORNERS = np.array([[1, 1, 0], [-1, 1, 0], [-1, -1, 0], [1, -1, 0]]) / np.sqrt(2)


def _cross(folder, k=7000.0, t=150.0, length=0.8, **legs):
    legs = legs or {"stiffness": k, "preload": t}
    return load(
        write_file(
            folder,
            kind="springs",
            unilateral=True,
            base=length * CORNERS,
            platform=np.zeros((4, 3)),
            legs=legs,
        )
    )


@pytest.mark.parametrize(
    ("k", "t", "length"), [(7000.0, 150.0, 0.8), (50.0, 0.0, 2.0), (1e5, 3e3, 0.1)]
)
def test_four_diagonal_cables(tmp_path, k, t, length):
    """Meeting in a point: (2 k + 2 t / l) I in their plane, 4 t / l across it."""
    result = analyse(_cross(tmp_path, k, t, length))
    plane, across = 2 * k + 2 * t / length, 4 * t / length
    expected = np.zeros((6, 6))
    expected[3:, 3:] = np.diag([plane, plane, across])
    for name in "ABK":
        assert relative_error(result.matrices[name], expected) <= CLOSED_FORM
    assert np.abs(result.wrench).max() <= CLOSED_FORM * (k + t)


def test_slack_cables_are_named(tmp_path):
    rest = np.array([0.79, 0.81, 0.795, 0.83])
    k, length = 7000.0, 0.8
    result = analyse(_cross(tmp_path, stiffness=k, rest_length=rest.tolist()))
    found = note(result, "slack")
    assert found.values["slack"] == [2, 4]
    assert "2, 4" in found.message
    # Cables 1 and 3 are opposite each other: all the stiffness is along them and tension's across.
    t = k * (length - rest[[0, 2]])
    u = CORNERS[0]
    across = np.eye(3) - np.outer(u, u)
    expected = 2 * k * np.outer(u, u) + t.sum() / length * across
    assert relative_error(result.matrices["B"][3:, 3:], expected) <= CLOSED_FORM
    # W holds the body: against the pull of the two.
    assert relative_error(result.wrench[3:], (t[1] - t[0]) * u) <= CLOSED_FORM


def _crane(folder):
    """A body hung on six cables in pairs, as an inverted hexapod."""
    top = np.deg2rad([10, 110, 130, 230, 250, 350])
    low = np.deg2rad([50, 70, 170, 190, 290, 310])
    ring = lambda a: np.stack([np.cos(a), np.sin(a), np.zeros(6)], axis=1)  # noqa: E731
    return load(
        write_file(
            folder,
            kind="springs",
            unilateral=True,
            base=ring(top) + np.array([0, 0, 1.5]),
            platform=0.4 * ring(low),
            legs={"stiffness": 1e4},
        )
    )


def test_redundant_cables_share_a_load():
    """Eight cables, six equations: no tension is negative, and together they hold the load."""
    elastic = load("cable-robot")
    rng = np.random.default_rng(11)
    for _ in range(20):
        wrench = rng.uniform(-1, 1, 6) * [2.0, 2.0, 2.0, 40.0, 40.0, 40.0]
        result = analyse(elastic, wrench=wrench)
        springs = result.elastic.springs
        lines = bundled_lines("cable-robot", springs.rest)
        ends = lines.points + lines.pose0[:3, 3]
        lengths = np.linalg.norm(ends - lines.base, axis=1)
        tensions = springs.stiffness * (lengths - springs.rest)
        assert tensions.min() >= -TENSIONS * tensions.max()
        u = (ends - lines.base) / lengths[:, None]
        held = np.concatenate([np.cross(lines.points, u).T @ tensions, u.T @ tensions])
        assert relative_error(held, wrench) <= TENSIONS
        assert relative_error(result.wrench, wrench) <= TENSIONS


def test_a_load_no_line_feels_is_refused(tmp_path):
    """Four cables through a point feel no moment."""
    with pytest.raises(InputError, match="no tensions"):
        analyse(_cross(tmp_path), wrench=[0, 0, 5.0, 0, 0, 0])


def test_an_equilibrium_names_its_slack_cables(tmp_path):
    """Pushed along a diagonal by more than the preload, the cable on that side hangs loose."""
    k, t, length = 7000.0, 150.0, 0.8
    state = equilibrium(_cross(tmp_path, k, t, length), DeadForce(400.0 * CORNERS[0]))
    assert [n.values["slack"] for n in state.notes if n.code == "slack"] == [[1]]
    moved = state.displacement[3:] @ CORNERS[0]
    assert moved > t / k
    # Cable 3 alone pulls back along the diagonal; the two across it help by their tension.
    across = np.hypot(length, moved)
    sideways = 2 * (k * (across - length) + t) * moved / across
    assert np.isclose(t + k * moved + sideways, 400.0, rtol=TENSIONS)


def _eight(folder, low, **more):
    """A frame between eight corners, its cables crossed in height if `low` is below zero."""
    corners = np.array([[x, y, z] for z in (0.0, 2.0) for x in (-1, 1) for y in (-1, 1)])
    inner = np.array([[x, y, low * z] for z in (-1, 1) for x in (-1, 1) for y in (-1, 1)])
    return load(
        write_file(
            folder,
            kind="springs",
            unilateral=True,
            base=corners,
            platform=inner * [0.3, 0.1, 0.15],
            pose={"xyz": [0, 0, 1.0]},
            legs={"stiffness": 2e4},
            body={"mass": 10.0, "com": [0, 0, 0]},
            gravity=[0, 0, -9.81],
            **more,
        )
    )


@pytest.mark.parametrize("low", [1.0, -1.0])
def test_every_cable_is_taut_where_that_is_possible(tmp_path, low):
    """The nearest tensions to none in which each is a tenth of the mean, by another solver."""
    elastic = _eight(tmp_path, low)
    rng = np.random.default_rng(3)
    for W in [None, *(rng.uniform(-1, 1, 6) * [1, 1, 1, 25, 25, 25] for _ in range(6))]:
        result = analyse(elastic, wrench=W)
        lines = result.posture.lines
        found = result.elastic.springs.tensions(lines.lengths)
        asked = np.array([0, 0, 0, 0, 0, -98.1]) + (0 if W is None else W)
        shortest = np.linalg.lstsq(lines.lines.T, asked, rcond=None)[0]
        assert shortest.min() < 0.0  # those from below would push
        least = 0.1 * np.abs(shortest).mean()
        heavy = 1e6
        other = lsq_linear(
            np.vstack([heavy * lines.lines.T, np.eye(8)]),
            np.append(heavy * asked, np.zeros(8)),
            bounds=(least, np.inf),
            tol=1e-15,
            method="bvls",
        )
        assert found.min() >= least * (1 - 1e-9)
        assert found == pytest.approx(other.x, rel=1e-5, abs=1e-5 * found.max())
        chosen = note(result, "tensions-chosen").values["tensions"]
        assert chosen == pytest.approx(found, rel=1e-12)
        assert not {"slack", "direction-dependent"} & set(codes(result))
        # Every cable counts: stiffness by differences of the forces that these springs exert.
        K, h = np.zeros((3, 3)), 1e-6
        for j, e in enumerate(np.eye(3)):
            ends = [elastic.mechanism.points + [0, 0, 1.0] + s * h * e for s in (-1, 1)]
            pulls = []
            for end in ends:
                along = end - elastic.mechanism.anchors
                L = np.linalg.norm(along, axis=1)
                t = found + 2e4 * (L - lines.lengths)
                assert t.min() > 0.0
                pulls.append((t / L) @ along)
            K[:, j] = (pulls[1] - pulls[0]) / (2 * h)
        assert result.matrices["B"][3:, 3:] == pytest.approx(K, rel=1e-5, abs=1.0)
        many = cartstiff.analyse_many(elastic, elastic.q[None], wrench=W)
        assert many["stiffness_B"][0] == pytest.approx(result.matrices["B"], rel=1e-9, abs=1e-4)


def test_a_cable_at_the_edge_of_slackness_is_named(tmp_path):
    """A point hung on one cable, another one at its side: it cannot pull, and no choice exists."""
    elastic = load(
        write_file(
            tmp_path,
            kind="springs",
            unilateral=True,
            base=[[0, 0, 1.0], [1.0, 0, 0]],
            platform=np.zeros((2, 3)),
            legs={"stiffness": 1e4},
            body={"mass": 2.0, "com": [0, 0, 0]},
            gravity=[0, 0, -9.81],
        )
    )
    result = analyse(elastic)
    assert result.elastic.springs.tensions(result.posture.lines.lengths) == pytest.approx(
        [19.62, 0]
    )
    assert note(result, "direction-dependent").values == {"cables": [2]}
    assert "tensions-chosen" not in codes(result)
    assert result.matrices["B"][3, 3] == pytest.approx(1e4 + 19.62)
    pushed = {
        side: equilibrium(elastic, DeadForce([side * 5.0, 0, 0])).displacement[3]
        for side in (1, -1)
    }
    assert pushed[-1] == pytest.approx(-5.0 / (1e4 + 19.62), rel=0.01)
    assert pushed[1] == pytest.approx(np.sin(np.arctan(5.0 / 19.62)), rel=0.01)


def test_six_lines_that_hold_are_not_chosen(tmp_path):
    assert "tensions-chosen" not in codes(analyse(_crane(tmp_path), wrench=[0, 0, 0, 0, 0, -60.0]))
    assert "tensions-chosen" in codes(analyse(load("cable-robot"), wrench=[0, 0, 0, 5.0, 0, 0]))
    assert "tensions-chosen" not in codes(analyse(load("cable-robot")))


# Six legs of which three push as well: cables from above, struts from below.
CABLES = [True, True, True, False, False, False]


def _mixed(folder, rest, unilateral=CABLES, **more):
    angles = 2 * np.pi / 3 * np.arange(3)
    ring = lambda a, r, z: np.stack([r * np.cos(a), r * np.sin(a), np.full(3, z)], axis=1)  # noqa: E731
    points = np.concatenate([ring(angles + 0.5, 0.3, 0.0), ring(angles - 0.6, 0.25, -0.1)])
    anchors = np.concatenate([ring(angles, 0.9, 1.0), ring(angles - 0.9, 0.5, -0.8)])
    legs = {"stiffness": [2e4, 2.1e4, 1.9e4, 5e4, 5.2e4, 4.9e4], **rest}
    file = write_file(
        folder,
        kind="springs",
        unilateral=unilateral,
        base=anchors,
        platform=points,
        body={"mass": 20.0, "com": [0, 0, 0]},
        legs=legs,
        **more,
    )
    return load(file), anchors, points, np.array(legs["stiffness"])


def test_some_lines_push_and_others_only_pull(tmp_path):
    """Energy, wrench and K against a sum over the lines that carry, its second differences."""
    rest = np.array([0.7, 2.0, 0.9, 0.9, 0.7, 1.2])  # the second cable is slack
    elastic, anchors, points, k = _mixed(tmp_path, {"rest_length": rest.tolist()})
    q = np.array([0.03, -0.02, 0.05, 0.1, -0.05, 0.2])
    result = analyse(elastic, q)

    def energy(x):
        T = result.pose @ small_motion(x)
        away = np.linalg.norm(points @ T[:3, :3].T + T[:3, 3] - anchors, axis=1) - rest
        away[:3] = np.maximum(away[:3], 0.0)
        return 0.5 * float(k @ away**2)

    assert note(result, "slack").values == {"slack": [2]}
    tensions = result.elastic.springs.tensions(result.posture.lines.lengths)
    assert tensions[1] == 0.0
    assert tensions[3:].min() < 0.0  # one that pushes
    h, eye = 1e-4, np.eye(6)
    slopes = [(energy(h * e) - energy(-h * e)) / (2 * h) for e in eye]
    assert relative_error(result.wrench, np.array(slopes)) <= 1e-6
    bends = [
        [
            (energy(h * (a + b)) - energy(h * (a - b)) - energy(h * (b - a)) + energy(-h * (a + b)))
            / (4 * h * h)
            for b in eye
        ]
        for a in eye
    ]
    assert relative_error(result.matrices["B"], np.array(bends)) <= 1e-6
    at = np.array([q, 0.5 * q])
    K, engine = (
        cartstiff.analyse_many(elastic, at, outputs=("stiffness_B",), path=path)["stiffness_B"]
        for path in ("auto", "engine")
    )
    assert relative_error(K[0], result.matrices["B"]) <= 1e-12
    assert relative_error(K, engine) <= 1e-12


def test_struts_hold_what_cables_cannot(tmp_path):
    """Under its weight the struts push and the cables pull; cables alone refuse it."""
    elastic, anchors, points, _ = _mixed(tmp_path, {}, gravity=[0, 0, -9.81])
    lines = points - anchors
    u = lines / np.linalg.norm(lines, axis=1)[:, None]
    A = np.concatenate([np.cross(points, u), u], axis=1).T
    result = analyse(elastic)
    tensions = result.elastic.springs.tensions(result.posture.lines.lengths)
    # They bear what the weight pulls with.
    expected = np.linalg.solve(A, [0, 0, 0, 0, 0, -20 * 9.81])
    assert tensions == pytest.approx(expected, rel=1e-9)
    assert expected[:3].min() > 0.0 > expected[3:].min()
    # A way out ends where the first cable would push, whatever the struts carry.
    rays = cartstiff.workspace(elastic, radius=0.5, directions=50, fits=False).positions
    cut = rays.first < 0.49
    assert cut.sum() > 10
    for p in rays.directions[cut] * rays.first[cut, None]:
        lines = points + p - anchors
        u = lines / np.linalg.norm(lines, axis=1)[:, None]
        A = np.concatenate([np.cross(points, u), u], axis=1).T
        t = np.linalg.solve(A, [0, 0, 0, 0, 0, -20 * 9.81])
        assert abs(t[:3].min()) <= 1e-3 * np.abs(t).max()
    refuses("one would have to push", analyse, _mixed(tmp_path, {}, True, gravity=[0, 0, -9.81])[0])
    refuses(r"key unilateral.*6, one per leg, got 2", _mixed, tmp_path, {}, [True, False])
    refuses("cables cannot push", _mixed, tmp_path, {"force": [-100.0, -50.0]})
    limited, *_ = _mixed(tmp_path, {"force": [-1e4, 1e4]}, gravity=[0, 0, -9.81])
    assert limited.mechanism.leg_limits.forces[:, 0].tolist() == [0, 0, 0, -1e4, -1e4, -1e4]
    limits = cartstiff.workspace(limited, radius=0.5, directions=50, fits=False).positions
    assert limits.first[cut] == pytest.approx(rays.first[cut], rel=1e-6)


def test_cables_that_come_to_rest_far_away(tmp_path):
    """Balance by a sum over seven cables; the way there begins where motions are free."""
    rng = np.random.default_rng(5)
    for m in (8, 7):
        anchors, points = rng.uniform(-1, 1, (m, 3)), 0.2 * rng.uniform(-1, 1, (m, 3))
        legs = {"stiffness": rng.uniform(1e4, 5e4, m), "preload": rng.uniform(50, 300, m)}
        legs["driven"] = False  # ropes of fixed lengths, far from balance at the file's pose
    pose = {"xyz": [0.05, 0.1, -0.03], "rpy": [0.1, -0.2, 0.3]}
    frame = {"xyz": [0.02, 0.01, 0.05], "rpy": [0, 0.3, 0]}
    keys = {"unilateral": True, "base": anchors, "platform": points, "pose": pose, "frame": frame}
    elastic = load(write_file(tmp_path, kind="springs", legs=legs, **keys))
    force = np.array([5.0, -8.0, -20.0])
    found = equilibrium(elastic, DeadForce(force))
    T, b = found.pose, elastic.mechanism.points
    ends = b @ T[:3, :3].T
    lines = ends + T[:3, 3] - anchors
    lengths = np.linalg.norm(lines, axis=1)
    tensions = legs["stiffness"] * np.maximum(lengths - elastic.springs.rest_length, 0.0)
    pulls = (tensions / lengths)[:, None] * lines
    assert pulls.sum(axis=0) == pytest.approx(force, abs=1e-6)
    assert np.cross(ends, pulls).sum(axis=0) == pytest.approx(np.zeros(3), abs=1e-6)
    slack = [int(i) + 1 for i in np.flatnonzero(tensions == 0.0)]
    assert note(found, "slack").values == {"slack": slack}
