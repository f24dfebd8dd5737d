"""What plots show: the library's numbers, live and from a file, and as the address says."""

from __future__ import annotations

import csv

import numpy as np
import pytest
from tools.screenshot import settled

import cartstiff
from tests.support.pages import page_text, row_shown, source_of, state_of

LOAD = (1.0, 2.0, -3.0, 40.0, 20.0, -90.0)
QUANTITY, ALONG, AND = (
    f"select[aria-label='{words}']" for words in ("Values of", "Along what", "And along what")
)
#: Parts of the units that plots are written in, and what they are in those of a row.
PREFIXES = {"k": 1e3, "M": 1e6, "G": 1e9, "m": 1e-3, "µ": 1e-6}
WHOLE = {"1": 1.0, "m": 1.0, "m/N": 1.0, "N/mm": 1e3, "kN/mm": 1e6, "MN/mm": 1e9}


def shown_unit(name: str) -> float:
    """What the unit in brackets at the end of a column's name is in the mechanism's own."""
    unit = name[name.index("[") + 1 : -1]
    if unit in WHOLE or unit[0] not in PREFIXES:
        return WHOLE.get(unit, 1.0)
    return PREFIXES[unit[0]]


def read_table(download, path) -> tuple[list[str], list[str], np.ndarray]:
    """Comments, names and numbers of a saved plot; what has no number has a reason."""
    download.save_as(path)
    lines = path.read_text("utf-8").splitlines()
    comments = [line for line in lines if line.startswith("#")]
    (*names, why), *rows = csv.reader(lines[len(comments) :])
    assert why == "why there is no value"
    numbers = np.array([[float(x) if x else np.nan for x in row[:-1]] for row in rows])
    assert np.isnan(numbers[[row[-1] != "" for row in rows], -1]).all()
    return comments, names, numbers


def saved(page, kind: str, path):
    with page.expect_download() as download:
        page.select_option("select[aria-label='Save the plot']", kind)
    return read_table(download.value, path)


@pytest.mark.parametrize(
    ("name", "i", "has_legs"), [("ur5", 2, False), ("cubic", 2, True), ("6-ups", 8, False)]
)
def test_every_quantity_is_what_the_library_says(serve, pages, tmp_path, name, i, has_legs):
    page = pages.shared(serve(name).url)
    page.evaluate("(load) => window.cartstiff.change({ load, load_axes: 'body' })", LOAD)
    elastic = cartstiff.load(name)
    state = state_of(load=LOAD)
    page.select_option(ALONG, f"sweep:{i}")
    settled(page)
    keys = page.eval_on_selector_all(f"{QUANTITY} option", "(all) => all.map((o) => o.value)")
    assert keys[0] == "deflection"
    for key in keys:
        page.select_option(QUANTITY, key)
        if key == "leg_force" and not has_legs:
            assert "no legs" in page.text_content("#strip .plot .nothing")
            continue
        page.wait_for_selector(f"#strip .plot .{key}.curve-0")
        comments, names, table = saved(page, "csv", tmp_path / "plot.csv")
        assert comments[0].startswith("# ")
        assert f"load ({', '.join(f'{x:g}' for x in LOAD)})" in comments[1]
        assert all("[" in one for one in names)
        near = int(np.argmin(np.abs(table[:, 0] - elastic.q[i])))
        q = np.array(elastic.q)
        q[i] = table[near, 0]
        row = row_shown(cartstiff.analyse(elastic, q, wrench=LOAD), state)
        expected = np.array(row[key]) / shown_unit(names[1])
        assert table[near, 1:] == pytest.approx(expected, rel=1e-6), key


@pytest.mark.parametrize(("name", "i"), [("ur5", 2), ("cubic", 2)])
def test_a_file_plots_the_same_quantities(pages, tmp_path, name, i):
    """By its own arithmetic."""
    elastic = cartstiff.load(name)
    path = tmp_path / "page.html"
    path.write_text(page_text(source_of(elastic, load=np.array(LOAD))), "utf-8")
    page = pages.open(path.as_uri(), offline=True)
    page.wait_for_selector("#strip .plot .curve-0, #strip .plot .nothing", state="attached")
    page.select_option(ALONG, f"sweep:{i}")
    quantity = page.evaluate("() => window.cartstiff.state.quantity")
    for key in page.eval_on_selector_all(f"{QUANTITY} option", "(all) => all.map((o) => o.value)"):
        page.select_option(QUANTITY, key)
        at_rest = "#strip .plot:not(.computing)"
        drawn = f"{at_rest} .{key}.curve-0, {at_rest} .nothing"
        page.wait_for_selector(drawn, state="attached")
        _, names, table = saved(page, "csv", tmp_path / "plot.csv")
        near = int(np.argmin(np.abs(table[:, 0] - elastic.q[i])))
        q = np.array(elastic.q)
        q[i] = table[near, 0]
        row = row_shown(cartstiff.analyse(elastic, q, wrench=LOAD), state_of(quantity=quantity))[
            key
        ]
        if row is None:
            assert np.isnan(table[near, 1:]).all(), key
        else:
            assert table[near, 1:] == pytest.approx(
                np.array(row, float) / shown_unit(names[1]), rel=1e-6, abs=1e-15, nan_ok=True
            ), key


