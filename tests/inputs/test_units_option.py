"""Text and pictures are in N/mm, mm and degrees; files have their units in their heads."""

import csv

import numpy as np
import pytest
from matplotlib.colors import LogNorm
from tests.doors import figure_content, new_figure
from tests.support.commands import answer, run

import cartstiff
from cartstiff import DeadForce, compensate


def test_analyse_prints_the_numbers_of_its_json_in_engineering_units():
    words = "analyse ur5 --load 1,2,3,10,20,30 --connection B"
    found, text = answer(words), run(f"{words} --analysis full").splitlines()

    def row(start, column=0):
        """Numbers in brackets of the first line that begins so."""
        line = next(x for x in text if x.strip().startswith(start) and "(" in x)
        return np.array(line.split("(")[1 + column].partition(")")[0].split(", "), float)

    own = found["analysis"]["ellipsoids"]["stiffness"]
    np.testing.assert_allclose(
        row("translation", 1),
        np.array(own["translation"]["free"]["eigenvalues"]) / 1e3,
        rtol=1e-3,
    )
    np.testing.assert_allclose(
        row("rotation", 1), own["rotation"]["free"]["eigenvalues"], rtol=1e-3
    )
    position = np.array(found["pose"])[:3, 3]
    said = next(line for line in text if line.startswith("M at ("))
    said = said.removeprefix("M at (").partition(") mm in F")[0]
    np.testing.assert_allclose(np.array(said.split(", "), float), 1e3 * position, rtol=1e-5)
    centre = found["analysis"]["centres"]["stiffness"]
    np.testing.assert_allclose(row("centre of stiffness"), 1e3 * np.array(centre), rtol=1e-3)


def test_tables_have_their_units_in_their_heads_and_are_read_again(tmp_path):
    path, postures, moved = (tmp_path / name for name in ("path.csv", "q.csv", "moved.csv"))
    path.write_text("x [mm],y [mm],z [mm],roll [deg],pitch,yaw\n400,100,400,170,0,0.3\n")
    load = "--load 0,0,0,0,0,-50"
    q = answer("path ur5", path, load, f"-o {postures}")["q"]
    with postures.open() as handle:
        head, *rows = csv.reader(handle)
    assert head[0] == "shoulder_pan_joint [rad]"
    np.testing.assert_array_equal(np.array([row[:6] for row in rows], float), q)
    text = run("path ur5", path, load)
    assert "shoulder_pan_joint [deg]" in text
    assert f"{np.degrees(q[0][0]):.3f}" in text
    run(f"equilibrium ur5 --path {postures} -o {moved}", said="not needed here")
    assert {"command_elbow_joint [rad]", "before_rx [rad]", "before_z [m]"} <= {
        *moved.read_text(encoding="utf-8").split("\n")[0].split(",")
    }


def test_pictures_of_errors_are_in_the_units_shown():
    """Ticks are plain text: a picture's words are no formulas."""
    arm = cartstiff.load("ur5")
    figure = compensate(arm, [arm.q] * 2, [[DeadForce([0, 0, -50])]] * 2).plot()
    figure_content(figure, ".png")
    assert [a.get_ylabel() for a in figure.axes] == [
        "translation error [mm]",
        "rotation error [deg]",
    ]
    ticks = [t.get_text() for a in figure.axes for t in a.get_yticklabels()]
    assert any(ticks)
    assert not any("$" in t for t in ticks)


@pytest.mark.parametrize("scale", ["axes", "bar"])
def test_no_picture_with_a_logarithm_prints_a_formula(scale):
    """Names may hold a dollar, so that no text is read as a formula; ticks must not be one."""
    figure = new_figure(4.0, 3.0)
    axis = figure.subplots()
    if scale == "axes":
        axis.loglog([1.0, 10.0, 1000.0], [1e-6, 1e-3, 2e-3])
    else:
        drawn = axis.imshow([[1e-6, 1e-3], [1e-2, 2.0]], norm=LogNorm(1e-6, 2.0))
        figure.colorbar(drawn, ax=axis)
    figure_content(figure, ".png")
    ticks = [
        t.get_text() for a in figure.axes for t in (*a.get_xticklabels(), *a.get_yticklabels())
    ]
    assert any("1e" in text for text in ticks)
    assert not any("$" in text for text in ticks)


def test_what_holds_assembly_modes_has_a_unit():
    assert "Held: left_motor 126.051 deg, right" in run("assemble five-bar --all")
    assert "Held: leg1 836.457 mm, leg2" in run("assemble hexapod")


def test_how_far_the_body_turns_is_told_in_degrees():
    words = "analyse ur5 --load 0,0,0,0,0,-100 --analysis full"
    line = next(x for x in run(words).splitlines() if "turns (" in x)
    assert ") deg (all" in line
    told = np.array(line[line.index("(") + 1 : line.index(")")].split(","), float)
    turned = answer(words)["analysis"]["deflection"]["twist"][:3]
    np.testing.assert_allclose(told, np.degrees(turned), rtol=1e-3)


def test_a_joint_that_does_not_move_is_told_as_zero():
    text = run("analyse ur5 --load 0,0,0,0,0,-100 --analysis full")
    table = text.partition("shares of the displacement")[2]
    row = next(x for x in table.splitlines() if "wrist_3_joint" in x and " %" in x)
    assert row.split() == ["wrist_3_joint", "0", "deg", "0", "%", "(0,", "0,", "0)", "mm"]
