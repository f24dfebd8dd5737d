"""What cannot be used is refused in one line that says what, where, expected, got."""

from __future__ import annotations

import math

import pytest
from tests.identify.campaigns import SPRINGS, arm, load, random_campaign, table_of
from tests.support.commands import answer, run

Q = "j1,j2,j3,j4,j5,j6"
HEAD = f"{Q},fx,fy,fz,dx,dy,dz"
ROW = "0.1,0.2,0.3,0.4,0.5,0.6,10,20,-50,0.0001,0.0002,-0.0003"


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    place = tmp_path_factory.mktemp("refusals")
    path = arm("elbow", place)
    q, W, d = random_campaign(load(path), SPRINGS["elbow"], 8, 1)
    table_of(place / "good.csv", q, W, d)
    return place


def _lines(head, *rows):
    return "\n".join([head, *rows]) + "\n"


def _many(head, row, count=8, **changed):
    """Rows that differ in their posture, so that nothing but the change is wrong."""
    names, cells = head.split(","), row.split(",")
    rows = []
    for i in range(count):
        one = list(cells)
        one[0] = f"{0.1 + 0.07 * i:g}"
        for name, value in changed.items():
            one[names.index(name)] = value
        rows.append(",".join(one))
    return _lines(head, *rows)


#: Content of the table, and words of the answer.
TABLES = {
    "an empty file": ("", ("empty",)),
    "only a head": (HEAD + "\n", ("no measurements",)),
    "no head": (_lines(ROW, ROW), ("no line of names",)),
    "an unknown column": (
        _many(HEAD.replace("dx", "ddx"), ROW),
        ("unknown column", "closest", "'ddx'"),
    ),
    "a mistyped joint": (_many(HEAD.replace("j3", "joint3"), ROW), ("unknown column", "'joint3'")),
    "a joint missing": (
        _many(HEAD.replace("j3,", ""), "0.1,0.2,0.4,0.5,0.6,1,2,3,1e-4,2e-4,3e-4"),
        ("column 'j3' is missing", "posture is not known"),
    ),
    "an unknown unit": (_many(HEAD.replace("dx", "dx [mn]"), ROW), ("unknown unit", "mm", "'mn'")),
    "a unit of another kind": (_many(HEAD.replace("fx", "fx [mm]"), ROW), ("unknown unit", "kN")),
    "a head with one bracket": (_many(HEAD.replace("dx", "dx [mm"), ROW), ("cannot be read",)),
    "a column twice": (_many(HEAD.replace("dy", "dx"), ROW), ("named twice", "'dx'")),
    "a column twice by its unit": (
        _many(HEAD.replace("dy", "dx [mm]"), ROW),
        ("named twice", "'dx'"),
    ),
    "a joint twice": (_many(HEAD.replace("fx", "q_j1"), ROW), ("named twice", "'j1'")),
    "a cell too many": (_lines(HEAD, ROW + ",1"), ("line 2", "wrong count", "12 cells", "got 13")),
    "a cell too few": (_lines(HEAD, ROW, ROW[:-8]), ("line 3", "wrong count", "got 11")),
    "a word for a number": (_many(HEAD, ROW, dx="high"), ("line 2", "'dx'", "number", "'high'")),
    "a decimal comma": (_lines(HEAD, ROW.replace("0.1,", "0,1,", 1)), ("wrong count",)),
    "decimal commas and points": (
        _lines(HEAD.replace(",", ";"), ROW.replace(",", ";").replace("0.1", "0,1")),
        ("decimal commas and points in one line", "line 2"),
    ),
    "decimal commas between commas": (
        _lines(
            HEAD,
            ",".join(
                f'"{x.replace(".", ",")}"'
                for x in ROW.replace(",10,20,-50,", ",10.5,20.5,-50.5,").split(",")
            ),
        ),
        ("line 2", "commas between numbers and in them", "semicolons"),
    ),
    "an infinite number": (_many(HEAD, ROW, dy="inf"), ("'dy'", "finite", "'inf'")),
    "NaN": (_many(HEAD, ROW, dy="nan"), ("'dy'", "finite", "'nan'")),
    "an underscore": (_many(HEAD, ROW, fx="1_0"), ("'fx'", "'1_0'")),
    "no posture in a row": (_many(HEAD, ROW, j2=""), ("line 2", "'j2' is empty")),
    "no load in a row": (_many(HEAD, ROW, fy=""), ("line 2", "'fy' is empty", "0 for none")),
    "millimetres for metres": (
        _many(HEAD, ROW, dx="0.31"),
        ("'dx'", "declares no unit", "[mm]", "0.31 m"),
    ),
    "degrees for radians": (
        _many(HEAD, ROW, j2="90"),
        ("'j2'", "degrees given as radians", "j2 [deg]", "90 rad"),
    ),
    "a tilt in degrees": (
        _many(HEAD.replace("dx", "drx"), ROW, drx="1.5"),
        ("'drx'", "declares no unit", "[deg]"),
    ),
    "no load": (_many(HEAD, ROW, fx="0", fy="0", fz="0"), ("load is zero everywhere", "mass")),
    "no load column": (
        _many(f"{Q},dx,dy,dz", "0.1,0.2,0.3,0.4,0.5,0.6,1e-4,2e-4,3e-4"),
        ("load is zero everywhere",),
    ),
    "nothing measured": (
        _many(f"{Q},fx,fy,fz", "0.1,0.2,0.3,0.4,0.5,0.6,1,2,3"),
        ("nothing was measured", "dx"),
    ),
    "nothing measured in a row": (
        _many(HEAD, ROW, dx="", dy="", dz=""),
        ("line 2", "nothing was measured in this row"),
    ),
    "fewer numbers than springs": (
        _lines(HEAD, ROW),
        ("fewer numbers than unknowns", "at least 6", "3 measured"),
    ),
    "as many numbers as springs": (
        _lines(HEAD, ROW, "0.9,-0.4,0.8,-1.1,0.7,0.2,30,-10,5,0.0001,0.0002,-0.0003"),
        ("as many parameters as numbers", "sd_"),
    ),
    "a gauge without direction": (
        _many(f"{Q},fx,d", "0.1,0.2,0.3,0.4,0.5,0.6,10,1e-4"),
        ("'d'", "nx, ny, nz"),
    ),
    "a direction of zero": (
        _many(f"{Q},fx,d,nx,ny,nz", "0.1,0.2,0.3,0.4,0.5,0.6,10,1e-4,0,0,0"),
        ("no direction",),
    ),
    "a direction without gauge": (
        _many(f"{HEAD},nx,ny,nz", f"{ROW},0,0,1"),
        ("direction without a dial gauge",),
    ),
    "half an orientation": (
        _many(f"{HEAD},roll", f"{ROW},0.1"),
        ("orientation needs all of roll, pitch, yaw",),
    ),
    "a deviation of zero": (
        _many(f"{HEAD},sd_dx", f"{ROW},0"),
        ("standard deviation of 'dx'", "above zero"),
    ),
    "a negative deviation": (_many(f"{HEAD},sd_dx", f"{ROW},-1e-5"), ("'dx'", "above zero")),
    "a deviation of nothing": (
        _many(f"{HEAD},sd_d", f"{ROW},1e-5"),
        ("'sd_d' without its column",),
    ),
    "deviations of some": (
        _many(f"{HEAD},sd_dx", f"{ROW},1e-5"),
        ("some lengths have a standard deviation",),
    ),
    "a negative mass": (
        _many(f"{Q},mass,dx,dy,dz", "0.1,0.2,0.3,0.4,0.5,0.6,-5,1e-4,2e-4,3e-4"),
        ("mass cannot be used", "zero or more", "-5"),
    ),
    "an empty session": (_many(f"{HEAD},session", f"{ROW},"), ("no session",)),
    "rows that contradict": (
        _lines(
            HEAD,
            *[ROW.replace("0.1,", f"{0.1 * i:g},", 1) for i in range(1, 7)],
            ROW.replace("0.0001,0.0002,-0.0003", "-0.0001,-0.0002,0.0003"),
        ),
        ("rows 1 and 7 contradict", "'dx'", "same posture and load"),
    ),
}

