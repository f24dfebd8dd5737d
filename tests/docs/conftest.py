"""The documentation, built once."""

import os
import subprocess
import sys

import pytest
from tests.docs.blocks import ROOT
from tests.docs.html_pages import Page

DOCS = ROOT / "docs"


@pytest.fixture(scope="session")
def built(tmp_path_factory):
    """Every HTML page by its path; building it is a test of its own: warnings are errors.

    `make test` has built them a moment before and says where they are.
    """
    if made := os.environ.get("CARTSTIFF_BUILT_DOCS"):
        return {path: Page(path) for path in (ROOT / made).resolve().rglob("*.html")}
    for package in ("sphinx", "myst_parser", "furo", "latex2mathml"):
        pytest.importorskip(package, reason="the documentation tools are not installed")
    target = tmp_path_factory.mktemp("docs").resolve() / "html"
    command = [sys.executable, "-m", "sphinx", "-W", "--keep-going", "-q", "-b", "html"]
    done = subprocess.run(
        [*command, "-d", str(target.parent / "doctrees"), str(DOCS), str(target)],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return {path: Page(path) for path in target.rglob("*.html")}
