"""URDF and MJCF files, whole and damaged; whole ones against other programs and differences."""

from __future__ import annotations

import math
import random
from pathlib import Path
from typing import Any

import numpy as np
from tools.fuzz_common import (
    ODD_NUMBERS,
    FaultError,
    command,
    mutated_bytes,
    mutated_xml,
    nudged_xml,
    outcome,
)


def _vector(rng: random.Random, size: float = 1.0) -> str:
    return " ".join(f"{rng.uniform(-size, size):.6g}" for _ in range(3))


def urdf_text(rng: random.Random, *, plain: bool = False) -> str:
    """A tree of links: any kinds of joints, masses, followers; or plainly a chain."""
    count = rng.randint(1, 9)
    parts = ['<link name="l0"/>']
    axial: list[str] = []
    for i in range(1, count + 1):
        kind = rng.choices(
            ["revolute", "continuous", "prismatic", "fixed", "planar", "floating"],
            [8, 3, 4, 2, 0, 0] if plain else [8, 3, 4, 2, 1, 1],
        )[0]
        parent = i - 1 if plain or rng.random() < 0.8 else rng.randrange(i)
        mass = (
            (
                f'<inertial><origin xyz="{_vector(rng)}"/><mass value="{rng.uniform(0, 5):.4g}"/>'
                "</inertial>"
            )
            if plain or rng.random() < 0.6
            else ""
        )
        limits = '<limit lower="-2" upper="2" effort="9" velocity="9"/>'
        mimic = ""
        if axial and not plain and kind in ("revolute", "prismatic") and rng.random() < 0.15:
            mimic = f'<mimic joint="{rng.choice(axial)}" multiplier="{rng.uniform(-2, 2):.4g}"/>'
        elif kind in ("revolute", "continuous", "prismatic"):
            axial.append(f"j{i}")
        axis = f'<axis xyz="{_vector(rng)}"/>' if kind not in ("fixed", "floating") else ""
        parts.append(
            f'<link name="l{i}">{mass}</link><joint name="j{i}" type="{kind}">'
            f'<parent link="l{parent}"/><child link="l{i}"/>'
            f'<origin xyz="{_vector(rng)}" rpy="{_vector(rng, 3.1)}"/>{axis}{limits}{mimic}</joint>'
        )
    return f'<robot name="r">{"".join(parts)}</robot>'


def urdf(rng: random.Random) -> str:
    """A URDF, whole or damaged; whole ones are compared with Pinocchio and with differences."""
    text = urdf_text(rng)
    if rng.random() < 0.35:
        Path("r.urdf").write_text(text, encoding="utf-8")
        return _compared(rng, Path("r.urdf"))
    damage = rng.random()
    data = (
        nudged_xml(rng, text)
        if damage < 0.6
        else mutated_xml(rng, text)
        if damage < 0.85
        else mutated_bytes(rng, text.encode())
    )
    Path("r.urdf").write_bytes(data)
    words = ["analyse", "r.urdf", "--json"]
    if rng.random() < 0.3:
        words += [
            rng.choice(["--load", "--q", "--stiffness", "--gravity"]),
            ",".join(str(rng.choice(ODD_NUMBERS)) for _ in range(rng.choice([1, 3, 6]))),
        ]
    return outcome(command(words)[0])


def _compared(rng: random.Random, path: Path) -> str:
    """Pose and Jacobian against Pinocchio as it reads the file itself, and against differences."""
    import pinocchio as pin

    import cartstiff
    from cartstiff import CartstiffError
    from cartstiff.geometry import se3

    try:
        elastic = cartstiff.load(path)
    except CartstiffError:
        return "refused"
    mechanism = elastic.mechanism
    q = np.array([rng.uniform(-1, 1) for _ in elastic.names])
    posture = mechanism.at(q)
    J = (
        np.array(
            [
                se3.log(se3.inverse(posture.pose) @ mechanism.at(q + 1e-6 * e).pose)
                - se3.log(se3.inverse(posture.pose) @ mechanism.at(q - 1e-6 * e).pose)
                for e in np.eye(len(q))
            ]
        ).T
        / 2e-6
    )
    jacobian = posture.motion.jacobian
    if not np.allclose(jacobian, J, atol=1e-7 * max(1.0, np.abs(J).max())):
        raise FaultError(f"Jacobian differs from differences by {np.abs(jacobian - J).max():.3g}")
    _stiffness_compared(rng, elastic, q)
    try:
        model = pin.buildModelFromUrdf(str(path), True)  # followers obey their leaders
    except ValueError:
        return "answered"  # followers of other kinds than their leader's are not in Pinocchio
    names = list(model.names)
    configuration = pin.neutral(model)
    for name, value in zip(elastic.names, q, strict=True):
        if name not in names or model.joints[names.index(name)].nv != 1:
            return "answered"  # joints of several coordinates have charts of their own
        joint = model.joints[names.index(name)]
        at = joint.idx_q
        configuration[at : at + joint.nq] = (
            [math.cos(value), math.sin(value)] if joint.nq == 2 else [value]
        )
    data = model.createData()
    pin.framesForwardKinematics(model, data, configuration)
    expected = data.oMf[model.getFrameId(mechanism.frame)].homogeneous
    if not np.allclose(posture.pose, expected, atol=1e-10):
        raise FaultError(
            f"pose differs from Pinocchio's by {np.abs(posture.pose - expected).max():.3g}"
        )
    return "compared"


