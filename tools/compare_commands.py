#!/usr/bin/env python3
"""What the commands print and write, of two trees of the source, compared number by number.

    python tools/compare_commands.py run --source OLD/src -o before
    python tools/compare_commands.py run --source NEW/src -o after [COMMAND...]
    python tools/compare_commands.py compare before after [COMMAND...] [--gone REGEX]
    python tools/compare_commands.py options --source NEW/src

`run` executes `COMMANDS`, each in a folder of its own and in a process of its own; a line beginning
with & goes on in the folder of the line before it. `compare` says where numbers differ by more than
1e-10 of the largest entry of their block (a list of numbers; of a 6x6 matrix each 3x3 block), and
where texts differ; lines and keys that match --gone may be missing. `options` lists the options
of each command that none of the lines uses.
"""

from __future__ import annotations

import argparse
import base64
import gzip
import html
import json
import math
import os
import re
import shutil
import signal
import socket
import subprocess
import sys
import time
import traceback
import zlib
from collections import Counter
from collections.abc import Callable
from contextlib import redirect_stderr, redirect_stdout, suppress
from pathlib import Path
from typing import Any

#: Agreement of numbers, as a share of the largest entry of their block.
AGREEMENT = 1e-10

# Seconds after which a command is ended.
_LONGEST = 120

_XACRO = "arm.xacro --xacro-arg reach:=0.5 --package-path ../inputs/packages --frame tool"
_UR5 = "ur5 --q 0,-1.2,1.5,0.2,1,0"
_TABLE = "arm.yaml measured.csv --sd dx=0.02mm --sd dy=0.02mm --sd dz=0.02mm"
_PLAN = "--sd dx=0.02mm --sd dy=0.02mm --sd dz=0.02mm"

