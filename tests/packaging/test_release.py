"""One version everywhere, and licences that go together."""

import json
import re
import runpy
import tomllib
from importlib.metadata import PackageNotFoundError

import pytest
from packaging.requirements import Requirement
from ruamel.yaml import YAML
from tests.packaging.environment import ROOT, closure

from cartstiff import __version__

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
EXTRAS = ["", *PROJECT["optional-dependencies"]]

# Permissive: to keep their notices is all they ask of who uses the package.
PERMISSIVE = {
    "0BSD",
    "Apache-2.0",
    "Apache-2.0 WITH LLVM-exception",
    "BSD",
    "BSD-2-Clause",
    "BSD-3-Clause",
    "BSL-1.0",
    "CC0-1.0",
    "ISC",
    "MIT",
    "MIT-CMU",
    "PSF-2.0",
    "Zlib",
}
# Words that packages use for them.
WORDS = {
    "Apache 2.0": "Apache-2.0",
    "Apache Software License": "Apache-2.0",
    "BSD License": "BSD",
    "ISC License (ISCL)": "ISC",
    "ISC license": "ISC",
    "MIT License": "MIT",
    "MIT license": "MIT",
    "Python Software Foundation License": "PSF-2.0",
}


def licence(distribution):
    """The licence that a package's metadata states, in SPDX's words; "" if it states none."""
    metadata = distribution.metadata
    found = [metadata.get(key, "") or "" for key in ("License-Expression", "License")]
    classifiers = metadata.get_all("Classifier") or []
    found += [c.rpartition(" :: ")[2] for c in classifiers if c.startswith("License ::")]
    short = [text for text in found if text and len(text) < 80 and text != "UNKNOWN"]
    return WORDS.get(short[0], short[0]) if short else ""


def table():
    """Licence by package, as docs/licences.md lists them."""
    text = (ROOT / "docs" / "licences.md").read_text(encoding="utf-8")
    return dict(re.findall(r"^\| `([\w.-]+)` \| ([^|]+?) \|", text, re.M))


def test_one_version_everywhere():
    citation = YAML(typ="safe").load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    assert citation["version"] == __version__
    changes = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    newest = re.search(r"^## \[(\d[^\]]*)\]", changes, re.M)
    assert newest
    assert newest[1] == __version__
    assert "version" in PROJECT["dynamic"]  # pyproject.toml has no number of its own


def test_citation_names_the_same_licence_and_a_complete_reference():
    citation = YAML(typ="safe").load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    assert citation["cff-version"] == "1.2.0"
    assert citation["license"] == PROJECT["license"]
    for key in ("message", "title", "authors"):
        assert citation[key]
    for reference in citation["references"]:
        assert {"type", "title", "authors", "year"} <= set(reference)


@pytest.mark.parametrize("extra", EXTRAS, ids=lambda name: name or "required")
def test_licences_are_permissive_or_listed(extra):
    try:
        needed = closure(extra)
    except PackageNotFoundError as missing:
        pytest.skip(f"{missing.name} of this extra is not installed")
    listed = table()
    for name, distribution in needed.items():
        stated = licence(distribution)
        if name in listed:
            # An older release may state the family alone, such as BSD.
            assert stated in listed[name], f"{name} states {stated}"
        else:
            parts = re.split(r" AND | OR ", stated)
            assert set(parts) <= PERMISSIVE, f"docs/licences.md does not list {name}: {stated!r}"


def test_every_direct_dependency_is_listed():
    texts = [*PROJECT["dependencies"]]
    texts += [text for extra in PROJECT["optional-dependencies"].values() for text in extra]
    names = {Requirement(text).name.lower() for text in texts}
    assert names <= set(table()), f"docs/licences.md does not list {names - set(table())}"


def test_actions_of_the_workflow_are_pinned_by_commit():
    """A tag can be moved to other code, a commit cannot."""
    text = (ROOT / ".github" / "workflows" / "ci.yml").read_text(encoding="utf-8")
    used = re.findall(r"uses: (.*)", text)
    assert len(used) == 8
    assert all(re.fullmatch(r"[\w/-]+@[0-9a-f]{40} # v[\d.]+", one) for one in used)


@pytest.mark.parametrize("name", ["requirements.lock", "requirements-dev.lock"])
def test_a_lock_with_hashes_has_one_for_every_package(name):
    """pip then refuses a file that is not the one that was locked."""
    text = (ROOT / name).read_text(encoding="utf-8").replace("\\\n", " ")
    lines = [line for line in text.splitlines() if re.match(r"[\w.-]+==", line)]
    assert lines
    hashed = [line for line in lines if "--hash=sha256:" in line]
    assert hashed in ([], lines)
    assert "--generate-hashes" in (ROOT / "Makefile").read_text(encoding="utf-8")


def test_an_audit_that_was_not_answered_is_no_good_news():
    """Names of packages without an answer are counted; an advisory ends the check."""
    tool = runpy.run_path(str(ROOT / "tools" / "check_release.py"))
    whole = {"name": "a", "version": "1.0", "vulns": []}
    skipped = {"name": "b", "skip_reason": "not found"}
    answer = json.dumps({"dependencies": [whole, skipped], "fixes": []})
    assert tool["judged"](answer, "") == (
        "no known advisory for 1 packages; of 1 nothing could be asked"
    )
    assert "skipped" in tool["judged"]("", "ConnectionError: no route")
    advisory = {"id": "PYSEC-1", "fix_versions": ["1.1"]}
    answer = json.dumps({"dependencies": [{**whole, "vulns": [advisory]}]})
    with pytest.raises(SystemExit, match=r"a 1\.0: PYSEC-1, fixed in 1\.1"):
        tool["judged"](answer, "")


def test_every_direct_dependency_has_a_lower_bound_that_is_audited():
    names = [
        text.partition("==")[0]
        for text in runpy.run_path(str(ROOT / "tools" / "check_release.py"))["bounds"]()
    ]
    wanted = [*PROJECT["dependencies"]]
    wanted += [text for extra in PROJECT["optional-dependencies"].values() for text in extra]
    assert {Requirement(text).name for text in wanted} <= set(names)
