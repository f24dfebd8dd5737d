"""The report: the answer agrees with the commands, one file, everything assumed is said."""

import html
import json
import re
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from tests.doors import PolynomialLaw
from tests.support.commands import command as cartstiff_command
from tests.support.printed import VERDICTS, answer_of, report_of, sentences_of
from tests.support.read_units import read
from tests.support.report_words import (
    METRES,
    matrix_after,
    said_under,
    si_length,
    states_what_is_said,
    table_after,
    words,
)

import cartstiff
from cartstiff import DeadWrench, analyse_posture, equilibrium
from cartstiff.extend import in_units
from cartstiff.geometry import se3

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


@pytest.fixture
def no_search(monkeypatch):
    """Reports that look for no better posture, for tests of what else they say."""
    monkeypatch.setattr("cartstiff.shown.page.html_report.better_posture", lambda *_, **__: None)


class Outside(HTMLParser):
    """Collects what a page would load from elsewhere."""

    def __init__(self):
        super().__init__()
        self.found = []

    def handle_starttag(self, tag, attrs):
        self.found += [v for k, v in attrs if k in ("src", "href") and not v.startswith("data:")]


@pytest.mark.usefixtures("no_search")
def test_displacements_of_two_definitions_are_named(arm):
    """Soft springs: from equilibrium to equilibrium it is another number than by the stiffness."""
    soft, W = arm.with_springs(0.05 * arm.springs.stiffness), [0, 0, 0, 0, 30, -200]
    said = words(report_of(soft, Q, wrench=W, load_axes="world"))
    state = equilibrium(soft, q=Q, wrench=W, load_axes="world")
    moved = 1e3 * np.linalg.norm(state.displacement[3:])
    result = cartstiff.analyse(soft, Q, wrench=W, load_axes="world")
    linear = 1e3 * np.linalg.norm(analyse_posture(result)["deflection"]["displacement"])
    assert abs(linear - moved) > 5e-3 * moved
    assert f"The body frame moves {moved:.4g} mm under the load" in said
    assert f"(by the equilibrium; {linear:.4g} mm to first order, K^load)" in said


@pytest.mark.usefixtures("no_search")
def test_the_answer_is_that_of_the_commands(arm):
    W = [0, 0, 0, 0, 30, -200]
    text = report_of(
        arm, Q, wrench=W, load_axes="world", load_at=[0, 0, 0.1], command="cartstiff <&>"
    )
    said = words(text)
    result = cartstiff.analyse(arm, Q, wrench=W, load_at=[0, 0, 0.1], load_axes="world")
    for sentence in sentences_of(result):
        assert sentence in said
    C = result.tangent_compliance[3:, 3:]
    soft = 1e-3 / np.linalg.eigvalsh((C + C.T) / 2)[-1]
    assert f"{soft:.4g} N/mm" in said
    shown, _ = matrix_after(text, arm)
    assert shown[5, 5] == pytest.approx(result.tangent[5, 5], rel=1e-3)
    for note in result.notes:
        assert note.message in said
    assert "on 12 kg" in said
    assert "cartstiff <&>" in said
    said_share = r"(\d+) % of the first-order displacement comes from (j\d) "
    share, name = re.search(said_share, said).groups()
    shares = analyse_posture(result)["deflection"]["shares"]
    most = max(shares, key=lambda part: abs(part["share"]))
    assert (name, share) == (most["name"], f"{100 * most['share']:.0f}")
    parser = Outside()
    parser.feed(text)
    assert parser.found == []
    assert text.count("<svg ") == 2  # those of the page are escaped


def moved_by(elastic, q, W):
    state = equilibrium(elastic, q=q, wrench=W, load_axes="world")
    return np.linalg.norm(state.displacement[3:])