COMMANDS = f"""
analyse stewart-gough --json
analyse {_UR5} --load 0,0,0,0,0,-100
analyse {_UR5} --load 0,0,0,30,0,-100 --world --load-at 0,0,0.1 --json
analyse {_UR5} --load 0,0,5,30,0,-100 --load-kind conservative --added-load 0,0,0,10,0,0 --json
analyse {_UR5} --load 0,0,5,30,0,-100 --load-kind follower --connection A --direction 0,0,1
analyse {_UR5} --analysis full --report-at 0,0,0.1 --length 0.2
analyse {_UR5} --tcp 0,0,0.1,0,0.5,0 --payload 2,0,0,0.1 --gravity 0,0,-9.81 --json
analyse {_UR5} --order linear-angular --axes base --analysis none
analyse {_UR5} --target target.json --json
analyse panda --frame panda_hand --q 0,-0.8,0,-2.4,0,1.6,0.8 --json
analyse panda --rest 0,-0.8,0.1,-2.3,0,1.6,0.8 --relax --json
analyse fanuc-r2000ic --springs kuka-kr270/klimchik-2013
analyse ur5 --stiffness elbow_joint=300,wrist_1_joint=rigid --json
analyse 6-pus --load 0,0,0,0,0,-500 --actuate leg1/slide=0.001 --json
analyse stewart-simscape --pose 0.005,0,0.07,0,0.02,0 --json
analyse stewart-simscape --lengths 0.085,0.085,0.085,0.085,0.085,0.086
analyse inclined-hexapod --set sz=0.6 --json
analyse inclined-hexapod --tcp 0,0,0.05 --pose 0,0,0.01,0,0.1,0 --pose-of M --json
analyse cubic --tolerance 0.05,0.0001
analyse cubic --sensitivities --json
analyse delta --load 0,0,0,0,0,-100 --json
analyse five-bar --strict
analyse flexure-hexapod --json
analyse cable-robot --load 0,0,0,0,0,-100 --json
analyse hexagonal.yaml --load 10,0,0,0,0,-500 --json
analyse flexible_arm.yaml --load 0,0,0,0,0,-50 --json
analyse arm.xml --load 0,0,0,0,0,-50 --json
analyse {_XACRO} --stiffness 1000 --load 0,0,0,0,0,-10
analyse 3-rrr -o answer.json
analyse ur6
analyse ur5 --load 0,0,0
equilibrium ur5 --load 0,0,0,0,0,-100
equilibrium stewart-gough --load 0,0,0,0,0,-50 --world --json
equilibrium {_UR5} --load 0,0,0,0,0,-100 --world --load-at 0,0,0.1 --json
equilibrium {_UR5} --load 0,0,5,0,0,-100 --load-kind follower
equilibrium {_UR5} --load 0,0,5,0,0,-100 --load-kind follower --json
equilibrium 6-pus --load 0,0,0,0,0,-500 --actuate leg1/slide=0.001
equilibrium panda --payload 3,0,0,0.1 --frame panda_hand --json
equilibrium ur5 --hold z=-0.002 --json
equilibrium five-bar --load 0,0,0,0,-2000,0 --world --curve 0.5 --json
equilibrium ur5 --load 0,0,0,0,0,-80 --path postures.csv -o commands.csv
equilibrium ur5 --payload 2 --gravity 0,0,-9.81 --path postures.csv --against all --json
equilibrium cubic --payload 20 --gravity 0,-9.81,0 --against-gravity 0,0,-9.81 --json
equilibrium stewart-gough --load 0,0,0,0,0,-50 --tolerance 0.05,0.01
equilibrium stewart-gough --load 0,0,0,0,0,-50 --sensitivities --json
equilibrium stewart-simscape --lengths 0.085,0.085,0.085,0.085,0.085,0.086 --load 0,0,0,0,0,-5
equilibrium inclined-hexapod --set sz=0.6 --tcp 0,0,0.05 --pose 0,0,0.01,0,0.1,0 --pose-of M \
    --load 0,0,0,0,0,-100 --no-limits --json
equilibrium ur5 --stiffness 5000 --rest 0,-1.2,1.5,0.2,1,0.01 --json
equilibrium fanuc-r2000ic --springs kuka-kr270/klimchik-2013 --load 0,0,0,0,0,-900 --world
equilibrium {_XACRO} --stiffness 1000 --load 0,0,0,0,0,-10 --json
view ur5 --no-open
view stewart-gough arm.yaml --load 0,0,0,0,0,-50 --load-at 0,0,0.1 --world --no-open
view {_UR5} --springs ../inputs/springs.csv --frame tool0 --tcp 0,0,0.1 --payload 2 \
    --gravity 0,0,-9.81 --load 0,0,0,0,0,-50 --load-kind follower --no-open \
    --trajectory postures.csv --host 127.0.0.1
view hexapod --workspace --no-open
view {_XACRO} --stiffness 1000 --rest 0,0.1 --no-open
view stewart-simscape --lengths 0.085,0.085,0.085,0.085,0.085,0.086 --no-open
view inclined-hexapod --set sz=0.6 --tcp 0,0,0.05 --pose 0,0,0.01,0,0.1,0 --pose-of M --no-open
view 6-pus --actuate leg1/slide=0.001 --no-open
map ur5 --grid shoulder_lift_joint=-2:0:5,elbow_joint=0.3:2.5:5 --quantity deflection \
    --load 0,0,0,0,0,-100 -o m.zarr
& view ur5 --map m.zarr --no-open
& export ur5 --map m.zarr -o page.html
& report ur5 --map m.zarr --quantity deflection --load 0,0,0,0,0,-100 -o r.html
export ur5 -o page.html
export hexapod --load 0,0,0,0,0,-50 --load-at 0,0,0.1 --world --workspace -o page.html
export {_UR5} --springs ../inputs/springs.csv --frame tool0 --tcp 0,0,0.1 --payload 2 \
    --gravity 0,0,-9.81 --load 0,0,0,0,0,-50 --load-kind follower \
    --trajectory postures.csv -o page.html
export {_XACRO} --stiffness 1000 --rest 0,0.1 -o page.html
export stewart-simscape --lengths 0.085,0.085,0.085,0.085,0.085,0.086 -o page.html
export inclined-hexapod --set sz=0.6 --tcp 0,0,0.05 --pose 0,0,0.01,0,0.1,0 --pose-of M -o page.html
export 6-pus --actuate leg1/slide=0.001 -o page.html
report {_UR5} --load 0,0,0,0,0,-100 --world --load-at 0,0,0.1 -o r.html
report {_UR5} --springs ../inputs/springs.csv --frame tool0 --tcp 0,0,0.1 --payload 2 \
    --gravity 0,0,-9.81 --load 0,0,0,0,0,-50 --load-kind follower -o r.html
report stewart-simscape --lengths 0.085,0.085,0.085,0.085,0.085,0.086 -o r.html
report inclined-hexapod --set sz=0.6 --tcp 0,0,0.05 --pose 0,0,0.01,0,0.1,0 --pose-of M -o r.html
report {_XACRO} --stiffness 1000 --rest 0,0.1 -o r.html
report delta --load 0,0,0,0,0,-100 -o r.html
map {_UR5} --random 40 --range elbow_joint=0.3:2 --quantity condition --quantity along_free \
    --direction 0,0,1 --connection B --length 0.2 -o m.zarr --json --best 2
map ur5 --cartesian x=0.3:0.6:3,z=0.1:0.4:3 --quantity translation_free_min --orientation 0,1.57,0 \
    --branches 8 --best 3 -o m.zarr
map ur5 --cartesian x=0.3:0.6:3 --cartesian z=0.1:0.4:3 --quantity deflection --free x \
    --load 0,0,0,30,0,-100 --load-at 0,0,0.1 --load-kind follower --world --orientation keep \
    -o m.zarr --json
map panda --trajectory panda.csv --frame panda_hand --payload 2 --gravity 0,0,-9.81 \
    --quantity deflection --added-load 0,0,0,0,0,-10 --load 0,0,0,0,0,-30 -o m.zarr --json
map panda --frame panda_hand --cartesian x=0.4:0.5:2 --redundant best --branches 1 \
    --quantity translation_free_min -o m.zarr --json
map flexure-hexapod --grid z=-1e-5:1e-5:3 --quantity translation_free_min -o m.zarr
map inclined-hexapod --grid x=-0.02:0.02:3 --set sz=0.6 --tcp 0,0,0.05 --pose 0,0,0.01,0,0.1,0 \
    --pose-of M --quantity condition --chunk 2 --progress -o m.zarr
map stewart-simscape --lengths 0.085,0.085,0.085,0.085,0.085,0.086 --grid z=0.06:0.08:5 \
    --quantity frequency_1 --quantity translation_free_min --slice z=0.07 -o m.zarr --json
map fanuc-r2000ic --springs kuka-kr270/klimchik-2013 --random 20 --quantity condition -o m.zarr
map {_XACRO} --stiffness 1000 --rest 0,0.1 --grid turn=-1:1:3 --quantity translation_free_min \
    -o m.zarr
map ur5 --grid elbow_joint=0.3:2.5:4 --quantity damping_1 --damping 0.02 \
    --payload 2 -o m.zarr
map ur5 --grid elbow_joint=0.3:2.5:4 --quantity condtion -o m.zarr
path ur5 edge.csv --free-axis x --load 0,0,0,-80,30,40 -o postures.csv
path ur5 edge.csv --free-axis x --load 0,0,0,-80,30,40 --loaded --load-kind follower \
    --load-at 0,0,0.1 --json
path ur5 edge.csv --free-rotation --samples 6 --criterion along_free --direction 1,0,0 --json
path panda hand.csv --frame panda_hand --criterion translation_free_min --redundant panda_joint1 \
    --samples 12 --objective mean --connection K --json
path ur5 edge.csv --q 0,-1.2,1.5,0,1,0 --free-axis x --samples 12 --range elbow_joint=0:2.9 \
    --payload 1 --gravity 0,0,-9.81 --load 0,0,0,-80,0,0 --axes base --progress
path ur5 edge.csv --free-axis x --near -3,-2,-1.4,-2,0.2,-0.8 --load 0,0,0,-80,0,0 --json
path fanuc-r2000ic fanuc.csv --springs kuka-kr270/klimchik-2013 --free-axis z --samples 8 \
    --load 0,0,0,0,0,-500 --world --json
path ur5 edge.csv --free-axis x --samples 8 --criterion damping_1 --damping 0.02 --json
path {_XACRO} reach.csv --stiffness 1000 --load 0,0,0,0,0,-10
path arm.yaml reach.csv --free-rotation --set k=9000 --tcp 0,0,0.01 --load 0,0,0,0,0,-10 --json
modes stewart-simscape
modes {_UR5} --load 0,0,0,0,0,-500 --world --load-at 0,0,0.1 --json
modes panda --frame panda_hand --payload 2,0,0,0.1 --tcp 0,0,0.1 --json
modes {_UR5} --load 0,0,5,0,0,-500 --load-kind follower
modes {_UR5} --response 5:100:20 --damping 0.02 --direction 0,0,1 --json
modes stewart-simscape --response 5:100:20 --kind transmissibility --point 0,0,0.05 \
    --rayleigh 0.1,1e-5 --json
modes panda --impedance target.json --order angular-linear --axes base --ratio 0.7 \
    -o controller.yaml --json
modes stewart-simscape --sensitivities --json
modes stewart-simscape --tolerance 0.05,0.0001
modes stewart-simscape --lengths 0.085,0.085,0.085,0.085,0.085,0.086 --strict --json
modes inclined-hexapod --set sz=0.6 --tcp 0,0,0.05 --pose 0,0,0.01,0,0.1,0 --pose-of M \
    --payload 3 --json
modes fanuc-r2000ic --springs kuka-kr270/klimchik-2013 --gravity 0,0,-9.81
modes {_XACRO} --stiffness 1000 --rest 0,0.1 --json
modes flexible_arm.yaml --json
modes cubic
identify {_TABLE}
identify {_TABLE} --json
identify {_TABLE} --axes world --point 0,0,0.01 --load-at 0,0,0.01 --loaded --fit robust --json
identify {_TABLE} --unknown turn,lift,bow --tie turn=lift --offsets none --tcp 0,0,0.01 --json
identify {_TABLE} -o known.yaml
identify {_TABLE} --payload 1 --gravity 0,0,-9.81 --set k=9000 --json
identify ur5 --plan 4 --force 80 {_PLAN} --within z=0.1:1 --range elbow_joint=0.3:2.5 --json
identify ur5 --plan 4 --mass 5 --sd d=0.005mm --criterion all --json
identify {_UR5} --plan 4 --force 80 {_PLAN} --criterion posture --load 0,0,0,0,0,-50 --frame tool0
identify inclined-hexapod --set sz=0.6 --plan 3 --force 80 {_PLAN}
identify {_XACRO} --plan 3 --force 80 {_PLAN}
workspace hexapod --directions 60 --scan 20 --no-progress -o boundary.csv
workspace hexapod --pose 0,0,0.7,0.1,0,0 --directions 60 --scan 20 --json
workspace cables.yaml --radius 2 --load 0,0,0,0,0,-50 --world --load-at 0,0,0.1 \
    --load-kind follower --tensions closed-form --directions 60 --scan 20 --json --strict
workspace limited.yaml --set sz=0.6 --tcp 0,0,0.05 --pose 0,0,0.3,0,0.1,0 --pose-of M \
    --payload 3 --gravity 0,0,-9.81 --directions 60 --scan 20 --json
workspace 6-pus --frame body --q leg1/slide=0 --directions 30 --scan 10 --json
workspace {_XACRO}
assemble hexapod --all -o modes.json
assemble stewart-simscape --all --lengths 0.085,0.085,0.085,0.085,0.085,0.086 --json
assemble hexapod --all --load 0,0,0,0,0,-500 --world --load-at 0,0,0.1 --load-kind follower --json
assemble five-bar --all --q left_motor=2.1,right_motor=1.0 --json --strict
assemble inclined-hexapod --set sz=0.6 --tcp 0,0,0.05 --pose 0,0,0.01,0,0.1,0 --pose-of M \
    --payload 3 --gravity 0,0,-9.81 --stiffness 1e6
assemble 3-rrr --frame body --springs ../inputs/springs.csv
assemble {_XACRO}
design study.yaml --best 3 --no-progress
design study.yaml --json
design front.yaml --tcp 0,0,0.05 --payload 2 --gravity 0,0,-9.81 --json
design front.yaml --load 0,0,0,0,0,-100 --load-at 0,0,0.1 --world --load-kind follower
design sampled.yaml -o designs.csv --json
compare ur5 ur10 --load 0,0,0,0,0,-100 --world
compare inclined-hexapod --with sz=0.6 --load 0,0,0,0,0,-500 --json
compare hexapod stewart-gough --load 10,0,0,0,0,-100 --load-at 0,0,0.1 --tcp 0,0,0.05 --json
compare ur5 ur10 --springs ../inputs/springs.csv --frame tool0 --json
compare stewart-simscape stewart-simscape --lengths 0.085,0.085,0.085,0.085,0.085,0.086 --json
compare inclined-hexapod --with sz=0.6 --pose 0,0,0.01,0,0.1,0 --pose-of M --json
compare {_XACRO} arm.xacro --stiffness 1000 --rest 0,0.1
compare five-bar 3-rrr --load 0,0,0,0,10,0 --world --load-kind follower -o both.json
compare arm.yaml --set k=9000 --with k=12000 --q 0,-0.5,1 --payload 2 --gravity 0,0,-9.81 --json
compare ur5 panda --load 0,0,0,0,0,-100
compare delta
frames {_UR5} --springs ../inputs/springs.csv
frames panda --frame panda_hand --tcp 0,0,0.1 --payload 2 --gravity 0,0,-9.81 --json
frames 6-pus --stiffness 1e6
frames inclined-hexapod --set sz=0.6 --json
frames {_XACRO}
models
models --json
models --quantities
models --help
"""


