"""Edits of one number in a mechanism's files between two halves of a map.

    python tools/fuzz_edits.py [--count N] [--seed N]

Each edit is made from the seed and its number alone. Half of a map is computed, one number in one
of the files is changed, and the same call goes on. It passes if it is refused in one line, or if
the numbers of both halves are those of the changed files.
"""

from __future__ import annotations

import argparse
import random
import re
import shutil
import sys
import tempfile
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np

import cartstiff
from cartstiff import CartstiffError
from cartstiff.files.catalogue import bundled_folder, example_robot
from cartstiff.maps import Axis, Grid
from cartstiff.wings.maps.run import prepare_map, run_map

BUNDLED = [
    *("3-prs", "3-rrr", "6-pus", "6-rus", "6-ups", "cable-robot", "cubic", "delta", "five-bar"),
    *("fanuc-r2000ic", "flexure-hexapod", "grasp", "hexapod", "inclined-hexapod", "orthoglide"),
    *("stewart-gough", "stewart-simscape", "tricept", "xarm7"),
]
_NUMBER = re.compile(r"(?<![\w.#])-?\d+(?:\.\d+)?(?:[eE][-+]?\d+)?(?![\w.])")
_MAIN = "robot.yaml"
_XACRO = """<robot name="r" xmlns:xacro="http://www.ros.org/wiki/xacro">
<xacro:include filename="links.xacro"/>
<link name="base"/><xacro:arm before="base" name="a" z="0.3"/>
<xacro:arm before="a" name="b" z="0.25"/><xacro:arm before="b" name="c" z="0.2"/></robot>"""
_LINKS = """<robot xmlns:xacro="http://www.ros.org/wiki/xacro">
<xacro:property name="heavy" value="2.5"/>
<xacro:macro name="arm" params="before name z">
<link name="${name}"><inertial><origin xyz="0.01 0 0.1"/><mass value="${heavy}"/>
<inertia ixx="0.02" iyy="0.03" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="turn_${name}" type="revolute"><parent link="${before}"/><child link="${name}"/>
<origin xyz="0.05 0 ${z}" rpy="0.3 0.2 0"/><axis xyz="0 1 0"/>
<limit lower="-2" upper="2" effort="10" velocity="1"/></joint></xacro:macro></robot>"""
_MJCF = """<mujoco><include file="inside.xml"/><worldbody><body pos="0 0 0.2">
<joint name="one" axis="0 1 0" stiffness="300"/><geom type="mesh" mesh="lump"/>
<body pos="0.3 0 0.1"><joint name="two" axis="0 0.8 0.6" stiffness="200"/>
<geom size="0.05" pos="0 0 0.1" mass="1.5"/><site name="tip" pos="0.2 0 0.1"/></body></body>
</worldbody></mujoco>"""
_INSIDE = """<mujoco><option gravity="0 0 -9.81"/><asset><mesh name="lump" file="lump.obj"/></asset>
</mujoco>"""
_LUMP = """v 0.1 0.1 0.1
v 0.12 -0.1 -0.1
v -0.1 0.13 -0.1
v -0.1 -0.1 0.14
f 1 2 3
f 1 4 2
f 1 3 4
f 2 4 3
"""


def write_files(name: str, folder: Path) -> list[Path]:
    """Copies of a mechanism's files, `robot.yaml` first; which of them are edited."""
    main = folder / _MAIN
    more: list[Path] = []
    if name in ("ur5", "panda"):
        shutil.copy(example_robot(name), folder / "robot.urdf")
        more = [folder / "robot.urdf"]
        text = (bundled_folder() / f"{name}.yaml").read_text(encoding="utf-8")
        main.write_text(text.replace(f"model: {name}", "model: robot.urdf"))
    elif name in ("xacro", "mjcf"):
        texts = {"robot.xacro": _XACRO, "links.xacro": _LINKS}
        if name == "mjcf":
            texts = {"robot.xml": _MJCF, "inside.xml": _INSIDE, "lump.obj": _LUMP}
        for file, text in texts.items():
            more.append(folder / file)
            more[-1].write_text(text)
        joints = ("turn_a", "turn_b", "turn_c") if name == "xacro" else ()
        springs = "".join(f"  {joint}: {{stiffness: 500}}\n" for joint in joints)
        springs = f"springs:\n{springs}" if springs else ""
        main.write_text(f"kind: serial\nmodel: {more[0].name}\n{springs}gravity: [0, 0, -9.81]\n")
    else:
        text = (bundled_folder() / f"{name}.yaml").read_text(encoding="utf-8")
        main.write_text(text)
        for model in set(re.findall(r"model: *([\w-]+\.urdf)", text)):
            more.append(folder / model)
            shutil.copy(bundled_folder() / model, more[-1])
    return [main, *more]


