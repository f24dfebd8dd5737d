"""States and mechanisms beside what is in hand: numbers, ratios, pictures, curves."""

from dataclasses import replace

import numpy as np
import pytest
from tools.screenshot import settled

import cartstiff
from cartstiff.extend import in_units
from tests.support.pages import served, source_of
from tests.support.read_units import read, si

LOAD = [0.0, 0.0, 0.0, 0.0, 0.0, -100.0]


@pytest.fixture(scope="module")
def two():
    arm = cartstiff.load("ur5")
    soft = replace(arm.with_springs((0.5 * arm.springs.stiffness).tolist()), name="softer")
    server = served(source_of(arm), beside=[source_of(soft)])
    yield arm, soft, server.url
    server.close()


def rows(page, late=False):
    """The rows but the first: (numbers, ratios) by name."""
    if not late:
        settled(page)
    page.wait_for_function("() => window.cartstiff.rows.every((row) => row.numbers)")
    units = [si(unit) for unit in page.locator(".compared thead .unit").all_inner_texts()]
    units[0] *= 1e3  # in mm
    found = {}
    for row in page.locator(".compared tbody tr").all()[1:]:
        cells = [cell.inner_text().split("\n") for cell in row.locator("td").all()]
        found[row.locator("b").inner_text()] = (
            [float(cell[0]) * unit for cell, unit in zip(cells, units, strict=True)],
            [float(cell[1].replace("× ", "")) for cell in cells],
        )
    return found


def expected(elastic, q, times=1.0):
    wrench = [times * x for x in LOAD]
    result = cartstiff.analyse(elastic, q, wrench=wrench, load_axes="world")
    moved = np.linalg.solve(result.tangent, result.wrench)
    C = np.linalg.inv(result.tangent)
    soft = [1 / np.linalg.eigvalsh((0.5 * (C + C.T))[i : i + 3, i : i + 3])[-1] for i in (3, 0)]
    return np.array([1e3 * np.linalg.norm(moved[3:]), *soft])


