"""Build the release, install it with its dependencies into empty environments, and use it there.

    python tools/check_release.py [--python PYTHON ...] [--extra EXTRA ...] [--lowest] [-o FOLDER]

The wheel and the sdist each go into an environment of their own, made with each PYTHON (default:
the one that runs this). With --lowest, the whole suite also runs with the lowest release of every
direct dependency. This downloads the dependencies; the tests check the same without a network.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import subprocess
import sys
import tempfile
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
# Entry of K^A in row 1, column 2 as the paper prints it, to one decimal.
PRINTED = -1725.1


def run(*command: str | Path) -> str:
    """Standard output; ends with what the command said if it fails."""
    kept = {k: v for k, v in os.environ.items() if k not in ("PYTHONPATH", "PYTHONHOME")}
    done = subprocess.run(
        [str(part) for part in command],
        cwd=tempfile.gettempdir(),
        env=kept,
        text=True,
        capture_output=True,
        check=False,
    )
    if done.returncode:
        sys.exit(f"failed: {' '.join(map(str, command))}\n{done.stdout}{done.stderr}")
    return done.stdout


def build(target: Path) -> list[Path]:
    """The sdist, and the wheel that is made from it."""
    with tempfile.TemporaryDirectory() as folder:
        run(sys.executable, "-m", "venv", folder)
        python = Path(folder) / "bin" / "python"
        run(python, "-m", "pip", "-q", "install", "build")
        run(python, "-m", "build", "--outdir", target, ROOT)
    return sorted(target.glob("cartstiff-*"))


def project() -> dict[str, Any]:
    """The project table of pyproject.toml."""
    return dict(tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"])


def bounds() -> list[str]:
    """The lowest release of every direct dependency, as a requirement of just that."""
    data = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    groups = [
        project()["dependencies"],
        *project()["optional-dependencies"].values(),
        *data["dependency-groups"].values(),
    ]
    texts = [text for group in groups for text in group if isinstance(text, str)]
    lowest = [re.fullmatch(r"([\w.-]+)>=([\w.]+)(,<[\w.]+)?", text) for text in texts]
    return sorted({f"{found[1]}=={found[2]}" for found in lowest if found})


def audit() -> Iterator[str]:
    """What pip-audit says of the locked versions and of the lowest that are allowed.

    A line where it cannot be asked, and for the packages of which it knows nothing: silence of a
    mirror without advisories is no answer.
    """
    with tempfile.TemporaryDirectory() as folder:
        run(sys.executable, "-m", "venv", folder)
        scripts = Path(folder) / "bin"
        try:
            run(scripts / "python", "-m", "pip", "-q", "install", "pip-audit")
        except SystemExit:
            yield "pip-audit: skipped, it cannot be installed here"
            return
        asked = {
            "locked versions": [ROOT / "requirements.lock", ROOT / "requirements-dev.lock"],
            "lower bounds": [Path(folder) / "lowest.txt"],
        }
        asked["lower bounds"][0].write_text("\n".join(bounds()), encoding="utf-8")
        for what, files in asked.items():
            names = [part for file in files for part in ("-r", str(file))]
            # OSV compares versions; PyPI's own service wants the exact name of a release.
            done = subprocess.run(
                [
                    str(scripts / "pip-audit"),
                    "--no-deps",
                    "--disable-pip",
                    "--format",
                    "json",
                    "--vulnerability-service",
                    "osv",
                    *names,
                ],
                text=True,
                capture_output=True,
                check=False,
            )
            yield f"pip-audit: {what}: {judged(done.stdout, done.stderr)}"


def judged(answer: str, errors: str) -> str:
    """What an answer of pip-audit means; ends if it names an advisory."""
    try:
        packages = json.loads(answer)["dependencies"]
    except (ValueError, KeyError):
        last = (errors.strip().splitlines() or ["no reason given"])[-1]
        return f"skipped, it cannot be asked here ({last[:200]})"
    found = [
        f"{p['name']} {p['version']}: {v['id']}, fixed in {', '.join(v['fix_versions'])}"
        for p in packages
        for v in p.get("vulns", ())
    ]
    if found:
        sys.exit("pip-audit: " + "; ".join(found))
    unknown = sum("skip_reason" in p for p in packages)
    words = f"no known advisory for {len(packages) - unknown} packages"
    return words + (f"; of {unknown} nothing could be asked" if unknown else "")


def use(python: str, distribution: Path, extras: list[str]) -> str:
    """Install into an empty environment, analyse the paper's platform, say what was there."""
    with tempfile.TemporaryDirectory() as folder:
        run(python, "-m", "venv", folder)
        scripts = Path(folder) / "bin"
        wanted = f"{distribution}[{','.join(extras)}]" if extras else str(distribution)
        run(scripts / "python", "-m", "pip", "-q", "install", wanted)
        run(scripts / "python", "-m", "pip", "check")
        version = run(scripts / "cartstiff", "--version").strip()
        data = json.loads(run(scripts / "cartstiff", "analyse", "stewart-gough", "--json"))
        entry = data["stiffness"]["A"][0][1]
        if abs(entry - PRINTED) > 0.05:
            sys.exit(f"{distribution.name}: K^A[1, 2] is {entry}, the paper prints {PRINTED}")
        if "robots" in extras:
            run(scripts / "cartstiff", "analyse", "ur5")
        packages = len(run(scripts / "python", "-m", "pip", "list", "--format=freeze").split())
        name = run(scripts / "python", "--version").strip()
    return f"{name}: {distribution.name} ({version}), {packages} packages"


def suite_with_lowest(python: str) -> str:
    """Run the whole suite with the lowest release of every direct dependency; its last line."""
    with tempfile.TemporaryDirectory() as folder:
        run(python, "-m", "venv", folder)
        scripts = Path(folder) / "bin"
        run(scripts / "python", "-m", "pip", "-q", "install", "uv")
        lowest = ["--resolution", "lowest-direct", "--group", f"{ROOT / 'pyproject.toml'}:dev"]
        extras = ",".join(project()["optional-dependencies"])
        install = ["pip", "install", "-q", "--python", scripts / "python", *lowest]
        run(scripts / "uv", *install, "-e", f"{ROOT}[{extras}]")
        done = subprocess.run(
            [str(scripts / "python"), "-m", "pytest", "-q", "-n", "2", "-p", "no:cacheprovider"],
            cwd=ROOT,
            env={**os.environ, "PATH": f"{scripts}:{os.environ['PATH']}", "OMP_NUM_THREADS": "1"},
            text=True,
            capture_output=True,
            check=False,
        )
    if done.returncode:
        sys.exit(f"failed with the lowest releases:\n{done.stdout}{done.stderr}")
    return f"lowest releases: {done.stdout.strip().splitlines()[-1]}"


def main() -> None:
    """Parse, build, use."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--python", action="append", default=[], help="interpreter; repeatable")
    parser.add_argument("--extra", action="append", default=[], help="extra to install; repeatable")
    parser.add_argument(
        "--lowest", action="store_true", help="run the suite with the lowest releases too"
    )
    parser.add_argument("-o", "--output", type=Path, help="keep the distributions in this folder")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        target = (options.output or Path(folder)).resolve()
        target.mkdir(parents=True, exist_ok=True)
        for line in audit():
            print(line, flush=True)
        distributions = build(target)
        for python in options.python or [sys.executable]:
            for distribution in distributions:
                print(use(python, distribution, options.extra), flush=True)
            if options.lowest:
                print(suite_with_lowest(python), flush=True)


if __name__ == "__main__":
    main()
