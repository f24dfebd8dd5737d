"""Stiffnesses with their units, wherever one is given: files, options, Python, heads of tables."""

import math

import numpy as np
import pytest
from tests.support.commands import answer

import cartstiff
from cartstiff import InputError

#: By hand: an arc minute is pi/10800 rad, an inch 0.0254 m, a pound 4.4482216152605 N.
BY_HAND = {
    "392 N m/arcmin": 392 * 10800 / math.pi,
    "392Nm/arc.min": 392 * 10800 / math.pi,
    "113 Nm/'": 113 * 10800 / math.pi,
    "1000 N·m/°": 1000 * 180 / math.pi,
    "2 kN m/mrad": 2e6,
    "50 lbf in/deg": 50 * 4.4482216152605 * 0.0254 * 180 / math.pi,
}
ARM = """kind: serial
model: ur5
frame: tool0
springs:
  shoulder_pan_joint: {stiffness: %s}
  shoulder_lift_joint: {stiffness: 3.0e4}
  elbow_joint: {stiffness: 2.0e4}
  wrist_1_joint: {stiffness: 5.0e3}
  wrist_2_joint: {stiffness: rigid}
  wrist_3_joint: {stiffness: 4.0e3}
"""
HEXAPOD = """kind: stewart-gough
units: {length: mm, force: kN}
layout: {base: {radius: 300}, platform: {radius: 200, half_angle: 0.5}, height: 400}
legs: {%s}
"""


@pytest.mark.parametrize("text", BY_HAND)
def test_turning_springs_everywhere(text, tmp_path):
    """One text in a file, in Python and in both forms of the option."""
    (path := tmp_path / "arm.yaml").write_text(ARM % f'"{text}"')
    expected = pytest.approx(BY_HAND[text], rel=1e-12)
    assert cartstiff.load(path).springs.stiffness[0] == expected
    named = cartstiff.load("ur5", stiffness={"shoulder_pan_joint": text})
    assert named.springs.stiffness[0] == expected
    assert named.with_springs([text, 1, 2, 3, 4, "5 N m/deg"]).springs.stiffness[0] == expected
    K = answer("analyse ur5 --analysis none", [f"--stiffness={text}"])["stiffness"]["B"]
    same = answer("analyse ur5 --analysis none", [f"--stiffness={BY_HAND[text]!r}"])
    np.testing.assert_allclose(K, same["stiffness"]["B"], rtol=1e-9, atol=1e-3)


def test_legs_and_flexures_in_a_file_of_millimetres(tmp_path):
    """20 N/um are 20 kN/mm; bending stays in N m/rad whatever the file's units."""
    path = tmp_path / "hexapod.yaml"
    path.write_text(HEXAPOD % "stiffness: 20 N/um")
    platform = cartstiff.load(path)
    assert platform.springs.stiffness == pytest.approx(20.0, rel=1e-12)
    assert platform.with_springs("3 kN/mm").springs.stiffness == pytest.approx(3.0, rel=1e-12)
    upper = "{bending: 33, torsion: 20, axial: 40}"
    strut = "strut: {axial: %s, lower: {bending: %s, torsion: rigid}, upper: %s}"
    path.write_text(HEXAPOD % (strut % ("20 kN/mm", f"{math.pi / 180 * 33!r} N m/deg", upper)))
    given = cartstiff.load(path).springs
    path.write_text(HEXAPOD % (strut % (20, math.pi / 180 * 33 * 180 / math.pi, upper)))
    np.testing.assert_allclose(given.stiffness, cartstiff.load(path).springs.stiffness)
    assert given.lower.bending == pytest.approx(cartstiff.load(path).springs.lower.bending)


