"""``cartstiff analyse`` with the options of the analysis."""

import json

import numpy as np
import pytest
from tests.doors import LoadKind, plain
from tests.support.commands import answer, run
from tests.support.printed import text_of

import cartstiff
from cartstiff import analyse_posture
from cartstiff.analysis import Tolerances
from cartstiff.geometry import se3

LOAD = "10,-20,5,30,-40,50"


@pytest.fixture
def analysis():
    def check(*arguments):
        return answer("analyse", *arguments)["analysis"]

    return check


def test_levels():
    none, short, full = (
        run(f"analyse cubic --analysis {level}") for level in ("none", "short", "full")
    )
    assert run("analyse cubic") == short
    head = none.partition("\n\nLegs\n")[0]
    assert short.startswith(head)
    assert full.startswith(head)
    for words in ("centre", "Principal stiffness", "choice of connection"):
        assert words not in none
    for words in (
        "Softest (free to turn): ",
        "Stiffest (free to turn): ",
        "Principal stiffness",
        "he choice of connection",
    ):
        assert words in short
        assert words in full
    for words in ("others held", "(2000, 2000, 2000) N/mm", "(1.25e+05, 1.25e+05, 5e+05) N m/rad"):
        assert words in full
    for words in (
        "Eigenscrews",
        "Wrench-compliant axes",
        "Twist-compliant axes",
        "normal form",
        "decoupling frame",
        "Modes with respect to",
        "isotropy",
        "determinant",
        "N^6/rad^3",
        "asymmetry of K^A",
        "Centres, from the origin of the body frame",
        "condition number",
        "mm/rad",
        "Principal compliance",
        "Stiffness along and about lines",
    ):
        assert words in full
        assert words not in short


