"""The documentation is true: its code runs, its links lead somewhere, its lists are complete."""

import importlib.util
import re
import sys
from unittest.mock import patch

import pytest
from tests.docs.blocks import ROOT, agree, blocks_of, pages, run_page
from tests.support.robots import example_robots

from cartstiff.__main__ import main
from cartstiff.extend import QUANTITIES

DOCS, SOURCES = ROOT / "docs", ROOT / "src" / "cartstiff"
_LARGEST_GALLERY = 1_500_000
_ROBOTS = re.compile(r'load\("(ur5|ur10|panda|xarm7)"|examples / "(paper_tables)')


def _module(path):
    spec = importlib.util.spec_from_file_location(path.stem, path)
    module = importlib.util.module_from_spec(spec)
    sys.modules[path.stem] = module
    spec.loader.exec_module(module)
    return module


def _with_code():
    languages = {"python", "console"}
    return [p for p in pages() if languages & {b.language for b in blocks_of(p.read_text("utf-8"))}]


# -- code blocks --------------------------------------------------------------------------------


@pytest.mark.parametrize("page", _with_code(), ids=lambda p: str(p.relative_to(ROOT)))
def test_page_prints_what_it_says(page, tmp_path, monkeypatch):
    text = page.read_text(encoding="utf-8")
    names = {m[1] for m in _ROBOTS.finditer(text) if m[1]}
    if names and not example_robots():
        pytest.skip("the page uses example robots, which are not installed")
    monkeypatch.chdir(tmp_path)
    with patch.dict(QUANTITIES):  # a page adds an entry of its own
        results = run_page(page)
    assert results, "a page with code shows no output"
    for block, printed in results:
        assert agree(block.text, printed), (
            f"{page.name}, line {block.line}: the page says\n{block.text}\nand the code\n{printed}"
        )


@pytest.mark.parametrize(
    ("expected", "got", "same"),
    [
        ("K = 1.23457 N", "K =  1.234570001 N", True),
        ("K = 1.23457 N", "K = 1.23557 N", False),
        ("1e-12", "3e-13", True),
        ("a\n...\nd 4", "a\nb\nc\nd 4", True),
        ("a\n...", "b\nc", False),
        ("x ...", "x anything", True),
        ("K^A 2", "K^B 2", False),
        ("a", "a\nb", False),
    ],
)
def test_comparison_tells_same_from_different(expected, got, same):
    assert agree(expected, got) is same


# -- lists that must be complete ----------------------------------------------------------------


def test_commands_in_the_readme_s_table_are_answered(tmp_path, monkeypatch):
    """Those without a file of the user's and without an ellipsis, as they stand there."""
    pytest.importorskip("example_robot_data")
    table = (ROOT / "README.md").read_text("utf-8").partition("## What it answers")[2]
    commands = re.findall(r"`cartstiff (\w+ ur5[^`]*)`", table.partition("\n## ")[0])
    monkeypatch.chdir(tmp_path)
    answered = 0
    for command in commands:
        if "..." not in command and command.split()[0] not in ("view", "path"):
            with pytest.raises(SystemExit) as end:
                main(command.replace(":41", ":3").split())
            assert end.value.code == 0, command
            answered += 1
    assert answered >= 4


def test_every_bibliography_key_resolves():
    known = set(
        re.findall(r"^\.\. \[(\w+)\]", (DOCS / "bibliography.rst").read_text("utf-8"), re.M)
    )
    used = {}
    for path in SOURCES.rglob("*.py"):
        for key in re.findall(r"\[([A-Za-z]\w*)\]_", path.read_text(encoding="utf-8")):
            used.setdefault(key, path.name)
    for path in pages():
        for key in re.findall(r"\{key\}`(\w+)`", path.read_text(encoding="utf-8")):
            used.setdefault(key, path.name)
    assert used
    missing = {key: place for key, place in used.items() if key not in known}
    assert not missing, f"keys without an entry in docs/bibliography.rst: {missing}"


def test_every_code_is_explained():
    codes = _module(DOCS / "_ext" / "codes.py").codes
    listed = set(
        re.findall(r"^\| `([a-z0-9-]+)` \|", (DOCS / "reference/notes.md").read_text("utf-8"), re.M)
    )
    produced = {c.code: c.module for c in codes() if not c.module.startswith("answer.analysis.")}
    missing = {code: module for code, module in produced.items() if code not in listed}
    assert not missing, f"codes without a line in docs/reference/notes.md: {missing}"
    assert not listed - set(produced), "docs/reference/notes.md lists codes that nothing produces"


def test_imports_point_one_way():
    drawing = _module(DOCS / "draw_architecture.py")
    found = drawing.imports()
    assert drawing.upward(found) == []
    picture = drawing.svg(found)
    assert all(f">{name}<" in picture for name in found)


def test_gallery_has_a_small_picture_of_every_example():
    pictures = {path.stem: path.stat().st_size for path in (DOCS / "images").glob("*.png")}
    examples = {p.stem for p in (ROOT / "examples").glob("*.py")} - {"make_gallery"}
    examples |= {p.stem for p in (ROOT / "examples" / "notebooks").glob("*.ipynb")}
    assert examples <= set(pictures), "python examples/make_gallery.py makes the missing pictures"
    assert sum(pictures.values()) < _LARGEST_GALLERY


@pytest.mark.parametrize("name", ["README.md", "CONTRIBUTING.md"])
def test_links_of_plain_pages_exist(name):
    text = re.sub(r"```.*?```", "", (ROOT / name).read_text(encoding="utf-8"), flags=re.S)
    links = [target for target in re.findall(r"\]\(([^)\s]+)\)", text) if "://" not in target]
    paths = re.findall(r"`((?:docs|examples|robots|tests)/[\w./-]+\.\w+)`", text)
    for target in [*links, *paths]:
        assert (ROOT / target).exists(), f"{name} names {target}, which does not exist"


_TABLE = re.compile(r"^\| \| cartstiff \|.*?(?=\n\n)", re.M | re.S)


def test_every_cell_of_the_comparison_that_claims_something_has_a_source():
    text = (DOCS / "comparison.md").read_text(encoding="utf-8")
    used = set(re.findall(r"\[\^(\w+)\]", "".join(_TABLE.findall(text))))
    assert used == set(re.findall(r"^\[\^(\w+)\]:", text, re.M))