def test_rows_are_states_and_mechanisms_with_their_ratios(two, pages):
    arm, soft, url = two
    page = pages.open(f"{url}#load=0,0,0,0,0,-100&load_axes=world")
    page.keyboard.press("a")
    settled(page)
    first = arm.q.tolist()
    q = [*first[:2], first[2] + 0.4, *first[3:]]
    page.evaluate("(q) => window.cartstiff.goTo(q)", q)
    settled(page)
    page.click("button:has-text('Keep as 2')")
    page.evaluate("() => window.cartstiff.change({load: [0, 0, 0, 0, 0, -200]})")
    settled(page)
    page.evaluate("() => window.cartstiff.change({load: [0, 0, 0, 0, 0, -100]})")
    here = expected(arm, q)
    found = rows(page)
    # Another mechanism with the same coordinates follows the hand; what was kept stays.
    for name, elastic, posture in (("softer", soft, q), ("1", arm, first), ("2", arm, q)):
        numbers, ratios = found[name]
        other = expected(elastic, posture)
        assert np.allclose(numbers, other, rtol=6e-4)
        assert np.allclose(ratios, other / here, rtol=6e-3)
    # A row that is not answered yet keeps its numbers with the ratios that belong to them.
    page.evaluate("""() => {
        const row = window.cartstiff.rows.find((row) => !row.own);
        const { source } = row.store;
        const { ask } = source;
        source.ask = (message) => {
            source.held = () => [source.ask, source.held] = [ask, ask.call(source, message)];
        };
        window.cartstiff.change({load: [0, 0, 0, 0, 0, -300]});
    }""")
    page.wait_for_function("() => window.cartstiff.busy === null")
    assert page.locator(".compared .late b").all_inner_texts() == ["softer"]
    cells = [cell.inner_text() for cell in page.locator(".compared .late td").all()]
    assert [float(cell.split("\n× ")[1]) for cell in cells] == found["softer"][1]
    # In the units of the present state, which may be others.
    assert np.allclose(rows(page, late=True)["softer"][0], found["softer"][0], rtol=6e-4)
    page.evaluate("() => window.cartstiff.rows.find((row) => !row.own).store.source.held()")
    numbers, ratios = rows(page)["softer"]
    other = expected(soft, q, 3.0)
    assert np.allclose(numbers, other, rtol=6e-4)
    assert np.allclose(ratios, other / expected(arm, q, 3.0), rtol=6e-3)
    page.evaluate("() => window.cartstiff.change({load: [0, 0, 0, 0, 0, -100]})")
    settled(page)
    # One eye for all pictures, and radii that mean the same.
    page.wait_for_function("() => window.cartstiff.rows.every((row) => row.store?.legend)")
    page.evaluate("() => window.cartstiff.pane.look('top', window.cartstiff.hello.bounds)")
    settled(page)
    seen = page.evaluate("""() => {
        const store = window.cartstiff;
        return store.rows.map((row) => [row.pane.view, row.store.legend.measures]);
    }""")
    eye = page.evaluate("() => [window.cartstiff.pane.view, window.cartstiff.legend.measures]")
    assert len(seen) == 3
    for view, measures in seen:
        assert np.allclose(view, eye[0], atol=1e-3)
        assert measures == eye[1]
    # Its curve lies in the same plot.
    page.evaluate(
        "() => document.querySelector('#strip select').dispatchEvent(new Event('change'))"
    )
    page.wait_for_selector("#strip .plot .curve.other")
    # The address holds what was kept.
    page.wait_for_function("""() => {
        const held = new URLSearchParams(location.hash.slice(1));
        return held.has("kept2") && held.get("load")?.endsWith("-100");
    }""")
    again = pages.open(page.evaluate("() => window.location.href"))
    again.wait_for_function("() => window.cartstiff.rows.length === 3")
    assert {name: rows(again)[name] for name in ("1", "2")} == {n: found[n] for n in ("1", "2")}
    page.click("[aria-label='Forget state 1']")
    settled(page)
    assert "1" not in rows(page)


#: What stands at the arrow of the way of each picture, and below it, but for the picture in hand.
WAYS = """() => [window.cartstiff, ...window.cartstiff.rows].map(({ store, pane, caption }) => [
    pane.part("callout").children[0].userData.label.text,
    caption?.firstChild.textContent ?? null])"""


def test_each_mechanism_opens_at_its_own_posture_and_then_follows_the_hand(pages):
    arm, other = cartstiff.load("ur5"), cartstiff.load("ur10")
    in_mm = replace(in_units(other, "mm"), name="ur10-in-mm")
    assert np.abs(arm.q - other.q).max() > 0.1  # or nothing is asked
    server = served(source_of(arm), beside=[source_of(other), source_of(in_mm)])
    try:
        page = pages.open(f"{server.url}#load=0,0,0,0,0,-100&load_axes=world")
        moved = [arm.q[0], arm.q[1] - 0.2, *arm.q[2:]]
        for there, here, act in (
            (other.q, arm.q, ""),
            (moved, moved, "(q) => window.cartstiff.goTo(q)"),
            (other.q, arm.q, "(q) => window.cartstiff.goTo(q)"),
        ):
            if act:
                page.evaluate(act, np.array(here).tolist())
            settled(page)
            page.wait_for_function(
                "() => window.cartstiff.rows.every((row) => row.numbers && !row.late)"
            )
            settled(page)
            rows = page.locator(".compared tbody tr").all()
            assert ("its own posture" in rows[1].inner_text()) == (here is arm.q)
            assert "other units" in rows[2].inner_text()
            found = [expected(each, q)[0] / 1e3 for each, q in ((arm, here), (other, there))]
            ways = page.evaluate(WAYS)
            for (arrow, caption), way in zip(ways, [*found, found[1]], strict=True):
                assert read(arrow) == pytest.approx(way, rel=6e-4)
                assert caption is None or caption.endswith(f", {arrow}")
    finally:
        page.goto("about:blank")
        server.close()
