"""Mechanism files: what is refused in one line with its place, and what must not be."""

import os
import re
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from tests.doors import read_yaml

import cartstiff
from cartstiff import InputError

ROOT = Path(__file__).resolve().parents[2]
PLATFORM = (ROOT / "robots" / "stewart-gough.yaml").read_text(encoding="utf-8")
URDF = """<robot name="two">
  <link name="a"/><link name="b"/><link name="c"/>
  <joint name="j1" type="revolute"><parent link="a"/><child link="b"/><axis xyz="0 0 1"/>
    <origin xyz="0 0 1"/><limit lower="-3" upper="3" effort="1" velocity="1"/></joint>
  <joint name="j2" type="revolute"><parent link="b"/><child link="c"/><axis xyz="0 1 0"/>
    <origin xyz="1 0 0"/><limit lower="-3" upper="3" effort="1" velocity="1"/></joint>
</robot>
"""
ARM = "kind: serial\nmodel: two.urdf\nframe: c\n"


def changed(old, new):
    assert PLATFORM.count(old) >= 1
    return PLATFORM.replace(old, new, 1)


def place(text, name="file.yaml"):
    Path("two.urdf").write_text(URDF, encoding="utf-8")
    Path(name).write_bytes(text if isinstance(text, bytes) else text.encode())
    return name


# -- files that are no mechanism files ------------------------------------------------------------


def _number(text):
    return PLATFORM.replace("[0, 0, 0]", f"[{text}, 0, 0]", 1).encode()