@pytest.mark.parametrize(("name", "W"), [("panda", [0, 0, -50]), ("ur5", [0, 0, -100])])
def test_a_better_posture_keeps_the_tip_where_it_is(name, W):
    """Self-motion of seven joints, another branch of six: same pose, less displacement."""
    arm, W = cartstiff.load(name), [0, 0, 0, *W]
    said = words(report_of(arm, wrench=W, load_axes="world"))
    less = re.search(r"\(the tip stays where it is\): (\d+) % less", said).group(1)
    places = re.search(r"It is at (.*?)\. ", said).group(1)
    degrees = [float(place.split()[1]) for place in places.split(", ")]
    assert [place.split()[0] for place in places.split(", ")] == list(arm.names)
    q = np.radians(degrees)
    apart = arm.mechanism.at(q).pose - arm.mechanism.at(arm.q).pose
    assert np.abs(apart).max() < 3e-3  # a tenth of a degree is what is said
    gained = 100 * (1 - moved_by(arm, q, W) / moved_by(arm, arm.q, W))
    assert gained == pytest.approx(float(less), abs=1.5)


def test_the_forces_that_drives_hold_are_drawn_to_the_scale_of_the_load():
    elastic, W = cartstiff.load("ur5"), [0, 0, 0, 0, 0, -100.0]
    held = cartstiff.capacity(elastic, wrench=W, load_axes="world").polytope
    text = report_of(elastic, wrench=W, load_axes="world")
    most = np.linalg.norm(held, axis=1).max()
    assert f"the drives hold, up to {most:.4g} N, to the arrow" in html.unescape(text)
    drawn = re.findall(r'<polygon points="([^"]*)" fill="#c22f1e" fill-opacity', text)
    arrows = re.findall(r'y1="([-0-9.]+)" x2="[-0-9.]+" y2="([-0-9.]+)" stroke="#c22f1e"', text)
    # From the side the height of the body over the arrow's is that of forces over 100 N.
    corners = np.array([[float(x) for x in one.split(",")] for one in drawn[1].split()])
    y1, y2 = map(float, arrows[1])
    assert np.ptp(corners[:, 1]) / abs(y2 - y1) == pytest.approx(np.ptp(held[:, 2]) / 100, rel=0.02)
    assert "the drives hold, up to" not in report_of(cartstiff.load("hexapod"), wrench=W)


def test_springs_that_nobody_measured_are_doubted_before_the_answer():
    assumed = cartstiff.load(f"<robot name='arm'>{ARM}</robot>")
    for elastic, words_of_doubt in (
        (assumed, "The springs are assumed: no joint stiffness was given"),
        (cartstiff.load("ur5"), "The springs are illustrative, not measured"),
    ):
        text = report_of(elastic)
        assert 0 < text.index('<p class="doubt">') < text.index("<li>")
        assert words_of_doubt in words(text)
    known = cartstiff.load(f"<robot name='arm'>{ARM}</robot>", stiffness=1e4)
    assert 'class="doubt"' not in report_of(known)


def test_legs_stand_beside_their_limits_and_passive_joints_are_left_out(tmp_path):
    """Lengths by hand from the two ends of each leg; tensions by the spring's law."""
    text = report_of(hexapod := cartstiff.load("hexapod"), wrench=[0, 0, 0, 0, 0, -100])
    result = cartstiff.analyse(hexapod, wrench=[0, 0, 0, 0, 0, -100])
    platform, T = hexapod.mechanism, result.pose
    ends = platform.points @ T[:3, :3].T + T[:3, 3]
    heads, *rows = table_after(text, "Legs")
    lengths = [read(row[heads.index("length")]) for row in rows]
    assert lengths == pytest.approx(np.linalg.norm(ends - platform.anchors, axis=1), rel=1e-3)
    forces = [read(row[heads.index("force")]) for row in rows]
    along = (ends - platform.anchors) / np.linalg.norm(ends - platform.anchors, axis=1)[:, None]
    # The legs hold the body against the load.
    assert np.array(forces) @ along == pytest.approx([0, 0, -100], abs=0.05)
    # Passive joints have no spring, and the loops' drives a table of their own.
    text = report_of(cartstiff.load("five-bar"))
    assert [row[0] for row in table_after(text, "Drives")[1:]] == ["left_motor", "right_motor"]
    assert "<h2>Joints" not in text


