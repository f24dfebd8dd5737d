"""Bodies with fewer than six freedoms on mechanisms with more: spins, joints beside, parallels."""

import numpy as np
import pytest
from tests.mechanisms.machines import codes, joint, note, write_file, write_urdf
from tests.support.printed import sentences_of

import cartstiff

STIFFNESS = (2e5, 3e5, 5e5)
RADIUS, PLATE, ROD, WIDTH = 0.3, 0.06, 0.4, 0.05
SPINS = 6


def rod_vectors(p):
    """From each slide to the plate's corner (3, 3), slides below the plate."""
    angles = 2 * np.pi * np.arange(3) / 3
    out = np.column_stack([np.cos(angles), np.sin(angles), np.zeros(3)])
    level = (PLATE - RADIUS) * out + np.array([*p[:2], 0.0])
    return np.column_stack([level[:, :2], np.sqrt(ROD**2 - (level[:, :2] ** 2).sum(axis=1))])


def linear_delta(folder, p):
    """Three vertical slides, each with two rods between balls, at the plate's place p."""
    joints, closures = [], []
    for k, d in enumerate(rod_vectors(p)):
        a = 2 * np.pi * k / 3
        out, aside = np.array([np.cos(a), np.sin(a), 0]), np.array([-np.sin(a), np.cos(a), 0])
        turn = (0.0, np.arctan2(np.hypot(d[0], d[1]), d[2]), np.arctan2(d[1], d[0]))
        foot = RADIUS * out + [0, 0, p[2] - d[2]]
        joints.append(joint(f"slide{k}", "base", f"s{k}", at=foot, kind="prismatic"))
        for side, sign in (("l", 1), ("r", -1)):
            rod, at = f"{k}{side}", sign * WIDTH * aside
            joints += [
                joint(f"x{rod}", f"s{k}", f"a{rod}", at=at, rpy=turn, axis=(1, 0, 0)),
                joint(f"y{rod}", f"a{rod}", f"b{rod}", axis=(0, 1, 0)),
                joint(f"z{rod}", f"b{rod}", f"rod{rod}"),
            ]
            corner = PLATE * out + at
            if (k, side) == (0, "l"):
                back = [(0, -turn[1], 0), (0, 0, -turn[2])]
                joints += [
                    joint("e1", f"rod{rod}", "e1", at=(0, 0, ROD), rpy=back[0]),
                    joint("e2", "e1", "e2", rpy=back[1], axis=(1, 0, 0)),
                    joint("e3", "e2", "corner", axis=(0, 1, 0)),
                    joint("plate", "corner", "plate", at=-corner, kind="fixed"),
                ]
            else:
                ends = {"points": [[0, 0, ROD], corner], "type": "point"}
                closures.append({"frames": [f"rod{rod}", "plate"], **ends})
    urdf = write_urdf(folder, *joints, name="delta")
    drives = [f"slide{k}" for k in range(3)]
    springs = {drive: {"stiffness": k} for drive, k in zip(drives, STIFFNESS, strict=True)}
    content = {"closures": closures, "actuated": drives, "springs": springs}
    file = write_file(folder, kind="closed-chain", model=urdf.name, frame="plate", **content)
    return cartstiff.load(file)


@pytest.mark.parametrize("p", [(0.0, 0.0, 0.5), (0.05, -0.08, 0.55)])
def test_a_linear_delta_on_spinning_rods_is_regular(tmp_path, p):
    result = cartstiff.analyse(linear_delta(tmp_path, p))
    np.testing.assert_allclose(result.pose[:3, 3], p, atol=1e-12)
    assert "fewer-than-six-freedoms" in codes(result)
    assert not [code for code in codes(result) if "singularity" in code]
    message = note(result, "fewer-than-six-freedoms").message
    assert f"in 3 of 6 directions here, and {SPINS} of the {3 + SPINS} free motion(s)" in message
    # Slides move by n . dp / n_z.
    n = rod_vectors(p)
    G = n / n[:, 2:]
    C = result.compliances["B"]
    np.testing.assert_allclose(C[3:, 3:], np.linalg.inv(G.T * STIFFNESS @ G), rtol=1e-9)
    np.testing.assert_allclose(C[:3], 0.0, atol=1e-18)
    many = cartstiff.analyse_many(result.elastic, np.repeat(result.q[None], 3, axis=0))
    assert dict(many.counts()) == {"idle-self-motion": 3}  # the spins, which are left out


