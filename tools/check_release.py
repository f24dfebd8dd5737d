"""Build the release, install it with its dependencies into empty environments, and use it there.

    python tools/check_release.py [--python PYTHON ...] [--extra EXTRA ...] [-o FOLDER]

The wheel and the sdist each go into an environment of their own, made with each PYTHON (default:
the one that runs this). This downloads the dependencies; the tests check the same without a
network.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
# Entry of K^A in row 1, column 2 as the paper prints it, to one decimal.
PRINTED = -1725.1


def run(*command: str | Path) -> str:
    """Standard output; ends with what the command said if it fails."""
    kept = {k: v for k, v in os.environ.items() if k not in ("PYTHONPATH", "PYTHONHOME")}
    done = subprocess.run(
        [str(part) for part in command], cwd=tempfile.gettempdir(), env=kept, text=True,
        capture_output=True, check=False,
    )  # fmt: skip
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


def audit() -> str:
    """What pip-audit says of the locked versions; a line where it cannot be asked."""
    with tempfile.TemporaryDirectory() as folder:
        run(sys.executable, "-m", "venv", folder)
        scripts = Path(folder) / "bin"
        try:
            run(scripts / "python", "-m", "pip", "-q", "install", "pip-audit")
        except SystemExit:
            return "pip-audit: skipped, it cannot be installed here"
        locks = [ROOT / name for name in ("requirements.lock", "requirements-dev.lock")]
        names = [part for lock in locks for part in ("-r", str(lock))]
        done = subprocess.run(
            [str(scripts / "pip-audit"), "--no-deps", "--disable-pip", *names],
            text=True, capture_output=True, check=False,
        )  # fmt: skip
    if done.returncode == 0:
        return "pip-audit: no known advisory for the locked versions"
    if "Found " in done.stderr and "vulnerabilit" in done.stderr:
        sys.exit(f"pip-audit: {done.stderr}{done.stdout}")
    last = (done.stderr.strip().splitlines() or ["no reason given"])[-1]
    return f"pip-audit: skipped, it cannot be asked here ({last[:200]})"


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


def main() -> None:
    """Parse, build, use."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--python", action="append", default=[], help="interpreter; repeatable")
    parser.add_argument("--extra", action="append", default=[], help="extra to install; repeatable")
    parser.add_argument("-o", "--output", type=Path, help="keep the distributions in this folder")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        target = (options.output or Path(folder)).resolve()
        target.mkdir(parents=True, exist_ok=True)
        print(audit(), flush=True)
        distributions = build(target)
        for python in options.python or [sys.executable]:
            for distribution in distributions:
                print(use(python, distribution, options.extra), flush=True)


if __name__ == "__main__":
    main()