@pytest.mark.parametrize("name", ["cubic", "five-bar", "grasp"])
def test_every_kind_has_one(name):
    elastic = cartstiff.load(name)
    W = [0, 0, 0, 5, -5, 0] if name != "grasp" else None
    said = words(report_of(elastic, wrench=W))
    assert "What is assumed" in said
    assert any(title in said for title in VERDICTS.values())


def run(*arguments):
    return CliRunner().invoke(cartstiff_command, ["report", *map(str, arguments)])


def test_the_command_writes_one_file(tmp_path):
    file = tmp_path / "cubic.html"
    done = run("cubic", "--load", "0,0,0,0,0,-50", "--world", "-o", file)
    assert done.exit_code == 0, done.output
    assert f"{file}: " in done.output
    assert file.read_text(encoding="utf-8").startswith("<!doctype html>")


def test_a_map_stands_in_the_report(arm, tmp_path):
    """Its picture and range, with joints in degrees; a map of another mechanism is refused."""
    from cartstiff.maps import Axis, Grid, compute_map, open_map

    grid = Grid({"j2": Axis(0.3, 0.9, 4), "j3": Axis(-1, -0.4, 3)}, arm.names, Q)
    map_file, file, page = (tmp_path / name for name in ("m.zarr", "arm.urdf", "r.html"))
    compute_map(arm, grid, ["condition"], map_file, length=1.0)

    def reported(name="arm", stiffness=2e4):
        file.write_text(f"<robot name='{name}'>{ARM}</robot>")
        more = ["--q", ",".join(map(str, Q)), "--gravity", "0,0,-9.81", "--map", map_file]
        done = run(file, f"--stiffness={stiffness}", *more, "-o", page)
        said = str(done.exception) if done.exit_code else page.read_text("utf-8")
        return done.exit_code, said.partition("<h2>Map</h2>")[2] or said

    code, said = reported()
    text, end, _ = said.partition("<h2>What is assumed</h2>")
    least = float(open_map(map_file)["condition"].min())
    assert (code, bool(end)) == (0, True)
    assert f"<li>condition from {least:.4g} to " in text
    assert "<li>States of the 12 postures: regular 12</li>" in text
    assert "j2 [deg]" in text
    assert text.count("<svg") == 1
    assert "than this report" not in text
    assert "of other springs than this report" in reported(stiffness=1e4)[1]
    code, said = reported(name="b")
    assert code
    assert "map of another mechanism; expected b, got " in said


@pytest.mark.usefixtures("no_search")
def test_the_map_of_the_help_can_be_shown(tmp_path, monkeypatch):
    """Its commands are run as they are printed, with fewer points."""
    monkeypatch.chdir(tmp_path)
    text = CliRunner().invoke(cartstiff_command, ["report", "--help"]).output.replace("\\\n", " ")
    for line in re.findall(r"cartstiff (.* m\.zarr.*)", text):
        done = CliRunner().invoke(cartstiff_command, line.replace(":41", ":3").split())
        assert done.exit_code == 0, done.output
    page = (tmp_path / "ur5.html").read_text("utf-8")
    assert re.search(r"<li>\w+ from \S+ µm to \S+ mm</li>", page)


def test_what_the_file_says_of_its_springs_is_told():
    arm = cartstiff.load("five-bar")
    assert arm.source
    assert html.escape(arm.source[:40]) in report_of(arm)


def _load_of(elastic, size):
    return size * np.array([0, 0, 0, 0.3, -0.2, -1.0]) * elastic.units.newtons


