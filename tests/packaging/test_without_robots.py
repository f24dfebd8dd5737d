"""Without the extra `robots`: a user's own arm works, and a hint says what is missing."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

URDF = """<robot name="two">
  <link name="base"/><link name="upper"/><link name="tool"/>
  <joint name="shoulder" type="revolute">
    <parent link="base"/><child link="upper"/><axis xyz="0 0 1"/>
    <limit lower="-2" upper="2" effort="1" velocity="1"/>
  </joint>
  <joint name="slide" type="prismatic">
    <parent link="upper"/><child link="tool"/><origin xyz="0.5 0 0"/><axis xyz="1 0 0"/>
    <limit lower="-1" upper="1" effort="1" velocity="1"/>
  </joint>
</robot>
"""


#: Commands in a process in which the package of the robots is not found: what each says.
RUN = """
import json, sys
sys.modules["example_robot_data"] = None
from tests.support.commands import outcome
print(json.dumps([outcome(line) for line in json.loads(sys.argv[1])]))
"""


@pytest.fixture(scope="module")
def said(tmp_path_factory):
    """Exit code, standard output and standard error by command."""
    folder = tmp_path_factory.mktemp("without")
    (folder / "two.urdf").write_text(URDF, encoding="utf-8")
    lines = (
        "analyse two.urdf --json",
        "analyse stewart-gough --json",
        "analyse ur5",
        "models",
    )
    root = Path(__file__).parents[2]
    paths = os.pathsep.join(map(str, (root / "src", root)))
    done = subprocess.run(
        [sys.executable, "-c", RUN, json.dumps(lines)],
        env=os.environ | {"PYTHONPATH": paths},
        cwd=folder,
        capture_output=True,
        check=True,
    )
    return dict(zip(lines, json.loads(done.stdout), strict=True))


def test_own_urdf_is_analysed(said):
    code, out, err = said["analyse two.urdf --json"]
    assert (code, err) == (0, "")
    assert json.loads(out)["mechanism"]["joints"] == ["shoulder", "slide"]


def test_platform_is_analysed(said):
    code, out, err = said["analyse stewart-gough --json"]
    assert (code, err) == (0, "")
    assert json.loads(out)["stiffness"]["F"] is not None


def test_an_arm_of_the_extra_names_it_in_one_line(said):
    code, out, err = said["analyse ur5"]
    assert (code, out) == (2, "")
    assert err.count("\n") == 1
    assert "pip install 'cartstiff[robots]'" in err


def test_models_names_the_extra(said):
    code, out, _ = said["models"]
    assert code == 0
    assert "pip install 'cartstiff[robots]'" in out
