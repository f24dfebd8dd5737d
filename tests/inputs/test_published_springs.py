"""Published joint springs by name: their numbers, what is said of them, and what is refused."""

import json
from pathlib import Path

import numpy as np
import pytest
from tests.support.commands import answer, run
from tests.support.robots import example_robot

import cartstiff
from cartstiff import InputError

KLIMCHIK = "kuka-kr270/klimchik-2013"
#: Compliances as printed, in urad/(N m), joints 2 to 6 (arXiv:1311.6810, table IV).
PRINTED = (0.302, 0.406, 3.002, 3.303, 2.365)


def notes_of(data):
    return {note["code"]: note for note in data["notes"]}


def test_values_are_those_printed():
    """Printed compliances; a spring at the motor times the ratio squared; N m/deg of a thesis."""
    sets = answer("models")["springs"]
    stiffness = sets[KLIMCHIK]["stiffness"]
    assert list(stiffness) == ["2", "3", "4", "5", "6"]
    np.testing.assert_allclose([1e6 / k for k in stiffness.values()], PRINTED, rtol=2e-6)
    at_motor = {"1": 43 * 105**2, "2": 8 * 210**2, "3": 58 * 60**2}
    assert sets["manutec-r3/tuerk-1990"]["stiffness"] == at_motor
    per_degree = sets["kuka-kr10/karlsruhe-a"]["stiffness"]["1"] * np.pi / 180
    assert per_degree == pytest.approx(1213.5, rel=1e-5)


def test_every_set_says_what_it_is():
    for name, entry in answer("models")["springs"].items():
        assert name.count("/") == 1
        assert entry["grade"] in "ABC"
        assert entry["robot"]
        assert entry["method"]
        assert entry["source"]
        assert all(1e3 < k < 1e7 for k in entry["stiffness"].values())


def test_the_set_of_the_bundled_arm_is_its_own():
    """fanuc-r2000ic has the same springs in its file, to a N m/rad."""
    own = cartstiff.load("fanuc-r2000ic")
    named = cartstiff.load("fanuc-r2000ic", springs="fanuc-r2000ic/longton-first")
    np.testing.assert_allclose(named.springs.stiffness, own.springs.stiffness, atol=0.6)
    assert named.identified is None


@pytest.mark.parametrize("is_table", [False, True])
def test_joints_beyond_a_nearer_frame_need_no_spring(tmp_path, is_table):
    """The note names them; the others are those of the whole arm; their covariance remains."""
    springs = "fanuc-r2000ic/longton-first"
    whole = cartstiff.load("fanuc-r2000ic", springs=springs).springs.stiffness
    if is_table:
        springs = tmp_path / "springs.csv"
        rows = "".join(f"{i},{k}\n" for i, k in enumerate(whole, start=1)).replace("\n6,", "\nj6,")
        springs.write_text(f"joint,stiffness\n{rows}", "utf-8")
    arm = cartstiff.load("fanuc-r2000ic", frame="link4", springs=str(springs))
    assert arm.springs.stiffness.tolist() == pytest.approx(whole[:4], rel=1e-12)
    note = next(note for note in arm.notes if note.code == "published-springs")
    last = "j6" if is_table else "6"
    assert f"Joints beyond frame 'link4' need none: 5, {last}" in note.message
    own = cartstiff.load("fanuc-r2000ic").identified
    short = cartstiff.load("fanuc-r2000ic", frame="link4").identified
    assert short.names == own.names[:4]
    assert short.covariance.tolist() == own.covariance[:4, :4].tolist()
    with pytest.raises(InputError, match="of an arm with 7 turning joints"):
        cartstiff.load("fanuc-r2000ic", frame="link4", springs="kuka-lwr4/jubien-2014")