# ------------------------------------------------------------------------------------------------
# Small files


def _rows(head: str, *rows: tuple[float, ...]) -> str:
    return "\n".join([head, *(",".join(f"{x:.12g}" for x in row) for row in rows)]) + "\n"


_ARM = """<robot name="arm">
  <link name="base"/>
  <link name="a"><inertial><origin xyz="0 0 0.15"/><mass value="4"/>
    <inertia ixx="0.03" iyy="0.03" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <link name="b"><inertial><origin xyz="0.2 0 0"/><mass value="3"/>
    <inertia ixx="0.01" iyy="0.04" izz="0.04" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <link name="tool"><inertial><origin xyz="0.1 0 0"/><mass value="1"/>
    <inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="turn" type="revolute"><parent link="base"/><child link="a"/><axis xyz="0 0 1"/>
    <limit lower="-3" upper="3" effort="100" velocity="1"/></joint>
  <joint name="lift" type="revolute"><parent link="a"/><child link="b"/><axis xyz="0 1 0"/>
    <origin xyz="0 0 0.3"/><limit lower="-2" upper="2" effort="100" velocity="1"/></joint>
  <joint name="bow" type="revolute"><parent link="b"/><child link="tool"/><axis xyz="0 1 0"/>
    <origin xyz="0.4 0 0"/><limit lower="-2.5" upper="2.5" effort="50" velocity="1"/></joint>
  <link name="tip"/>
  <joint name="end" type="fixed"><parent link="tool"/><child link="tip"/>
    <origin xyz="0.3 0 0"/></joint>
</robot>
"""

