"""The sdist installs where only the declared packages are, and runs; so does the wheel."""

import json
from pathlib import Path

import pytest
from tests.packaging import environment

from cartstiff import __version__


@pytest.fixture(scope="module")
def scripts(sdist, tmp_path_factory):
    """Folder of the interpreter and the commands of an environment with cartstiff."""
    python = environment.make(tmp_path_factory.mktemp("empty") / "env")
    environment.install(python, sdist)
    return python.parent


def test_the_wheel_installs_what_the_sdist_does(scripts, wheel):
    """The same files with the same contents: what runs from one runs from the other."""
    records = {}
    for kind in ("sdist", "wheel"):
        if kind == "wheel":
            environment.install(scripts / "python", wheel)
        (record,) = scripts.parent.glob("lib/*/site-packages/cartstiff-*.dist-info/RECORD")
        own = ("direct_url.json", "RECORD", "REQUESTED", ".pyc")
        lines = record.read_text(encoding="utf-8").splitlines()
        records[kind] = sorted(x for x in lines if not x.split(",")[0].endswith(own))
    assert any("robots/" in line for line in records["wheel"])
    assert records["wheel"] == records["sdist"]


def test_nothing_but_the_declared_packages_is_there(scripts, tmp_path):
    code = (
        "import importlib.util as u, cartstiff; print(cartstiff.__file__); "
        "print([n for n in ('matplotlib', 'example_robot_data', 'hatchling', 'pytest', 'zarr', "
        "'xacro') if u.find_spec(n)])"
    )
    done = environment.run(scripts / "python", "-c", code, cwd=tmp_path)
    where, found = done.stdout.splitlines()
    assert Path(where).is_relative_to(scripts.parent)
    assert found == "[]"


def test_the_command_analyses_the_platform(scripts, tmp_path):
    done = environment.run(
        scripts / "cartstiff", "analyse", "stewart-gough", "--json", cwd=tmp_path
    )
    assert (done.returncode, done.stderr) == (0, "")
    data = json.loads(done.stdout)
    assert data["mechanism"]["name"] == "stewart-gough"
    assert data["stiffness"]["A"][0][1] == pytest.approx(-1725.1, abs=0.05)  # as printed


def test_the_command_knows_its_version(scripts, tmp_path):
    done = environment.run(scripts / "cartstiff", "--version", cwd=tmp_path)
    assert __version__ in done.stdout


@pytest.mark.parametrize(
    ("command", "extra"),
    [
        ("analyse ur5", "robots"),
        ("equilibrium five-bar --load 0,0,0,0,-100,0 --curve 0.1 -o curve.png", "plots"),
        ("map five-bar --random 3 --quantity condition -o five-bar.zarr", "maps"),
    ],
    ids=["robots", "plots", "maps"],
)
def test_a_missing_extra_is_named_in_one_line(scripts, tmp_path, command, extra):
    done = environment.run(scripts / "cartstiff", *command.split(), cwd=tmp_path)
    assert done.returncode == 2
    assert f"pip install 'cartstiff[{extra}]'" in done.stderr
    assert done.stderr.count("\n") == 1
    assert not list(tmp_path.iterdir())


def test_the_page_comes_with_the_plain_install(scripts, tmp_path):
    command = ["export", "cubic", "-o", "cubic.html"]
    done = environment.run(scripts / "cartstiff", *command, cwd=tmp_path)
    assert (done.returncode, done.stderr) == (0, "")
    assert (tmp_path / "cubic.html").stat().st_size > 100_000