#: An arm of the size of a KR210, whose file has no springs: offsets and axes of its joints.
HEAVY = "<robot name='heavy'><link name='l0'/>" + "".join(
    f"<link name='l{i}'><inertial><mass value='{mass}'/><inertia ixx='9' iyy='9' izz='9' ixy='0' "
    f"ixz='0' iyz='0'/></inertial></link><joint name='A{i}' type='revolute'>"
    f"<parent link='l{i - 1}'/><child link='l{i}'/><origin xyz='{xyz}'/><axis xyz='{axis}'/>"
    "<limit lower='-2' upper='2' effort='0' velocity='0'/></joint>"
    for i, (xyz, axis, mass) in enumerate(
        [
            ("0 0 0.33", "0 0 1", 300),
            ("0.35 0 0.345", "0 1 0", 250),
            ("0 0 1.15", "0 1 0", 200),
            ("0.96 0 -0.041", "1 0 0", 60),
            ("0.54 0 0", "0 1 0", 40),
            ("0.193 0 0", "1 0 0", 20),
        ],
        1,
    )
)

CASES = [
    ("ur5", {}, 100.0),
    ("fanuc-r2000ic", {}, 300.0),  # published springs
    ("6-ups", {"gravity": [0, 0, -9.81]}, 100.0),
    ("heavy", {"q": [0.2, -0.4, 0.5, 0.3, 0.6, -0.1]}, 50.0),
    ("five-bar", {}, 20.0),
    ("examples/flexible_arm.yaml", {"gravity": [0, 0, -9.81]}, 50.0),
    ("6-pus", {}, 100.0),
    ("delta", {}, 0.05),
    ("3-rrr", {}, 1.0),
    ("grasp", {}, None),
    ("flexure-hexapod", {}, 5.0),
    ("cubic", {}, 50.0),
    ("stewart-gough", {}, None),
    ("cable-robot", {"q": [0.03, 0, 0.6, 0, 0, 0]}, 20.0),
    ("hexaglide", {"unit": "mm"}, 50.0),
]


@pytest.mark.usefixtures("no_search")
@pytest.mark.parametrize(("name", "more", "size"), CASES, ids=[case[0] for case in CASES])
def test_every_number_is_that_of_the_commands(name, more, size):
    """Matrix, stiffnesses, shares, softest direction, displacement and verdict."""
    root = Path(cartstiff.__file__).parents[2]
    source = HEAVY + "</robot>" if name == "heavy" else name
    elastic = cartstiff.load(root / name if "/" in name else source)
    if "gravity" in more:
        elastic = elastic.with_gravity(more["gravity"])
    if "unit" in more:
        elastic = in_units(elastic, more["unit"])
    q = elastic.mechanism.assembled(more.get("q", elastic.q))
    W = None if size is None else _load_of(elastic, size)
    text = report_of(elastic, q, wrench=W, load_axes="body" if W is None else "world")
    # What holds the posture without the load stays: the body is not let go first.
    alone = cartstiff.analyse(elastic, q)
    is_held = alone.wrench is not None and alone.shown_wrench(alone.wrench).any()
    added = {}
    result = alone
    if W is not None and is_held:
        R = np.kron(np.eye(2), alone.pose[:3, :3])
        added = {"wrench": R.T @ W, "load_at": np.zeros(3)}
    elif W is not None:
        result = cartstiff.analyse(elastic, q, wrench=W, load_axes="world")
    states_what_is_said(text, result, answer_of(result, **added))
    # The displacement is near that between two equilibria, by the search itself.
    if moved := re.search(r"The body frame moves (\S+ \S+) under", said_under(text)):
        R = np.kron(np.eye(2), alone.pose[:3, :3])
        held = R @ (np.zeros(6) if alone.wrench is None else alone.shown_wrench(alone.wrench))
        hold = [DeadWrench(held)] if is_held else []
        before = equilibrium(elastic, q, *hold, settle=False)
        after = equilibrium(elastic, q, *hold, DeadWrench(W))
        far = np.linalg.norm((after.pose - before.pose)[:3, 3])
        assert si_length(moved.group(1)) == pytest.approx(
            far * METRES[elastic.units.length], rel=0.02
        )


