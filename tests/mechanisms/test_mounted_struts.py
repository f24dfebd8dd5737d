"""A base and a platform that give, in a row with the struts between them."""

from dataclasses import replace

import numpy as np
import pytest
from tests.doors import tensions_of
from tests.mechanisms.machines import write_file
from tests.mechanisms.test_flexure_struts import AXIAL, BODY, LAYOUT, LOWER, SAME, UPPER
from tests.support import (
    gradient_of,
    refused,
    relative_error,
)

import cartstiff
from cartstiff import analyse, load
from cartstiff.extend import in_units
from cartstiff.geometry import se3

LEGS = {"strut": {"axial": AXIAL, "lower": LOWER, "upper": UPPER}}
RESTS = 1e-4 * np.array([1.0, -0.5, 2.0, 0.7, -1.0, 0.3])


def _spring(seed):
    root = np.random.default_rng(seed).normal(size=(6, 6))
    sizes = np.repeat([100.0, 3e3], 3)
    return ((root @ root.T + 6 * np.eye(6)) * np.outer(sizes, sizes)).tolist()


PLACES = {
    "base": {"xyz": [0.01, 0.02, -0.05], "rpy": [0.1, 0.2, 0.3]},
    "platform": {"xyz": [0, -0.01, 0.03], "rpy": [0.3, -0.2, 0]},
}
FLEXIBLE = {
    end: {"stiffness": _spring(i), "offset": place} for i, (end, place) in enumerate(PLACES.items())
}


def _machine(folder, legs=LEGS, **keys):
    keys = {"kind": "stewart-gough", "layout": LAYOUT, "frame": {"xyz": BODY}} | keys
    return load(write_file(folder, "machine", legs=legs, **keys))


def _place(end):
    offset = PLACES[end]
    return se3.from_roll_pitch_yaw(np.array(offset["xyz"]), np.array(offset["rpy"]))


@pytest.mark.parametrize("ends", [("base",), ("platform",), ("base", "platform")])
@pytest.mark.parametrize("legs", [LEGS, {"stiffness": AXIAL}])
def test_compliances_add_up_where_nothing_is_loaded(tmp_path, ends, legs):
    given = {end: FLEXIBLE[end] for end in ends}
    rigid, soft = _machine(tmp_path, legs), _machine(tmp_path, legs, flexible=given)
    T = rigid.mechanism.pose_of(rigid.q)
    C = np.linalg.inv(analyse(rigid).B.matrix)
    to_M = {"base": se3.inverse(T), "platform": se3.pose(translation=-np.array(BODY))}
    for end in ends:
        Ad = se3.adjoint(to_M[end] @ _place(end))
        C = C + Ad @ np.linalg.inv(FLEXIBLE[end]["stiffness"]) @ Ad.T
    assert relative_error(analyse(soft).B.matrix, np.linalg.inv(C)) <= SAME


def test_gradient_and_stiffness_are_those_of_the_energy(tmp_path):
    elastic = _machine(tmp_path, flexible=FLEXIBLE)
    struts = replace(elastic.springs, rest_length=elastic.springs.made + RESTS)
    T = elastic.mechanism.pose_of(elastic.q) @ se3.exp([0.01, -0.02, 0.015, 5e-4, -4e-4, 3e-4])
    energy, wrench, K = struts.on_pose(T)
    sizes = np.repeat([1e-3, 1e-4], 3)
    first = gradient_of(lambda x: struts.on_pose(T @ se3.exp(x))[0], sizes, 1.0)
    assert np.allclose(first * sizes, wrench * sizes, rtol=1e-9, atol=1e-10 * energy)
    K_A = gradient_of(lambda x: struts.on_pose(T @ se3.exp(x))[1], sizes, 1.0)
    size = np.sqrt(np.diag(K))
    # K^B: derivative of the wrench, less half its bracket. What the load adds is a hundred times
    # the first bound.
    assert np.abs((K - 0.5 * (K_A + K_A.T)) / np.outer(size, size)).max() <= 1e-9
    assert relative_error(K, analyse(elastic).B.matrix) > 1e-3