def test_units_of_parameters_in_the_files_own(tmp_path):
    """20 N/um are 20 kN/mm in a file of mm and kN; 392 N m/arcmin stays in N m/rad there."""
    path = tmp_path / "hexapod.yaml"
    upper = "{bending: =b, torsion: 20, axial: =2*k}"
    strut = f"strut: {{axial: =k, lower: {{bending: =b, torsion: rigid}}, upper: {upper}}}"
    text = "parameters: {k: 20 N/um, b: 1 N m/deg}\n" + HEXAPOD % strut
    path.write_text(text)
    platform = cartstiff.load(path)
    assert platform.parameters == pytest.approx({"k": 20.0, "b": 180 / math.pi}, rel=1e-12)
    found = platform.springs
    assert found.stiffness == pytest.approx(20.0 * 40.0 / 60.0, rel=1e-12)  # in series
    assert found.upper.axial == pytest.approx(40.0, rel=1e-12)
    path.write_text(
        HEXAPOD
        % strut.replace("=b", "1 N m/deg").replace("=2*k", "40 N/um").replace("=k", "20 N/um")
    )
    assert found.lower.bending == pytest.approx(cartstiff.load(path).springs.lower.bending)
    path.write_text(text)
    assert cartstiff.load(path, parameters={"k": 7.0}).springs.upper.axial == pytest.approx(14.0)
    path.write_text(text.replace("1 N m/deg", "1 N/mm"))
    with pytest.raises(InputError, match=r"legs.strut.lower.bending: unit is of .* slides"):
        cartstiff.load(path)
    path.write_text(text.replace("400}", "=k}"))
    with pytest.raises(
        InputError, match=r"key layout.height: cannot be used; expected a number.*20 N/um"
    ):
        cartstiff.load(path)
    path.write_text(
        ARM.replace("kind: serial", "kind: serial\nparameters: {k: 392 N m/arcmin}") % "=k"
    )
    assert cartstiff.load(path).springs.stiffness[0] == pytest.approx(
        392 * 10800 / math.pi, rel=1e-12
    )
    path.write_text(
        ARM.replace("kind: serial", "kind: serial\nparameters: {k: 392 N m/foo}") % "=k"
    )
    with pytest.raises(InputError, match=r"line 2, key parameters.k: not a stiffness"):
        cartstiff.load(path)


LINK = """flexible:
  forearm_link:
    stiffness:
      - [10 N m/mrad, 0, 0, 0, 0, 0]
      - [0, 3 N m/deg, 0, 0, 0, %s]
      - [0, 0, 1.0e4, 0, 0, 0]
      - [0, 0, 0, 2 N/um, 0, 0]
      - [0, 0, 0, 0, 1.0e6, 0]
      - [0, %s, 0, 0, 0, %s]
"""


def test_units_in_matrices_and_polynomials(tmp_path):
    """Blocks of 6x6 springs that turn and slide, and a polynomial's first coefficient."""
    path = tmp_path / "arm.yaml"
    path.write_text(ARM % "5.0e4" + LINK % (7, 7, "1 kN/mm"))
    found = cartstiff.load(path)
    plain = LINK.replace("10 N m/mrad", "1.0e4").replace("2 N/um", "2.0e6")
    plain = plain.replace("3 N m/deg", repr(3 * 180 / math.pi)) % (7, 7, 1e6)
    path.write_text(ARM % "5.0e4" + plain)
    one, other = (cartstiff.analyse(e).matrices["B"] for e in (found, cartstiff.load(path)))
    np.testing.assert_allclose(one, other, rtol=1e-12, atol=1e-12 * np.abs(other).max())
    for last, words in (("1 N m/deg", "turns"), ("1 kN", "not a stiffness")):
        path.write_text(ARM % "5.0e4" + LINK % (7, 7, last))
        with pytest.raises(
            InputError, match=rf"key flexible.forearm_link.stiffness.6.6: .*{words}"
        ):
            cartstiff.load(path)
    path.write_text(ARM % "5.0e4" + LINK % ("7 N/m", 7, 1e6))
    with pytest.raises(InputError, match=r"stiffness.2.6: no stiffness; expected a number"):
        cartstiff.load(path)
    law = ARM.replace("{stiffness: %s}", "{polynomial: %s}")
    path.write_text(law % "[1 N m/arcmin, 0, 1.0e6]")
    k = cartstiff.load(path).springs.laws[0].coefficients
    assert k == pytest.approx((10800 / math.pi, 0.0, 1e6), rel=1e-12)
    for text, words in (("[20 N/um]", "polynomial: .*slides"), ("[1, 2 N m/deg]", "polynomial.2")):
        path.write_text(law % text)
        with pytest.raises(InputError, match=words):
            cartstiff.load(path)
