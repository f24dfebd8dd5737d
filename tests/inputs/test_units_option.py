"""``--units``: what is given and shown in millimetres and degrees is the same as in SI."""

import csv
import json
import re

import numpy as np
import pytest
from matplotlib.colors import LogNorm
from tests.support.commands import answer, run

import cartstiff
from cartstiff.figures import figure_content, new_figure
from cartstiff.mechanisms.other_units import in_units
from cartstiff.potentials.loads import DeadForce
from cartstiff.statics.toolpath import compensate

SHOWN = "--units mm,deg"
SI = "--tcp 0,0,0.1,0,0,0.5 --payload 2,0,0,0.05 --q 0.2,-1,1.2,0.3,1,0.1"
NUMBER = re.compile(r"[-+]?\d[\d.]*(?:e[-+]?\d+)?")
OTHER = (
    "--units",
    "mm,deg",
    "--tcp",
    f"0,0,100,0,0,{np.degrees(0.5)}",
    "--payload",
    "2,0,0,50",
    "--q",
    ",".join(str(x) for x in np.degrees([0.2, -1, 1.2, 0.3, 1, 0.1])),
)


def test_analyse():
    """Text is in the units asked for, as another program's users would compute by hand."""
    si = answer("analyse ur5", SI, "--load 1,2,3,10,20,30")
    loaded = (*OTHER, "--load", "1000,2000,3000,10,20,30", "--connection", "B")
    text = run("analyse ur5", *loaded, "--analysis none")
    assert "lengths in mm" in text
    assert "N mm/rad" in text
    s = np.repeat([1e3, 1.0], 3)
    K = np.array(si["stiffness"]["B"]) * s[:, None] * s / 1e3
    rows = text[text.index("K^B") :].split("\n")
    found = [
        [float(x) for x in NUMBER.findall(row)[-6:]]
        for row in rows
        if len(NUMBER.findall(row)) >= 6
    ][:6]
    np.testing.assert_allclose(found, K, rtol=1e-4, atol=1e-4 * np.abs(K).max())


def test_path_and_what_reads_it(tmp_path):
    """Written in mm and degrees, read by the next commands with and without --units."""
    si, mm = tmp_path / "si.csv", tmp_path / "mm.csv"
    si.write_text("x,y,z,roll,pitch,yaw\n0.4,0.1,0.4,3,0,0.3\n0.4,0.15,0.4,3,0,0.3\n")
    degrees = [str(np.degrees(x)) for x in (3, 0, 0.3)]
    mm.write_text(
        "x,y,z,roll,pitch,yaw\n" + "".join(f"400,{y},400,{','.join(degrees)}\n" for y in (100, 150))
    )
    load = "--load 0,0,0,0,0,-50"
    postures = {}
    for name, file, units in (("a", si, ()), ("b", mm, ("--units", "mm,deg"))):
        out = tmp_path / f"{name}.csv"
        data = answer("path ur5", file, load, *units, f"--csv {out}")
        postures[name] = np.array(data["q"])
        with out.open() as handle:
            rows = list(csv.reader(handle))
        assert rows[0][0] == f"shoulder_pan_joint [{'deg' if units else 'rad'}]"
        if units:
            shown = np.array([row[:6] for row in rows[1:]], float)
            np.testing.assert_allclose(np.radians(shown), postures[name], rtol=1e-12)
    np.testing.assert_allclose(postures["a"], postures["b"], rtol=1e-6, atol=1e-8)
    text = run("path ur5", mm, load, "--units mm,deg")
    assert "coordinates in deg" in text
    assert "[mm]" in text
    moved = tmp_path / "commands.csv"
    run("equilibrium ur5", load, "--path", tmp_path / "b.csv", f"--csv {moved}", code=2)
    path, unneeded = f"equilibrium ur5 --path {tmp_path / 'b.csv'}", "not needed here"
    run(path, f"--csv {moved} --units deg", said=unneeded)
    head = moved.read_text(encoding="utf-8").split("\n")[0]
    assert head.startswith("command_shoulder_pan_joint [deg]")
    assert "before_rx [deg]" in head
    names, first = (line.split(",") for line in moved.read_text().split("\n")[:2])
    told = answer(path, said=unneeded)
    turned = float(first[names.index("before_rx [deg]")])
    assert np.isclose(np.radians(turned), told["error_before"][0][0], rtol=1e-9)
    curve = tmp_path / "curve.csv"
    run("equilibrium ur5", load, f"--curve 1 --csv {curve} --units mm,deg")
    names = curve.read_text().split("\n")[0].split(",")
    assert {"elbow_joint [deg]", "rx [deg]", "z [mm]", "linear_z [mm]"} <= set(names)