_XACRO_FILE = """<robot name="reacher" xmlns:xacro="http://www.ros.org/wiki/xacro">
  <xacro:arg name="reach" default="0.4"/>
  <xacro:include filename="$(find parts)/tool.xacro"/>
  <link name="base"/><link name="arm"/>
  <joint name="turn" type="revolute"><parent link="base"/><child link="arm"/><axis xyz="0 0 1"/>
    <limit lower="-3" upper="3" effort="100" velocity="1"/></joint>
  <joint name="lift" type="revolute"><parent link="arm"/><child link="tool"/><axis xyz="0 1 0"/>
    <origin xyz="$(arg reach) 0 0"/><limit lower="-2" upper="2" effort="9" velocity="1"/></joint>
</robot>
"""
_XACRO_PART = """<robot xmlns:xacro="http://www.ros.org/wiki/xacro">
  <link name="tool"><inertial><origin xyz="0.1 0 0"/><mass value="2"/>
    <inertia ixx="0.01" iyy="0.02" izz="0.02" ixy="0" ixz="0" iyz="0"/></inertial></link>
</robot>
"""
_MJCF = """<mujoco model="arm"><compiler angle="radian"/><worldbody>
  <body name="a" pos="0 0 0.3"><joint name="turn" axis="0 0 1" stiffness="900"/>
    <geom type="capsule" size="0.03" fromto="0 0 0 0.4 0 0" density="1000"/>
    <body name="b" pos="0.4 0 0"><joint name="lift" axis="0 1 0" stiffness="700"/>
      <geom type="capsule" size="0.03" fromto="0 0 0 0.3 0 0" density="1000"/>
      <body name="c" pos="0.3 0 0"><joint name="roll" axis="1 0 0" stiffness="300"/>
        <geom type="sphere" size="0.05" density="1000"/><site name="tool" pos="0.1 0 0"/>
      </body></body></body>
</worldbody></mujoco>
"""
_STUDY = """mechanism: inclined-hexapod
variables:
  sz: {low: 0.4, high: 0.9, count: 5}
poses:
  grid: {x: [-0.02, 0.02, 3], z: [-0.01, 0.01, 2]}
  about_home: true
objectives:
  stiff: {quantity: translation_free_min}
"""
_FRONT = """mechanism: inclined-hexapod
variables:
  sz: [0.4, 0.9]
  a: {values: [0.2, 0.3]}
set: {half: 0.2}
cases:
  up: {direction: [0, 0, 1], world: true}
  side: {direction: [1, 0, 0], world: true}
objectives:
  up: {quantity: along_held, case: up}
  side: {quantity: along_held, case: side}
constraints:
  width: {value: =2*a, at_most: 0.5}
"""
_SAMPLED = """mechanism: inclined-hexapod
variables:
  sz: [0.4, 0.9]
  a: [0.2, 0.4]
poses:
  random: {count: 3, seed: 1, ranges: {x: [-0.02, 0.02]}}
  about_home: true
method: {kind: sobol, designs: 4, seed: 2}
objectives:
  condition: {quantity: condition}
"""


