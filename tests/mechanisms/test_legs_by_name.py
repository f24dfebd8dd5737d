"""Machines whose legs are named in their files, against the energy over their closed forms.

The oracle shares no code with the engine: where the drives stand is written down for each machine
as a formula of its free coordinates y, and so is the pose. First and second derivatives by y are
differences with 50 digits. With tensions t of the drives, springs k and W on the body

    W . V = t . A           V = d log / dy, A = da / dy            (balance)
    C^B = V (A^T k A + t . d2a - W . d2 log)^-1 V^T
"""

import re
from dataclasses import replace
from functools import cache
from pathlib import Path

import mpmath as mp
import numpy as np
import pytest
from ruamel.yaml import YAML
from scipy.spatial.transform import Rotation
from tests.support import absolute_error
from tests.support.digits import skew, turned
from tests.support.robots import bundled_files

import cartstiff

# Two exact ways; condition numbers of 1e3 stand between.
SAME = 1e-10
STEP = mp.mpf(10) ** -14
DIGITS = 50
DELTA_HEIGHT = -0.5
#: Two struts in a plane that turns about x, and one across it: UPR, UPR, SPR.
EXECHON = [
    {
        "chain": "UPR",
        "base": {"points": [[-0.4, 0, 0], [0.4, 0, 0]]},
        "platform": {"points": [[-0.15, 0, 0], [0.15, 0, 0]]},
        "axis": [1, 0, 0],
        "end_axis": [0, 1, 0],
        "stiffness": [1e7, 2e7],
    },
    {
        "chain": "SPR",
        "base": {"points": [[0, 0.5, 0]]},
        "platform": {"points": [[0, 0.2, 0]]},
        "end_axis": [1, 0, 0],
        "stiffness": 3e7,
    },
]
EXECHON_PLACE = ("0.3", "0.1", "0.9")  # turn of the plane, turn within it, distance


def rotation(axis, angle):
    c, s = mp.cos(angle), mp.sin(angle)
    i, j = (axis + 1) % 3, (axis + 2) % 3
    R = mp.eye(3)
    R[i, i], R[j, j], R[i, j], R[j, i] = c, c, -s, s
    return R


def logarithm(R, p):
    """Twist (angular, linear) whose exponential is a small motion."""
    s = [(R[2, 1] - R[1, 2]) / 2, (R[0, 2] - R[2, 0]) / 2, (R[1, 0] - R[0, 1]) / 2]
    sine = mp.sqrt(sum(x * x for x in s))
    angle = mp.asin(sine)
    w = s if sine == 0 else [x * angle / sine for x in s]
    K = skew(w)
    # To the second order, and the steps are 1e-14.
    v = (mp.eye(3) - K / 2 + K * K / 12) * mp.matrix(p)
    return [*w, *v]


def plus(a, b, c=1):
    return [x + c * y for x, y in zip(a, b, strict=True)]


def dot(a, b):
    return sum(x * y for x, y in zip(a, b, strict=True))


def on_circle(radius, angle, z=0.0):
    return [radius * mp.cos(angle), radius * mp.sin(angle), mp.mpf(z)]


def third(k):
    return 2 * mp.pi * k / 3


