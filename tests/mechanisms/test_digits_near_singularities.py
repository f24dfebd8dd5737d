"""Near constraint and type-2 singularities the notes say how many digits the compliance has lost.

The oracles are rod directions and axes by hand, at the pose that the answer states.
"""

import mpmath
import numpy as np
import pytest
from tests.mechanisms.machines import codes, note, write_file

from cartstiff import analyse, at_pose, load

ROD, STIFFNESS = 0.31, 1e7
FIRST_AXES = np.array([[0.0, 1, 0], [0, 0, 1], [1, 0, 0]])
GROUND, PLATFORM = -0.6 * np.eye(3), -0.05 * np.eye(3)


def rods_of_orthoglide(p, mp=mpmath):
    """Directions of the three rods, and of the moments that their universal joints carry."""
    rods = []
    for i in range(3):
        d = [mp.mpf(float(p[j])) + float(PLATFORM[i, j] - GROUND[i, j]) for j in range(3)]
        across = sum(d[j] ** 2 for j in range(3) if j != i)
        d[i] = mp.sqrt(mp.mpf(ROD) ** 2 - across)
        rods.append([x / mp.mpf(ROD) for x in d])
    n = np.array(rods, float)
    return rods, np.cross(FIRST_AXES, np.cross(FIRST_AXES, n))


def singular_distance(d):
    """Where along a direction the rods first lie in one plane."""
    at = np.linspace(0.0, 0.4, 200)

    def volume(t):
        return float(np.linalg.det(np.array(rods_of_orthoglide(t * d)[0], float)))

    values = [volume(t) for t in at if max(np.abs(t * d)) < 0.2]
    i = next(i for i in range(len(values) - 1) if values[i] * values[i + 1] < 0.0)
    low, high = at[i], at[i + 1]
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if volume(low) * volume(middle) > 0.0 else (low, middle)
    return low


def lost_digits(result):
    told = [n.values for n in result.notes if n.code == "ill-conditioned"]
    return max((v["relative_error"] for v in told if v["matrix"] == "compliance"), default=1e-9)


SINGULAR = np.array([0.6, 0.6, -0.52915026])


@pytest.mark.parametrize("away", [1e-2, 1e-5, 1e-7, 1e-8, 1e-9, 1e-10])
def test_orthoglide_near_its_constraint_singularity(away):
    """Rods in one plane, and their moments too: errors go with the square of the distance."""
    elastic = load("orthoglide")
    place = (singular_distance(SINGULAR) - away) * SINGULAR
    result = analyse(elastic, at_pose(elastic, [*place, 0, 0, 0])[0])
    with mpmath.workdps(50):
        rods, _ = rods_of_orthoglide(result.pose[:3, 3])
        J = mpmath.matrix([[x / n[i] for x in n] for i, n in enumerate(rods)])
        C = np.array(((STIFFNESS * (J.T * J)) ** -1).tolist(), float)
    error = np.abs(result.compliances["B"][3:, 3:] - C).max() / np.abs(C).max()
    assert error <= lost_digits(result)
    found = codes(result)
    assert ("near-type-2-singularity" in found) == (away < 1e-2)
    assert ("near-constraint-singularity" in found) == (away < 1e-4)
    assert ("ill-conditioned" in found) == (away < 1e-4)
    # What is said is not said for nothing: a few hundred times too much at most.
    assert lost_digits(result) <= max(1e-9, 1e-13 / away**2)


def test_orthoglide_at_its_constraint_singularity():
    elastic = load("orthoglide")
    place = singular_distance(SINGULAR) * SINGULAR
    moments = rods_of_orthoglide(place)[1]
    assert np.linalg.svd(moments)[1][-1] < 1e-12  # the platform gains a rotation
    result = analyse(elastic, at_pose(elastic, [*place, 0, 0, 0])[0])
    assert "constraint-singularity" in codes(result)
    assert result.reduction.freedoms == 4
    assert result.compliances["B"] is None


def plate_on_cranks(folder, yaw, **sizes):
    """A plate in the plane on cranks and rods, turned by `yaw`."""
    legs = {"chain": "RRR", "mode": "plus", **sizes}
    pose = {"xyz": [0, 0, 0], "rpy": [0, 0, yaw]}
    return load(write_file(folder, kind="parallel", legs=legs, pose=pose))


