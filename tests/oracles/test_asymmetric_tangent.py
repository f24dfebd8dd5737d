"""Principal values of an asymmetric tangent: what is held from K, what is free from C."""

from itertools import product

import numpy as np
import pytest
from tests.doors import block_ellipsoid
from tests.support.pages import numbers_shown, state_of
from tests.support.printed import text_of

import cartstiff
from cartstiff import analyse_posture
from cartstiff.maps import Trajectory, map_of

MOMENT = [3.0, -5.0, 2.0, 40.0, -30.0, -120.0]
U = np.array([0.48, -0.6, 0.64])


@pytest.fixture(scope="module", params=["dead", "follower"])
def loaded(request):
    return cartstiff.analyse(cartstiff.load("cubic"), wrench=MOMENT, load_kind=request.param)


def test_free_stiffness_is_the_force_over_the_motion_along_it(loaded):
    K = loaded.tangent
    assert np.abs(K - K.T).max() > 1e-3 * np.abs(loaded.wrench).max()
    C = np.linalg.inv(K)
    section = analyse_posture(loaded, direction=U, wrench=[0, 0, 0, *(10.0 * U)])
    given = next(row for row in section["directions"] if row["name"] == "given")
    moved = 10.0 * C[3:, 3:] @ U
    assert section["deflection"]["twist"][3:] == pytest.approx(moved, rel=1e-9)
    assert given["along"]["free"] == pytest.approx(10.0 / (moved @ U), rel=1e-9)
    assert given["about"]["free"] == pytest.approx(1.0 / (U @ C[:3, :3] @ U), rel=1e-9)
    assert given["along"]["held"] == pytest.approx(U @ K[3:, 3:] @ U, rel=1e-9)
    assert given["about"]["held"] == pytest.approx(U @ K[:3, :3] @ U, rel=1e-9)


def test_analysis_page_picture_and_map_read_the_same(loaded):
    K = loaded.tangent
    C = np.linalg.inv(K)
    blocks = {"translation": slice(3, 6), "rotation": slice(0, 3)}
    table = analyse_posture(loaded)["ellipsoids"]
    names = [
        f"{prefix}{freedom}_{others}_{end}"
        for prefix, freedom, others, end in product(
            ("", "compliance_"), blocks, ("held", "free"), ("min", "max")
        )
    ]
    here, load = Trajectory(loaded.q[None]), {"wrench": MOMENT, "load_kind": loaded.load.kind}
    found = map_of(loaded.elastic, here, names, connection="load", **load).compute()
    for freedom, block in blocks.items():
        held = np.linalg.eigvalsh(0.5 * (K + K.T)[block, block])
        free = np.linalg.eigvalsh(0.5 * (C + C.T)[block, block])
        truth = {
            ("stiffness", "held"): held,
            ("stiffness", "free"): np.sort(1.0 / free),
            ("compliance", "held"): np.sort(1.0 / held),
            ("compliance", "free"): free,
        }
        for (quantity, others), values in truth.items():
            near = pytest.approx(values, rel=1e-8)
            assert table[quantity][freedom][others]["eigenvalues"] == near
            drawn = block_ellipsoid(loaded.at(), "load", quantity, freedom, others)
            assert drawn.eigenvalues == near
            prefix = "" if quantity == "stiffness" else "compliance_"
            ends = [float(found[f"{prefix}{freedom}_{others}_{end}"][0]) for end in ("min", "max")]
            assert ends == pytest.approx(values[[0, 2]], rel=1e-8)
        for quantity, others in truth:
            state = state_of(connection="load", quantity=quantity, others=others)
            page = numbers_shown(loaded, state)
            assert page["principal"][freedom]["values"] == pytest.approx(
                truth[quantity, others], rel=1e-8
            )


def test_a_coupling_above_one_is_not_said_to_be_full():
    for name, words in (("stewart-gough", "not bounded"), ("cubic", "0 none, 1 full")):
        result = cartstiff.analyse(cartstiff.load(name))
        section = analyse_posture(result)
        lines = text_of(section).splitlines()
        line = next(x for x in lines if "coupling of" in x)
        assert words in line
        assert (section["decoupling_frame"]["coupling_before"] > 1.0) == (words == "not bounded")


TWO_BARS = """<robot name="two_bars">
<link name="w"/><link name="a"/><link name="b"/><link name="tip"/>
<joint name="j1" type="continuous"><parent link="w"/><child link="a"/><axis xyz="0 1 0"/></joint>
<joint name="j2" type="continuous"><parent link="a"/><child link="b"/><origin xyz="1 0 0"/>
<axis xyz="0 1 0"/></joint><joint name="f" type="fixed"><parent link="b"/><child link="tip"/>
<origin xyz="1 0 0"/></joint></robot>"""


def test_what_is_held_on_two_motions_comes_from_the_tangent():
    """Ziegler's column, P l / k = 2.2: the torques are ``[[1, P], [0, 1]]`` times the angles."""
    arm = cartstiff.load(TWO_BARS).with_springs([1.0, 1.0])
    column = cartstiff.analyse(arm, [0, 0], wrench=[0, 0, 0, -2.2, 0, 0], load_kind="follower")
    tangent = np.array([[1.0, 2.2], [0.0, 1.0]])
    table = analyse_posture(column)["ellipsoids"]["compliance"]
    sideways, turn = np.array([-1.0, 1.0]), np.array([1.0, -2.0])  # rad per m, rad per -rad
    for freedom, motion in (("translation", sideways), ("rotation", turn)):
        held = 1.0 / (motion @ tangent @ motion)
        values = table[freedom]["held"]["eigenvalues"]
        assert max(values, key=abs) == pytest.approx(held, rel=1e-12)
        assert drawn_last(column, freedom) == pytest.approx(held, rel=1e-12)
    lines = text_of(column).splitlines()
    shown = next(i for i, line in enumerate(lines) if "; K^load under the load: " in line)
    below = np.array(
        [[float(x) for x in line.split()[1:3]] for line in lines[shown + 2 : shown + 4]]
    )
    U = np.eye(6)[:, [5, 1]]  # along z and about y: the task axes
    joints = np.linalg.lstsq(column.jacobian, U, rcond=None)[0]
    assert lines[shown + 3].endswith(" mN m/rad | mN")
    below[1] *= 1e-3
    np.testing.assert_allclose(below, joints.T @ tangent @ joints, rtol=1e-5)


def drawn_last(column, freedom):
    """The principal value that is drawn and is not zero."""
    values = block_ellipsoid(column.at(), "load", "compliance", freedom, "held").eigenvalues
    return max(values, key=abs)
