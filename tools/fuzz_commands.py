"""Command lines for `tools/fuzz.py`: every command, options that fit and odd ones, every file."""

from __future__ import annotations

import json
import random
import re
import shutil
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from tools.fuzz_common import (
    ODD_NUMBERS,
    ODD_TEXTS,
    command,
    mutated_bytes,
    outcome,
)
from tools.fuzz_maps import whole_map

import cartstiff

_NEVER = {"view", "gui"}
#: Commands by how often they are tried: what makes pages and pictures takes long.
_WEIGHTS = {
    "analyse": 8,
    "equilibrium": 5,
    "map": 5,
    "path": 4,
    "identify": 5,
    "modes": 5,
    "frames": 2,
    "export": 1,
    "report": 1,
    "models": 1,
}
#: Name: numbers in --q.
_MECHANISMS = {
    "cubic": 6,
    "stewart-gough": 6,
    "five-bar": 4,
    "ur5": 6,
    "grasp": 6,
    "cable-robot": 6,
    "stewart-simscape": 6,
    "panda": 7,
    "m.yaml": 6,
}
#: A mechanism of our own, with masses, whose words may be damaged.
_OWN = (
    "kind: serial\nmodel: ur5\nsprings: {shoulder_pan_joint: {stiffness: 20000}, "
    "shoulder_lift_joint: {stiffness: 3.0e4, rest: -1.2}, "
    "elbow_joint: {table: [[-3, -9e4], [3, 9e4]]}, "
    "wrist_1_joint: {stiffness: 5000}, wrist_2_joint: rigid, "
    "wrist_3_joint: {stiffness: 5000}}\ngravity: [0, 0, -9.81]\n"
    "payload: {mass: 2, com: [0, 0, 0.1]}\nframe: tool0\n"
)
_FILES = {"t.csv", "p.csv", "d.csv", "target", "impedance.json", "m.yaml", "m.zarr"}


def _numbers(rng: random.Random, count: int, size: float = 1.0) -> str:
    return ",".join(f"{rng.uniform(-size, size):.4g}" for _ in range(count))


def _fitting(rng: random.Random, option: str, command_name: str, mechanism: str) -> str | None:
    """A value that an option takes, or None where only its type is known."""
    n = _MECHANISMS.get(mechanism, 6)
    axes = ["x=0.4:0.6:2", "z=0.2:0.3:2,x=0.3:0.4:2", "y=0:0.1:2"]
    joints = ["elbow_joint=-1:1:3", "z=0:0.1:3", "shoulder_lift_joint=-2:0:2,elbow_joint=0:1:2"]
    values: dict[str, list[str]] = {
        "--q": [_numbers(rng, n), _numbers(rng, 1), "elbow_joint=0.3"],
        "--pose": [_numbers(rng, 6, 0.1)],
        "--lengths": [_numbers(rng, 6, 0.01)],
        "--frame": ["tool0", "wrist_1_link", "platform", "C"],
        "--tcp": [_numbers(rng, 3), _numbers(rng, 6)],
        "--gravity": ["0,0,-9.81", _numbers(rng, 3, 9)],
        "--payload": ["3", "2,0,0,0.1"],
        "--xacro-arg": ["a:=1", "name:=x"],
        "--package-path": ["."],
        "--stiffness": ["1e4", ",".join(["1e4"] * n), "elbow_joint=5000", "elbow_joint=rigid"],
        "--rest": [_numbers(rng, n), "elbow_joint=1"],
        "--load": [_numbers(rng, 6, 50), "0,0,0,0,0,-100"],
        "--load-at": [_numbers(rng, 3, 0.2)],
        "--report-at": [_numbers(rng, 3, 0.2)],
        "--point": [_numbers(rng, 3, 0.2)],
        "--direction": ["0,0,1", _numbers(rng, 3)],
        "--added-load": [_numbers(rng, 6, 9)],
        "--length": ["0.2", "1"],
        "--tolerance": ["0.05", "0.05,0.0001", "0.1,0,0.01"],
        "--samples": ["20", "3"],
        "--target": ["target"],
        "--hold": ["z=-0.002", "x=0.001,rx=0.01"],
        "--curve": ["1.5", "0.1", "-1"],
        "--path": ["p.csv"],
        "--grid": joints,
        "--range": joints if command_name == "map" else ["elbow_joint=-1:1"],
        "--cartesian": axes,
        "--trajectory": ["p.csv"],
        "--random": ["3", "9"],
        "--branches": ["1", "2"],
        "--orientation": ["keep", "0,0,0", "0,1.57,0"],
        "--quantity": [
            "condition",
            "translation_free_min",
            "translation_held_min",
            "deflection",
            "along_free",
            "determinant",
            "frequency_1",
        ],
        "--chunk": ["1", "4"],
        "--slice": ["elbow_joint=0", "x=0.4"],
        "--best": ["1", "3"],
        "--map": ["m.zarr"],
        "--free-axis": ["x", "z"],
        "--redundant": ["elbow_joint", "panda_joint1"],
        "--criterion": ["deflection", "translation_free_min", "worst", "condition"],
        "--axes": [],
        "--sd": ["d=0.005mm", "dx=0.02mm", "d=1e-5,r=1e-4"],
        "--unknown": ["elbow_joint", "all"],
        "--tie": ["wrist_1_joint=wrist_2_joint"],
        "--plan": ["3", "6"],
        "--mass": ["5"],
        "--force": ["100"],
        "--within": ["z=0:1"],
        "--response": ["5:100:5", "1:50", "0:10:3"],
        "--damping": ["0.02", "0.01,0.02"],
        "--rayleigh": ["0.1,1e-4"],
        "--impedance": ["impedance.json"],
        "--ratio": ["0.7"],
    }
    fitting = values.get(option)
    return rng.choice(fitting) if fitting else None