@pytest.mark.parametrize(
    "command",
    [
        "ur5 --load 0,0,0,0,0,-100",
        "stewart-gough",
        "cable-robot --load 0,0,0,0,0,-100",
        "delta --load 0,0,0,0,0,-100",
        "6-ups --gravity 0,0,-9.81",
        "grasp --load 0,0,0,0,0,-100",
        "five-bar --added-load 0,0,0,1,0,0",
    ],
)
def test_it_fits_on_a_screen_and_says_what_does_not(command):
    """42 lines of 100 columns: answer, doubts, then tables; nothing is left out in silence."""
    lines, full = run(f"analyse {command}").splitlines(), run(f"analyse {command} --analysis full")
    assert sum(max(1, -(-len(line) // 100)) for line in lines) <= 42
    assert lines.index("Answer") < lines.index("Doubts")
    doubts = full.partition("\nDoubts\n")[2].partition("\n\n")[0].splitlines()
    assert set(doubts) <= set(lines)
    left = lines[-1].removeprefix("Not shown: ").partition(";")[0].split(", ")
    titles = {"notes": "Notes", "energy": "energy stored", "choice of connection": "he choice of c"}
    for title in (titles[name] for name in left if name in titles):
        assert title in full
        assert title not in "\n".join(lines)


def test_json_without_analysis():
    assert "analysis" not in json.loads(run("analyse cubic --json --analysis none"))


@pytest.mark.parametrize("level", ["full", "short"])
def test_json_does_not_depend_on_the_level(analysis, level):
    found = analysis(f"stewart-gough --analysis {level}")
    expected = analyse_posture(cartstiff.analyse(cartstiff.load("stewart-gough")))
    assert found == json.loads(json.dumps(expected))


def test_options_are_those_of_the_function(analysis):
    found = analysis(
        f"stewart-gough --load {LOAD} --connection K --report-at 1,2,3 --direction 1,1,0 "
        "--added-load 0,0,0,1,2,3 --length 5",
    )
    wrench = [float(x) for x in LOAD.split(",")]
    result = cartstiff.analyse(cartstiff.load("stewart-gough"), wrench=wrench)
    expected = analyse_posture(
        result,
        connection="K",
        at=se3.pose(translation=[1.0, 2.0, 3.0]),
        direction=[1, 1, 0],
        wrench=[0, 0, 0, 1, 2, 3],
        length=5.0,
    )
    assert found == json.loads(json.dumps(expected))
    assert found["length"]["origin"] == "given"
    assert found["directions"][3]["name"] == "given"


def test_tolerances(analysis):
    found = analysis("five-bar --tolerance 0.05,0.0001")["uncertainty"]
    result = cartstiff.analyse(cartstiff.load("five-bar"))
    expected = analyse_posture(result, tolerances=Tolerances(0.05, 1e-4))["uncertainty"]
    assert found == plain(expected)
    text = run("analyse cubic --tolerance 0.05")
    assert "Uncertainty from stiffness 5 % (to first order; standard deviations)" in text


def wanted(**keys):
    """A target for the cubic platform, as JSON."""
    return json.dumps({"matrix": np.diag([1e5, 1e5, 2e5, 1e6, 2e6, 1e6]).tolist()} | keys)


def test_a_target_says_its_order_units_and_frame(analysis, workplace):
    """The same target in SI, in mm and kN, and with translation first: the same legs."""
    K = np.array(json.loads(wanted())["matrix"])
    swap = [3, 4, 5, 0, 1, 2]
    # 1 N m/rad is 1 kN mm/rad, 1 N/m is 1e-6 kN/mm.
    in_mm = K * np.diag([1.0, 1, 1, 1e-6, 1e-6, 1e-6])
    files = {
        "plain.json": wanted(),
        "frame.json": wanted(frame="platform", order="angular-linear"),
        "swapped.json": wanted(matrix=K[swap][:, swap].tolist(), order="linear-angular"),
        "mm.json": wanted(matrix=in_mm.tolist(), units={"length": "mm", "force": "kN"}),
    }
    found = []
    for name, text in files.items():
        (workplace / name).write_text(text)
        found.append(analysis(f"cubic --target {name}")["synthesis"]["target"])
    head = "order linear-angular"
    np.savetxt(workplace / "swapped.csv", K[swap][:, swap], delimiter=",", header=head)
    found.append(analysis("cubic --target swapped.csv")["synthesis"]["target"])
    for other in found[1:]:
        np.testing.assert_allclose(other["matrix"], found[0]["matrix"], rtol=1e-12)
    assert [f["order_from"] for f in found] == ["default", "file", "file", "default", "file"]
    assert {f["order"] for f in found[:2]} == {"angular-linear"}


def test_a_target_with_translation_first_is_noticed(refused, workplace):
    K = np.diag([5e6, 5e6, 2e6, 2e2, 2e2, 1e2])
    np.savetxt(workplace / "a.csv", K, delimiter=",")
    words = ("--target a.csv", "translation came before rotation", "# order linear-angular")
    refused("analyse cubic --target a.csv", words=words)
    for order in ("linear-angular", "angular-linear"):
        np.savetxt(workplace / "a.csv", K, delimiter=",", header=f"order {order}")
        assert f"({order} by its file)" in run("analyse cubic --target a.csv")
    np.savetxt(workplace / "b.csv", K[::-1, ::-1], delimiter=",")
    assert "(angular-linear by default)" in run("analyse cubic --target b.csv")


@pytest.mark.parametrize("suffix", [".json", ".csv", ".npy"])
def test_target_files(analysis, tmp_path, suffix):
    path = tmp_path / f"wanted{suffix}"
    result = cartstiff.analyse(cartstiff.load("stewart-gough"))
    if suffix == ".npy":
        np.save(path, result.B.matrix)
    else:
        result.B.save(path)
    # The own files of a stiffness name its matrix.
    command = f"stewart-gough --target {path}" + " --connection B" * (suffix == ".npy")
    found = analysis(command)["synthesis"]["target"]
    assert found["connection"] == "B"
    assert found["diagonal_fit"]["stiffness"] == pytest.approx([10, 20, 30, 40, 50, 60])
    text = run(f"analyse {command}")
    assert "independent springs give it exactly" in text
    assert "N/cm" in text


def test_a_posture_without_stiffness():
    out = run("analyse five-bar --added-load 0,0,0,1,0,0")
    for words in (
        "Principal compliance",
        " mm/N, positive semidefinite",
        "under the added load",
        "only the compliance exists",
    ):
        assert words in out


def test_output_file_holds_the_analysis(workplace):
    out = run("analyse cubic --json -o result.json")
    assert json.loads((workplace / "result.json").read_text()) == json.loads(out)


def test_a_spread_that_does_not_exist_is_a_dash(analysis):
    """A tolerance far beyond its parameter leaves values without a spread, or a spread alone."""

    found = analysis("cubic --tolerance 0.1,0.0001 --length 0.3")
    whole = text_of(found).splitlines()
    for entry in found["uncertainty"]["numbers"].values():
        entry |= {"deviation": None, "lower": None, "upper": None}
        if "main_share" in entry:
            entry["main_share"] = None
    lines = text_of(found).splitlines()
    assert len(lines) == len(whole)
    assert [line for line in lines if line.endswith(" -, -, -")]


def test_world_means_every_wrench_and_direction(analysis):
    """Also of a map and, by differences, of the equilibrium."""
    posture = ("cubic", "--pose", "0,0,0,0.3,-0.2,0.5")
    load, push = [1.0, -2.0, 0.5, 30.0, -20.0, -90.0], [0.0, 0.0, 0.0, 0.0, 0.0, -10.0]
    data = analysis(
        *posture,
        "--load",
        _listed(load),
        "--added-load",
        _listed(push),
        "--direction 0,0,1 --world",
    )
    cubic = cartstiff.load("cubic")
    result = cartstiff.analyse(cubic, [0, 0, 0, 0.3, -0.2, 0.5], wrench=load, load_axes="world")
    R = result.pose[:3, :3]
    down = R.T @ [0.0, 0.0, 1.0]
    given = next(row for row in data["directions"] if row["name"] == "given")
    C = np.linalg.inv(result.tangent)
    assert given["direction"] == pytest.approx(down, abs=1e-12)
    assert given["along"]["free"] == pytest.approx(1.0 / (down @ C[3:, 3:] @ down), rel=1e-9)
    assert data["deflection"]["wrench"][3:] == pytest.approx(-10.0 * down, abs=1e-12)
    before, after = (
        cartstiff.equilibrium(
            result.elastic, result.q, LoadKind().acting(np.add(load, x), result.pose, "world")
        ).pose[:3, 3]
        for x in (np.multiply(-1e-3, push), np.multiply(1e-3, push))
    )
    moved = R @ data["deflection"]["displacement"]
    assert moved == pytest.approx((after - before) / 2e-3, rel=1e-5, abs=1e-9)


def _listed(numbers):
    return ",".join(f"{x:g}" for x in numbers)
