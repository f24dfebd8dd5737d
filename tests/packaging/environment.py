"""An environment that holds what cartstiff declares as needed, and nothing else; no network.

The packages are links to those of the running environment. What cartstiff imports without
declaring it is therefore missing, as it would be for a user.
"""

import csv
import os
import subprocess
import sys
import tomllib
import venv
from collections import Counter
from importlib.metadata import distribution, distributions
from pathlib import Path

from packaging.requirements import Requirement

ROOT = Path(__file__).resolve().parents[2]


def requirements(distribution, extra=""):
    """Names of the packages that a distribution needs here, with an extra or without."""
    found = [Requirement(text) for text in distribution.requires or []]
    return [r.name for r in found if r.marker is None or r.marker.evaluate({"extra": extra})]


def closure(extra=""):
    """Distributions that cartstiff needs, directly and indirectly; itself left out.

    What it declares is read from pyproject.toml: an installed copy may be older.
    """
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    texts = list(project["dependencies"])
    if extra:
        texts += project["optional-dependencies"][extra]
    waiting = [Requirement(text).name for text in texts]
    found = {}
    while waiting:
        name = waiting.pop()
        if name.lower() in found:
            continue
        found[name.lower()] = distribution(name)
        waiting += requirements(found[name.lower()])
    return found


def _files(distribution):
    """Files inside site-packages; scripts and headers stay where they are."""
    rows = csv.reader((distribution.read_text("RECORD") or "").splitlines())
    return [row[0] for row in rows if row[0][:2] != ".." and "__pycache__" not in row[0]]


def _link(target, source):
    target.parent.mkdir(parents=True, exist_ok=True)
    if not target.exists():
        target.symlink_to(source)


def python_of(folder):
    """The environment's interpreter."""
    return folder / "bin" / "python"


def make(folder):
    """Make the environment; its interpreter."""
    venv.create(folder, with_pip=False, symlinks=True)
    version = f"python{sys.version_info.major}.{sys.version_info.minor}"
    site = folder / "lib" / version / "site-packages"
    # A folder that several distributions share is linked file by file, any other as a whole.
    owners = Counter(
        top for d in distributions() for top in {name.partition("/")[0] for name in _files(d)}
    )
    for needed in closure().values():
        source = Path(str(needed.locate_file("")))
        names = {
            n.partition("/")[0] if owners[n.partition("/")[0]] == 1 else n for n in _files(needed)
        }
        for name in names:
            _link(site / name, source / name)
    return python_of(folder)


def install(python, built):
    """Install a wheel or an sdist there with this environment's pip and build backend."""
    command = [sys.executable, "-m", "pip", "--disable-pip-version-check", "--quiet"]
    command += ["--python", str(python), "install", "--no-index", "--no-deps"]
    command.append("--force-reinstall")  # another file of this version may be there
    environment = dict(os.environ)
    if built.suffix == ".gz":
        command.append("--no-build-isolation")
        # The backend is not in the environment; pip finds this one's.
        environment["PYTHONPATH"] = str(Path(distribution("hatchling").locate_file("")))
    done = subprocess.run(
        [*command, str(built)], env=environment, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr


def run(*command, cwd):
    """Run there, with nothing of this environment in the way."""
    kept = {k: v for k, v in os.environ.items() if not k.startswith(("PYTHON", "CARTSTIFF"))}
    return subprocess.run(
        [str(part) for part in command],
        cwd=cwd,
        env=kept,
        capture_output=True,
        text=True,
        check=False,
    )
