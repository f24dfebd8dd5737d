"""What is built from this tree installs and works away from it."""

import json
import os
import subprocess
import sys
import tarfile
import zipfile
from pathlib import Path

import pytest

from cartstiff import __version__

ROOT = Path(__file__).resolve().parents[2]
ROBOTS = sorted(path.name for path in (ROOT / "robots").iterdir())


def run(*command, cwd, **environment):
    """Standard output of a command that must succeed."""
    done = subprocess.run(
        [str(part) for part in command],
        cwd=cwd,
        env=os.environ | environment,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def installed(wheel, tmp_path_factory):
    """A folder that holds the installed wheel; its dependencies are this environment's."""
    target = tmp_path_factory.mktemp("site")
    pip = [sys.executable, "-m", "pip", "--disable-pip-version-check", "--quiet"]
    run(*pip, "install", "--no-deps", "--no-index", "--target", target, wheel, cwd=target)
    return target


def test_sdist_holds_what_builds_tests_and_describes_the_package(sdist):
    with tarfile.open(sdist) as archive:
        names = {name.partition("/")[2] for name in archive.getnames()}
    wanted = ["LICENSE", "README.md", "CHANGELOG.md", "CITATION.cff", "Makefile", "pyproject.toml"]
    wanted += ["CONTRIBUTING.md", "examples/notebooks/energy_to_matrices.ipynb", "docs/index.md"]
    wanted += ["requirements.lock", "requirements-dev.lock", "src/cartstiff/py.typed"]
    wanted += [f"robots/{name}" for name in ROBOTS]
    assert names.issuperset(wanted), set(wanted) - names


def test_wheel_holds_the_package_the_robots_and_nothing_else(wheel):
    with zipfile.ZipFile(wheel) as archive:
        names = set(archive.namelist())
        licences = [name for name in names if name.endswith("licenses/LICENSE")]
        entry_points = next(name for name in names if name.endswith("entry_points.txt"))
        assert "cartstiff = cartstiff.__main__:main" in archive.read(entry_points).decode()
    assert wheel.name == f"cartstiff-{__version__}-py3-none-any.whl"
    assert licences
    package = {name for name in names if name.startswith("cartstiff/")}
    assert {name.partition("/")[0] for name in names - package} == {
        f"cartstiff-{__version__}.dist-info"
    }
    assert "cartstiff/py.typed" in package
    assert {f"cartstiff/robots/{name}" for name in ROBOTS} <= package
    source = ROOT / "src"
    modules = {path.relative_to(source).as_posix() for path in source.rglob("*.py")}
    assert {name for name in package if name.endswith(".py")} == modules


def test_installed_wheel_analyses_the_platform_from_elsewhere(installed, tmp_path):
    where = run(
        sys.executable,
        "-c",
        "import cartstiff; print(cartstiff.__file__)",
        cwd=tmp_path,
        PYTHONPATH=str(installed),
    )
    assert Path(where.strip()).is_relative_to(installed)  # and not the checkout
    out = run(
        sys.executable,
        "-m",
        "cartstiff",
        "analyse",
        "stewart-gough",
        "--json",
        cwd=tmp_path,
        PYTHONPATH=str(installed),
    )
    data = json.loads(out)
    assert data["schema"] == "cartstiff/1"
    assert data["mechanism"]["name"] == "stewart-gough"
    assert all(len(data["stiffness"][name]) == 6 for name in "ABKF")


def test_installed_wheel_lists_its_bundled_mechanisms(installed, tmp_path):
    out = run(
        sys.executable,
        "-m",
        "cartstiff",
        "models",
        "--json",
        cwd=tmp_path,
        PYTHONPATH=str(installed),
    )
    stems = [Path(name).stem for name in ROBOTS if name.endswith(".yaml")]
    assert sorted(json.loads(out)["bundled"]) == sorted(stems)


def test_sources_of_every_bundled_file_are_told():
    told = (ROOT / "robots/SOURCES.md").read_text(encoding="utf-8")
    untold = [name for name in ROBOTS if f"`{name}`" not in told and name != "SOURCES.md"]
    assert not untold, f"robots/SOURCES.md says nothing of {', '.join(untold)}"