# An arm with springs that its maker publishes, the same without, the paper's platform, six legs
# with a heavy body, and cables: each as a command, whose JSON has the same numbers.
FIVE = [
    ["fanuc-r2000ic", "--load", "0,0,0,200,0,-500", "--world"],
    ["arm.urdf", "--load", "0,0,0,20,0,-50", "--world"],
    ["stewart-gough"],
    ["6-ups", "--gravity", "0,0,-9.81", "--load", "0,0,0,30,0,-200", "--world"],
    ["cable-robot", "--q", "0.03,0,0.6,0,0,0", "--load", "0,0,0,5,0,-20", "--world"],
]


@pytest.mark.parametrize("line", FIVE, ids=[line[0] for line in FIVE])
def test_a_report_is_the_json_of_its_command(line, tmp_path, monkeypatch):
    """Number by number; and the Python API gives both."""
    monkeypatch.chdir(tmp_path)
    Path("arm.urdf").write_text(HEAVY + "</robot>", encoding="utf-8")
    done = run(*line, "-o", "r.html")
    assert done.exit_code == 0, done.output
    text = Path("r.html").read_text("utf-8")
    done = CliRunner().invoke(cartstiff_command, ["analyse", *line, "--json"])
    assert done.exit_code == 0, done.output
    told = json.loads(done.output)
    options = dict(zip(line[1::2], line[2::2], strict=False))
    elastic = cartstiff.load(line[0])
    if "--gravity" in line:
        elastic = elastic.with_gravity([0, 0, -9.81])
    given = {name: [float(x) for x in value.split(",")] for name, value in options.items()}
    load = given.get("--load")
    result = cartstiff.analyse(
        elastic, given.get("--q"), wrench=load, load_axes="body" if load is None else "world"
    )
    mine = answer_of(result)
    assert json.loads(json.dumps(mine)) == told["answer"]
    states_what_is_said(text, result, told["answer"])


def test_no_direction_is_named_where_two_are_alike():
    """A delta of three equal legs: x and y are alike, straight down it only moves."""
    delta = cartstiff.load("delta")
    W = np.array([0, 0, 0, 0, 0, -50.0])
    result = cartstiff.analyse(delta, wrench=W)
    C = result.tangent_compliance[3:, 3:]
    least, middle, most = np.linalg.eigvalsh((C + C.T) / 2)
    assert most - middle < 1e-9 * most < 1e-3 * (most - least)
    said = words(report_of(delta, wrench=W, load_axes="world"))
    same = r"oftest \(free to turn\): (.*?) along more than one direction alike"
    soft = re.search(f"S{same}", said)
    assert read(soft.group(1)) == pytest.approx(1.0 / most, rel=1e-3)
    line = ["analyse", "delta", "--load", "0,0,0,0,0,-50", "--world"]
    told = CliRunner().invoke(cartstiff_command, line).output
    assert re.search(f"S{same}", told).group(1) == soft.group(1)


@pytest.mark.usefixtures("no_search")
def test_a_sweep_ends_at_the_limit_of_its_joint(arm):
    """Beyond it there is no posture, and no line."""
    q = np.array(Q)
    q[2] = arm.mechanism.coordinates[2].upper
    text = report_of(replace(arm, q=q), wrench=[0, 0, 0, 0, 0, -20])
    line = re.findall(r'<path d="([^"]+)" fill="none" stroke="[^"]+" stroke-width="2"', text)[2]
    ends = [float(point.split(",")[0]) for point in re.split("[ML]", line)[1:]]
    assert (ends[0], ends[-1]) == (50.0, 240.0)


@pytest.mark.usefixtures("no_search")
def test_what_springs_hold_before_the_load_is_named_beside_the_picture():
    arm = cartstiff.load("ur5")
    arm = arm.with_springs(None, arm.q + 0.01)  # given, so that a wrench holds the posture
    heads = [
        re.findall("<h2>(In three.*?)</h2>", report_of(arm, wrench=W))
        for W in (None, [0, 0, 0, 0, 0, -50])
    ]
    assert heads == [["In three dimensions"], ["In three dimensions, before the load"]]


