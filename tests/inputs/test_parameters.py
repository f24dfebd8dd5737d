"""Parameters of mechanism files: their arithmetic against Python's, their refusals, and --set."""

import json
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.support.commands import answer, run

import cartstiff
from cartstiff import InputError

FILE = """\
kind: springs
parameters: {r: 0.25, h: =2*r, k: "=4e3*r**2/h"}
base: [[=r, 0, 0], ["=r*cos(2*pi/3)", "=r*sin(2*pi/3)", 0], [=-r/2, "=-r*sqrt(3)/2", 0]]
platform: [[0, 0, 0], [0, 0, 0], [0, 0, 0]]
pose: {xyz: [0, 0, =h]}
legs: {stiffness: =k}
"""


@pytest.fixture
def tripod(tmp_path):
    """Three legs to a point over the middle of an equilateral triangle."""
    path = tmp_path / "tripod.yaml"
    path.write_text(FILE, encoding="utf-8")
    return path


@pytest.mark.parametrize(("r", "given"), [(0.25, None), (0.4, {"r": 0.4})])
def test_numbers_follow_from_the_parameters(tripod, r, given):
    """The tripod's stiffness by hand: k (3/2 sin^2, 3/2 sin^2, 3 cos^2) of the leg's angle."""
    elastic = cartstiff.load(tripod, parameters=given)
    h, k = 2 * r, 4e3 * r**2 / (2 * r)
    across = r**2 / (r**2 + h**2)
    K = cartstiff.analyse(elastic).matrices["B"][3:, 3:]
    expected = k * np.diag([1.5 * across, 1.5 * across, 3 * (1 - across)])
    assert np.abs(K - expected).max() < 1e-12 * k
    assert elastic.parameters == pytest.approx({"r": r, "h": h, "k": k})


numbers = st.floats(0.1, 9.0).map(lambda x: repr(round(x, 3)))
texts = st.recursive(
    numbers | st.sampled_from(["x", "y", "pi"]),
    lambda part: (
        st.tuples(part, st.sampled_from(["+", "-", "*", "/", "**"]), part).map(
            lambda found: f"({found[0]} {found[1]} {found[2]})"
        )
        | st.tuples(st.sampled_from(["sin", "cos", "sqrt", "-", "atan2"]), part).map(
            lambda found: f"{found[0]}({found[1]}{', 2' if found[0] == 'atan2' else ''})"
        )
    ),
    max_leaves=8,
)


@pytest.fixture(scope="module")
def value_of(tmp_path_factory):
    """The value of an expression in a file that has the parameters x and y."""
    path = tmp_path_factory.mktemp("file") / "tripod.yaml"

    def value(text):
        known = f"found: {json.dumps('=' + text)}, x: 0.7, y: -1.3, r: =0.25 + 0 * (found+x+y)"
        path.write_text(FILE.replace("{r: 0.25", "{" + known), encoding="utf-8")
        return cartstiff.load(path).parameters["found"]

    return value


@settings(max_examples=60)
@given(text=texts)
def test_arithmetic_is_that_of_python(value_of, text):
    names = {
        "x": 0.7,
        "y": -1.3,
        "pi": math.pi,
        "sin": math.sin,
        "cos": math.cos,
        "sqrt": math.sqrt,
        "atan2": math.atan2,
    }
    try:
        expected = eval(text, {"__builtins__": {}}, names)
    except (ArithmeticError, ValueError, TypeError):
        expected = math.nan
    if isinstance(expected, complex) or not math.isfinite(expected):
        with pytest.raises(InputError, match=r"division by zero|no finite real number"):
            value_of(text)
    else:
        found = value_of(text)
        assert found == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize(
    "text",
    [
        "",
        "2 +",
        "__import__('os')",
        "r.real",
        "r[0]",
        "r if r else 1",
        "r < 2",
        "True",
        "1j",
        "'a'",
        "lambda: 1",
        "sin",
        "sin(1, 2)",
        "sin(x=1)",
        "(" * 300,
        "-" * 390 + "1 2",
        "1 # 2\n3",
        "r := 2",
        "abs(r)",
        "f'{r}'",
        "[1]",
        "2 if r",
        "pow(2, 3)",
        "9" * 500,
    ],
)
def test_what_is_no_arithmetic_is_refused(value_of, text):
    with pytest.raises(InputError, match=r"key parameters.found: .*(arithmetic|unknown function)"):
        value_of(text)


def test_parameters_may_need_each_other_in_a_long_row(tripod):
    """Each is one more than the next, which is written after it: the first is their number."""
    row = ", ".join(f"p{i}: =p{i + 1}+1" for i in range(1999))
    tripod.write_text(FILE.replace("{r: 0.25", f"{{r: =p0/8000, {row}, p1999: 1"), encoding="utf-8")
    assert cartstiff.load(tripod).parameters["r"] == 2000 / 8000


def test_what_is_set_is_known_and_told(tripod):
    notes = answer("analyse", tripod, "--set r=0.4")["notes"]
    note = next(n for n in notes if n["code"] == "parameters-set")
    assert note["values"] == {"r": 0.4}
    assert "r = 0.4, h = 1" in run("analyse", tripod, "--set r=0.4,h=1")
    with pytest.raises(InputError, match="parameter 'r'"):
        cartstiff.load(tripod, parameters={"r": math.nan})


def test_counts_and_xacro_arguments_may_be_arithmetic(tmp_path):
    """What is a whole number can stand where a count stands."""
    arm = (
        "<robot name='a'><link name='b'/><link name='l'/><link name='t'/>"
        "<joint name='j' type='revolute'><parent link='b'/><child link='l'/><axis xyz='0 0 1'/>"
        "<limit lower='-3' upper='3' effort='1' velocity='1'/></joint>"
        "<joint name='e' type='fixed'><parent link='l'/><child link='t'/>"
        "<origin xyz='0.5 0 0'/></joint></robot>"
    )
    (tmp_path / "a.urdf").write_text(arm)
    text = (
        "kind: serial\nmodel: a.urdf\nframe: t\nparameters: {n: 2, I: 4.0e-8}\n"
        "flexible: {l: {beam: {E: 7.0e10, G: 2.6e10, length: 0.5, area: 6.0e-4, Iy: =I, Iz: =I, "
        "J: =2*I, segments: =n}}}\n"
    )
    (tmp_path / "a.yaml").write_text(text)
    counts = [
        len(cartstiff.load(tmp_path / "a.yaml", parameters={"n": n}).names) for n in (1, 2, 3)
    ]
    assert counts[1] - counts[0] == counts[2] - counts[1] == 6
    with pytest.raises(InputError, match=r"flexible\.l\.beam.*got 1\.5"):
        cartstiff.load(tmp_path / "a.yaml", parameters={"n": 1.5})
