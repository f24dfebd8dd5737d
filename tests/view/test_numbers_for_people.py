"""Numbers for people: one style in Python and in the page, held to one table."""

import json
import math
import re
import shutil
import subprocess

import pytest
from tests.doors import engineering
from tests.support.pages import motion_shown, scripts, source_of, state_of, tab_of

import cartstiff

#: Value, unit, digits, what is read.
READ = [
    (75690.0, "N/m", 4, "75.69 N/mm"),
    (75700.0, "N/m", 4, "75.7 N/mm"),
    (999.9, "N/m", 4, "999.9 N/m"),
    (1000.0, "N/m", 4, "1 N/mm"),
    (2.5e6, "N/m", 4, "2.5 kN/mm"),
    (3e12, "N/m", 4, "3000 MN/mm"),
    (26.88, "N/cm", 4, "26.88 N/cm"),
    (7.5, "N/mm", 4, "7.5 N/mm"),
    (7540.0, "N m/rad", 4, "7.54 kN m/rad"),
    (7041.0, "N cm/rad", 4, "7.041 kN cm/rad"),
    (0.0039, "m", 4, "3.9 mm"),
    (0.39, "cm", 4, "3.9 mm"),
    (1.5, "mm", 4, "1.5 mm"),
    (1500.0, "mm", 4, "1.5 m"),
    (2.0e-8, "m", 4, "0.02 µm"),
    (1.0e-12, "m", 4, "1e-6 µm"),
    (12345.0, "m", 4, "12350 m"),
    (0.0, "m", 4, "0 m"),
    (-0.0, "N", 4, "0 N"),
    (-100.0, "N", 4, "-100 N"),
    (-1234.56, "N", 4, "-1.235 kN"),
    (1234.5, "1", 4, "1235"),  # half a digit goes up, in binary and by hand
    (2.675, "", 3, "2.68"),
    (0.138, "N m", 4, "138 mN m"),
    (6.49e-3, "rad", 4, "6.49 mrad"),
    (3.2, "rad", 4, "3.2 rad"),
    (2.5e-5, "m/N", 4, "25 µm/N"),
    (2.5e-4, "rad/(N cm)", 4, "250 µrad/(N cm)"),
    (2.5e-4, "rad/(N mm)", 4, "250 mrad/(N m)"),
    (31.51, "", 4, "31.51"),
    (99999.6, "", 4, "100000"),
    (123456.0, "", 4, "1.235e5"),
    (0.00012345, "", 4, "1.235e-4"),
    (12.345, "kg", 3, "12.3 kg"),
    (math.inf, "N", 4, "∞ N"),
    (-math.inf, "", 4, "-∞"),
]


@pytest.mark.parametrize(("value", "unit", "digits", "read"), READ)
def test_a_number_is_read(value, unit, digits, read):
    assert engineering(value, unit, digits) == read


def test_what_is_rounding_is_zero_and_what_is_not_there_a_dash():
    assert engineering(1e-13, "N", least=1e-12) == "0 N"
    assert engineering(None, "N") == "-"
    assert engineering(math.nan, "N") == "-"


def _in_node(module, made):
    """What an expression of a module of the page is."""
    if shutil.which("node") is None:
        pytest.skip("no node to run JavaScript")
    script = f"{scripts(module)}process.stdout.write(JSON.stringify({made}));"
    done = subprocess.run(["node", "-"], input=script, capture_output=True, text=True, check=True)
    return json.loads(done.stdout)


def test_the_page_reads_the_same():
    asked = json.dumps([[str(value), unit, digits] for value, unit, digits, _ in READ])
    number = '(x) => Number(x.replace("inf", "Infinity"))'
    texts = _in_node(
        "dom.js",
        f"{asked}.map(([x, unit, digits]) => engineering(({number})(x), unit, digits))",
    )
    assert [text.replace("\u2212", "-") for text in texts] == [r for *_, r in READ]


