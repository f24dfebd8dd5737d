"""Files are YAML 1.2, read and written as an independent reader of YAML 1.2 has it."""

import pytest
from ruamel.yaml import YAML
from tests.docs.blocks import ROOT
from tests.doors import read_yaml

from cartstiff import InputError

FILES = [*(ROOT / "robots").glob("*.yaml"), *(ROOT / "cases").glob("*/*.yaml")]
SCALARS = """a: [yes, no, on, 1:30, 0x1F, 0o17, 017, 1e5, 3.0e+4, .5, 1., -.inf, ~, null, Null]
b: {=: 1, c: true, d: FALSE, e: '1', f: "2", g: +3, h: -0.0, i: 2026-01-02, j: 1_000, k: }
l: >-
  folded
  text
m: |
  lines
  stay
n: a text
  over two lines
"""


def other(text):
    return YAML(typ="safe", pure=True).load(text)


@pytest.mark.parametrize("path", sorted(FILES), ids=lambda p: f"{p.parent.name}-{p.stem}")
def test_every_file_of_ours_is_read_as_another_reader_has_it(path):
    assert read_yaml(path)[0] == other(path.read_text(encoding="utf-8"))


def test_words_of_yaml_1_1_are_text(tmp_path):
    path = tmp_path / "scalars.yaml"
    path.write_text(SCALARS, encoding="utf-8")
    data, lines = read_yaml(path)
    expected = other(SCALARS)
    expected["b"] |= {"i": "2026-01-02", "j": "1_000"}  # neither dates nor grouped digits
    assert data == expected
    assert data["a"][:4] == ["yes", "no", "on", "1:30"]
    assert lines["m",] == 6


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("a: [1, 2\nb: 3\n", "line 2: not valid YAML"),
        ("a: {b: 1\n", "not valid YAML"),
        ("a: @\n", "line 1: not valid YAML, got found character '@'"),
        ("- " * 20000, "nested too deeply"),
        ("a: &x [*x]\n", "nested too deeply"),
        ("a: 1\na: 2\n", "key stands twice"),
        ("a: 1\n---\nb: 2\n", "one YAML document, got several"),
    ],
)
def test_what_cannot_be_read_is_refused_in_one_line(tmp_path, text, words):
    path = tmp_path / "broken.yaml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(InputError) as refused:
        read_yaml(path)
    assert words in str(refused.value).replace("; got", ", got")
    assert "\n" not in str(refused.value)
