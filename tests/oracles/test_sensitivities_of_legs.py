"""Derivatives by the numbers of struts, by complex steps; by those of loops, by laws of scale."""

import mpmath as mp
import numpy as np
import pytest
from tests.doors import Parameters
from tests.mechanisms.machines import write_file
from tests.support import absolute_error, relative_error
from tests.support.digits import skew

import cartstiff
from cartstiff import ConvergenceError
from cartstiff.geometry import se3

#: Required of every derivative, of its largest entry; struts give 1e-10.
EXACT = 1e-8
DIGITS = 50
PLACED = ("placement", "frame", "closure")
TINY = mp.mpf(10) ** -30
MIDDLE = [0.0, 0.0, 0.06]  # of M in P, as in the file
LOAD = [3.0, -2.0, 1.0, 50.0, 80.0, -400.0]


def strut_stiffness(i, pose, values):
    """A strut's compliance is the sum of its springs': hinges and slides about two middles."""
    R, place = mp.matrix(pose[:3, :3].tolist()), mp.matrix(pose[:3, 3].tolist())
    a, b = (
        mp.matrix([values[f"{body}.leg{i}.{x}"] for x in "xyz"]) for body in ("base", "platform")
    )
    foot, head = R.T * (a - place), b - mp.matrix(MIDDLE)  # in M
    z = head - foot
    z /= mp.sqrt(sum(x * x for x in z))
    line = z * z.T
    across, slides = mp.eye(3) - line, line / values[f"stiffness.leg{i}"]
    C = mp.zeros(6)
    for end, at in (
        ("lower", foot + values["offset.lower"] * z),
        ("upper", head - values["offset.upper"] * z),
    ):
        axial, shear, bending, torsion = (
            values[f"stiffness.{end}.{word}"] for word in ("axial", "shear", "bending", "torsion")
        )
        turns = mp.zeros(6, 3)
        turns[:3, :], turns[3:, :] = mp.eye(3), skew(at)
        C += turns * (across / bending + line / torsion) * turns.T
        slides += across / shear + line / axial
    C[3:, 3:] += slides
    return mp.inverse(C)


@pytest.fixture(scope="module")
def struts():
    result = cartstiff.analyse(cartstiff.load("flexure-hexapod"))
    return result, cartstiff.sensitivities(result)


def test_struts_by_complex_steps(struts):
    """All 52 numbers of a hexapod between flexures: springs, offsets, points."""
    result, known = struts
    nominal = dict(zip(known.names, known.values, strict=True))
    assert len(nominal) == 6 + 8 + 2 + 36
    pose, legs = np.asarray(result.pose), range(1, 7)
    with mp.workdps(DIGITS):
        exact = {name: mp.mpf(x) for name, x in nominal.items()}
        K = [strut_stiffness(i, pose, exact) for i in legs]
        whole = np.array(sum(K, mp.zeros(6)).tolist(), float)
        assert relative_error(result.K.matrix, whole) < 1e-10
        for row, (name, x) in enumerate(exact.items()):
            its = [i for i in legs if f"leg{i}" in name] or legs
            near = exact | {name: x + mp.mpc(0, TINY)}
            slopes = sum((strut_stiffness(i, pose, near) for i in its), mp.zeros(6)) / TINY
            wanted = np.array([[float(x.imag) for x in line] for line in slopes.tolist()])
            off = np.abs(known.stiffness["K"][row] - wanted)
            assert off.max() < EXACT * np.abs(wanted).max(), name
            assert known.errors[row] < EXACT


def test_all_springs_by_one_factor(tmp_path):
    """Springs of struts and of the base beneath them, all stiffer by a factor: K by the same."""
    end = {"axial": 1.2e8, "shear": 1.1e7, "bending": 33, "torsion": 236}
    result = cartstiff.analyse(
        cartstiff.load(
            write_file(
                tmp_path,
                "mounted",
                kind="stewart-gough",
                layout={
                    "base": {"radius": 0.115, "half_angle": 0.2},
                    "height": 0.06,
                    "platform": {"radius": 0.09, "half_angle": 0.2},
                },
                flexible={"base": {"stiffness": np.diag([2e5, 3e5, 1e5, 2e7, 3e7, 4e7]).tolist()}},
                legs={"strut": {"axial": 2e7, "lower": end, "upper": end}},
            )
        )
    )
    known = cartstiff.sensitivities(result)
    rows = [i for i, n in enumerate(known.names) if n.startswith("stiffness.")]
    assert "stiffness.base (link)" in known.names
    assert len(rows) == 6 + 8 + 1
    found = np.tensordot(known.values[rows], known.stiffness["K"][rows], 1)
    K = result.K.matrix
    assert relative_error(found, K) < EXACT