def test_a_file_is_of_what_the_page_says_also_at_once(serve, pages, tmp_path):
    """Curves follow a change by a third of a second; a file that is asked for waits for them."""
    elastic = cartstiff.load("ur5")
    page = pages.shared(serve("ur5", curves=True).url)
    page.select_option(QUANTITY, "condition")
    for i, load in ((1, (0, 0, 0, 0, 0, -100)), (3, LOAD)):
        page.evaluate("(load) => window.cartstiff.change({ load, load_axes: 'body' })", load)
        page.select_option(ALONG, f"sweep:{i}")
        comments, names, table = saved(page, "csv", tmp_path / "plot.csv")
        assert f"along {elastic.names[i]}" in comments[0]
        assert f"load ({', '.join(f'{x:g}' for x in load)})" in comments[1]
        assert names[0].split(" ")[0] == elastic.names[i]
        for row in table[[7, 30, 51]]:
            q = np.array(elastic.q)
            q[i] = row[0]
            expected = row_shown(cartstiff.analyse(elastic, q, wrench=load), state_of(load=load))
            assert row[1:] == pytest.approx(expected["condition"], rel=1e-6)
    page.evaluate(
        "() => window.cartstiff.change({ load_axes: 'body', load: [0, 0, 0, 0, 0, -300] })"
    )
    page.select_option(AND, "0")
    comments, names, table = saved(page, "csv", tmp_path / "map.csv")
    assert f"along {elastic.names[3]} and {elastic.names[0]}" in comments[0]
    q = np.array(elastic.q)
    q[[3, 0]] = table[200, :2]
    expected = row_shown(
        cartstiff.analyse(elastic, q, wrench=(0, 0, 0, 0, 0, -300)),
        state_of(load=(0, 0, 0, 0, 0, -300)),
    )
    assert table[200, 2] == pytest.approx(expected["condition"][0], rel=1e-6)


def test_an_address_holds_the_plot_and_what_is_seen_of_it(serve, pages):
    url = serve("ur5").url
    page = pages.open(url + "#load=0,0,0,0,0,-100&load_axes=body")
    page.wait_for_selector("#strip .plot .curve-0")
    page.select_option(QUANTITY, "turn")
    page.select_option(ALONG, "sweep:1")
    page.wait_for_selector("#strip .plot .turn.curve-0")
    box = page.locator("#strip .plot").first.bounding_box()
    page.mouse.move(box["x"] + 0.7 * box["width"], box["y"] + 0.5 * box["height"])
    for _ in range(4):
        page.mouse.wheel(0, -100)
    page.wait_for_function("() => location.hash.includes('seen=')")
    before = ""
    while before != page.url:  # the address is written a little after the last turn of the wheel
        before = page.url
        page.wait_for_timeout(1000)
        plot = page.evaluate("() => window.cartstiff.plot")
    again = pages.open(page.url)
    again.wait_for_selector("#strip .plot .turn.curve-0")
    assert again.evaluate("() => window.cartstiff.plot") == plot
    assert plot["of"] == "turn"
    assert plot["along"] == "sweep:1"
    assert again.input_value(QUANTITY) == "turn"
    assert plot["seen"][1] - plot["seen"][0] < 4 * np.pi / 2
    # What is not there is left out.
    other = pages.open(url + "#plot=flavour&along=sweep:77&seen=1,x")
    other.wait_for_selector("#strip .plot .curve-0")
    assert other.evaluate("() => window.cartstiff.plot.of") == "translation"
    for each in (page, again, other):
        each.context.close()


def test_a_map_of_colours_is_zoomed_and_saved(serve, pages, tmp_path):
    page = pages.open(serve("cubic").url + "#and=3&plot=condition&along=sweep:2")
    page.wait_for_function("() => document.querySelectorAll('.plot.heat rect').length > 40 * 40")
    settled(page)
    _, names, table = saved(page, "csv", tmp_path / "map.csv")
    assert [name.split(" ")[0] for name in names] == ["z", "roll", "value"]
    elastic = cartstiff.load("cubic")
    q = np.array(elastic.q)
    for row in table[[40, 333, 620]]:
        q[2:4] = row[:2]
        numbers = row_shown(cartstiff.analyse(elastic, q), state_of())
        assert row[2] == pytest.approx(numbers["condition"][0], rel=1e-6)
    box = page.locator(".plot.heat").bounding_box()
    x, y = box["x"] + 0.5 * box["width"], box["y"] + 0.5 * box["height"]
    page.mouse.move(x, y)
    said = page.inner_text(".reading")
    before = page.locator(".plot.heat g rect").count()
    for _ in range(5):
        page.mouse.wheel(0, -100)
    few = "(most) => document.querySelectorAll('.plot.heat g rect').length < most"
    page.wait_for_function(few, arg=0.3 * before)
    page.mouse.move(x + 0.5, y)
    assert page.inner_text(".reading").split(":")[0] == said.split(":")[0]  # stays where it was
    page.click("#strip button[title*=whole]")
    assert page.locator(".plot.heat g rect").count() == before