def _stiffness_compared(rng: random.Random, elastic: Any, q: Any) -> None:
    """The compliance, free and under a force that keeps its direction, against differences.

    The energy ``1/2 k |q - q0|^2 - f . x(q)`` is known here by poses alone: its Hessian H by second
    differences gives the compliance ``J H^-1 J^T``.
    """
    import cartstiff

    mechanism, n = elastic.mechanism, len(q)
    k = np.array([10.0 ** rng.uniform(2, 4) for _ in range(n)])
    elastic = elastic.with_springs(k)
    start = mechanism.at(q)
    force = np.array([rng.uniform(-9, 9) for _ in range(3)]) if rng.random() < 0.7 else np.zeros(3)

    def work(at: Any) -> float:
        return float(force @ (start.pose[:3, :3].T @ (at - start.pose[:3, 3])))

    def x(*steps: Any) -> float:
        return work(mechanism.at(q + sum(steps)).pose[:3, 3])

    h = 1e-4
    e = h * np.eye(n)
    H = np.diag(k) - np.array(
        [[x(a, b) - x(a, -b) - x(-a, b) + x(-a, -b) for b in e] for a in e]
    ).reshape(n, n) / (4 * h * h)
    J = start.motion.jacobian
    expected = J @ np.linalg.solve(H, J.T)
    result = cartstiff.analyse(elastic, q, wrench=np.concatenate([np.zeros(3), force]))
    found = result.tangent_compliance
    if found is None or np.linalg.eigvalsh(0.5 * (H + H.T))[0] < 1e-3 * k.min():
        return  # near buckling: the differences have lost their digits
    size = np.abs(expected).max()
    if not np.allclose(found, expected, rtol=0, atol=1e-5 * size):
        raise FaultError(
            f"compliance differs from differences by {np.abs(found - expected).max() / size:.3g}"
        )


_KINDS = ["hinge", "slide", "ball"]


def mjcf_text(rng: random.Random) -> str:
    """A tree of bodies with springs, defaults and now and then a loop."""
    count = rng.randint(1, 6)
    text = ""
    for i in reversed(range(count)):
        kind = rng.choices(_KINDS, [6, 3, 1])[0]
        axis = f'axis="{_vector(rng)}" ' if kind != "ball" else ""
        stiff = f'stiffness="{rng.uniform(0, 1e4):.4g}" ' if rng.random() < 0.7 else ""
        text = (
            f'<body name="b{i}" pos="{_vector(rng)}" euler="{_vector(rng, 90)}">'
            f'<joint name="j{i}" type="{kind}" {axis}{stiff}pos="{_vector(rng, 0.1)}"/>'
            f'<geom size="0.1"/>{text}</body>'
        )
    tie = ""
    if count > 3 and rng.random() < 0.3:
        tie = f'<connect body1="b0" body2="b{count - 1}" anchor="{_vector(rng)}"/>'
    angle = rng.choice(["radian", "degree"])
    return (
        f'<mujoco><compiler angle="{angle}"/><worldbody>{text}</worldbody>'
        f"<equality>{tie}</equality></mujoco>"
    )


def _against_mujoco(rng: random.Random) -> str:
    """What a file means to MuJoCo: a changed file of many elements, or a tree of bodies."""
    from tools import mjcf_against_mujoco as tool

    from cartstiff.files.mjcf import reading as mjcf
    from cartstiff.shown.cli.main import main  # noqa: F401  (its imports are not the input's)

    text = tool.mutant(rng) if rng.random() < 0.6 else nudged_xml(rng, mjcf_text(rng)).decode()
    Path("r.xml").write_text(text, encoding="utf-8")
    own, mjcf.compile_mjcf = mjcf.compile_mjcf, tool.compile_here
    try:
        kind, words = tool.verdict(Path("r.xml").resolve(), rng.randrange(2**31))
        if kind in ("wrong", "broken"):
            raise FaultError(f"{kind}: {words[-300:]}")
        code = command(["analyse", "r.xml", "--json"])[0]
    finally:
        mjcf.compile_mjcf = own
    return "compared" if kind == "same" else outcome(code)


def mjcf(rng: random.Random) -> str:
    """An MJCF file, whole or damaged."""
    if rng.random() < 0.96:  # the others go through a process of their own
        return _against_mujoco(rng)
    text = mjcf_text(rng)
    damage = rng.random()
    data = (
        text.encode()
        if damage < 0.3
        else mutated_xml(rng, text)
        if damage < 0.8
        else mutated_bytes(rng, text.encode())
    )
    Path("r.xml").write_bytes(data)
    return outcome(command(["analyse", "r.xml", "--json"])[0])