_ENDINGS = {
    "map": "out.zarr",
    "export": "out.html",
    "report": "out.html",
    "identify": "o.yaml",
    "modes": "o.yaml",
    "analyse": "o.json",
}
#: What the options of a command come on top of: alone many of them are refused.
_BASES: dict[str, list[list[str]]] = {
    "map": [
        ["--random", "3"],
        ["--grid", "elbow_joint=-1:1:3"],
        ["--grid", "z=0:0.1:3"],
        ["--cartesian", "x=0.4:0.5:2"],
        ["--trajectory", "p.csv"],
        [],
    ],
    "path": [["--free-axis", "x"], []],
    "modes": [["--response", "5:50:5"], []],
    "equilibrium": [["--load", "0,0,0,0,0,-20"], ["--payload", "2"], []],
    "analyse": [["--load", "0,0,0,0,0,-20"], [], []],
    "workspace": [["--directions", "20"], ["--scan", "6"]],
}


def option(rng: random.Random) -> str:
    """A command with some of its options, files that it reads, and values that fit or do not."""
    import click

    from cartstiff.shown.cli.main import command as group

    context = click.Context(group)
    known = [name for name in group.list_commands(context) if name not in _NEVER]
    name = rng.choices(known, [_WEIGHTS.get(each, 3) for each in known])[0]
    chosen = group.get_command(context, name)
    assert chosen is not None
    mechanism = rng.choice(["ur5"] * 4 + ["stewart-simscape"] + list(_MECHANISMS))
    words = [name]
    for parameter in chosen.params:
        if not isinstance(parameter, click.Argument):
            continue
        fitting = {"mechanism": mechanism, "path_file": "s.csv", "table": "d.csv"}
        if rng.random() < 0.05:
            words.append(_odd_value(rng, parameter))
        elif parameter.name == "table" and name == "identify" and rng.random() < 0.4:
            pass  # a plan needs no table
        else:
            words.append(fitting.get(parameter.name or "", "cubic"))
    words += rng.choice(_BASES.get(name, [[]]))
    if name in _ENDINGS and (name in ("map", "export", "report") or rng.random() < 0.2):
        words += ["-o", _ENDINGS[name]]
    if name == "map" and rng.random() < 0.97:
        words += ["--quantity", rng.choice(["condition", "translation_free_min", "deflection"])]
    if name == "identify" and words[-1] != "d.csv":
        words += ["--plan", "3", "--force", "50", "--sd", "d=0.005mm"]
    options = [
        p
        for p in chosen.params
        if isinstance(p, click.Option)
        and p.name not in ("workers", "dask", "cluster", "help_all")
        and (p.multiple or not set(p.opts) & set(words) or rng.random() < 0.02)
    ]
    for parameter in rng.sample(options, min(len(options), rng.randint(0, 3))):
        longest = max(parameter.opts, key=len)
        words.append(longest)
        if parameter.is_flag or parameter.count:
            continue
        value = _fitting(rng, longest, name, mechanism)
        chance = rng.random()
        if longest == "--output":
            longest, value = "-o", _ENDINGS.get(name, "o.txt")
        if value is None or chance > 0.85:
            value = _odd_value(rng, parameter)
        elif chance > 0.7:
            value = _nearly(rng, value)
        if longest == "--scan" and value == "1_000":
            value = "1_00"  # a thousand steps along each ray take as long as that is
        words.append(value)
    if rng.random() < 0.5 and "--json" not in words and any("--json" in p.opts for p in options):
        words.append("--json")
    _write_files(rng, words)
    return outcome(command(words)[0])