def edit(files: list[Path], dice: random.Random) -> str:
    """Change one number of one file; says which."""
    file = dice.choice(files)
    text = file.read_text(encoding="utf-8")
    number = dice.choice(list(_NUMBER.finditer(text)))
    old = float(number[0])
    factor = dice.choice([1.0 + 1e-9, 1.001, 1.5, 4.0, -1.0])
    new = repr(old * factor) if old else repr(dice.choice([1e-6, 0.1]))
    if "." not in number[0] and "e" not in number[0].lower() and old and abs(old) < 1e6:
        new = str(int(old) + 1)
    file.write_text(text[: number.start()] + new + text[number.end() :], encoding="utf-8")
    return f"{file.name}: {number[0]} -> {new}"


def _grid(elastic: Any) -> Grid:
    """Four postures along the first coordinate, near the default one."""
    first, step = elastic.names[0], 1e-3
    if elastic.mechanism.coordinates[0].is_length:
        step *= elastic.mechanism.at(elastic.q).length
    low = elastic.q[0]
    return Grid({first: Axis(low, low + 3.0 * step, 4)}, elastic.names, elastic.q)


_QUANTITIES = ["translation_free_min", "frequency_1"]


def _map(folder: Path, file: str, parts: int | None = None) -> np.ndarray[Any, Any]:
    elastic = cartstiff.load(folder / _MAIN)
    job, stored = prepare_map(elastic, _grid(elastic), _QUANTITIES, folder / file, chunk=2)
    if parts is not None:
        stored.write(0, job.compute(stored.parts.box(0)))
        return np.zeros(0)
    run_map(job, stored)
    return np.array([stored.described[name][:] for name in job.names])


def outcome(index: int, seed: int = 1) -> tuple[str, str]:
    """What becomes of one edit: "refused", "same", "broken" (the new file), "MIXED"; and which."""
    dice = random.Random(f"{seed} {index}")
    name = dice.choice([*BUNDLED, "ur5", "panda", "xacro", "mjcf", "xacro", "mjcf"])
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        files = write_files(name, folder)
        _map(folder, "two.zarr", 1)
        what = f"{name}, {edit(files, dice)}"
        try:
            found = _map(folder, "two.zarr")
            refusal = ""
        except CartstiffError as error:
            refusal = str(error)
        if "another mechanism" in refusal and "\n" not in refusal:
            return "refused", what
        try:
            expected = _map(folder, "new.zarr")
        except CartstiffError:
            return ("broken" if refusal else "MIXED"), f"{what}: {refusal}"
    same = not refusal and np.allclose(found, expected, rtol=1e-12, atol=0, equal_nan=True)
    return ("same" if same else "MIXED"), f"{what}: {refusal}"


def main() -> None:
    """Make the edits, print what is wrong and how many there were of each outcome."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--count", type=int, default=500)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    counts = Counter[str]()
    for index in range(options.count):
        state, what = outcome(index, options.seed)
        counts[state] += 1
        if state == "MIXED":
            print(f"{index}: {what}", flush=True)
    print(", ".join(f"{n} {state}" for state, n in counts.most_common()))
    sys.exit(1 if counts["MIXED"] else 0)


if __name__ == "__main__":
    main()