def test_measurements_are_planned_found_and_written_in_other_units(tmp_path):
    """Point, ranges, volume, springs and tables of `identify`; the file written is in its own."""
    small, large = ("--units", "mm,deg", "--point", "0,0,50"), ("--point", "0,0,0.05")
    what = [word for axis in "xyz" for word in ("--sd", f"d{axis}=0.02mm")]
    found = []
    for own, volume, turn, to in (
        (small, "z=100:900", "elbow_joint=-90:90", tmp_path / "mm"),
        (large, "z=0.1:0.9", f"elbow_joint={-np.pi / 2}:{np.pi / 2}", tmp_path / "m"),
    ):
        text = run(
            "identify ur5",
            *own,
            "--plan 8 --force 80",
            *what,
            f"--within {volume} --range {turn} --candidates 20 --csv {to}1.csv",
        )
        run(
            "identify ur5",
            *own,
            tmp_path / "mm1.csv",
            "--simulate 1",
            *what,
            f"--csv {to}2.csv",
        )
        data = json.loads(run("identify ur5", *own, f"{to}2.csv", *what, f"--json -o {to}.yaml"))
        K = cartstiff.analyse(cartstiff.load(f"{to}.yaml")).matrices["B"]
        found.append((text, data, K))
    (text, mm, K), (_, m, wanted) = found
    assert "elbow_joint [deg]" in text
    head = (tmp_path / "mm2.csv").read_text().splitlines()[0]
    assert "elbow_joint [deg]" in head
    assert "dz [mm]" in head
    for a, b in zip(mm["parameters"], m["parameters"], strict=True):
        assert a["unit"] == b["unit"] == "N m/rad"
        assert a["identifiable"] == b["identifiable"]
        if b["identifiable"]:
            assert a["stiffness"] == pytest.approx(b["stiffness"], rel=1e-6)
    assert np.allclose(K, wanted, rtol=1e-6, atol=1e-6 * np.abs(wanted).max())


def test_pictures_of_errors_are_in_the_units_shown():
    """Ticks are plain text: a picture's words are no formulas."""
    arm = in_units(cartstiff.load("ur5"), "mm", "deg")
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
    assert "Held: left_motor 126.051 deg, right" in run("assemble five-bar --all", SHOWN)
    assert "Held: leg1 836.457 mm, leg2" in run("assemble hexapod", SHOWN)


def test_how_far_the_body_turns_is_told_in_degrees():
    words = "analyse ur5 --load 0,0,0,0,0,-100 --analysis full"
    found = {}
    for units in ("rad", "deg"):
        line = next(x for x in run(words, f"--units mm,{units}").splitlines() if "turns (" in x)
        assert f") {units} (all" in line
        found[units] = np.array(line[line.index("(") + 1 : line.index(")")].split(","), float)
    np.testing.assert_allclose(found["deg"], np.degrees(found["rad"]), rtol=1e-3)


def test_a_joint_that_does_not_move_is_told_as_zero():
    text = run("analyse ur5 --load 0,0,0,0,0,-100 --analysis full")
    row = next(x for x in text.splitlines() if "wrist_3_joint" in x and " %" in x)
    assert row.split() == ["wrist_3_joint", "0", "rad", "0", "%", "0", "0", "0"]