def test_a_load_finds_rest_lengths_with_which_it_is_borne(tmp_path):
    elastic = _machine(tmp_path, flexible=FLEXIBLE)
    wrench = np.array([1.0, 2.0, 3.0, 40.0, -30.0, 200.0])
    told = analyse(elastic, wrench=wrench)
    assert relative_error(told.elastic.springs.on_pose(told.pose)[1], wrench) <= SAME
    # The same struts, base and platform where the springs leave them, with the same tensions.
    lengths = told.elastic.springs.lengths_at(told.pose)
    assert np.abs(lengths - elastic.mechanism.leg_lengths(told.q)).max() > 1e-6
    found = tensions_of(told.elastic, told.posture)
    assert np.allclose(
        found, told.elastic.springs.stiffness * (lengths - told.elastic.springs.rest)
    )


def test_one_many_and_other_units_tell_the_same(tmp_path):
    elastic = _machine(tmp_path, flexible=FLEXIBLE)
    elastic = elastic.with_springs(rest=elastic.springs.made + RESTS)
    rng = np.random.default_rng(3)
    Q = elastic.q + rng.normal(size=(4, 6)) * np.repeat([3e-4, 1e-2], 3)
    many = cartstiff.analyse_many(elastic, Q, outputs=["B", "wrench"])
    in_mm, sizes = in_units(elastic, "mm"), np.repeat([1e3, 1.0], 3)
    for i in range(4):
        one = analyse(elastic, Q[i])
        assert relative_error(many.stiffness_B[i], one.B.matrix) <= SAME
        assert relative_error(many.wrench[i], one.wrench) <= SAME
        other = analyse(in_mm, Q[i] * np.repeat([1e3, 1.0], 3)).B.matrix
        assert relative_error(other / np.outer(sizes, sizes) * 1e3, one.B.matrix) <= SAME


def test_cables_need_a_rigid_mounting(tmp_path):
    ends = np.random.default_rng(1).normal(size=(7, 3)).tolist()
    refused(
        "cables need a rigid mounting",
        load,
        write_file(
            tmp_path,
            "cables",
            kind="springs",
            base=ends,
            platform=ends[1:] + ends[:1],
            unilateral=True,
            legs={"stiffness": 1e4},
            flexible=FLEXIBLE,
        ),
    )


def test_mass_in_a_strut_is_mass_in_its_leg(tmp_path):
    bars = {"fixed": 0.3, "moving": 0.2, "fixed_com": 0.03, "moving_com": 0.02}
    body = {"mass": 5.0}
    within = _machine(tmp_path, {"strut": LEGS["strut"] | {"mass": bars}}, body=body)
    beside = _machine(tmp_path, LEGS | {"mass": bars}, body=body)
    one, other = (cartstiff.modes(elastic).frequencies for elastic in (within, beside))
    assert np.array_equal(one, other)
    assert one[0] < 0.95 * cartstiff.modes(_machine(tmp_path, body=body)).frequencies[0]
    refused("not both", _machine, tmp_path, {"strut": LEGS["strut"] | {"mass": bars}, "mass": bars})


@pytest.mark.parametrize("driven", [True, False])
def test_a_preload_is_the_force_of_struts_on_compliant_bodies(tmp_path, driven):
    """At every commanded pose of driven struts; of passive ones at the file's pose."""
    legs = LEGS | {"preload": 150.0, "driven": driven}
    elastic = _machine(tmp_path, legs, flexible=FLEXIBLE)
    for step in (0.0, 1.0) if driven else (0.0,):
        q = elastic.q + step * np.array([2e-4, -1e-4, 3e-4, 1e-3, -1e-3, 5e-4])
        result = analyse(elastic, q)
        springs = result.elastic.springs
        forces = springs.tensions(springs.lengths_at(result.pose))
        assert forces == pytest.approx(np.full(6, 150.0), rel=1e-6)
        # A rest length is that of the energy's gradient, too.
        assert result.wrench == pytest.approx(springs.on_pose(result.pose)[1], rel=1e-6, abs=1e-6)