#: Options with a table that is sound, and words of the answer.
OPTIONS = {
    "an unknown spring": (["--unknown", "j9"], ("--unknown", "unknown spring", "'j9'")),
    "links that it has not": (["--unknown", "links"], ("--unknown", "has no links")),
    "a tie of one": (["--tie", "j1"], ("--tie", "two springs")),
    "a tie of nobody": (["--tie", "j1=j9"], ("--tie", "'j9'")),
    "tied twice": (["--tie", "j1=j2", "--tie", "j2=j3"], ("--tie", "'j2'", "twice")),
    "held at zero": (["--known", "j1=0"], ("--known", "above zero")),
    "held without a number": (["--known", "j1"], ("--known", "NAME=VALUE")),
    "held twice": (["--known", "j1=1", "--known", "j1=2"], ("--known", "given twice")),
    "a prior without deviation": (["--prior", "j1=1e4"], ("--prior j1", "2 numbers")),
    "a prior of nobody": (["--prior", "j9=1e4,1"], ("--prior", "'j9'")),
    "everything held": (
        [x for j in range(1, 7) for x in ("--known", f"j{j}=1e4")],
        ("nothing is to be found",),
    ),
    "a unit of nothing": (["--units", "parsec"], ("--units", "unknown unit")),
    "two units of lengths": (["--units", "mm,um"], ("--units", "two units of length")),
    "a deviation without unit": (["--sd", "dx=0.02"], ("--sd", "declares no unit", "mm")),
    "a deviation of no column": (["--sd", "dq=0.02mm"], ("--sd", "unknown column", "closest: d")),
    "a deviation of a column not there": (["--sd", "d=0.02mm"], ("--sd", "not in the table")),
    "a rule that is none": (["--reject", "all"], ("--reject", "unknown rule", "suspects")),
    "a rule of half a deviation": (["--reject", "0.5"], ("--reject", "at least 1")),
    "a level of one": (["--level", "1"], ("--level", "between 0 and 1")),
    "a file of another kind": (["-o", "x.urdf"], ("unknown file ending", ".yaml")),
}


