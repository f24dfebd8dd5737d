"""Maps over what drives are told, and over poses after a command."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import cartstiff
from cartstiff.cli.main import main
from cartstiff.errors import InputError, UnknownNameError
from cartstiff.maps.job import CommandGrid
from cartstiff.maps.sampling import Grid


def run(*words: str) -> int:
    """Exit code of the command line in this process."""
    with pytest.raises(SystemExit) as ended:
        main([*words])
    return int(ended.value.code or 0)


LOAD = [0.2, -0.1, 0.3, 5.0, -4.0, -10.0]
QUANTITIES = ["translation_free_min", "deflection", "rotation_held_max"]


def test_a_map_over_commands_is_the_analysis_after_each(tmp_path: Path, capsys) -> None:
    """Each cell is what `analyse --actuate` says, and the body moves as the legs' columns say."""
    machine = cartstiff.load("flexure-hexapod")
    grid = CommandGrid({"leg1": (-1e-5, 1e-5, 3), "leg4": (0.0, 2e-5, 2)}, machine)
    found = cartstiff.compute_map(
        machine, grid, QUANTITIES, tmp_path / "a.zarr", wrench=LOAD, told={"leg2": 1e-6}
    )
    assert dict(found.sizes)["command_leg4"] == 2
    for i, a in enumerate((-1e-5, 0.0, 1e-5)):
        for j, b in enumerate((0.0, 2e-5)):
            words = f"leg1={a},leg4={b},leg2=1e-6"
            load = ",".join(map(str, LOAD))
            assert (
                run("analyse", "flexure-hexapod", "--actuate", words, "--load", load, "--json") == 0
            )
            here = json.loads(capsys.readouterr().out)
            cell = found.isel(command_leg1=i, command_leg4=j)
            assert np.abs(cell.q.values - here["q"]).max() < 1e-12
            assert cell.state.values == 0
            C = np.array(here["analysis"]["compliance"])[3:, 3:]
            lowest = 1.0 / np.linalg.eigvalsh(0.5 * (C + C.T)).max()
            assert float(cell.translation_free_min) == pytest.approx(lowest, rel=1e-9)
            assert np.abs(cell.position.values - np.array(here["pose"])[:3, 3]).max() < 1e-15
    # Along the poses that legs of other lengths lead to.
    legs = np.array(cartstiff.analyse(machine).jacobian)
    moved = found.position.values[2, 0] - found.position.values[0, 0]
    assert np.abs(moved - 2e-5 * legs[3:, 0]).max() < 2e-6


def test_a_map_over_poses_is_read_after_the_command(tmp_path: Path) -> None:
    machine = cartstiff.load("6-pus")
    told = {"leg1/slide": 0.001, "leg5/slide": -0.002}
    grid = Grid({"leg2/slide": (0.0, 0.01, 2)}, machine.names, machine.q)
    found = cartstiff.compute_map(
        machine, grid, ["translation_free_min"], tmp_path / "b.zarr", wrench=LOAD, told=told
    )
    for i in range(2):
        q = machine.q.copy()
        q[machine.names.index("leg2/slide")] = grid.axes["leg2.slide"].values[i]
        q = machine.mechanism.closed(q, hold=machine.mechanism.held).q
        rest = cartstiff.after_command(machine, told, q, wrench=LOAD)
        assert np.abs(found.position.values[i] - rest.pose[:3, 3]).max() < 1e-9
        here = cartstiff.analyse(rest.elastic, rest.q)
        C = np.array(
            here.compliances["load"] if "load" in here.compliances else here.compliances["K"]
        )
        lowest = 1.0 / np.linalg.eigvalsh(0.5 * (C + C.T)[3:, 3:]).max()
        assert float(found.translation_free_min[i]) == pytest.approx(lowest, rel=1e-6)


def test_a_command_beyond_what_a_leg_can_bear_gives_no_numbers(tmp_path: Path) -> None:
    file = tmp_path / "limited.yaml"
    text = Path("robots/cable-robot.yaml").read_text(encoding="utf-8")
    file.write_text(text.rstrip() + "\n  force: [50, 250]\n", encoding="utf-8")
    machine = cartstiff.load(file)
    grid = CommandGrid({"leg1": (-0.02, 0.0, 2)}, machine)
    found = cartstiff.compute_map(
        machine, grid, ["translation_free_min"], tmp_path / "c.zarr", wrench=[0, 0, 0, 0, 0, -10.0]
    )
    names = found.state.attrs["flag_meanings"].split()
    assert [names[i] for i in found.state.values] == ["beyond-limits", "regular"]
    assert np.isnan(found.translation_free_min.values).tolist() == [True, False]


def test_what_cannot_be_told_is_refused(tmp_path: Path) -> None:
    machine = cartstiff.load("6-pus")
    with pytest.raises(InputError, match="nothing drives it"):
        CommandGrid({"leg1/u1": (0.0, 1.0, 2)}, machine)
    with pytest.raises(UnknownNameError, match="drive"):
        CommandGrid({"leg9": (0.0, 1.0, 2)}, machine)
    grid = CommandGrid({"leg1/slide": (0.0, 1e-3, 2)}, machine)
    with pytest.raises(InputError, match="twice"):
        cartstiff.compute_map(
            machine, grid, ["condition"], tmp_path / "d.zarr", told={"leg1/slide": 1e-3}
        )


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--actuate", "leg1/slide=0.001"], "say where the map looks"),
        (["--actuate", "leg1/slide=0:1:2", "--random", "3"], "say where the map looks"),
        (["--actuate", "leg1/slide=0:1"], "NAME=LOW:HIGH:COUNT or NAME=VALUE"),
        (["--actuate", "leg1/s1=0:1:2"], "nothing drives it"),
    ],
)
def test_options_that_do_not_fit(words: list[str], said: str, tmp_path: Path, capsys) -> None:
    out = str(tmp_path / "e.zarr")
    assert run("map", "6-pus", *words, "--quantity", "condition", "-o", out) == 2
    assert said in capsys.readouterr().err


def test_degrees_and_slices_reach_the_drives(tmp_path: Path, capsys) -> None:
    """Motors of 6-rus turn: 1 deg told is 0.01745... rad."""
    words = [
        "map",
        "6-rus",
        "--units",
        "mm,deg",
        "--actuate",
        "leg1/crank=0:1:2",
        "--quantity",
        "translation_free_min",
        "-o",
        str(tmp_path / "f.zarr"),
        "--slice",
        "command_leg1/crank=1",
        "--json",
    ]
    assert run(*words) == 0
    json.loads(capsys.readouterr().out)
    axis = cartstiff.open_map(tmp_path / "f.zarr")["command_leg1.crank"]
    assert axis.values[-1] == pytest.approx(np.radians(1.0), rel=1e-12)
    assert axis.attrs["units"] == "rad"
