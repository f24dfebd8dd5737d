"""Values that would end the process: each is refused in one line."""

import subprocess
import sys

import numpy as np
import pytest

import cartstiff
from cartstiff import InputError

CALLS = {
    "inverse kinematics": "cartstiff.inverse_kinematics(arm, np.eye(4), seed=VALUE)",
    "starts": "cartstiff.inverse_kinematics(arm, np.eye(4), starts=VALUE)",
    "poses": "cartstiff.inverse_kinematics(arm, VALUE)",
    "random postures": "RandomPostures(3, VALUE, [0], [1])",
    "posture": "cartstiff.analyse(arm, VALUE)",
}
CODE = """
import sys
import numpy as np
import cartstiff
from cartstiff import InputError
from cartstiff.maps import RandomPostures
itself = []
itself.append(itself)
mixed = [0.0] * 5 + [itself]
arm = cartstiff.load("<robot name='r'><link name='a'/><link name='b'/><joint name='j' "
    "type='continuous'><parent link='a'/><child link='b'/></joint></robot>")
for value in (itself, mixed, [[itself]], "1", -1, 1.5, True, {"a": itself}):
    try:
        CALL
    except InputError as error:
        assert "\\n" not in str(error)
    else:
        assert not isinstance(value, list), value
print("alive")
"""


@pytest.mark.parametrize("name", CALLS)
def test_a_list_that_contains_itself_ends_no_process(name):
    code = CODE.replace("CALL", CALLS[name].replace("VALUE", "value"))
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.stdout == "alive\n", done.stderr


@pytest.mark.parametrize(
    "call",
    [
        lambda e, r: cartstiff.analyse_posture(r, length=5e-324),
        lambda e, r: cartstiff.analyse_posture(r, length=1e-300),
        lambda e, r: cartstiff.analyse_posture(r, mass=10**400, inertia=np.eye(3)),
        lambda e, r: cartstiff.inverse_kinematics(e, r.pose, starts=10**400),
        lambda e, r: cartstiff.inverse_kinematics(e, r.pose, starts=10**9),
    ],
)
def test_numbers_without_measure_are_refused(call):
    elastic = cartstiff.load("ur5")
    result = cartstiff.analyse(elastic)
    with pytest.raises(InputError):
        call(elastic, result)
