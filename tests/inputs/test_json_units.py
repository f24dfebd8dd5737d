"""``--units`` beside ``--json``: numbers are given in them, the answer is the same as without."""

import json
import math

import click
import numpy as np
import pytest
from tests.support.commands import answer, words

from cartstiff.cli.declare import OptionType
from cartstiff.cli.main import command as group
from cartstiff.cli.options import Pairs

MM = "--units mm,deg"
Q = "0.2,-1,1.2,0.3,1,0.1"
DEG = ",".join(repr(math.degrees(float(x))) for x in Q.split(","))
PATH = "x,y,z,roll,pitch,yaw,mx,my,mz,fx,fy,fz\n"
POSES = [(0.4, 0.1, 0.4, 3.0, 0.0, 0.3), (0.4, 0.15, 0.4, 3.0, 0.0, 0.3)]
K = np.diag([3e3, 4e3, 5e3, 2e5, 3e5, 4e5])


def same(a, b, where=""):
    """Two answers, number by number: relative to the largest of a list."""
    if isinstance(a, dict):
        assert a.keys() == b.keys(), where
        for key in a.keys() - {"message", "seconds", "command"}:
            same(a[key], b[key], f"{where}.{key}")
    elif isinstance(a, list) and a and not all(isinstance(x, int | float) for x in a):
        assert len(a) == len(b), where
        numbers = np.array(a, dtype=object).ravel().tolist()
        if all(isinstance(x, int | float) for x in numbers):
            same(numbers, np.array(b, dtype=object).ravel().tolist(), where)
        else:
            for i, (x, y) in enumerate(zip(a, b, strict=True)):
                same(x, y, f"{where}[{i}]")
    elif isinstance(a, list) or (isinstance(a, float) and b is not None):
        size = np.abs(a).max(initial=0.0) if np.size(a) else 0.0
        near = 1e-4 if "uncertainty" in where else 1e-7  # derivatives of what was searched for
        np.testing.assert_allclose(b, a, rtol=near, atol=1e-8 * size + 1e-9, err_msg=where)
    else:
        assert a == b, where


def scaled(text, *powers, degrees=()):
    """Numbers in mm, by the power of length of each (the last for all others)."""
    numbers = [float(x) for x in text.split(",")]
    powers = [*powers, *[powers[-1]] * len(numbers)]
    return ",".join(
        repr(math.degrees(x) if i in degrees else x * 1000.0 ** powers[i])
        for i, x in enumerate(numbers)
    )


def wrench(text):
    return scaled(text, 1, 1, 1, 0)


def pose(text):
    return scaled(text, 1, 1, 1, 0, degrees=(3, 4, 5))