@pytest.mark.parametrize("case", TABLES)
def test_a_table_is_refused_in_one_line(case, folder, tmp_path):
    text, words = TABLES[case]
    (tmp_path / "m.csv").write_text(text, "utf-8")
    line = run("identify", folder / "elbow.yaml", tmp_path / "m.csv", code=2)
    assert [word for word in words if word not in line] == []


@pytest.mark.parametrize("case", OPTIONS)
def test_an_option_is_refused_in_one_line(case, folder):
    options, words = OPTIONS[case]
    line = run("identify", folder / "elbow.yaml", folder / "good.csv", options, code=2)
    assert [word for word in words if word not in line] == []


def test_what_spreadsheets_write_is_understood(folder, tmp_path):
    """Semicolons, decimal commas, degrees, (um), q1 for the first joint, a line with sep=;."""
    head, *rows = (folder / "good.csv").read_text().splitlines()
    names = [name.split("[")[0].strip() for name in head.split(",")]
    shown = {
        **{f"j{i}": (f"q{i} [\u00b0]", 180 / math.pi) for i in range(1, 7)},
        **{f"d{axis}": (f"d{axis} (\u00b5m)", 1e6) for axis in "xyz"},
    }
    lines = ["sep=;", ";".join(shown.get(name, (name, 1))[0] for name in names)]
    for row in rows:
        pairs = zip(names, row.split(","), strict=True)
        cells = [repr(float(x) * shown.get(name, ("", 1.0))[1]) for name, x in pairs]
        lines.append(";".join(cells).replace(".", ","))
    (tmp_path / "sheet.csv").write_text("\n".join(lines), "utf-8")
    plain, sheet = (
        [p["compliance"] for p in answer("identify", folder / "elbow.yaml", path)["parameters"]]
        for path in (folder / "good.csv", tmp_path / "sheet.csv")
    )
    assert sheet == pytest.approx(plain, rel=1e-9)


def test_a_tool_given_by_option_is_that_point(folder, tmp_path):
    """Measured and loaded at --point, or at M moved there by --tcp; -o would not hold it."""
    command = "identify", folder / "elbow.yaml", folder / "good.csv"
    at_point, by_tool = (
        [p["compliance"] for p in answer(*command, option)["parameters"]]
        for option in ("--point 0.1,0.02,0.05", "--tcp 0.1,0.02,0.05 --payload 0.001")
    )
    assert at_point == pytest.approx(by_tool, rel=1e-9)
    file = tmp_path / "known.yaml"
    words = "-o: the file written would not hold what --tcp say"
    assert words in run(*command, "--tcp 0.1,0,0 -o", file, code=2)
    assert not file.exists()
    run(*command, "--gravity 0,0,-3.7 -o", file)
    assert "gravity: [0.0, 0.0, -3.7]\n" in file.read_text()


@pytest.mark.parametrize(("units", "is_doubtful"), [("--units mm,deg", True), ("", False)])
def test_radians_that_are_read_as_degrees_are_doubted(folder, units, is_doubtful):
    """A campaign in which no joint leaves zero by more than a few degrees; the fit goes on."""
    found = answer("identify", folder / "elbow.yaml", folder / "good.csv", units)
    assert ("small-angles" in [note["code"] for note in found["notes"]]) == is_doubtful