def _measured() -> str:
    """Displacements of the arm of three joints under forces, to first order, with small errors."""
    import numpy as np

    random = np.random.default_rng(1)
    compliance = 1.0 / np.array([20000.0, 30000.0, 10000.0])
    rows = []
    for _ in range(14):
        q = random.uniform([-2, -1, -1], [2, 1, 1])
        force = random.uniform(-80, 80, 3)
        axis = np.array([-np.sin(q[0]), np.cos(q[0]), 0.0])
        out = np.array([np.cos(q[0]), np.sin(q[0]), 0.0])

        def along(angle: float, out: Any = out) -> Any:
            return out * np.cos(angle) + np.array([0.0, 0.0, -np.sin(angle)])

        shoulder = np.array([0.0, 0.0, 0.3])
        elbow = shoulder + 0.4 * along(q[1])
        tip = elbow + 0.3 * along(q[1] + q[2])
        J = np.column_stack(
            [
                np.cross([0.0, 0.0, 1.0], tip),
                np.cross(axis, tip - shoulder),
                np.cross(axis, tip - elbow),
            ]
        )
        d = J @ (compliance * (J.T @ force)) + random.normal(0.0, 2e-5, 3)
        rows.append((*q, *force, *d))
    return _rows("turn,lift,bow,fx,fy,fz,dx [m],dy [m],dz [m]", *rows)


def write_inputs(folder: Path) -> None:
    """Write the files that the commands read."""
    folder.mkdir(parents=True)
    root = Path(__file__).resolve().parents[1]
    inclined, cables, hexapod = (
        (root / "robots" / f"{name}.yaml").read_text(encoding="utf-8")
        for name in ("inclined-hexapod", "cable-robot", "hexapod")
    )
    target = [[0.0] * 6 for _ in range(6)]
    for i, k in enumerate((4e3, 5e3, 3e3, 2e4, 3e4, 5e4)):
        target[i][i] = k
    files = {
        "arm.urdf": _ARM,
        "arm.yaml": "kind: serial\nmodel: arm.urdf\nframe: tip\nparameters: {k: 20000}\n"
        "springs: {turn: {stiffness: =k}, lift: {stiffness: 30000}, bow: {stiffness: 10000}}\n",
        "limited.yaml": inclined.replace(
            "{stiffness: 1.0e6}", "{stiffness: 1.0e6, limits: [0.2, 0.5]}"
        ),
        "cables.yaml": cables + "  force: [20, 900]\n",
        "arm.xacro": _XACRO_FILE,
        "packages/parts/package.xml": "<package><name>parts</name></package>\n",
        "packages/parts/tool.xacro": _XACRO_PART,
        "arm.xml": _MJCF,
        "hexagonal.yaml": hexapod,
        "flexible_arm.yaml": (root / "examples" / "flexible_arm.yaml").read_text(encoding="utf-8"),
        "springs.csv": "joint,stiffness [N m/rad]\n"
        + "".join(f"{i},{k}\n" for i, k in enumerate((9e3, 8e3, 7e3, 3e3, 2e3, 1e3), 1)),
        "target.json": json.dumps({"matrix": target, "order": "angular-linear"}),
        "study.yaml": _STUDY,
        "front.yaml": _FRONT,
        "sampled.yaml": _SAMPLED,
        "measured.csv": _measured(),
        "postures.csv": _rows(
            "shoulder_pan_joint,shoulder_lift_joint,elbow_joint,"
            "wrist_1_joint,wrist_2_joint,wrist_3_joint",
            *((0.1 * i, -1.2 + 0.05 * i, 1.5, 0.2, 1.0, 0.0) for i in range(4)),
        ),
        "panda.csv": _rows(
            ",".join(f"panda_joint{i}" for i in range(1, 8)),
            *((0.1 * i, -0.8, 0.0, -2.4 + 0.1 * i, 0.0, 1.6, 0.8) for i in range(4)),
        ),
        "edge.csv": _rows(
            "x,y,z,roll,pitch,yaw",
            (0.62, -0.10, 0.30, 0, 0, 0.0),
            (0.62, -0.03, 0.31, 0, 0, 0.1),
            (0.63, 0.04, 0.32, 0, 0, 0.2),
            (0.64, 0.11, 0.34, 0, 0, 0.3),
        ),
        "hand.csv": _rows(
            "x,y,z,roll,pitch,yaw",
            *((0.45, -0.1 + 0.1 * i, 0.4, math.pi, 0, 0.05 * i) for i in range(3)),
        ),
        "fanuc.csv": _rows(
            "x,y,z,roll,pitch,yaw",
            *((1.6, -0.1 + 0.1 * i, 1.2, math.pi, 0, 0.05 * i) for i in range(3)),
        ),
        "reach.csv": _rows("x,y,z,roll,pitch,yaw", (0.5, 0, 0, 0, 0, 0), (0.5, 0, 0, 0, 0.1, 0)),
    }
    for name, text in files.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")