def test_struts_under_load_with_masses():
    """The file's one number for both ends does what both ends' numbers do together."""
    arm = cartstiff.load("flexure-hexapod").with_payload(2.0, [0.01, 0.0, 0.03])
    found = cartstiff.modes(arm, wrench=LOAD)
    known = cartstiff.sensitivities(
        found,
        reread=lambda v: cartstiff.load("flexure-hexapod", parameters=dict(v)).with_payload(
            2.0, [0.01, 0.0, 0.03]
        ),
    )
    for word in ("bending", "torsion"):
        ends = [known.index(f"stiffness.{end}.{word}") for end in ("lower", "upper")]
        file = known.index(f"parameter.{word}")
        for rows in (known.stiffness["K"], known.squares):
            assert relative_error(rows[ends].sum(axis=0), rows[file]) < EXACT


def test_legs_that_touch_each_other_hold_no_body(tmp_path):
    """It rests there with any numbers: by a parameter of its file as by its legs' springs."""
    rings = {
        "base": {"radius": 0.5, "half_angle": 0.2},
        "platform": {"radius": 0.3, "half_angle": 0.2},
        "height": 0.6,
    }
    legs = {"stiffness": "=k", "limits": [0.4, 0.9], "diameter": 0.4}
    kind = {"kind": "stewart-gough", "layout": rings, "parameters": {"k": 2e5}}
    path = write_file(tmp_path, "thick", **kind, legs=legs)
    rest = cartstiff.equilibrium(cartstiff.load(path), wrench=LOAD)
    assert "beyond-limits" in {note.code for note in rest.notes}
    known = cartstiff.sensitivities(rest, reread=lambda v: cartstiff.load(path, parameters=dict(v)))
    each = [known.index(f"stiffness.leg{i}") for i in range(1, 7)]
    found = known.pose[known.index("parameter.k")]
    assert relative_error(found, known.pose[each].sum(axis=0)) < EXACT


def test_all_lengths_by_one_factor():
    """Motors turn: stiffness about axes stays, that along them falls with the square."""
    result = cartstiff.analyse(cartstiff.load("6-rus"))
    known = cartstiff.sensitivities(result)
    each = zip(known.names, known.angles, strict=True)
    rows = [i for i, (n, turns) in enumerate(each) if n.partition(".")[0] in PLACED and not turns]
    powers = np.add.outer(*[np.repeat([0.0, -1.0], 3)] * 2)
    for letter, slopes in known.stiffness.items():
        wanted = powers * result.matrices[letter]
        found = np.tensordot(known.values[rows], slopes[rows], 1)
        assert relative_error(found, wanted) < EXACT


def test_what_parts_the_loops_has_no_derivative():
    """Planar loops close with other lengths in the plane, and never out of it."""
    result = cartstiff.analyse(cartstiff.load("five-bar"))
    known = cartstiff.sensitivities(result)
    assert {"placement.left_elbow.x", "closure.tip.y", "frame.rz", "mass.left_crank"} <= set(
        known.names
    )
    for name in ("placement.left_elbow.z", "closure.right_tip.z", "placement.left_motor.rx"):
        assert name not in known.names
        assert name in known.left_out
    mechanism, parameters = result.elastic.mechanism, Parameters(result)
    for name in parameters.misfits:  # each, a little larger, leaves a gap at every posture near
        moved = mechanism.with_numbers({name: mechanism.numbers()[name].value + 1e-6})
        try:
            far = absolute_error(moved.closed(result.q).q, result.q)
        except ConvergenceError:
            far = np.inf
        assert far > 1e-2, name


def test_links_that_give_have_no_joints_to_be_placed():
    """Virtual joints are how a link bends, not parts that someone mounts."""
    elastic = cartstiff.load("delta")
    names = Parameters(cartstiff.analyse(elastic)).nominal
    assert "placement.leg1/wrist_tilt.x" in names
    assert not [n for n in names if "forearm." in n and n.startswith("placement")]


def test_moved_frames_of_a_weld_turn_the_body_of_the_other_leg():
    """A leg's grip moved one way is all other grips, and the frame, moved the other way."""
    result = cartstiff.analyse(cartstiff.load("6-rus"))
    chain, q = result.elastic.mechanism, result.q
    x = chain.numbers()
    T = se3.pose(translation=[1e-3, 0.0, 0.0])
    name = "closure.body of leg 2"
    moved = chain.with_numbers({f"{name}.x": x[f"{name}.x"].value + 1e-3})
    before, after = (c.placement("body of leg 2").T_j_f for c in (chain, moved))
    assert np.allclose(after[:3, 3] - before[:3, 3], T[:3, 3], atol=1e-15)
    assert np.abs(moved.closed(q).residual).max() < 1e-12


def test_rounding_is_told_as_zero():
    """Motors of a 3-RRR lie in its plane: modes out of it do not feel them."""
    known = cartstiff.sensitivities(cartstiff.modes(cartstiff.load("stewart-simscape")))
    sizes = np.abs(known.squares) * np.abs(known.values)[:, None]
    assert not ((sizes > 0.0) & (sizes < 1e-6)).any()
    heavier = known.of("mass.platform")
    assert heavier[5] == 0.0  # turning about its own axis
