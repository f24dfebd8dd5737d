"""The report: the answer agrees with the commands, one file, everything assumed is said."""

from __future__ import annotations

import html
import re
from html.parser import HTMLParser

import numpy as np
import pytest
from click.testing import CliRunner

import cartstiff
from cartstiff.cli.main import command as cartstiff_command
from cartstiff.errors import CartstiffError
from cartstiff.page.paper import report_page
from cartstiff.statics.equilibrium import equilibrium

ARM = "".join(
    f"<link name='l{i}'><inertial><mass value='2'/><inertia ixx='1' iyy='1' izz='1' ixy='0' "
    "ixz='0' iyz='0'/></inertial></link>"
    + (
        f"<joint name='j{i}' type='revolute'><parent link='l{i - 1}'/><child link='l{i}'/>"
        f"<origin xyz='0.1 0.05 0.2'/><axis xyz='{(i + 1) % 2} {int(i % 3 == 0)} {i % 2}'/>"
        "<limit lower='-3' upper='3' effort='0' velocity='0'/></joint>"
        if i
        else ""
    )
    for i in range(7)
)
Q = [0.2, 0.5, -0.7, 0.4, 0.6, -0.3]


@pytest.fixture(scope="module")
def arm():
    return cartstiff.load(f"<robot name='arm'>{ARM}</robot>", stiffness=2e4, gravity=[0, 0, -9.81])


class Outside(HTMLParser):
    """Collects what a page would load from elsewhere."""

    def __init__(self):
        super().__init__()
        self.found = []

    def handle_starttag(self, tag, attrs):
        self.found += [v for k, v in attrs if k in ("src", "href") and not v.startswith("data:")]


def words(text):
    text = re.sub(r"<(style|svg|iframe).*?</\1>", " ", text, flags=re.DOTALL)
    return html.unescape(re.sub(r"<[^>]+>", " ", text))


def test_the_answer_is_that_of_the_commands(arm):
    W = [0, 0, 0, 0, 30, -200]
    text = report_page(
        arm, Q, wrench=W, load_axes="world", load_at=[0, 0, 0.1], command="cartstiff <&>", frames=2
    )
    said = words(text)
    at_rest = equilibrium(arm, q0=Q, wrench=W, load_at=[0, 0, 0.1], load_axes="world")
    moved = 1e3 * np.linalg.norm(at_rest.displacement[3:])
    assert f"The tip moves {moved:.3g} mm" in said
    assert "The equilibrium is stable." in said
    result = cartstiff.analyse(arm, Q, wrench=W, load_at=[0, 0, 0.1], load_axes="world")
    C = result.tangent_compliance[3:, 3:]
    soft = 1e-3 / np.linalg.eigvalsh((C + C.T) / 2)[-1]
    assert f"{soft:.4g} N/mm" in said
    assert f"{result.tangent[5, 5]:.6g}" in said
    for note in (*result.notes, *at_rest.notes):
        assert note.message in said
    assert "on 12 kg" in said
    assert "cartstiff <&>" in said
    assert re.search(r"j\d gives \d+ % of it", said)
    parser = Outside()
    parser.feed(text)
    assert parser.found == []
    assert text.count("<svg ") == 2  # those of the page are escaped


def test_better_is_really_better(arm):
    """What the sentence says, by the equilibrium at the other posture."""
    W = [0, 0, 0, 0, 0, -200]
    said = words(report_page(arm, Q, wrench=W, load_axes="world", frames=2))
    name, at, less = re.search(r"(j\d) at (-?[\d.]+) deg instead, (\d+) % less", said).groups()
    other = list(Q)
    other[int(name[1]) - 1] = np.radians(float(at))

    def moved(q):
        state = equilibrium(arm, q0=q, wrench=W, load_axes="world")
        return np.linalg.norm(state.displacement[3:])

    assert 100 * (1 - moved(other) / moved(Q)) == pytest.approx(float(less), abs=1.5)


@pytest.mark.parametrize("name", ["cubic", "five-bar", "grasp"])
def test_every_kind_has_one(name):
    elastic = cartstiff.load(name)
    W = [0, 0, 0, 5, -5, 0] if name != "grasp" else None
    said = words(report_page(elastic, wrench=W, frames=2))
    assert "What is assumed" in said
    assert "stable" in said


def run(*arguments):
    return CliRunner().invoke(cartstiff_command, ["report", *map(str, arguments)])


def test_the_command_writes_one_file(tmp_path):
    file = tmp_path / "cubic.html"
    done = run("cubic", "--load", "0,0,0,0,0,-50", "--world", "--frames", 2, "-o", file)
    assert done.exit_code == 0, done.output
    assert f"{file}: " in done.output
    assert file.read_text(encoding="utf-8").startswith("<!doctype html>")


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("cubic",), "Missing option '-o'"),
        (("cubic", "-o", "x.pdf"), "unknown file ending"),
        (("cubic", "-o", "/none/x.html"), "no such folder"),
        (("cubic", "-o", "x.html", "--world"), "--world"),
        (("cubic", "-o", "x.html", "--load-at", "0,0,1"), "--load-at"),
        (("cubic", "-o", "x.html", "--load", "1,2"), "wrong count"),
        (("cubic", "-o", "x.html", "--load", "0,0,0,0,0,1", "--rest", "1"), "not both"),
        (("cubic", "-o", "x.html", "--frames", "1"), "range"),
        (("none", "-o", "x.html"), "unknown mechanism"),
    ],
)
def test_refusals(arguments, said, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    done = run(*arguments)
    assert isinstance(done.exception, (CartstiffError, SystemExit))
    assert said in f"{done.output} {done.exception}"
    assert list(tmp_path.iterdir()) == []


def test_a_map_stands_in_the_report(arm, tmp_path):
    """Its picture and range, with joints in degrees; a map of another mechanism is refused."""
    from dataclasses import replace

    from cartstiff.errors import InputError
    from cartstiff.maps import compute_map, open_map
    from cartstiff.maps.sampling import Axis, Grid
    from cartstiff.mechanisms.other_units import in_units
    from cartstiff.report.maps import map_section

    grid = Grid({"j2": Axis(0.3, 0.9, 4), "j3": Axis(-1, -0.4, 3)}, arm.names, Q)
    compute_map(arm, grid, ["condition"], tmp_path / "m.zarr", length=1.0)
    title, text = map_section(tmp_path / "m.zarr", None, in_units(arm, "m", "deg"))
    least = float(open_map(tmp_path / "m.zarr")["condition"].min())
    assert title == "Map"
    assert f"smallest {least:.5g}" in text
    assert "postures: 12 regular" in text
    assert "j2 [deg]" in text
    assert text.count("<svg") == 1
    page = report_page(arm, Q, frames=2, sections=[(title, text)])
    assert page.index("<h2>Map</h2>") < page.index("<h2>What is assumed</h2>")
    with pytest.raises(InputError, match="map of another mechanism; expected b, got "):
        map_section(tmp_path / "m.zarr", None, replace(arm, name="b"))


def test_what_the_file_says_of_its_springs_is_told():
    arm = cartstiff.load("five-bar")
    assert arm.source
    assert html.escape(arm.source[:40]) in report_page(arm, frames=2)