@pytest.mark.parametrize("legs", [3, 4])
@pytest.mark.parametrize("away", [1e-1, 1e-3, 1e-7, 1e-9])
def test_plate_on_cranks_whose_rods_nearly_meet(tmp_path, legs, away):
    """All rods point nearly at one point: cranks hardly feel the plate's rotation about it."""
    crank, ring, plate, k = 0.25, 0.4, 0.1, 2e4
    C = np.array([ring + crank * np.cos(0.9), crank * np.sin(0.9)])
    rod, turn = float(np.hypot(*C) - plate), float(np.arctan2(C[1], C[0]))
    sizes = {"base": {"radius": ring}, "platform": {"radius": plate}, "crank": crank, "rod": rod}
    elastic = plate_on_cranks(tmp_path, turn, symmetry=legs, stiffness=k, **sizes)
    result = analyse(elastic, at_pose(elastic, [0, 0, 0, 0, 0, turn + away])[0])
    R = result.pose[:2, :2]
    x, yaw = result.pose[:2, 3], float(np.arctan2(R[1, 0], R[0, 0]))
    with mpmath.workdps(50):
        rows = []
        for b in (2 * mpmath.pi * i / legs for i in range(legs)):
            at = b + yaw
            B = [x[0] + plate * mpmath.cos(at), x[1] + plate * mpmath.sin(at)]
            A = [ring * mpmath.cos(b), ring * mpmath.sin(b)]
            d = [B[0] - A[0], B[1] - A[1]]
            c = (d[0] ** 2 + d[1] ** 2 + crank**2 - mpmath.mpf(rod) ** 2) / (2 * crank)
            open_ = mpmath.acos(c / mpmath.hypot(*d))
            roots = [mpmath.atan2(d[1], d[0]) + sign * open_ for sign in (-1, 1)]
            t = min(roots, key=lambda t: abs(mpmath.sin((t - b - 0.9) / 2)))
            e = [mpmath.cos(t), mpmath.sin(t)]
            n = [(d[j] - crank * e[j]) / rod for j in (0, 1)]
            rate = crank * (e[0] * n[1] - e[1] * n[0])
            arm = [B[0] - x[0], B[1] - x[1]]
            rows.append([v / rate for v in (arm[0] * n[1] - arm[1] * n[0], *n)])
        J = mpmath.matrix(rows)
        C = np.array(((k * (J.T * J)) ** -1).tolist(), float)
    T = np.eye(3)
    T[1:, 1:] = R
    found = T @ result.compliances["B"][2:5, 2:5] @ T.T
    size = np.sqrt(C.diagonal())
    assert np.abs((found - C) / np.outer(size, size)).max() <= lost_digits(result)
    assert ("ill-conditioned" in codes(result)) == (away < 1e-5)
    assert ("near-type-2-singularity" in codes(result)) == (away < 0.05)


@pytest.mark.parametrize("short", [1e-2, 1e-6, 1e-10, 0.0])
def test_leg_of_a_plate_nearly_stretched(tmp_path, short):
    """A stretched crank and rod let the plate go along them by nothing: a serial singularity."""
    crank, rod, ring, plate, k, yaw = 0.25, 0.22, 0.4, 0.1, 2e4, 0.2
    sizes = {"base": {"radius": ring}, "platform": {"radius": plate}, "crank": crank, "rod": rod}
    elastic = plate_on_cranks(tmp_path, yaw, stiffness=k, **sizes)
    away = (crank + rod - short) * np.array([np.cos(np.pi + 0.15), np.sin(np.pi + 0.15)])
    place = np.array([ring, 0.0]) + away - plate * np.array([np.cos(yaw), np.sin(yaw)])
    result = analyse(elastic, at_pose(elastic, [*place, 0, 0, 0, yaw])[0])
    found = note(result, "fewer-than-six-freedoms")
    values = np.array(found.values["singular_values"])
    # A force along the rod turns the leg's own crank alone, on a lever that vanishes with `short`.
    D = crank + rod - short
    at_B = np.arccos(min(1.0, (rod**2 + D**2 - crank**2) / (2 * rod * D)))
    sine = np.sin(np.arccos(max(-1.0, (crank**2 + rod**2 - D**2) / (2 * crank * rod))))
    C, R = result.compliances["B"], result.pose[:3, :3]
    costs = []
    for angle in (0.15 - at_B, 0.15 + at_B):
        n = R.T @ -np.array([np.cos(angle), np.sin(angle), 0.0])
        grip = R.T @ np.array([np.cos(yaw), np.sin(yaw), 0.0]) * plate
        line = np.array([*np.cross(grip, n), *n])
        costs.append(line @ C @ line)
    expected = (crank * sine) ** 2 / k
    assert min(abs(c - expected) for c in costs) <= 1e-5 * expected + 1e-15 * np.abs(C).max()
    if short == 0.0:
        assert result.reduction.rank == 2
        assert "and 1 of the 3 free motion(s) do not move it" in found.message
    else:
        near = "near-serial-singularity" in codes(result)
        assert near == (values[2] < 0.05 * values[0]) == (short < 1e-3)
        assert result.reduction.rank == 3