def test_a_linear_delta_near_level_rods_is_nearly_singular(tmp_path):
    """Where the rods are level, slides do not move the plate sideways."""
    near = (RADIUS - PLATE) - ROD * np.cos(1e-3)
    result = cartstiff.analyse(linear_delta(tmp_path, (near, 0.0, 0.5)))
    assert "near-serial-singularity" in codes(result)
    assert "serial-singularity" not in codes(result)


def test_a_linear_delta_with_a_level_rod_is_singular(tmp_path):
    level = (RADIUS - PLATE) - ROD
    result = cartstiff.analyse(linear_delta(tmp_path, (level, 0.0, 0.5)))
    found = note(result, "serial-singularity")
    assert found.values["rank"] == 2
    assert "in 4 of 6 directions here (serial singularity)" in found.message


FEET = np.array([(np.cos(a), np.sin(a), 0.0) for a in 2 * np.pi * np.arange(3) / 3])


def three_rods(folder, lines):
    """Rods on universal joints on the floor, held by lines; the frame is on the first."""
    joints = []
    for k, foot in enumerate(FEET):
        joints += [joint(f"x{k}", "base", f"a{k}", at=foot, axis=(1, 0, 0))]
        joints += [joint(f"y{k}", f"a{k}", f"rod{k}", axis=(0, 1, 0))]
    urdf = write_urdf(folder, *joints, name="rods")
    content = {"model": urdf.name, "frame": "rod0", "closures": [], "lines": lines}
    return cartstiff.load(write_file(folder, kind="closed-chain", **content))


def test_joints_beside_those_of_the_body_are_no_singularity(tmp_path):
    """A tensegrity: its frame is on one of three rods, of which each has two freedoms."""
    ends = [[0, 0, 1], [0, 0, 1]]
    lines = [
        {"frames": [a, b], "points": ends, "stiffness": 100.0, "rest_length": length}
        for a, b, length in (
            *((f"rod{k}", f"rod{(k + 1) % 3}", 3**0.5) for k in range(3)),
            *((f"rod{k}", "base", 1.0) for k in range(2)),
        )
    ]
    result = cartstiff.analyse(three_rods(tmp_path, lines))
    assert "serial-singularity" not in codes(result)
    found = note(result, "fewer-than-six-freedoms")
    assert "in 4 of 6 directions here, and 4 of the 6 free motion(s) do not" in found.message


def planar_arm(folder, n):
    links = ["base", *(f"link{k}" for k in range(n))]
    joints = [joint(f"q{k}", links[k], links[k + 1], at=(0.3 * (k > 0), 0, 0)) for k in range(n)]
    tool = joint("tool", links[-1], "tool0", at=(0.3, 0, 0), kind="fixed")
    return cartstiff.load(write_urdf(folder, *joints, tool), stiffness=1e4)


@pytest.mark.parametrize("count", [3, 40])  # one by one, and by recorded arithmetic
def test_a_planar_arm_of_six_joints_is_singular_only_where_it_is_stretched(tmp_path, count):
    arm = planar_arm(tmp_path, 6)
    bent = np.random.default_rng(1).uniform(0.2, 0.8, (count, 6))
    many = cartstiff.analyse_many(arm, [*bent, np.zeros(6)])
    assert dict(many.counts()) == {"fewer-than-six-freedoms": count, "serial-singularity": 1}
    assert codes(cartstiff.analyse(arm, np.zeros(6)))[-1] == "serial-singularity"
    assert "fewer-than-six-freedoms" in codes(cartstiff.analyse(arm, bent[0]))


def parallel_arm(folder, tilt):
    """Two arms on parallelograms: the tool translates, and turns by the tilt of two axes."""
    joints = [
        joint("j1", "base", "a", axis=(0, 1, 0)),
        joint("l1", "a", "b", at=(0, 0, 1.0), axis=(tilt, 1, 0)),
        joint("j2", "b", "c", axis=(0, 1, 0)),
        joint("l2", "c", "tool0", at=(0.8, 0, 0), axis=(0, 1, tilt)),
    ]
    for k, lead in ((1, "j1"), (3, "j2")):
        joints[k] = joints[k].replace(
            "</joint>", f'<mimic joint="{lead}" multiplier="-1"/></joint>'
        )
    return cartstiff.load(write_urdf(folder, *joints, name=f"arm{tilt:g}"), stiffness=1e4)


@pytest.mark.parametrize("tilt", [1e-8, 1e-6, 2e-5])
def test_a_body_that_turns_by_a_tilt_of_its_axes_says_so(tmp_path, tilt):
    q = [0.4, 0.3]
    exact, tilted = (cartstiff.analyse(parallel_arm(tmp_path, t), q) for t in (0.0, tilt))
    assert "nearly-still" not in codes(exact)
    found = note(tilted, "nearly-still")
    assert found.values["half"] == "rotation"
    assert 0.5 * tilt < found.values["share"] < 2.0 * tilt
    C = [result.compliances["B"][3:, 3:] for result in (exact, tilted)]
    np.testing.assert_allclose(C[1], C[0], atol=10 * tilt * C[0].max())
    headlines = [sentences_of(result) for result in (exact, tilted)]
    assert headlines[0] == headlines[1]
    assert any("N/mm" in line for line in headlines[1])


