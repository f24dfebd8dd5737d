"""Mutated files: either they are read, or they are refused as any other."""

import re
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from tests.inputs.test_mechanism_files import URDF
from tests.inputs.test_mjcf import ARM as MJCF

from cartstiff.cli.main import main

ROOT = Path(__file__).resolve().parents[2]
ARM = "kind: serial\nmodel: two.urdf\nframe: c\n" + (
    "offset: {xyz: [0, 0, 0.1], rpy: [0, 1.5, 0]}\nq: {j1: 0.4}\n"
    "springs: {j1: {stiffness: 3.0e5, rest: 0.3}, j2: {table: [[-1, -5], [0, 0], [1, 7]]}}\n"
    "gravity: [0, 0, -9.81]\npayload: {mass: 2, com: [0, 0, 0.1]}\n"
)
FILES = {
    "platform.yaml": (ROOT / "robots" / "stewart-gough.yaml").read_text(encoding="utf-8"),
    "arm.yaml": ARM,
    "arm.urdf": URDF,
    "arm.xml": MJCF,
}
TOKENS = re.findall(
    r"\S+",
    r"""
nan inf 1e400 -1 0 1e30 1e-30 1e300 1e-300 -0.0 true null [ ] { } < > / " ' & * ! % # : ---
é 🦾 .. ~ << | j1 j2 a b c kind legs springs revolute fixed floating planar prismatic continuous
<link/> <joint/> <body/> <freejoint/> ball slide world""",
)
TOKENS += ["", "- ", "\t", "\n", "\0", "\ufeff", "\ud7ff", "? ", "<mimic joint='j1'/>"]


@st.composite
def mutations(draw, text):
    """A few changes of bytes, of tokens, or of the order of lines."""
    kind = draw(st.sampled_from(["bytes", "tokens", "lines"]))
    if kind == "bytes":
        data = bytearray(text.encode())
        for _ in range(draw(st.integers(1, 4))):
            data[draw(st.integers(0, len(data) - 1))] = draw(st.integers(0, 255))
        return bytes(data)
    if kind == "tokens":
        words = split(text)
        for _ in range(draw(st.integers(1, 3))):
            words[draw(st.integers(0, len(words) - 1))] = draw(st.sampled_from(TOKENS))
        return "".join(words).encode()
    lines = text.splitlines(keepends=True)
    i, j = (draw(st.integers(0, len(lines) - 1)) for _ in range(2))
    action = draw(st.sampled_from(["drop", "double", "swap", "cut"]))
    if action == "drop":
        del lines[i]
    elif action == "double":
        lines.insert(j, lines[i])
    elif action == "swap":
        lines[i], lines[j] = lines[j], lines[i]
    else:
        del lines[i:]
    return "".join(lines).encode()


def split(text):
    """Words, numbers, and single signs; together the text."""
    words = []
    for sign in text:
        if (
            words
            and (sign.isalnum() or sign in "._")
            and (words[-1][-1].isalnum() or words[-1][-1] in "._")
        ):
            words[-1] += sign
        else:
            words.append(sign)
    return words


@pytest.fixture
def answer(capfd):
    def check(name):
        with pytest.raises(SystemExit) as exit_:
            main(["analyse", name, "--json"])
        out, line = capfd.readouterr()
        if exit_.value.code == 0:
            assert (line, out.count("\n")) == ("", 1)
        else:
            assert exit_.value.code == 2, line
            assert (out, line.count("\n")) == ("", 1)
            assert line.startswith("cartstiff: ")

    return check


@pytest.mark.parametrize("name", FILES)
def test_a_changed_file_is_read_or_refused(name, answer):
    Path("two.urdf").write_text(URDF, encoding="utf-8")

    # Each MJCF file is compiled by a process of its own; `make fuzz` tries many more of all.
    count = 8 if name.endswith(".xml") else 24

    @settings(max_examples=count, suppress_health_check=list(HealthCheck))
    @given(mutations(FILES[name]))
    def law(data):
        Path(name).write_bytes(data)
        answer(name)

    law()


@pytest.mark.parametrize("ending", [".yaml", ".urdf", ".xml"])
def test_any_bytes_are_refused(ending, answer):
    @settings(max_examples=15, suppress_health_check=list(HealthCheck))
    @given(
        st.binary(max_size=200) | st.text(max_size=200).map(lambda t: t.encode("utf-8", "replace"))
    )
    def law(data):
        Path(f"x{ending}").write_bytes(data)
        answer(f"x{ending}")

    law()


@pytest.mark.parametrize("option", ["--q", "--load", "--stiffness", "--rest", "--frame", "--pose"])
def test_any_text_of_an_option_is_used_or_refused(option, capfd):
    Path("two.urdf").write_text(URDF, encoding="utf-8")
    texts = st.text(alphabet="j12=,.-+e0nainf_ \n", max_size=12) | st.text(max_size=12)

    @settings(max_examples=40, suppress_health_check=list(HealthCheck))
    @given(texts.filter(lambda t: "\0" not in t))
    def law(text):
        with pytest.raises(SystemExit) as exit_:
            main(["analyse", "two.urdf", f"{option}={text}", "--json"])
        out, line = capfd.readouterr()
        assert exit_.value.code in (0, 2), line
        assert (out + line).count("\n") == 1

    law()