# ------------------------------------------------------------------------------------------------
# Running


def lines() -> list[list[list[str]]]:
    """The words of the commands, together those that go on in one folder."""
    groups: list[list[list[str]]] = []
    for line in COMMANDS.replace("\\\n", " ").strip().splitlines():
        words = line.split()
        if words[0] == "&":
            groups[-1].append(words[1:])
        else:
            groups.append([words])
    return groups


def folder_name(words: list[str]) -> str:
    """The name of the folder of a command, which other commands do not change."""
    subject = re.sub(r"\W+", "-", next((w for w in words[1:] if w[0] != "-"), "all")).strip("-")
    return f"{words[0]}-{subject}-{zlib.crc32(' '.join(words).encode()):08x}"


def run(source: Path, output: Path, only: list[str]) -> None:
    """Run the commands of one tree, shared among the processors."""
    if output.exists() and not only:
        shutil.rmtree(output)
    inputs = output / "inputs"
    shutil.rmtree(inputs, ignore_errors=True)
    write_inputs(inputs)
    environment = {
        **os.environ,
        "PYTHONPATH": str(source.resolve()),
        "OMP_NUM_THREADS": "1",
        "PYTHONHASHSEED": "0",
        "COLUMNS": "100",
    }
    count = min(2, os.cpu_count() or 1)
    words = [sys.executable, str(Path(__file__).resolve()), "worker", str(output.resolve())]
    workers = [
        subprocess.Popen([*words, str(i), str(count), *only], env=environment) for i in range(count)
    ]
    codes = [worker.wait() for worker in workers]
    if any(codes):
        raise SystemExit("a worker failed")


def work(output: Path, share: int, count: int, only: list[str]) -> None:
    """Run every `count`-th command, each in a forked process, so that none changes another."""
    import cartstiff
    from cartstiff.shown.cli.main import _COMMANDS, command

    for name in _COMMANDS:
        command.get_command(None, name)  # type: ignore[arg-type]
    vars(cartstiff).get("__all__")
    chosen = [steps for steps in lines() if not only or {words[0] for words in steps} & {*only}]
    inputs = sorted((output / "inputs").iterdir())
    for steps in chosen[share::count]:
        folder = output / folder_name(steps[0])
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir()
        for path in inputs:
            (folder / path.name).symlink_to(path)
        for step, words in enumerate(steps):
            _in_a_fork(folder, step, words)
        for path in inputs:
            (folder / path.name).unlink()
        _in_a_child(lambda folder=folder: _flatten(folder))  # a thread of Zarr stays in it


def _in_a_fork(folder: Path, step: int, words: list[str]) -> None:
    """Run one command and keep what it printed."""
    port = _free_port() if words[0] == "view" else 0
    said = [*words, *(["--port", str(port)] if port else [])]
    out, error = folder / f"{step}.out", folder / f"{step}.err"
    begun = time.perf_counter()
    child = os.fork()
    if not child:
        code = 99
        signal.alarm(_LONGEST)
        with suppress(BaseException):
            os.chdir(folder)
            with (
                out.open("w", buffering=1) as stdout,
                error.open("w") as stderr,
                redirect_stdout(stdout),
                redirect_stderr(stderr),
            ):
                from cartstiff.shown.cli.main import main

                try:
                    main(said)
                except SystemExit as end:
                    code = int(end.code or 0)
        os._exit(code)
    if port:
        _visit(child, out, folder / f"{step}.page.json")
    _, status = os.waitpid(child, 0)
    texts = [
        out.read_text(encoding="utf-8", errors="replace"),
        error.read_text(encoding="utf-8", errors="replace"),
    ]
    root = str(Path(sys.modules["cartstiff"].__file__ or "").parents[2])
    texts = [re.sub(rf":{port}/\S*", ":PORT/SECRET", t).replace(root, "ROOT") for t in texts]
    code = os.waitstatus_to_exitcode(status)
    head = f"$ cartstiff {' '.join(words)}\nexit {code}\n"
    data = _json_or_none(texts[0])
    if data is not None:
        (folder / f"{step}.json").write_text(json.dumps(data, indent=1), encoding="utf-8")
        texts[0] = "JSON\n"
    bar = re.compile(r".*\[[#-]+\].*")
    err = "\n".join(line for line in texts[1].splitlines() if not bar.match(line))
    (folder / f"{step}.txt").write_text(f"{head}{texts[0]}--\n{err}\n", encoding="utf-8")
    out.unlink()
    error.unlink()
    with (folder.parent / "seconds.txt").open("a") as log:
        log.write(f"{time.perf_counter() - begun:.2f} {folder.name} {step}\n")