def test_a_joint_without_a_value_is_named_and_not_filled_in():
    """In JSON and text; where nothing was there the assumption is the first sentence."""
    own = cartstiff.load("fanuc-r2000ic").springs.stiffness
    for command in (
        "analyse fanuc-r2000ic --analysis none",
        "modes fanuc-r2000ic --payload 100",
        "equilibrium fanuc-r2000ic --load 0,0,0,0,0,-100",
    ):
        note = notes_of(answer(command, "--springs", KLIMCHIK))["published-springs"]
        assert note["values"]["without_value"] == ["j1"]
        assert note["values"]["grade"] == "B"
        assert note["values"]["method"] in note["message"]
        assert "grade B (second hand" in run(command, "--springs", KLIMCHIK)
    mixed = cartstiff.load("fanuc-r2000ic", springs=KLIMCHIK, stiffness={"j6": 7.0})
    np.testing.assert_allclose(mixed.springs.stiffness[1:5], 1e6 / np.array(PRINTED[:4]), rtol=1e-5)
    assert mixed.springs.stiffness[[0, 5]].tolist() == [own[0], 7.0]
    urdf = example_robot("ur5")
    text = run("analyse", urdf, "--springs", KLIMCHIK)
    first = text.split("\n")[0]
    assert first.startswith("No stiffness was given for some joints: 10000 N m/rad")
    assert "shoulder_pan_joint and" in first
    assert "elbow" not in first


def test_assumed_springs_are_the_first_sentence(tmp_path):
    """Of text and of JSON, with the value and what to do."""
    urdf = example_robot("ur5")
    load = "--load 0,0,0,0,0,-50"
    path, postures = tmp_path / "path.csv", tmp_path / "q.csv"
    path.write_text("x,y,z,roll,pitch,yaw\n0.4,0.1,0.4,3,0,0.3\n0.4,0.15,0.4,3,0,0.3\n")
    postures.write_text("0,-1,1,0,1,0\n0,-1.1,1,0,1,0\n")
    grid = "--grid elbow_joint=0.5:1:2 --quantity translation_free_min -o"
    for command, more in (
        ("analyse", []),
        ("equilibrium", [load]),
        ("equilibrium", [load, "--path", postures]),
        ("modes", []),
        ("path", [path, load]),
        ("map", [grid, tmp_path / "map.zarr"]),
        ("frames", []),
        ("identify", ["--plan 3 --mass 5 --sd dx=0.01mm"]),
    ):
        first = run(command, urdf, *more).split("\n")[0]
        assert first.startswith("No joint stiffness was given: 10000 N m/rad"), command
        assert "--springs" in first
        assert "identify" in first
        note = answer(command, urdf, *more)["notes"][0]
        assert note["code"] == "stiffness-assumed"
        assert note["values"]["stiffness"] == 1e4
        assert note["message"][1:] + "." == first[1:]


def test_a_table_of_ones_own(tmp_path):
    """Heads carry the unit, or each cell has its own; joints by number or name."""
    table = tmp_path / "mine.csv"
    table.write_text("joint,stiffness\n1,100 N m/deg\n2,392 N m/arcmin\n3,2000.\n", "utf-8")
    k = cartstiff.load("ur5", springs=str(table)).springs.stiffness[:3]
    assert k.tolist() == pytest.approx([18000 / np.pi, 392 * 10800 / np.pi, 2000], rel=1e-12)
    table.write_text("joint,stiffness [N m/arcmin]\n1,392\nelbow_joint,100\n6,rigid\n")
    k = cartstiff.load("ur5", springs=str(table)).springs
    assert k.stiffness[[0, 2]] == pytest.approx(np.array([392, 100]) * 10800 / np.pi, rel=1e-12)
    assert k.rigid == {5}
    K = answer("analyse ur5 --analysis none --springs", table, ["--stiffness=wrist_3_joint=4000"])
    named = ["--stiffness=shoulder_pan_joint=392 N m/arcmin,elbow_joint=100 N m/arcmin"]
    other = answer("analyse ur5 --analysis none", named)
    np.testing.assert_allclose(K["stiffness"]["B"], other["stiffness"]["B"], rtol=1e-9, atol=1e-3)
    table.write_text("joint,stiffness [N/um]\n1,392\n")
    with pytest.raises(InputError, match="slides"):
        cartstiff.load("ur5", springs=str(table))
    table.write_text("joint,stiffness\nelbow_joint,1e5\n3,1e4\n")
    with pytest.raises(InputError, match=r"line 3: joint named twice.*'elbow_joint'"):
        cartstiff.load("ur5", springs=str(table))


def test_models_lists_them():
    text, data = run("models"), answer("models")
    assert f"{KLIMCHIK}         B  KUKA KR 270, joints 2, 3, 4, 5, 6" in text
    assert all(name in text for name in data["springs"])
    assert len(data["springs"]) > 5
    assert "grade" in json.dumps(data["springs"][KLIMCHIK])
    assert (Path(cartstiff.files.loading.__file__).parent / "gear_stiffness.csv").is_file()