@pytest.mark.parametrize(("kind", "power"), [("root", 2), ("linear", 1)])
def test_the_legend_names_a_length_and_its_value(kind, power):
    session = tab_of(source_of(cartstiff.load("ur5")))
    drawn = session.picture.draw(session.result(session.start), state_of(scale=kind))
    legend = _in_node("legend.js", f"legendOf({json.dumps(drawn)})")
    text = legend["lines"][0]["text"]
    length, value, prefix, unit = re.search(r": (\S+) cm = (\S+) (k?)(N/m+)", text).groups()
    value = float(value) * (1e3 if prefix else 1.0) * (1e3 if unit == "N/mm" else 1.0)
    per_length = legend["measures"]["translation"]["value_per_length"]
    assert value == pytest.approx(per_length * (float(length) / 100) ** power)


def test_the_legend_says_what_else_is_drawn_and_what_is_not():
    session = tab_of(source_of(cartstiff.load("ur5")))
    state = state_of(load=(0, 2, 0, 0, 0, -100.0), scale="log", rotation=False)
    result = session.result(state)
    drawn = session.picture.draw(result, state, motion_shown(result, state))
    lines = _in_node("legend.js", f"legendOf({json.dumps(drawn)}).lines")
    assert [line["mark"] for line in lines] == ["translation", "force", "moment", "deflection"]
    assert re.search(r"\(rings\)$", lines[0]["text"])
    assert re.match(r"force: 100 N is \d+(\.\d+)? cm long; ten times the force", lines[1]["text"])
    assert lines[2]["title"].startswith("length = ")
    assert lines[0]["text"].startswith("compliance of translation (rotation free): ")
    factor = drawn["rest"]["enlarged"]
    assert (
        f"without the load; the way between is drawn {factor:.3g} times as far" in lines[3]["text"]
    )
    singular = state_of(q=[0.0] * 6, scale="log")
    drawn = session.picture.draw(session.result(singular), singular)
    lines = _in_node("legend.js", f"legendOf({json.dumps(drawn)}).lines")
    assert [line["mark"] for line in lines] == ["note"]
    both = "stiffness of translation (rotation free), stiffness of rotation (translation free)"
    assert lines[-1]["text"].startswith(f"{both} not drawn: ")


def test_curves_have_the_unit_of_their_values_that_are_not_zero():
    """A body that moves along one line only: two of three principal compliances are zero."""
    store = '{ sizes: {}, blockUnits: () => [["rad", ""], ["", "m/N"]] }'
    rows = "[{ translation: [0, 0, 6.83e-5] }, { translation: [0, 0, 6.5e-5] }]"
    made = f'plotted({store}, "translation", {{ quantity: "compliance" }}, {rows}).unit'
    assert _in_node("curves.js", made) == "µm/N"


def test_a_saved_plot_says_all_that_its_numbers_depend_on():
    arm = {"name": "arm", "frame": "tool", "coordinates": []}
    arm |= {"springs": [], "is_illustrative": False}
    hello = {"version": "1", "mechanism": arm}
    state = state_of(
        load=(0, 0, 0, 0, 0, -80.0),
        load_at=(0.1, 0, 0),
        gravity=(0, 0, -9.81),
        payload=(3, 0, 0, 0.2),
        stiffness=[2e4, None],
        command=[0, 0.1],
    )
    made = f'provenance({{ hello: {json.dumps(hello)} }}, {state.model_dump_json()}, "title")[1]'
    assert _in_node("plotfiles.js", made) == (
        "arm, frame tool, point (0, 0, 0), tool axes, connection load, "
        "load (0, 0, 0, 0, 0, -80) dead, tool axes, at (0.1, 0, 0) in M, gravity (0, 0, -9.81), "
        "payload 3 kg at (0, 0, 0.2), springs (20000, rigid), drives commanded by (0, 0.1)"
    )
