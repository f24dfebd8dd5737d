"""Without the extra `robots`: a user's own arm works, and a hint says what is missing."""

import json

import pytest
from tests.inner import catalogue

from cartstiff.__main__ import main

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


@pytest.fixture(autouse=True)
def _no_example_robots(monkeypatch):
    """The data's folder is not found, as in an install without it."""
    monkeypatch.setattr(catalogue, "_data_directory", lambda: None)
    catalogue.example_robots.cache_clear()
    yield
    catalogue.example_robots.cache_clear()


def cartstiff(capsys, *arguments):
    """Exit code, standard output and standard error."""
    with pytest.raises(SystemExit) as caught:
        main(list(arguments))
    out, err = capsys.readouterr()
    code = caught.value.code
    assert isinstance(code, int)
    return code, out, err


def test_own_urdf_is_analysed(tmp_path, capsys):
    path = tmp_path / "two.urdf"
    path.write_text(URDF, encoding="utf-8")
    code, out, err = cartstiff(capsys, "analyse", str(path), "--json")
    assert (code, err) == (0, "")
    assert json.loads(out)["mechanism"]["joints"] == ["shoulder", "slide"]


def test_platform_is_analysed(capsys):
    code, out, err = cartstiff(capsys, "analyse", "stewart-gough", "--json")
    assert (code, err) == (0, "")
    assert json.loads(out)["stiffness"]["F"] is not None


def test_an_arm_of_the_extra_names_it_in_one_line(capsys):
    code, out, err = cartstiff(capsys, "analyse", "ur5")
    assert (code, out) == (2, "")
    assert err.count("\n") == 1
    assert "pip install 'cartstiff[robots]'" in err


def test_models_names_the_extra(capsys):
    code, out, _ = cartstiff(capsys, "models")
    assert code == 0
    assert "pip install 'cartstiff[robots]'" in out