CONTENTS = {
    "white space": (b" \n\t\r\n ", "file is empty"),
    "byte order mark": (b"\xef\xbb\xbf", "one YAML document"),
    "binary": (bytes(range(256)) * 10, "not UTF-8 text"),
    "zero bytes": (bytes(4096), "zero byte"),
    "one zero byte": (PLATFORM.encode() + b"\0", "zero byte"),
    "picture": (b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR", "not UTF-8 text"),
    "Latin-1": ("name: Stäubli\n".encode("latin-1"), "not UTF-8 text"),
    "UTF-16": (PLATFORM.encode("utf-16"), "not UTF-8 text"),
    "half a character": ("name: ä".encode()[:-1], "not UTF-8 text"),
    "control character": (b"kind: \x01\n", "not valid YAML"),
    "deep brackets": (b"[" * 100_000, "nested too deeply"),
    "deep braces": (b"{a: " * 20_000, "nested too deeply"),
    "deep lists": (b"- " * 100_000 + b"1", "nested too deeply"),
    "deep keys": (b"".join(b" " * i + b"a:\n" for i in range(600)), "nested too deeply"),
    "thousand documents": (b"--- 1\n" * 20_000, "one YAML document"),
    "billion laughs": (
        b"a: &a [lol, lol]\n"
        + b"".join(
            b"%c: &%c [*%c, *%c, *%c, *%c, *%c, *%c, *%c, *%c]\n" % (i + 1, i + 1, *[i] * 8)
            for i in range(97, 120)
        ),
        "too many values",
    ),
    "half a million values": (b"kind: springs\nx: [" + b"1," * 300_000 + b"]\n", "too many values"),
    "many keys": (b"".join(b"k%d: 1\n" % i for i in range(50_000)), "too many values"),
    "number of 400 digits": (
        _number("1" + "0" * 400),
        "key base.1.1: cannot be used; expected a number",
    ),
    "number of 5000 digits": (
        _number("1" + "0" * 5000),
        "key base.1.1: cannot be used; expected a number",
    ),
    "endless name": ((PLATFORM + f"name: {'x' * 5000}\n").encode(), "at most 4000 characters"),
    "endless model": (b"kind: serial\nmodel: " + b"x" * 3000 + b".urdf\n", "File name too long"),
}


@pytest.mark.parametrize("case", CONTENTS)
def test_what_is_no_mechanism_file_is_refused(case, refused):
    content, words = CONTENTS[case]
    refused("analyse", place(content), words=("file.yaml", words))


@pytest.mark.parametrize("ending", [".yaml", ".yml", ".urdf", ".xml", ".mjcf", ".YAML", ".URDF"])
class TestPathsThatAreNoFiles:
    def test_missing(self, ending, refused):
        refused("analyse", f"none{ending}", words=(f"none{ending}", "No such file"))

    def test_below_a_file(self, ending, refused):
        place("x", "here")
        refused("analyse", f"here/none{ending}", words=("Not a directory",))

    def test_directory(self, ending, refused):
        Path(f"folder{ending}").mkdir()
        refused("analyse", f"folder{ending}", words=(f"folder{ending}", "is a directory"))

    def test_dangling_link(self, ending, refused):
        Path(f"link{ending}").symlink_to("nowhere")
        refused("analyse", f"link{ending}", words=(f"link{ending}", "No such file"))

    def test_link_to_itself(self, ending, refused):
        Path(f"loop{ending}").symlink_to(f"loop{ending}")
        refused("analyse", f"loop{ending}", words=(f"loop{ending}", "symbolic links"))

    def test_pipe(self, ending, refused):
        os.mkfifo(f"pipe{ending}")
        refused("analyse", f"pipe{ending}", words=(f"pipe{ending}", "not a regular file"))

    @pytest.mark.parametrize("device", ["/dev/zero", "/dev/null"])
    def test_device(self, ending, device, refused):
        Path(f"device{ending}").symlink_to(device)
        refused("analyse", f"device{ending}", words=(f"device{ending}", "not a regular file"))

    def test_huge(self, ending, refused):
        with Path(f"huge{ending}").open("wb") as file:
            file.truncate(1 << 40)
        refused("analyse", f"huge{ending}", words=(f"huge{ending}", "too large", str(1 << 40)))

    @pytest.mark.skipif(os.geteuid() == 0, reason="root reads everything")
    def test_unreadable(self, ending, refused):
        place("kind: serial\n", f"closed{ending}")
        Path(f"closed{ending}").chmod(0)
        refused("analyse", f"closed{ending}", words=(f"closed{ending}", "Permission denied"))

    def test_name_too_long(self, ending, refused):
        refused("analyse", "x" * 5000 + ending, words=("File name too long",))


def test_other_ending_is_refused(refused):
    refused("analyse", place(PLATFORM, "file.txt"), words=("file.txt", ".yaml"))


# -- what must not be refused ---------------------------------------------------------------------

SAME = {
    "comments": "# before\n" + PLATFORM.replace("\nlegs:", "\n# between\nlegs: # behind"),
    "byte order mark": b"\xef\xbb\xbf" + PLATFORM.encode(),
    "carriage returns": PLATFORM.replace("\n", "\r\n").encode(),
    "no last newline": PLATFORM.rstrip("\n"),
    "document marks": "---\n" + PLATFORM + "...\n",
    "YAML 1.2": "%YAML 1.2\n---\n" + PLATFORM,
    "exponent": PLATFORM.replace("[10, 20,", "[1e1, 2.0E+1,"),
    "decimal point": PLATFORM.replace("[10, 20,", "[10., +20.0,"),
    "decimal zeros": PLATFORM.replace("[10, 20,", "[010, 0x14,"),
    "one point a line": PLATFORM.replace("- [7, 0, 0]", "-\n    - 7\n    - 0\n    - 0"),
    "quoted text": PLATFORM.replace("length: cm", 'length: "cm"').replace("force: N", "'force': N"),
    "null for absent": PLATFORM + "gravity:\nname: ~\npayload: null\n",
    "identity written out": PLATFORM + "pose: {xyz: [0, 0, 0], rpy: [0, 0, 0]}\nframe: {}\n",
    "unicode name": PLATFORM + "name: Gough-Plattform für 六足 🦾\n",
}


@pytest.mark.parametrize("case", SAME)
def test_the_same_platform_in_other_words(case, accepted):
    got, expected = accepted(place(SAME[case])), accepted("stewart-gough")
    assert got["stiffness"] == expected["stiffness"]
    assert got["wrench"] == expected["wrench"]


@pytest.mark.parametrize(
    "name",
    [
        "a b.yaml",
        "платформа.yaml",
        "file.YAML",
        "file.yml",
        "-x.yaml",
        "100%.yaml",
        "new\nline.yaml",
        b"\xff.yaml",
    ],
)
def test_names_of_files(name, accepted):
    name = os.fsdecode(name)
    place(PLATFORM, name)
    assert accepted(f"./{name}")["mechanism"]["name"] == Path(name).stem


@pytest.mark.parametrize("model", ["two.urdf", "./two.urdf", "../folder/two.urdf", "A b/ü.URDF"])
def test_model_paths_are_relative_to_the_file(model, accepted):
    folder = Path("folder")
    (folder / model).resolve().parent.mkdir(parents=True, exist_ok=True)
    folder.mkdir(exist_ok=True)
    (folder / model).resolve().write_text(URDF, encoding="utf-8")
    (folder / "arm.yaml").write_text(f"kind: serial\nmodel: {model}\n", encoding="utf-8")
    data = accepted("folder/arm.yaml")
    assert data["mechanism"]["joints"] == ["j1", "j2"]
    assert data["frame"] == "c"


def test_absolute_and_linked_paths(accepted, tmp_path):
    place(f"kind: serial\nmodel: {Path('two.urdf').resolve()}\n")
    (tmp_path / "link.yaml").symlink_to(Path("file.yaml").resolve())
    data = accepted(str(tmp_path / "link.yaml"))
    assert np.allclose(np.array(data["pose"])[:3, 3], [1, 0, 1], atol=1e-15)


@pytest.mark.parametrize("position", [0.0, 0.7, -2.0])
def test_locked_joint_is_a_fixed_joint(position, accepted):
    got = accepted(place(ARM + f"locked: {{j1: {position}}}\n"), "--q", "0.4")
    fixed = URDF.replace('name="j1" type="revolute"', 'name="j1" type="fixed"').replace(
        '<origin xyz="0 0 1"/>', f'<origin xyz="0 0 1" rpy="0 0 {position}"/>'
    )
    Path("fixed.urdf").write_text(fixed, encoding="utf-8")
    expected = accepted("fixed.urdf", "--q", "0.4", "--frame", "c")
    assert got["mechanism"]["joints"] == ["j2"]
    for key in ("pose", "jacobian"):
        assert np.allclose(got[key], expected[key], atol=1e-14)
    assert np.allclose(got["compliance"]["B"], expected["compliance"]["B"], atol=1e-16)


def test_anchors_aliases_and_repeated_lists_are_read_as_what_they_name(tmp_path):
    """As ordinary dumpers write them where two values are one object."""
    plain, aliased = tmp_path / "plain.yaml", tmp_path / "aliased.yaml"
    plain.write_text(PLATFORM, encoding="utf-8")
    text = changed("[7, 0, 0]\n  - [7, 0, 0]", "&p [7, 0, 0]\n  - *p")
    aliased.write_text(text, encoding="utf-8")
    one, other = cartstiff.load(plain), cartstiff.load(aliased)
    assert np.array_equal(
        cartstiff.analyse(one).matrices["A"], cartstiff.analyse(other).matrices["A"]
    )


def test_merged_keys_are_those_of_the_mapping_that_they_name(tmp_path):
    """YAML's merge: keys that stand here count first, then those of the first mapping named."""
    path = tmp_path / "merged.yaml"
    text = changed("legs:\n", "legs:\n  <<: [{preload: 1}, {mass: {fixed: 1.0, radius: 0.1}}]\n")
    path.write_text(text.replace("  rest_length: [11, 12, 13, 14, 15, 16]\n", ""))
    elastic = cartstiff.load(path)
    assert elastic.masses["legs"] == 6.0
    assert np.allclose(elastic.springs.preload, 1.0)
    data, lines = read_yaml(
        _written(tmp_path, "a: &a {x: 1, y: {z: 1}}\nb: {<<: *a, x: 2}\nc:\n  <<: [{x: 3}, *a]\n")
    )
    assert data["b"] == {"x": 2, "y": {"z": 1}}
    assert data["c"] == {"x": 3, "y": {"z": 1}}
    assert (lines[("b", "x")], lines[("b", "y")], lines[("c", "x")]) == (2, 1, 4)


def test_mappings_that_grow_by_merging_are_refused(tmp_path):
    """They stay small in memory, and would take for ever."""
    names = "abcdefghijkl"
    text = "a: &a {k: 1}\n" + "".join(
        f"{new}: &{new} {{<<: [{', '.join([f'*{old}'] * 9)}]}}\n" for old, new in pairwise(names)
    )
    with pytest.raises(InputError, match="too many values"):
        read_yaml(_written(tmp_path, text))
    with pytest.raises(InputError, match="nested too deeply"):
        read_yaml(_written(tmp_path, "a: &a {<<: *a, b: 1}\n"))


def _written(folder, text):
    path = folder / "f.yaml"
    path.write_text(text, encoding="utf-8")
    return path


def test_a_folded_text_holds_no_marks_of_its_lines(tmp_path):
    path = tmp_path / "folded.yaml"
    path.write_text("source: >-\n  one\n  two\n\n  three\n", "utf-8")
    assert read_yaml(path)[0] == {"source": "one two\nthree"}


@pytest.mark.parametrize(
    ("there", "instead", "told"),
    [
        (
            "crank: {beam",
            "crank: {stiffness: [1, 2, 3, 4, 5, 6]} #",
            "legs.1.flexible.crank.stiffness.1",
        ),
        ("frame: end", "fram: end", "legs.1.fram: unknown key"),
        ("grip: {xyz: [", "grip: {xyz: [1, ", "legs.1.grip.xyz: wrong count"),
        ("{stiffness: 2.0e4}", "{stifness: 2.0e4}", "legs.1.springs.motor.stifness: unknown key"),
        ("passive: [elbow, wrist]", "passive: elbow", "legs.1.passive: cannot be used"),
        ("model: rrr-leg.urdf", "chain: RRR", "legs.1.frame: unknown key"),
    ],
)
def test_errors_of_a_leg_are_those_of_the_kind_that_is_meant(there, instead, told, tmp_path):
    # A leg by name has a `base` with other keys: its errors hid those of a leg that is described.
    text = (ROOT / "robots" / "3-rrr.yaml").read_text(encoding="utf-8")
    assert there in text
    path = tmp_path / "legs.yaml"
    path.write_text(text.replace(there, instead, 1), encoding="utf-8")
    (tmp_path / "rrr-leg.urdf").write_bytes((ROOT / "robots" / "rrr-leg.urdf").read_bytes())
    with pytest.raises(InputError, match=re.escape(told)):
        cartstiff.load(path)


def test_a_leg_by_name_among_several_is_named_by_its_place(tmp_path):
    # Its keys are those of the list's entry: there is no key legs.2.legs.
    ends = "base: {radius: 0.35, half_angle: 0.2}, platform: {radius: 0.15, half_angle: 0.2}"
    leg = f"{{chain: PUS, stiffness: 2.0e7, {ends}, rod: "
    legs = f"legs:\n  - {leg}0.5}}\n  - {leg}[0.5, 0.5]}}\n"
    path = tmp_path / "two.yaml"
    path.write_text(f"kind: parallel\npose: {{xyz: [0, 0, 0.55]}}\n{legs}", encoding="utf-8")
    with pytest.raises(InputError, match=r"two\.yaml, line 5, key legs\.2\.rod: wrong count"):
        cartstiff.load(path)