def lines_of(page, kind: str = "curve-0") -> np.ndarray:
    """Points (n, 2) of a curve, in dots; gaps are left out."""
    path = page.get_attribute(f"#strip .plot .curve.{kind}:not(.key)", "d")
    return np.array(
        [[float(x) for x in p.split(",")] for p in path[1:].replace("M", "L").split("L")]
    )


def test_cursor_slider_ticks_and_key(serve, pages):
    """A shoulder that turns twice is swept over one turn, with parts of it below."""
    page = pages.shared(serve("ur5", curves=True).url)
    page.select_option(ALONG, "sweep:0")
    # Principal stiffnesses do not depend on this joint: a level line has no height to be seen by.
    page.wait_for_selector("#strip .plot .curve-0", state="attached")
    settled(page)
    ticks = page.eval_on_selector_all(
        "#strip .plot:not(.heat) text", "(all) => all.map((t) => t.textContent)"
    )
    degrees = [float(t[:-1].replace("\u2212", "-")) for t in ticks if t.endswith("°")]
    assert degrees[0] == -180
    assert degrees[-1] == 180
    assert set(np.diff(degrees)) <= {30.0, 45.0, 60.0, 90.0}
    assert set(ticks) > {"softest", "middle", "stiffest"}
    assert any(t.endswith(", log") for t in ticks)
    for q in (0.3, -2.5, 3.0):
        page.evaluate(
            "(x) => window.cartstiff.change({ q: window.cartstiff.state.q.with(0, x) })", q
        )
        settled(page)
        x, thumb = page.evaluate(
            """() => {
            const time = document.querySelector("#time");
            const box = time.getBoundingClientRect();
            const share = (time.value - time.min) / (time.max - time.min);
            return [document.querySelector(".cursor").getBoundingClientRect().x,
                box.left + 8 + share * (box.width - 16)];
        }"""
        )
        assert x == pytest.approx(thumb, abs=0.6)


def test_values_by_equal_steps_or_equal_factors(serve, pages, tmp_path):
    """Heights of a curve on the screen are the values of the file, or their logarithms."""
    page = pages.shared(serve("ur5", curves=True).url)
    page.select_option(ALONG, "sweep:2")
    page.wait_for_selector("#strip .plot .curve-0")
    for kind, law in (("log", np.log), ("linear", np.asarray)):
        page.select_option("select[aria-label='Values by']", kind)
        settled(page)
        _, _, table = saved(page, "csv", tmp_path / "plot.csv")
        assert table[[0, -1], 0] == pytest.approx([-np.pi, np.pi])
        table = table[~np.isnan(table[:, 1])]  # singular ones have none
        dots = lines_of(page)
        slope, start = np.polyfit(law(table[:, 1]), dots[:, 1], 1)
        assert slope < 0
        assert dots[:, 1] == pytest.approx(slope * law(table[:, 1]) + start, abs=0.2)
    assert page.evaluate("() => window.cartstiff.plot.values") == "linear"
    page.wait_for_function("() => location.hash.includes('values=linear')")


def test_a_curve_of_another_state_is_dimmed(serve, pages):
    page = pages.shared(serve("ur5", curves=True).url)
    page.wait_for_selector("#strip .plot .curve-0")
    settled(page)
    stale = "() => document.querySelector('#strip .plot').classList.contains('stale')"
    page.evaluate(
        """() => {
        const { source } = window.cartstiff;
        const { ask } = source;
        source.between = null;
        window.cartstiff.ask = ((own) => (what) => (what.do === "sweep"
            ? new Promise((done) => { window.free = () => done(own.call(window.cartstiff, what)); })
            : own.call(window.cartstiff, what)))(window.cartstiff.ask);
    }"""
    )
    try:
        page.evaluate(
            "() => window.cartstiff.change({ load_axes: 'body', load: [0, 0, 0, 0, 0, -100] })"
        )
        page.wait_for_function("() => window.free")
        assert page.evaluate(stale)
    finally:
        page.evaluate("() => { delete window.cartstiff.ask; window.free(); }")
    page.wait_for_function(
        "() => !document.querySelector('#strip .plot').classList.contains('stale')"
    )


def test_where_another_drive_has_to_move_is_a_gap_that_says_so(serve, pages, tmp_path):
    """A delta's arm: between two of its ends the closures hold with other motors moved only."""
    page = pages.open(serve("delta", curves=True).url, viewport={"width": 1440, "height": 700})
    page.wait_for_selector("#strip .plot .curve-0")
    settled(page)
    page.evaluate("() => window.cartstiff.tell('replot')")
    with page.expect_download() as download:
        page.select_option("select[aria-label='Save the plot']", "csv")
    download.value.save_as(tmp_path / "plot.csv")
    rows = list(csv.reader((tmp_path / "plot.csv").read_text("utf-8").splitlines()))
    reasons = [row[-1] for row in rows if row[-1] and not row[0].startswith("#")][1:]
    assert any("leg" in reason for reason in reasons)
    assert page.locator("#strip .plot .gap").count() >= len(reasons) > 0