def _in_a_child(act: Callable[[], Any]) -> None:
    """Call a function in a forked process, so that its threads are not there at the next fork."""
    if child := os.fork():
        os.waitpid(child, 0)
        return
    try:
        act()
    except BaseException:
        traceback.print_exc()
    os._exit(0)


def _json_or_none(text: str) -> Any:
    try:
        return json.loads(text) if text.startswith("{") else None
    except ValueError:
        return None


def _free_port() -> int:
    with socket.socket() as s:
        s.bind(("127.0.0.1", 0))
        return int(s.getsockname()[1])


def _visit(child: int, out: Path, kept: Path) -> None:
    """Open the page of a server as a tab does, keep what it is greeted with, and end the server."""
    for _ in range(600):
        time.sleep(0.05)
        text = out.read_text(encoding="utf-8") if out.exists() else ""
        found = re.search(r"http://\S+", text)
        if found or text.startswith("cartstiff:"):
            break
    if found:
        address = found[0]
        _in_a_child(lambda: kept.write_text(json.dumps(_greeting(address), indent=1)))
    with suppress(ProcessLookupError):
        os.kill(child, signal.SIGINT)


def _greeting(address: str) -> Any:
    """The JSON of the first message of a page's server."""
    import asyncio

    async def greeted() -> Any:
        from tornado.httpclient import AsyncHTTPClient, HTTPRequest
        from tornado.websocket import websocket_connect

        page = (await AsyncHTTPClient().fetch(address)).body.decode()
        headers = {"Origin": "/".join(address.split("/")[:3])}
        socket_address = f"{address.replace('http:', 'ws:')}socket"
        talk = await websocket_connect(HTTPRequest(socket_address, headers=headers))
        message = await asyncio.wait_for(talk.read_message(), 60)
        if isinstance(message, str):  # a large answer comes in pieces, behind its size
            size, message = int(message), b""
            while len(message) < size:
                message += await asyncio.wait_for(talk.read_message(), 60)
        talk.close()
        return {"title": re.findall("<title>.*?</title>", page), "first": _first_chunk(message)}

    return asyncio.run(greeted())


def _first_chunk(packed: bytes) -> Any:
    """The JSON of a packed message."""
    return json.loads(packed[4 : 4 + int.from_bytes(packed[:4], "big")])


def _flatten(folder: Path) -> None:
    """Make JSON or text of maps and pages."""
    for path in sorted(folder.iterdir()):
        if path.suffix == ".zarr":
            import xarray

            with xarray.open_zarr(path, consolidated=False) as data:
                arrays = {
                    str(name): [str(array.dtype), _plain(array.values.ravel().tolist())]
                    for name, array in data.variables.items()
                }
            kept = {"arrays": arrays, "sizes": {str(k): int(n) for k, n in data.sizes.items()}}
            Path(f"{path}.json").write_text(json.dumps(kept, indent=1), encoding="utf-8")
            shutil.rmtree(path)
        elif path.suffix == ".html":
            text = path.read_text(encoding="utf-8")
            packed = re.search(r'<script type="text/plain" id="data">([^<]*)', text)
            if packed:
                data = _first_chunk(gzip.decompress(base64.b64decode(packed[1])))
                data.pop("program", None)
                Path(f"{path}.json").write_text(json.dumps(data, indent=1), encoding="utf-8")
            else:
                text = re.sub(r"<(script|style|svg)\b.*?</\1>", "", text, flags=re.S)
                words = html.unescape(re.sub(r"<[^>]*>", "\n", text))
                words = re.sub(r"(?<=\n)\s*\n", "", words)
                Path(f"{path}.txt").write_text(words, encoding="utf-8")
            path.unlink()


def _plain(values: list[Any]) -> list[Any]:
    return [
        str(x) if isinstance(x, float) and not math.isfinite(x) else x if _is_plain(x) else str(x)
        for x in values
    ]


def _is_plain(x: Any) -> bool:
    return isinstance(x, (str, int, float, bool))


# ------------------------------------------------------------------------------------------------
# Comparing


def compare(first: Path, second: Path, only: list[str], gone: str | None) -> int:
    """Print where two folders of outputs differ; returns the number of commands that do."""
    pattern = re.compile(gone) if gone else None
    names = sorted({p.name for f in (first, second) for p in f.iterdir() if p.is_dir()})
    names = [n for n in names if n != "inputs" and (not only or n.split("-")[0] in only)]
    differing: Counter[str] = Counter()
    total: Counter[str] = Counter()
    for name in names:
        command = name.split("-")[0]
        total[command] += 1
        found = list(_differences(first / name, second / name, pattern))
        if found:
            differing[command] += 1
            words = next(iter(sorted((first / name).glob("*.txt"))), None)
            said = words.read_text(encoding="utf-8").partition("\n")[0] if words else name
            print(f"{name}: {said}")
            for line in found[:12]:
                print(f"    {line[:220]}")
            if len(found) > 12:
                print(f"    ... and {len(found) - 12} more")
    for command, count in total.items():
        print(f"{command:<12} {count:>4} runs, {differing[command]} differ")
    return sum(differing.values())