TOOL = ("--tcp 0,0,0.1,0,0,0.5", f"--tcp {pose('0,0,0.1,0,0,0.5')}")
LOADED = (
    "--load 1,2,3,10,20,30 --load-at 0,0.02,0.1",
    f"--load {wrench('1,2,3,10,20,30')} --load-at 0,20,100",
)
# (command, words in SI, words in mm and degrees)
CASES = {
    "analyse": (
        "analyse ur5",
        (
            f"--q {Q} {TOOL[0]} {LOADED[0]} --payload 2,0,0,0.05 --gravity 0,0,-9.81 "
            "--report-at 0.1,0,0 --added-load 1,0,0,0,5,0 --added-load-at 0,0.1,0 --length 0.3 "
            "--direction 1,2,0 --inertia 2,0.1,0.2,0.3 "
            "--stiffness 2e4"
        ),
        (
            f"--q {DEG} {TOOL[1]} {LOADED[1]} --payload 2,0,0,50 --gravity 0,0,-9.81 "
            "--report-at 100,0,0 --added-load 1000,0,0,0,5,0 --added-load-at 0,100,0 "
            f"--length 300 --direction 1,2,0 "
            "--inertia 2,0.1,0.2,0.3 --stiffness 2e7"
        ),
    ),
    "analyse tolerances": (
        "analyse five-bar",
        "--tolerance 0.05,0.0001,0.001",
        f"--tolerance 0.05,0.1,{math.degrees(0.001)!r}",
    ),
    "analyse legs": (
        "analyse hexapod",
        "--pose 0.02,0.01,0.55,0.1,0,0.1 --stiffness 1e6 --actuate leg2=0.001",
        f"--pose {pose('0.02,0.01,0.55,0.1,0,0.1')} --stiffness 1e3 --actuate leg2=1",
    ),
    "analyse rest": (
        "analyse hexapod",
        (
            "--pose 0,0,0.55,0,0,0 --rest 0.6,0.6,0.6,0.6,0.6,0.61 "
            "--stiffness 1e6,2e6,1e6,2e6,1e6,2e6"
        ),
        "--pose 0,0,550,0,0,0 --rest 600,600,600,600,600,610 --stiffness 1e3,2e3,1e3,2e3,1e3,2e3",
    ),
    "analyse slides": (
        "analyse 6-pus",
        f"--actuate leg1/slide=0.001 --stiffness leg1/slide=1e6 {LOADED[0]}",
        f"--actuate leg1/slide=1 --stiffness leg1/slide=1e3 {LOADED[1]}",
    ),
    "analyse centimetres": ("analyse stewart-gough", "--tcp 1,2,3", "--tcp 10,20,30"),
    "equilibrium": (
        "equilibrium ur5",
        f"--q {Q} {TOOL[0]} {LOADED[0]} --payload 2,0,0,0.05",
        f"--q {DEG} {TOOL[1]} {LOADED[1]} --payload 2,0,0,50",
    ),
    "equilibrium held": (
        "equilibrium hexapod",
        "--hold x=0.001,rz=0.002 --lengths 0.6,0.6,0.6,0.6,0.6,0.6",
        f"--hold x=1,rz={math.degrees(0.002)!r} --lengths 600,600,600,600,600,600",
    ),
    "modes": (
        "modes ur5",
        (
            f"--q {Q} {TOOL[0]} {LOADED[0]} --response 10:20:5 --point 0,0.1,0 --damping 0.02 "
            "--impedance K.csv"
        ),
        (
            f"--q {DEG} {TOOL[1]} {LOADED[1]} --response 10:20:5 --point 0,100,0 --damping 0.02 "
            "--impedance K_mm.csv"
        ),
    ),
    "path": (
        "path ur5",
        "path.csv --max-step 0.4 --range elbow_joint=-2:2 --samples 8 --free-axis z",
        (
            f"path_mm.csv --max-step {math.degrees(0.4)!r} "
            f"--range elbow_joint={math.degrees(-2)!r}:{math.degrees(2)!r} "
            "--samples 8 --free-axis z"
        ),
    ),
    "compensate": (
        "equilibrium 6-pus",
        "--path slides.csv --payload 1",
        "--path slides_mm.csv --payload 1",
    ),
    "workspace": (
        "workspace hexapod",
        "--pose 0,0,0.6,0.1,0,0 --radius 0.5 --directions 20",
        f"--pose {pose('0,0,0.6,0.1,0,0')} --radius 500 --directions 20",
    ),
    "assemble": (
        "assemble hexapod",
        "--all --lengths 0.6,0.6,0.6,0.6,0.6,0.61 --load 1,0,0,0,0,-100",
        "--all --lengths 600,600,600,600,600,610 --load 1000,0,0,0,0,-100",
    ),
    "frames": ("frames ur5", f"--q {Q} --tcp 0,0,0.1", f"--q {DEG} --tcp 0,0,100"),
    "identify": (
        "identify ur5",
        (
            "measured.csv --point 0,0,0.05 --load-at 0,0,0.1 --known wrist_3_joint=8e3 "
            "--prior wrist_2_joint=9e3,500 --sd dz=0.02mm"
        ),
        (
            "measured.csv --point 0,0,50 --load-at 0,0,100 --known wrist_3_joint=8e6 "
            "--prior wrist_2_joint=9e6,5e5 "
            "--sd dz=0.02"
        ),
    ),
    "plan": (
        "identify ur5 --plan 4 --candidates 10 --criterion posture",
        (
            f"--q {Q} --load 1,2,3,10,20,30 --force 80 --range elbow_joint=-1:1 --within z=0.1:0.9 "
            "--sd dz=0.02mm --known wrist_3_joint=8e3"
        ),
        (
            f"--q {DEG} --load {wrench('1,2,3,10,20,30')} --force 80 "
            f"--range elbow_joint={math.degrees(-1)!r}:{math.degrees(1)!r} "
            "--within z=100:900 --sd dz=0.02 --known wrist_3_joint=8e6"
        ),
    ),
    "target": ("analyse ur5", f"--q {Q} --target K.csv", f"--q {DEG} --target K_mm.csv"),
}