def _nearly(rng: random.Random, text: str) -> str:
    """A value with one of its words odd, doubled or lost."""
    parts = re.split(r"([,:=])", text)
    at = 2 * rng.randrange((len(parts) + 1) // 2)
    parts[at] = rng.choice(
        [
            "",
            str(rng.choice(ODD_NUMBERS)),
            rng.choice(ODD_TEXTS).replace("\ud800", "\udcff"),
            ",".join([parts[at]] * 2),
        ]
    )
    return "".join(parts) or "x"


def _odd_value(rng: random.Random, parameter: Any) -> str:
    """A text for a parameter: of its kind, near it, or of none."""
    kind = type(parameter.type).__name__
    chance = rng.random()
    if kind == "Choice" and chance < 0.9:
        return str(rng.choice(list(parameter.type.choices)))
    if kind in ("IntRange", "IntParamType") and chance < 0.8:
        return str(rng.choice([0, 1, 2, 3, 7, -1, 10**6, 10**20]))
    if chance < 0.6:
        numbers = [
            str(rng.choice([0, 1, -1, 0.1, 1e-3, 100, rng.choice(ODD_NUMBERS)]))
            for _ in range(rng.choice([1, 1, 2, 3, 6, 6, 7]))
        ]
        return ",".join(numbers)
    if chance < 0.75:
        return rng.choice(
            [
                "z=0:0:1",
                "z=1:0:3",
                "x=0:1:1000000000",
                "elbow_joint=1",
                "K",
                "A",
                "d.csv",
                "target",
                ".",
                "/dev/null",
            ]
        )
    return rng.choice(ODD_TEXTS).replace("\ud800", "\udcff") or "x"  # bytes that are no text


def table(rng: random.Random) -> str:
    """A CSV file where postures, points or loads are read, whole or damaged."""
    mechanism = rng.choice(["ur5", "cubic", "five-bar"])
    n = _MECHANISMS[mechanism]
    words = rng.choice(
        [
            [
                "map",
                mechanism,
                "--trajectory",
                "t.csv",
                "--quantity",
                "condition",
                "-o",
                "t.zarr",
                "--json",
            ],
            ["path", "ur5", "t.csv", "--json"],
            ["path", "ur5", "t.csv", "--free-axis", "x", "--load", "0,0,0,0,0,-20", "--json"],
            ["equilibrium", mechanism, "--path", "t.csv", "--load", "0,0,0,0,0,-2", "--json"],
            ["equilibrium", mechanism, "--path", "t.csv", "--json"],
        ]
    )
    if words[0] == "path":
        data = _seam(rng)
    elif rng.random() < 0.7:
        data = _rows(rng, n if mechanism in words else 6, 6 if "--path" in words else 0)
    else:
        data = rng.choice(_TABLES)
    for _ in range(rng.choice([0, 1, 1, 2, 3])):
        data = mutated_bytes(rng, data)
    Path("t.csv").write_bytes(data)
    return outcome(command(words)[0])


_TABLES = [
    b"q1,q2\n0,1\n",
    b"x,y,z\n0,0,0\n0.1,0,0\n",
    b"time,x,y,z,roll,pitch,yaw\n0,0,0,0,0,0,0\n",
    b"1,2,3,4,5,6\n1,2,3,4,5,7\n",
    b"1;2;3;4;5;6\n1,5;2;3;4;5;7\n",
    b"x [mm];y [mm];z [mm]\n400;0;300\n",
    b"# only words\n",
    b"mass,dx\n1,2\n",
]


# -- files ------------------------------------------------------------------------------------


def _write_files(rng: random.Random, words: list[str]) -> None:
    """The files that a command line names; one of them may be damaged."""
    named = {part for word in words for part in [word] if part in _FILES | {"s.csv"}}
    if "m.yaml" in named:
        data = _OWN.encode()
        Path("m.yaml").write_bytes(mutated_bytes(rng, data) if rng.random() < 0.2 else data)
    if "m.zarr" in named:
        shutil.copytree(whole_map()[0], "m.zarr")
    columns = _MECHANISMS.get(words[1] if len(words) > 1 else "", 6)
    made = {
        "p.csv": lambda: _rows(rng, columns, rng.choice([0, 0, 6])),
        "s.csv": lambda: _seam(rng),
        "d.csv": lambda: _measured() if words[0] == "identify" else _rows(rng, columns, 0),
        "impedance.json": lambda: json.dumps(np.diag([9, 9, 9, 900, 900, 900]).tolist()).encode(),
    }
    for name in sorted(named & set(made)):
        data = made[name]()
        for _ in range(rng.choice([0, 0, 0, 1, 2])):
            data = mutated_bytes(rng, data)
        Path(name).write_bytes(data)
    if "target" in named:
        Path("target").write_bytes(matrix_file(rng)[1])


def _rows(rng: random.Random, columns: int, more: int) -> bytes:
    lines = [_numbers(rng, columns + more) for _ in range(rng.randint(1, 4))]
    return ("\n".join(lines) + "\n").encode()


def _seam(rng: random.Random) -> bytes:
    """A few poses within a UR5's reach."""
    head = rng.choice(["", "x,y,z,roll,pitch,yaw\n", "x,y,z\n"])
    count = rng.randint(1, 4)
    turned = "" if head == "x,y,z\n" else ",3.14,0,0"
    poses = [f"0.4,{0.05 * i:.2f},0.3{turned}" for i in range(count)]
    return (head + "\n".join(poses) + "\n").encode()


@cache
def _measured() -> bytes:
    """Deflections of a UR5 by a dial gauge."""
    arm = cartstiff.load("ur5")
    rng = np.random.default_rng(0)
    table = {f"{name} [rad]": rng.uniform(-1.5, 1.5, 12) for name in arm.names}
    force, along = 80.0 * rng.normal(size=(12, 3)), np.eye(3)[np.arange(12) % 3]
    q = np.array([*table.values()]).T
    moved = []
    for one, pull, n in zip(q, force, along, strict=True):
        R = arm.mechanism.at(one).pose[:3, :3]
        C = R @ cartstiff.analyse(arm, one).compliances["K"][3:, 3:] @ R.T
        moved.append(n @ C @ pull + 5e-6 * rng.normal())
    table |= dict(zip(("fx [N]", "fy [N]", "fz [N]"), force.T, strict=True))
    table |= dict(zip(("nx", "ny", "nz"), along.T, strict=True)) | {"d [m]": np.array(moved)}
    rows = np.array([*table.values()]).T.tolist()
    return "\n".join([",".join(table), *(",".join(map(repr, row)) for row in rows)]).encode()


def measured(rng: random.Random) -> str:
    """Measured deflections, whole or damaged, and what is asked of them."""
    data = _measured()
    for _ in range(rng.choice([0, 1, 1, 2, 3])):
        data = mutated_bytes(rng, data)
    Path("d.csv").write_bytes(data)
    words = ["identify", "ur5", "d.csv", "--json"]
    for more in rng.sample(
        [
            ["--sd", "d=0.005mm"],
            ["--fit", "robust"],
            ["--tie", "wrist_1_joint=wrist_2_joint"],
            ["--loaded"],
            ["-o", "k.yaml"],
        ],
        rng.randint(0, 3),
    ):
        words += more
    return outcome(command(words)[0])


# -- matrices -----------------------------------------------------------------------------------


def matrix_file(rng: random.Random) -> tuple[str, bytes]:
    """The name and the bytes of a matrix as people store one; it may be damaged."""
    import io

    A = np.array([[rng.uniform(-1, 1) for _ in range(6)] for _ in range(6)])
    K = 1e4 * (A @ A.T) if rng.random() < 0.7 else 1e3 * A
    kind = rng.choice(["csv", "txt", "json", "yaml", "npy", "npz", "npy"])
    if kind in ("npy", "npz"):
        stream = io.BytesIO()
        M: Any = rng.choice(
            [
                K,
                K,
                K.astype(np.float32),
                K.astype(complex),
                K.astype(object),
                K.ravel(),
                K[:5],
                np.asfortranarray(K),
                K.astype(">f8"),
                K.astype("U9"),
                np.zeros((6, 6, 1)),
                np.array(1.0),
            ]
        )
        if kind == "npz":
            np.savez(stream, **{rng.choice(["K", "a", "stiffness"]): M})
        else:
            np.save(stream, M, allow_pickle=True)
        data = stream.getvalue()
    elif kind in ("csv", "txt"):
        sign = "," if kind == "csv" else " "
        data = "\n".join(sign.join(f"{x:.17g}" for x in row) for row in K).encode()
    else:
        data = json.dumps(rng.choice([K.tolist(), {"K": K.tolist()}])).encode()
    for _ in range(rng.choice([0, 0, 1, 2])):
        data = mutated_bytes(rng, data)
    if rng.random() < 0.1:
        data = data[: rng.randrange(len(data) + 1)]
    return f"target.{kind}", data


def matrix(rng: random.Random) -> str:
    """A wanted stiffness from a file, whole or damaged, text or NumPy's."""
    name, data = matrix_file(rng)
    if rng.random() < 0.1:
        name = rng.choice(["target", "target.mat", "target.npy", "target.csv"])
    Path(name).write_bytes(data)
    words = ["analyse", rng.choice(["ur5", "cubic"]), "--target", name, "--json"]
    if rng.random() < 0.3:
        words = ["modes", "five-bar", "--impedance", name, "--ratio", "0.7", "--json"]
    if rng.random() < 0.3:
        words += ["--axes", "world"]
    return outcome(command(words)[0])


# -- xacro ----------------------------------------------------------------------------------------

_XACRO_TEXT = """<?xml version="1.0"?>
<robot name="r" xmlns:xacro="http://www.ros.org/wiki/xacro">
  <xacro:arg name="length" default="0.4"/>
  <xacro:property name="l" value="$(arg length)"/>
  <xacro:macro name="arm" params="name parent axis">
    <link name="${name}"><inertial><mass value="${2*l}"/></inertial></link>
    <joint name="${name}_joint" type="revolute"><parent link="${parent}"/><child link="${name}"/>
      <origin xyz="0 0 ${l}" rpy="0 ${pi/7} 0"/><axis xyz="${axis}"/>
      <limit lower="-2" upper="2" effort="9" velocity="9"/></joint>
  </xacro:macro>
  <link name="base"/>
  <xacro:arm name="a" parent="base" axis="0 0 1"/>
  <xacro:arm name="b" parent="a" axis="0 1 0"/>
  <xacro:if value="${l > 0.3}"><xacro:arm name="c" parent="b" axis="1 0 0"/></xacro:if>
</robot>
"""


def xacro(rng: random.Random) -> str:
    """A xacro file, whole or damaged, with arguments."""
    data = _XACRO_TEXT.encode()
    for _ in range(rng.choice([0, 1, 1, 2])):
        data = mutated_bytes(rng, data)
    Path("r.urdf.xacro").write_bytes(data)
    words = ["analyse", "r.urdf.xacro", "--json"]
    if rng.random() < 0.4:
        words += ["--xacro-arg", rng.choice(["length:=0.5", "length:=x", ":=", "length:=${1/0}"])]
    return outcome(command(words)[0])