def paired(half):
    return [third(k // 2) + (mp.mpf(half) if k % 2 else -mp.mpf(half)) for k in range(6)]


def carried(R, p, b):
    return plus(list(R * mp.matrix(b)), p)


def on_rail(d, along, rod, sign):
    x = dot(d, along)
    return x + sign * mp.sqrt(mp.mpf(rod) ** 2 - dot(d, d) + x * x)


def on_crank(d, zero, up, crank, rod, sign):
    a, b = dot(d, zero), dot(d, up)
    c = (dot(d, d) + mp.mpf(crank) ** 2 - mp.mpf(rod) ** 2) / (2 * mp.mpf(crank))
    return mp.atan2(b, a) + sign * mp.acos(c / mp.sqrt(a * a + b * b))


def entry(name):
    return YAML(typ="safe").load(bundled_files()[name].read_text())


def free(name):
    """The file's pose."""
    pose = entry(name)["pose"]
    r, p, y = map(mp.mpf, pose.get("rpy", [0, 0, 0]))
    return rotation(2, y) * rotation(1, p) * rotation(0, r), [mp.mpf(x) for x in pose["xyz"]]


def six(name, drive):
    """Six freedoms: y is a small twist of the body; its points stand on a circle."""
    legs = entry(name)["legs"]["platform"]
    if "half_angle" in legs:  # the platform's pairs stand between those of the base
        angles = paired(mp.pi / 3 - mp.mpf(legs["half_angle"]))
    else:
        angles = legs["angles"]
    points = [on_circle(legs["radius"], mp.mpf(a)) for a in angles]
    R0, p0 = free(name)

    def formula(y):
        K = skew(y)
        v = (mp.eye(3) + K / 2 + K * K / 6) * mp.matrix(y[3:])
        R, p = R0 * turned(y[:3]), plus(p0, list(R0 * v))
        return R, p, [drive(k, carried(R, p, b)) for k, b in enumerate(points)]

    return formula


def six_pus():
    legs = entry("6-pus")["legs"]
    base = [on_circle(legs["base"]["radius"], a) for a in paired(legs["base"]["half_angle"])]
    return six("6-pus", lambda k, B: on_rail(plus(B, base[k], -1), [0, 0, 1], legs["rod"], -1))


def hexaglide():
    legs = entry("hexaglide")["legs"]
    base = [[mp.mpf(x) for x in p] for p in legs["base"]["points"]]
    signs = [{"plus": 1, "minus": -1}[m] for m in legs["mode"]]

    def drive(k, B):
        return on_rail(plus(B, base[k], -1), [1, 0, 0], legs["rod"], signs[k])

    return six("hexaglide", drive)


def six_rus():
    legs = entry("6-rus")["legs"]
    angles = paired(legs["base"]["half_angle"])

    def drive(k, B):
        # Cranks of a pair point away from each other at zero, and rise with their angles.
        side = 1 if k % 2 else -1
        zero = [-side * mp.sin(angles[k]), side * mp.cos(angles[k]), mp.mpf(0)]
        d = plus(B, on_circle(legs["base"]["radius"], angles[k]), -1)
        return on_crank(d, zero, [0, 0, 1], legs["crank"], legs["rod"], -1)

    return six("6-rus", drive)


def tilting(name, drive):
    """Height and two angles; the third, x and y keep every point of the body in its leg's plane."""
    points = [on_circle(entry(name)["legs"]["platform"]["radius"], third(k)) for k in range(3)]
    across = [[-mp.sin(third(k)), mp.cos(third(k)), 0] for k in range(3)]
    height = free(name)[1][2]

    def formula(y):
        tilt = rotation(1, y[2]) * rotation(0, y[1])

        def body(u):
            return rotation(2, u[2]) * tilt, [u[0], u[1], height + y[0]]

        u = [mp.mpf(0)] * 3
        for _ in range(6):  # Newton's method, with differences

            def gap(u):
                R, p = body(u)
                return [dot(n, carried(R, p, b)) for n, b in zip(across, points, strict=True)]

            g, h = gap(u), mp.mpf(10) ** -25
            J = mp.matrix(3, 3)
            for j in range(3):
                moved = gap([x + (h if i == j else 0) for i, x in enumerate(u)])
                for i in range(3):
                    J[i, j] = (moved[i] - g[i]) / h
            u = plus(u, list(mp.lu_solve(J, mp.matrix(g))), -1)
        R, p = body(u)
        return R, p, [drive(k, carried(R, p, b)) for k, b in enumerate(points)]

    return formula


def three_rps():
    base = [on_circle(entry("3-rps")["legs"]["base"]["radius"], third(k)) for k in range(3)]

    def drive(k, B):
        d = plus(B, base[k], -1)
        return mp.sqrt(dot(d, d))

    return tilting("3-rps", drive)


def three_prs():
    legs = entry("3-prs")["legs"]
    base = [on_circle(legs["base"]["radius"], third(k)) for k in range(3)]
    return tilting("3-prs", lambda k, B: on_rail(plus(B, base[k], -1), [0, 0, 1], legs["rod"], -1))


def orthoglide():
    legs = entry("orthoglide")["legs"]
    base = [[mp.mpf(x) for x in p] for p in legs["base"]["points"]]
    points = [[mp.mpf(x) for x in p] for p in legs["platform"]["points"]]

    def formula(y):
        drives = [
            on_rail(
                plus(plus(y, points[k]), base[k], -1),
                [int(i == k) for i in range(3)],
                legs["rod"],
                -1,
            )
            for k in range(3)
        ]
        return mp.eye(3), list(y), drives

    return formula


def tricept():
    struts = entry("tricept")["legs"][0]
    height = free("tricept")[1][2]
    base = [on_circle(struts["base"]["radius"], third(k)) for k in range(3)]
    points = [on_circle(struts["platform"]["radius"], third(k)) for k in range(3)]

    def formula(y):
        p = plus(y, [0, 0, height])
        # The column turns about x, then about an axis across itself: its own y.
        L = mp.sqrt(dot(p, p))
        first = mp.atan2(p[1], -p[2])
        R = rotation(0, first) * rotation(1, mp.asin(-p[0] / L))
        ends = [plus(carried(R, p, b), a, -1) for a, b in zip(base, points, strict=True)]
        return R, p, [mp.sqrt(dot(d, d)) for d in ends]

    return formula


def delta():
    """With stiff forearms the body translates; cranks rise with their angles."""
    height = DELTA_HEIGHT

    def formula(y):
        p, drives = plus(y, [0, 0, mp.mpf(height)]), []
        for a in (third(k) for k in range(3)):
            d = plus(plus(p, on_circle(0.05, a)), on_circle(0.15, a), -1)
            outwards = [mp.cos(a), mp.sin(a), mp.mpf(0)]
            drives.append(on_crank(d, outwards, [0, 0, 1], 0.2, 0.45, 1))
        return mp.eye(3), p, drives

    return formula


def exechon():
    """The body's y axis is that of the plane; the last hinge, its x axis, is across its strut."""
    turn, within, away = map(mp.mpf, EXECHON_PLACE)
    ends = [(leg["base"]["points"], leg["platform"]["points"]) for leg in EXECHON]
    base, points = ([p for pair in ends for p in pair[i]] for i in (0, 1))

    def formula(y):
        t, f, r = turn + y[0], within + y[1], away + y[2]
        x = mp.tan(f) * (base[2][1] * mp.sin(t) - r)
        R = rotation(0, t) * rotation(1, f)
        p = list(rotation(0, t) * mp.matrix([x, 0, -r]))
        d = [plus(carried(R, p, b), a, -1) for a, b in zip(base, points, strict=True)]
        return R, p, [mp.sqrt(dot(v, v)) for v in d]

    return formula


@cache
def par4_turned():
    machine = cartstiff.load(Path(__file__).parents[2] / "examples/par4.yaml")
    turned = cartstiff.analyse(machine, {"motor1": 0.3, "motor2": 0.1, "motor4": -0.2})
    return replace(machine, q=turned.q), turned.pose


def par4():
    """The sides of the plate translate; the tool is in the middle of a bar between them."""
    _, T = par4_turned()
    yaw, p0 = mp.atan2(mp.mpf(T[1, 0]), mp.mpf(T[0, 0])), [mp.mpf(x) for x in T[:3, 3]]
    half_x, half_y = mp.mpf("0.06"), mp.mpf("0.09")
    corners = [(1, 1), (-1, 1), (-1, -1), (1, -1)]

    def formula(y):
        p, R = plus(p0, y[:3]), rotation(2, yaw + y[3])
        drives = []
        for a, (i, j) in zip((1, 3, 5, 7), corners, strict=True):
            end = plus(carried(R, p, [0, j * half_y, 0]), [(i - 1) * half_x, 0, 0])
            out = [mp.cos(a * mp.pi / 4), mp.sin(a * mp.pi / 4), mp.mpf(0)]
            rod = plus([half_x * i, half_y * j, mp.mpf("-0.7")], out, -mp.mpf("0.6"))
            d = plus(end, out, -mp.mpf("0.25"))
            drives.append(on_crank(d, out, [0, 0, 1], 0.35, mp.sqrt(dot(rod, rod)), 1))
        return R, p, drives

    return formula


def four_rrr():
    legs = entry("4-rrr")["legs"]
    angles = [mp.pi / 2 * k for k in range(4)]
    yaw = mp.mpf(entry("4-rrr")["pose"]["rpy"][2])

    def formula(y):
        R, p = rotation(2, yaw + y[2]), [y[0], y[1], mp.mpf(0)]
        drives = []
        for a in angles:
            d = plus(
                carried(R, p, on_circle(legs["platform"]["radius"], a)),
                on_circle(legs["base"]["radius"], a),
                -1,
            )
            outwards, up = [mp.cos(a), mp.sin(a), 0], [-mp.sin(a), mp.cos(a), 0]
            drives.append(on_crank(d, outwards, up, legs["crank"], legs["rod"], 1))
        return R, p, drives

    return formula


MACHINES = {
    "6-pus": (six_pus, 6),
    "hexaglide": (hexaglide, 6),
    "6-rus": (six_rus, 6),
    "3-rps": (three_rps, 3),
    "3-prs": (three_prs, 3),
    "orthoglide": (orthoglide, 3),
    "tricept": (tricept, 3),
    "4-rrr": (four_rrr, 3),
    "delta": (delta, 3),
    "exechon": (exechon, 3),
    "par4": (par4, 4),
}


def machine_of(name):
    if name == "par4":
        return par4_turned()[0]
    if name == "exechon":
        R, p, _ = exechon()([mp.mpf(0)] * 3)
        T = np.eye(4)
        T[:3, :3], T[:3, 3] = np.array(R.tolist(), float), [float(x) for x in p]
        return cartstiff.parallel(EXECHON, T)
    if name != "delta":
        return cartstiff.load(name)
    legs = {
        "chain": "RUU",
        "base": {"radius": 0.15},
        "platform": {"radius": 0.05},
        "crank": 0.2,
        "rod": 0.45,
        "stiffness": 1500.0,
    }
    return cartstiff.parallel(legs, [0, 0, DELTA_HEIGHT, 0, 0, 0])


@cache
def derivatives(name):
    """Values of log and drives at the file's pose, first and second derivatives by y."""
    make, n = MACHINES[name]
    with mp.workdps(DIGITS):
        formula = make()
        R0, p0, _ = formula([mp.mpf(0)] * n)

        def values(y):
            R, p, drives = formula(y)
            return [*logarithm(R0.T * R, list(R0.T * mp.matrix(plus(p, p0, -1)))), *drives]

        def at(**steps):
            return values([steps.get(f"y{i}", 0) * STEP for i in range(n)])

        f0 = at()
        single = [(at(**{f"y{i}": 1}), at(**{f"y{i}": -1})) for i in range(n)]
        slopes = np.array(
            [[float((a - b) / (2 * STEP)) for a, b in zip(*pair, strict=True)] for pair in single]
        ).T
        bends = np.zeros((len(f0), n, n))
        for i in range(n):
            for j in range(i + 1):
                if i == j:
                    second = [a + b - 2 * f for a, b, f in zip(*single[i], f0, strict=True)]
                else:
                    both, none = at(**{f"y{i}": 1, f"y{j}": 1}), at(**{f"y{i}": -1, f"y{j}": -1})
                    second = [
                        (c + d - a - b - e - g + 2 * f) / 2
                        for c, d, a, b, e, g, f in zip(
                            both, none, *single[i], *single[j], f0, strict=True
                        )
                    ]
                bends[:, i, j] = bends[:, j, i] = [float(x / STEP**2) for x in second]
        return np.array([float(x) for x in f0]), slopes, bends


@pytest.mark.parametrize("loaded", [False, True])
@pytest.mark.parametrize("name", MACHINES)
def test_stiffness_is_that_of_the_energy(name, loaded):
    machine = machine_of(name)
    f0, slopes, bends = derivatives(name)
    drives = [machine.names.index(n) for n in machine.names if re.search("/slide|/crank|^motor", n)]
    drives = [j for j in drives if machine.springs.stiffness[j] > 0]
    assert np.abs(np.angle(np.exp(1j * (machine.q[drives] - f0[6:])))).max() < SAME
    k = machine.springs.stiffness[drives]
    V, A = slopes[:6], slopes[6:]
    rest = machine.q.copy()
    if loaded:  # the drives are wound up, by hundredths
        rest[drives] += 0.01 * np.cos(1.0 + np.arange(len(drives)))
    result = cartstiff.analyse(machine.with_springs(rest=rest))
    t = k * (machine.q - rest)[drives]
    W = result.wrench
    assert absolute_error(V.T @ W, A.T @ t) <= SAME * max(1.0, np.abs(A.T @ t).max())
    H = A.T @ (k[:, None] * A) + np.tensordot(t, bends[6:], 1) - np.tensordot(W, bends[:6], 1)
    C = V @ np.linalg.solve(H, V.T)
    sizes = np.repeat([1.0, result.posture.length], 3)
    error = np.abs((result.compliances["B"] - C) / np.outer(sizes, sizes)).max()
    assert error <= SAME * np.abs(C / np.outer(sizes, sizes)).max()
    if len(V.T) == 6:
        K, found = np.linalg.inv(C), result.matrices["B"]
        error = np.abs((found - K) * np.outer(sizes, sizes)).max()
        assert error <= SAME * np.abs(K * np.outer(sizes, sizes)).max()
    if loaded:  # the load is felt: without it the matrices would be others
        plain = V @ np.linalg.solve(A.T @ (k[:, None] * A), V.T)
        assert absolute_error(plain, C) > 1e-5 * np.abs(C).max()


def test_cylindrical_struts_turn_along_with_the_body():
    """The legs of a hexapod of UCU pull as those of UPS do: k times the squares of their lines."""
    k, base, platform = 1e6, *(r * _pairs(t) for r, t in ((0.5, 0.2), (0.3, 0.8)))
    legs = {"chain": "UCU", "stiffness": k, "base": {"points": base.tolist()}}
    machine = cartstiff.parallel(
        legs | {"platform": {"points": platform.tolist()}}, [0, 0, 0.6, 0, 0, 0]
    )
    x = [0.03, -0.02, 0.65, 0.2, -0.1, 0.3]
    q, _ = cartstiff.at_pose(machine, x)
    R = Rotation.from_euler("xyz", x[3:]).as_matrix()
    along = (platform @ R.T + x[:3] - base) @ R
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    lines = np.hstack([np.cross(platform, along), along])
    rest = machine.with_springs(rest=q)
    assert cartstiff.analyse(rest, q).B.matrix == pytest.approx(k * lines.T @ lines, abs=1e-3)


def _pairs(half):
    """Points (6, 3) on a circle of radius 1, in pairs."""
    angles = (np.arange(3)[:, None] * 2 * np.pi / 3 + [-half, half]).ravel()
    return np.column_stack([np.cos(angles), np.sin(angles), 0 * angles])


def test_a_machine_with_axes_of_its_own_takes_a_pose():
    """From the straight posture to another that the body can take."""
    _, p, _ = exechon()([mp.mpf(0)] * 3)
    wanted = cartstiff.analyse(machine_of("exechon")).pose
    machine = cartstiff.parallel(EXECHON, [0, 0, -float(EXECHON_PLACE[2]), 0, 0, 0])
    roll, pitch, yaw = Rotation.from_matrix(wanted[:3, :3]).as_euler("xyz")
    q, notes = cartstiff.at_pose(machine, [*map(float, p), roll, pitch, yaw])
    assert notes == ()
    posture = machine.mechanism.at(q)
    assert max(absolute_error(posture.pose, wanted), np.abs(posture.residual).max()) < SAME