@pytest.mark.parametrize("case", CASES)
def test_answer_is_the_same(case, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    sizes = np.repeat([1e3, 1.0], 3)
    np.savetxt("K.csv", K, delimiter=",")
    np.savetxt("K_mm.csv", K * np.outer(sizes, sizes / 1e3), delimiter=",")
    for name, place, load in (("path", str, str), ("path_mm", pose, wrench)):
        rows = [f"{place(','.join(map(str, row)))},{load('1,2,3,0,0,-50')}" for row in POSES]
        (tmp_path / f"{name}.csv").write_text(PATH + "\n".join(rows) + "\n")
    command, si, mm = CASES[case]
    if case == "identify":
        measured = "--sd dz=0.02mm --csv measured.csv"
        answer("identify ur5 --plan 12 --candidates 15 --force 80", measured)
        answer("identify ur5 measured.csv --simulate 1", measured)
    if case == "compensate":
        import cartstiff

        robot = cartstiff.load("6-pus")
        shown = np.array(
            [1e3 if c.is_length else np.degrees(1.0) for c in robot.mechanism.coordinates]
        )
        q = np.array(robot.q)
        np.savetxt("slides.csv", q[None], delimiter=",")
        np.savetxt("slides_mm.csv", (q * shown)[None], delimiter=",")
    expected = answer(command, si)
    same(expected, answer(command, mm, MM))


def test_every_option_with_a_length_is_tried_here():
    tried = {
        word for command, si, _ in CASES.values() for word in words(command, si) if word[:2] == "--"
    }
    for name in group.list_commands(click.Context(group)):
        command = group.get_command(click.Context(group), name)
        options = {option for p in command.params for option in p.opts}
        # The JSON of a map, and of a study, is in the unit of length that is given.
        if name in ("map", "design") or not {"--units", "--json"} <= options:
            continue
        for option in command.params:
            if isinstance(option.type, OptionType) and (
                type(option.type).converted is not OptionType.converted
                and set(getattr(option.type, "powers", (1,))) != {0}
                and (not isinstance(option.type, Pairs) or option.type.frame or option.type.axes)
            ):
                assert set(option.opts) & {*tried, "--near"}, (name, option.opts)


def test_units_of_a_controllers_stiffness_act(tmp_path):
    sizes = np.repeat([1e3, 1.0], 3)
    named = {
        "matrix": (K * np.outer(sizes, sizes / 1e3)).tolist(),
        "order": "angular-linear",
        "units": {"length": "mm", "force": "N"},
    }
    (tmp_path / "K.json").write_text(json.dumps(named))
    np.savetxt(tmp_path / "K.csv", K, delimiter=",")
    a, b = (
        answer(f"modes ur5 --q {Q} --impedance", tmp_path / f"K.{end}")["impedance"]
        for end in ("csv", "json")
    )
    same(a, b)
