"""What a fit finds: steps of placements, and keys of the file."""

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from tests.identify.test_more_unknowns import _measured
from tests.inner import rates_by_step, written_values
from tests.mechanisms.machines import write_file
from tests.mechanisms.test_soft_contacts import data_of

import cartstiff
from cartstiff import load
from cartstiff.identify import identify


@pytest.mark.parametrize("word", ["tool", "base"])
def test_turned_tools_and_bases_change_by_a_step_as_differences_say(word):
    """Rotation vectors by Pinocchio: a tool's step turns after what was found, a base's before."""
    turn, h = np.array([0.6, -0.4, 0.9]), 1e-6
    found = dict(zip([f"{word}.r{axis}" for axis in "xyz"], turn, strict=True))
    rates, R = rates_by_step(found, word), pin.exp3(turn)
    for i, e in enumerate(h * np.eye(3)):
        more, less = (pin.exp3(e), pin.exp3(-e))
        ends = (more @ R, less @ R) if word == "tool" else (R @ more, R @ less)
        rate = (pin.log3(ends[0]) - pin.log3(ends[1])) / (2.0 * h)
        assert rates[3:, 3 + i] == pytest.approx(rate, abs=1e-8)
    assert rates[:3, :3] == pytest.approx(R if word == "base" else np.eye(3), abs=1e-12)
    assert not rates[:3, 3:].any()


def test_springs_that_were_found_are_written_where_the_contact_has_them(tmp_path):
    from tests.inner import _put_joints

    data = data_of({"normal": 3000, "tangential": 2000, "spin": 0.5})
    elastic = load(write_file(tmp_path, "grasp", **data))
    found = {"leg2/contact.tz": 4000.0, "leg2/contact.ty": 2500.0, "leg2/contact.z": 0.7}
    leg = data["legs"][1]
    _put_joints(leg, elastic.with_springs(found), "leg2/")
    expected = {"normal": 4000.0, "tangential": [2000.0, 2500.0], "spin": 0.7}
    for key, value in expected.items():
        np.testing.assert_allclose(leg["contact_stiffness"][key], value, rtol=1e-12)
    again = load(write_file(tmp_path, "again", **data))
    assert again.springs.stiffness.tolist() == pytest.approx(
        elastic.with_springs(found).springs.stiffness.tolist()
    )


def test_a_compliance_that_is_zero_but_for_roundoff_is_written_as_one_that_can_be_read():
    """The spring and its finding are the same number: a file in which they differ is refused."""
    elastic = cartstiff.load("ur5")
    result = identify(elastic, _measured(elastic, 12, 1e-6))
    first = replace(result.estimates[0], compliance=1e-21, interval=(0.0, 1e-21))
    values = written_values(result.unknowns, (first, *result.estimates[1:]))
    springs = result.unknowns.mechanism(values).springs
    assert 1.0 / springs.stiffness[0] == pytest.approx(values[0], rel=1e-12)
