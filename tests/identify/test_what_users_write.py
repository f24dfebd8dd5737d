"""Tables as spreadsheets write them, tools by option, doubtful units."""

import math

import pytest
from tests.identify.campaigns import SPRINGS, arm, load, random_campaign, table_of
from tests.support.commands import answer, run


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    place = tmp_path_factory.mktemp("refusals")
    path = arm("elbow", place)
    q, W, d = random_campaign(load(path), SPRINGS["elbow"], 8, 1)
    table_of(place / "good.csv", q, W, d)
    return place


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