def test_a_closed_chain_is_drawn_link_by_link():
    """Every point that a closure ties is the end of a line, on both of its sides."""
    five = cartstiff.load("five-bar")
    text = report_of(five)
    drawn = re.findall(r'<polyline points="([^"]+)"', text)[:3]  # from the side
    ends = {line.split()[-1] for line in drawn}
    assert len(drawn) == 3
    assert len(ends) == 1  # body, and both sides of the closure


def test_an_unbalanced_posture_is_not_held():
    """A payload bends forearms whose links the posture has straight: it rests at another one."""
    said = re.sub(r"<[^>]+>", " ", report_of(cartstiff.load("delta", payload=[3])))
    assert "Unbalanced" in said
    assert "not held at this posture" in said


@pytest.mark.usefixtures("no_search")
def test_rigid_and_nonlinear_springs_stand_in_the_table(arm):
    """A rigid joint is no passive joint; a spring by a law has the stiffness at the posture."""
    springs = replace(arm.springs, rigid=frozenset({1}), laws={2: PolynomialLaw((1e4, 0.0, 1e6))})
    text = report_of(replace(arm, springs=springs, q=np.array(Q)), wrench=[0, 0, 0, 0, 0, -20])
    heads, *cells = table_after(text, "Joints")
    rows = {row[0]: row[heads.index("stiffness")] for row in cells}
    assert rows["j2"] == "rigid"
    result = cartstiff.analyse(replace(arm, springs=springs), Q, wrench=[0, 0, 0, 0, 0, -20])
    turned = Q[2] - result.elastic.springs.rest[2]
    number, unit = rows["j3"].split(" ", 1)
    assert unit == "kN m/rad"
    assert float(number) == pytest.approx(1e-3 * (1e4 + 3e6 * turned**2), rel=1e-3)


def test_compliant_links_have_one_row_each():
    """Their virtual joints are no rows, no part of a better posture, and are not swept."""
    arm = cartstiff.load(Path(cartstiff.__file__).parents[2] / "examples/flexible_arm.yaml")
    text = report_of(arm, wrench=[0, 0, 0, 10, 0, -20], load_axes="world")
    said = words(text)
    assert "etter posture" in said
    assert "upper_arm_link.near_ry" not in re.sub("<iframe.*?</iframe>", "", text)
    assert "change of the coordinate [deg], within the limits" in text
    heads, *cells = table_after(text, "Joints")
    rows = {row[0]: row[heads.index("share")] for row in cells}
    assert len(rows) == len(cells) == 6 + 2
    result = cartstiff.analyse(arm, wrench=[0, 0, 0, 10, 0, -20], load_axes="world")
    shares = analyse_posture(result)["deflection"]["shares"]
    share = sum(part["share"] for part in shares if part["name"].startswith("forearm_link."))
    assert rows["the link forearm_link"] == f"{100 * share:.0f} %"


@pytest.mark.usefixtures("no_search")
def test_a_doubt_about_the_load_is_said_once(arm):
    """It has other numbers at the stated posture and at rest."""
    soft = arm.with_springs(0.05 * arm.springs.stiffness)
    text = report_of(soft, Q, wrench=[0, 0, 0, 0, 0, -300], load_axes="world")
    assert text.count("[implausible-deflection]") == 1


def test_a_posture_that_does_not_resist_the_load_has_no_linear_displacement(arm):
    """The load tips the soft arm over: what `analyse` does not say, the report does not either."""
    soft = arm.with_springs(0.013 * arm.springs.stiffness)
    text = report_of(
        soft, [0.0, 0.05, 0.0, 0.0, 0.02, 0.0], wrench=[0, 0, 0, 0, 0, -200], load_axes="world"
    )
    assert "<li>Not stable: " in text
    assert "to first order" not in text
    assert "etter posture" not in words(text)
    assert "share of" not in text[text.index("<h2>Joints") : text.index("<h2>Load and")]