@pytest.mark.parametrize("stiffness", [10.0, 30.0])
def test_a_mast_that_topples_is_indefinite(tmp_path, stiffness):
    """A mass of 2 kg, 1 m above a universal joint with equal springs."""
    joints = joint("x", "base", "a", axis=(1, 0, 0)), joint("y", "a", "mast", axis=(0, 1, 0))
    urdf = write_urdf(tmp_path, *joints)
    springs = {name: {"stiffness": stiffness} for name in "xy"}
    payload = {"mass": 2.0, "com": [0, 0, 1.0]}
    content = {"model": urdf.name, "frame": "mast", "springs": springs, "gravity": [0, 0, -9.81]}
    mast = cartstiff.load(write_file(tmp_path, kind="serial", payload=payload, **content))
    result = cartstiff.analyse(mast, [0.0, 0.0])
    left = stiffness - 2.0 * 9.81 * 1.0
    np.testing.assert_allclose(result.compliances["load"][0, 0], 1 / left)
    assert ("indefinite" in codes(result)) == (left < 0)
    answer = sentences_of(result)
    assert any("Not stable" in line for line in answer) == (left < 0)
    if left < 0:
        found = note(result, "indefinite")
        np.testing.assert_allclose(found.values["eigenvalues"], [left, left])
        assert "along 2 motion(s)" in found.message


def test_legs_in_compression_under_a_flat_plate_are_indefinite(tmp_path):
    """Vertical turns and slides cost -2 t / L each: six legs to three points, pushing alike."""
    corners = [[0.1, 0, 0], [-0.05, 0.08660254, 0], [-0.05, -0.08660254, 0]]
    base = [[3 * x, 3 * y, z] for z in (0.0, 1.0) for x, y, _ in corners]
    data = {
        "base": base,
        "platform": 2 * corners,
        "pose": {"xyz": [0, 0, 0.5]},
        "legs": {"stiffness": 1000, "preload": -200},
    }
    result = cartstiff.analyse(cartstiff.load(write_file(tmp_path, kind="springs", **data)))
    assert {"type-2-singularity", "indefinite"} <= set(codes(result))
    values = np.linalg.eigvalsh(result.matrices["load"])
    found = note(result, "indefinite").message
    assert f"along {int((values < 0).sum())} motion(s)" in found


@pytest.mark.parametrize("push", [2.0, -2.0])
def test_a_tensegrity_that_falls_over_is_indefinite(tmp_path, push):
    """Three rods whose tops push each other (or pull), held by guys to the centre of the floor."""
    lines, k = [], 100.0
    for i in range(3):
        for other, end, length, pull in (
            (f"rod{(i + 1) % 3}", [0, 0, 1], 3**0.5, -push),
            ("base", [0, 0, 0], 2**0.5, 6**0.5 * push),
        ):
            ends = {"frames": [f"rod{i}", other], "points": [[0, 0, 1], end]}
            lines.append(ends | {"stiffness": k, "rest_length": float(length - pull / k)})

    def energy(q):
        turned = np.cos(q[0::2]), np.sin(q[0::2]), np.cos(q[1::2]), np.sin(q[1::2])
        cx, sx, cy, sy = turned
        tops = FEET + np.column_stack([sy, -sx * cy, cx * cy])
        pairs = (
            np.linalg.norm(tops - np.roll(tops, -1, axis=0), axis=1),
            np.linalg.norm(tops, axis=1),
        )
        rests = 3**0.5 + push / k, 2**0.5 - 6**0.5 * push / k
        return sum(0.5 * k * ((x - rest) ** 2).sum() for x, rest in zip(pairs, rests, strict=True))

    h = 1e-3 * np.eye(6)
    slopes = [energy(a) - energy(-a) for a in h]
    assert np.abs(slopes).max() < 1e-8  # it is at rest
    second = [
        [(energy(a + b) - energy(a - b) - energy(b - a) + energy(-a - b)) / 4e-6 for b in h]
        for a in h
    ]
    least = np.linalg.eigvalsh(second)[0]
    assert (least < 0) == (push > 0)
    result = cartstiff.analyse(three_rods(tmp_path, lines))
    assert ("indefinite" in codes(result)) == (push > 0)