def _differences(first: Path, second: Path, gone: re.Pattern[str] | None) -> Any:
    files = sorted(
        {str(p.relative_to(f)) for f in (first, second) if f.is_dir() for p in f.rglob("*.*")}
    )
    for name in files:
        one, other = first / name, second / name
        if not one.exists() or not other.exists():
            if gone is None or not gone.search(name):
                yield f"{name}: only {'before' if one.exists() else 'after'}"
        elif one.suffix == ".json":
            a, b = (json.loads(p.read_text(encoding="utf-8")) for p in (one, other))
            yield from (f"{name} {text}" for text in _unequal(a, b, "", gone))
        elif one.suffix in (".txt", ".csv", ".yaml"):
            yield from (f"{name} {text}" for text in _unequal_text(one, other, gone))
        elif one.read_bytes() != other.read_bytes():
            yield f"{name}: other bytes"


def _unequal(a: Any, b: Any, at: str, gone: re.Pattern[str] | None) -> Any:
    """Places at which two JSON values differ."""
    if isinstance(a, dict) and isinstance(b, dict):
        for key in {**a, **b}:
            place = f"{at}.{key}"
            if gone is not None and gone.search(place):
                continue
            if key not in a or key not in b:
                yield f"{place}: only {'before' if key in a else 'after'}"
            else:
                yield from _unequal(a[key], b[key], place, gone)
    elif isinstance(a, list) and isinstance(b, list):
        if len(a) != len(b):
            yield f"{at}: {len(a)} entries before, {len(b)} after"
        elif _are_numbers(a) and _are_numbers(b):
            yield from _unequal_block(a, b, at)
        elif _is_six(a) and _is_six(b):
            for i in (0, 3):
                for j in (0, 3):
                    blocks = [[x for row in m[i : i + 3] for x in row[j : j + 3]] for m in (a, b)]
                    yield from _unequal_block(*blocks, f"{at}[{i}:,{j}:]")
        else:
            for i, (x, y) in enumerate(zip(a, b, strict=True)):
                yield from _unequal(x, y, f"{at}[{i}]", gone)
    elif _are_numbers([a, b]):
        yield from _unequal_block([a], [b], at)
    elif a != b and not (gone is not None and isinstance(a, str) and gone.search(a)):
        yield f"{at}: {a!r:.90} -> {b!r:.90}"


def _unequal_block(a: list[float], b: list[float], at: str) -> Any:
    size = max((abs(x) for x in [*a, *b]), default=0.0)
    off = max((abs(x - y) for x, y in zip(a, b, strict=True)), default=0.0)
    if off > AGREEMENT * size:
        worst = max(range(len(a)), key=lambda i: abs(a[i] - b[i]))
        yield f"{at}: {off / size:.1e} of the largest entry ({a[worst]!r} -> {b[worst]!r})"


def _are_numbers(values: list[Any]) -> bool:
    return all(isinstance(x, (int, float)) and not isinstance(x, bool) for x in values)


def _is_six(m: list[Any]) -> bool:
    return len(m) == 6 and all(
        isinstance(row, list) and len(row) == 6 and _are_numbers(row) for row in m
    )


def _unequal_text(one: Path, other: Path, gone: re.Pattern[str] | None) -> Any:
    import difflib

    before, after = (p.read_text(encoding="utf-8").splitlines() for p in (one, other))
    if before == after:
        return
    for line in difflib.unified_diff(before, after, n=0, lineterm=""):
        is_kept = gone is None or not gone.search(line)
        if line[:3] not in ("---", "+++") and line[:2] != "@@" and is_kept:
            yield line


# ------------------------------------------------------------------------------------------------


def unused_options() -> dict[str, list[str]]:
    """The options of each command that no line uses; a port and a scheduler are never the same."""
    import click

    from cartstiff.shown.cli.main import _COMMANDS, command

    used: dict[str, set[str]] = {name: {"--port", "--dask", "--help-all"} for name in _COMMANDS}
    for steps in lines():
        for words in steps:
            if words[0] in used:
                used[words[0]] |= {"--output" if w == "-o" else w for w in words}
    unused = {}
    for name in _COMMANDS:
        found = command.get_command(None, name)  # type: ignore[arg-type]
        options = [p for p in found.params if isinstance(p, click.Option)] if found else []
        left = [p.opts[-1] for p in options if not used[name] & {*p.opts, *p.secondary_opts}]
        if left:
            unused[name] = left
    return unused


def main() -> int:
    """Read the command line."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parts = parser.add_subparsers(dest="what", required=True)
    part = parts.add_parser("run")
    part.add_argument("--source", type=Path, required=True)
    part.add_argument("-o", dest="output", type=Path, required=True)
    part.add_argument("only", nargs="*")
    part = parts.add_parser("compare")
    part.add_argument("first", type=Path)
    part.add_argument("second", type=Path)
    part.add_argument("only", nargs="*")
    part.add_argument("--gone")
    part = parts.add_parser("options")
    part.add_argument("--source", type=Path, required=True)
    part = parts.add_parser("worker")
    part.add_argument("output", type=Path)
    part.add_argument("share", type=int)
    part.add_argument("count", type=int)
    part.add_argument("only", nargs="*")
    given = parser.parse_args()
    if given.what == "run":
        run(given.source, given.output, given.only)
    elif given.what == "worker":
        work(given.output, given.share, given.count, given.only)
    elif given.what == "compare":
        return int(compare(given.first, given.second, given.only, given.gone) > 0)
    else:
        sys.path.insert(0, str(given.source.resolve()))
        for name, options in unused_options().items():
            print(f"{name}: {' '.join(options)}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