@pytest.mark.usefixtures("no_search")
def test_a_report_has_a_page_for_each_point_the_worst_first(tmp_path, monkeypatch):
    """Poses reached next to the posture; each page has the numbers of a report of its own."""
    monkeypatch.chdir(tmp_path)
    arm, load = cartstiff.load("ur5"), np.array([0, 0, 0, 0, 0, -100.0])
    T = arm.mechanism.at(arm.q).pose
    places = T[:3, 3] + np.array([[0, 0, 0], [0.1, 0, 0.05], [-0.1, 0, 0]])
    x = [",".join(map(str, [*place, *se3.roll_pitch_yaw(T)])) for place in places]
    Path("part.csv").write_text("x,y,z,roll,pitch,yaw\n" + "\n".join(x), encoding="utf-8")
    done = run(
        "ur5", "--load", "0,0,0,0,0,-100", "--world", *["--at-points", "part.csv", "-o", "r.html"]
    )
    assert done.exit_code == 0, done.output
    text = Path("r.html").read_text("utf-8")
    assert text.count("<article>") == 3
    rows = table_after(text, "The points, worst first")[1:]
    moved = [read(row[1]) for row in rows]
    assert moved == sorted(moved, reverse=True)
    pages = re.findall(r"<article><h2>(.*?)</h2>(.*?)</article>", text, re.DOTALL)
    assert [name for name, _ in pages] == [row[0] for row in rows]
    for (name, page), far in zip(pages, moved, strict=True):
        place = places[int(name.split()[1]) - 1]
        places_of = dict(re.findall(r"<td>(\w+_joint)</td><td>(\S+) deg</td>", page))
        q = np.radians([float(places_of[joint]) for joint in arm.names])
        assert arm.mechanism.at(q).pose[:3, 3] == pytest.approx(place, abs=1e-3)
        assert np.abs(q - arm.q).max() < 1.0
        assert moved_by(arm, q, load) == pytest.approx(far, rel=2e-2)
    assert text.count('<section class="screen">') == 1


@pytest.mark.usefixtures("no_search")
def test_points_may_be_postures_and_what_is_out_of_reach_is_refused(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    arm = cartstiff.load("ur5")
    lines = [",".join(arm.names), *(",".join(map(str, arm.q + d)) for d in (0.0, 0.1))]
    Path("q.csv").write_text("\n".join(lines), encoding="utf-8")
    done = run("ur5", *["--load", "0,0,0,0,0,-100", "--at-points", "q.csv", "-o", "r.html"])
    assert done.exit_code == 0, done.output
    assert Path("r.html").read_text("utf-8").count("<article>") == 2
    Path("far.csv").write_text("x,y,z,roll,pitch,yaw\n9,0,0,0,0,0\n", encoding="utf-8")
    done = run("ur5", *["--at-points", "far.csv", "-o", "r.html"])
    assert done.exit_code != 0
    assert "point 1 of far.csv is out of reach" in str(done.exception)


@pytest.mark.usefixtures("no_search")
@pytest.mark.parametrize("length", ["m", "mm"])
def test_ticks_are_round(length):
    text = report_of(in_units(cartstiff.load("ur5"), length), wrench=[0, 0, 0, 0, 0, -100])
    ticks = re.findall(
        r'text-anchor="(?:end|middle)">(-?[\d.]+)</text>', text.partition("One joint")[2]
    )
    assert len(ticks) >= 6
    for tick in ticks:
        digits = tick.lstrip("-0.").replace(".", "").rstrip("0")
        assert len(digits) <= 2, tick
        assert tick != "-0"


def test_a_preloaded_platform_has_a_report_under_a_load_in_the_room(tmp_path):
    """The load is beside the wrench that holds it, and is not taken for one of the springs'."""
    file = tmp_path / "r.html"
    run("stewart-gough", "--load", "0,0,0,0,0,-50", "--world", "-o", file)
    said = words(file.read_text("utf-8"))
    assert "carries a force of 50 N, vertical downwards. It is held by the wrench" in said
    W = cartstiff.analyse(cartstiff.load("stewart-gough")).wrench
    named = re.search(r"held by force \((.*?)\) N, moment", said).group(1)
    assert [float(x) for x in named.split(", ")] == pytest.approx(W[3:], rel=1e-5)
