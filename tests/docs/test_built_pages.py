"""The built documentation: links lead somewhere, nothing is fetched, everything is there."""

import json
import re
from urllib.parse import urlsplit

import pytest
from tests.docs.blocks import ROOT
from tests.docs.html_pages import Page, broken

from cartstiff.extend import QUANTITIES

DOCS, SOURCES = ROOT / "docs", ROOT / "src" / "cartstiff"


def _page(built, name):
    return next(page for path, page in built.items() if path.as_posix().endswith(f"/{name}"))


def test_internal_links_and_pictures_resolve(built):
    assert broken(built) == []


@pytest.mark.parametrize(
    ("link", "found"),
    [
        ('<a href="b.html#here">', []),
        ('<a href="b.html#there">', ["a.html: b.html#there (no such anchor)"]),
        ('<a href="c.html">', ["a.html: c.html"]),
        ('<a href="#nowhere">', ["a.html: #nowhere (no such anchor)"]),
        ('<img src="no.png">', ["a.html: no.png"]),
        ('<a href="https://example.org/x#y">', []),
    ],
)
def test_a_broken_link_is_found(link, found, tmp_path):
    a, b = tmp_path / "a.html", tmp_path / "b.html"
    a.write_text(link, encoding="utf-8")
    b.write_text('<p id="here">', encoding="utf-8")
    assert broken({path: Page(path) for path in (a, b)}) == found


def test_pages_load_nothing_from_outside(built):
    for page in built.values():
        outside = [r for r in page.resources if urlsplit(r).scheme or r.startswith("//")]
        outside = [r for r in outside if not r.startswith("data:")]
        assert not outside, f"{page.path.name} loads {outside}"


def test_every_module_is_in_the_reference(built):
    text = "\n".join(p.text for path, p in built.items() if path.parent.name == "api")
    for path in SOURCES.rglob("*.py"):
        if path.stem.startswith("_") or path.stem == "version":
            continue
        name = ".".join(("cartstiff", *path.relative_to(SOURCES).with_suffix("").parts))
        assert f"module-{name}" in text, f"{name} is missing from the API reference"


def test_schema_page_has_every_key(built):
    from cartstiff.extend import file_schema

    text = re.sub(r"<[^>]+>", "", _page(built, "reference/mechanism-file.html").text)
    for model in file_schema()["$defs"].values():
        for key in model.get("properties", {}):
            assert key in text
    assert json.dumps(file_schema())


def test_every_equation_of_the_theory_is_numbered_and_rendered(built):
    source = (DOCS / "theory.md").read_text(encoding="utf-8")
    labels = re.findall(r"^\$\$ \(([\w-]+)\)$", source, re.M)
    page = _page(built, "theory.html")
    numbers = re.findall(r'<span class="eqno">\((\d+)\)', page.text)
    assert [int(n) for n in numbers] == list(range(1, len(labels) + 1))
    assert page.formulas > 200
    assert not re.findall(r"<merror", page.text)


def test_gallery_shows_every_example(built):
    page = _page(built, "gallery.html")
    examples = {p.stem for p in (ROOT / "examples").glob("*.py")} - {"make_gallery"}
    examples |= {p.stem for p in (ROOT / "examples" / "notebooks").glob("*.ipynb")}
    examples |= {p.stem for p in (ROOT / "docs" / "gallery").glob("*.txt")}
    for name in examples:
        assert page.has(f"example-{name.replace('_', '-')}"), name
        assert any(r.endswith(f"/{name}.png") for r in page.resources), name


def test_notebook_pages_hold_text_code_and_output(built):
    for path in (ROOT / "examples" / "notebooks").glob("*.ipynb"):
        text = re.sub(r"<[^>]+>", "", _page(built, f"notebooks/{path.stem}.html").text)
        text = text.replace("&quot;", '"')
        for cell in json.loads(path.read_text(encoding="utf-8"))["cells"]:
            for output in cell.get("outputs", []):
                first = "".join(output["text"]).splitlines()[0].strip()
                assert first.replace("'", "&#39;") in text or first in text, first


def test_every_quantity_is_on_the_page_of_the_command_line(built):
    text = _page(built, "reference/command-line.html").text
    assert [name for name in QUANTITIES if f'<span class="pre">{name}</span>' not in text] == []
