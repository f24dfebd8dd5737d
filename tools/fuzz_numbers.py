"""Numbers against other ways to them: many postures, natural frequencies, states of rest."""

from __future__ import annotations

import random
from pathlib import Path
from typing import Any

import numpy as np
from tools.fuzz_common import FaultError, nudged_data
from tools.fuzz_robots import urdf_text

#: Of the largest entry, where a stiffness has been found in two ways.
SAME = 1e-8


def _mechanism(rng: random.Random) -> Any:
    """A mechanism from a nudged file or a tree of links, or None where it is refused."""
    import json

    from tools.fuzz_inputs import bundled, copy_models

    import cartstiff
    from cartstiff import CartstiffError

    try:
        if rng.random() < 0.4:
            Path("r.urdf").write_text(urdf_text(rng), encoding="utf-8")
            elastic = cartstiff.load(Path("r.urdf"))
            return elastic.with_springs([10.0 ** rng.uniform(2, 5) for _ in elastic.names])
        copy_models()
        name = rng.choice(sorted(bundled()))
        data = bundled()[name][1]
        if rng.random() < 0.7:
            data = nudged_data(rng, data)
        Path("m.yaml").write_text(json.dumps(data), encoding="utf-8")
        return cartstiff.load(Path("m.yaml"))
    except CartstiffError:
        return None


def _load(rng: random.Random) -> Any:
    return None if rng.random() < 0.4 else [rng.uniform(-5, 5) for _ in range(6)]


def postures(rng: random.Random) -> str:
    """A stack of postures by array code or machine code, and each of them alone by the engine."""
    import cartstiff
    from cartstiff import CartstiffError, analyse

    elastic = _mechanism(rng)
    if elastic is None:
        return "refused"
    q = np.asarray(elastic.q) + np.array(
        [[rng.uniform(-0.2, 0.2) for _ in elastic.names] for _ in range(2)]
    )
    wrench, path = _load(rng), rng.choices(["auto", "portable", "engine"], [1, 8, 1])[0]
    try:
        found = cartstiff.analyse_many(
            elastic, q, wrench=wrench, path=path, outputs=["B", "A", "pose"]
        )
    except CartstiffError:
        return "refused"
    for row in range(2):
        try:
            alone = analyse(elastic, q[row], wrench=wrench)
            K = alone.B.matrix
            said = max(
                (n.values["relative_error"] for n in alone.notes if n.code == "ill-conditioned"),
                default=0.0,
            )
        except CartstiffError:
            K, said = None, 0.0
        both = found["stiffness_B"][row]
        if K is None or not np.isfinite(both).all():
            if K is not None and found.is_regular[row]:
                raise FaultError(f"{path}: posture {row} regular without a stiffness")
            continue
        size = max(float(np.abs(K).max()), float(np.abs(both).max()))
        off = float(np.abs(np.asarray(K) - both).max())
        # Both ways are off by what the result says of itself.
        if size and off > size * max(SAME, 1e-16 * np.linalg.cond(both), 10.0 * said):
            raise FaultError(f"{path}: stiffness differs by {off / size:.3g} in posture {row}")
    return "compared"


def _inertial(rng: random.Random, text: str) -> str:
    """Links with inertia about three axes, as a tree of solids has."""
    import re

    def solid(_: Any) -> str:
        a, b, c = (rng.uniform(0.01, 0.1) for _ in range(3))
        return (
            f'<mass value="{rng.uniform(0.5, 5):.4g}"/><inertia ixx="{b + c:.6g}" '
            f'iyy="{a + c:.6g}" izz="{a + b:.6g}" ixy="0" ixz="0" iyz="0"/>'
            "</inertial>"
        )

    return re.sub(r'<mass value="[^"]*"/></inertial>', solid, text)


def frequencies(rng: random.Random) -> str:
    """Frequencies without load against the mass matrix that Pinocchio's own algorithm gives."""
    import pinocchio as pin
    from scipy.linalg import eigh

    import cartstiff
    from cartstiff import CartstiffError

    text = _inertial(rng, urdf_text(rng, plain=True))
    path = Path("r.urdf")
    path.write_text(text, encoding="utf-8")
    try:
        elastic = cartstiff.load(path)
        k = np.array([10.0 ** rng.uniform(2, 4) for _ in elastic.names])
        elastic = elastic.with_springs(k)
        q = np.array([rng.uniform(-1, 1) for _ in elastic.names])
        found = cartstiff.modes(elastic, q)
    except CartstiffError:
        return "refused"
    model = pin.buildModelFromUrdf(str(path))
    if list(model.names)[1:] != list(elastic.names):
        raise FaultError(f"coordinates {elastic.names}, Pinocchio's {list(model.names)[1:]}")
    at = pin.neutral(model)
    for joint, value in zip(list(model.joints)[1:], q, strict=True):
        at[joint.idx_q : joint.idx_q + joint.nq] = (
            [np.cos(value), np.sin(value)] if joint.nq == 2 else [value]
        )
    M = pin.crba(model, model.createData(), at)
    M = np.triu(M) + np.triu(M, 1).T
    if np.linalg.eigvalsh(M)[0] < 1e-9 * np.abs(M).max():
        return "answered"  # motions that carry no mass have no frequency
    expected = np.sqrt(eigh(np.diag(k), M, eigvals_only=True)) / (2 * np.pi)
    if len(found.frequencies) != len(expected) or not np.allclose(
        found.frequencies, expected, rtol=1e-6
    ):
        raise FaultError(f"frequencies {found.frequencies}, Pinocchio {expected}")
    return "compared"


def rest(rng: random.Random) -> str:
    """The compliance at rest against where the mechanism comes to rest under a little more."""
    import cartstiff
    from cartstiff import CartstiffError, DeadForce

    elastic = _mechanism(rng)
    if elastic is None:
        return "refused"
    force = np.array([rng.uniform(-5, 5) for _ in range(3)])
    try:
        state = cartstiff.equilibrium(elastic, DeadForce(force), iterations=60)
        C = state.stiffness.tangent_compliance
        if not state.stable or C is None or state.reactions.limits:
            return "answered"
        # What moves hangs on digits of the geometry, as the note says.
        if any(note.code == "near-constraint-singularity" for note in state.stiffness.notes):
            return "answered"
        # Turns count as well: on a tiny platform a small force turns far before it shifts.
        size = float(np.linalg.norm(C[:, 3:], 2))
        if not 1e-12 < size < 1e-1:
            return "answered"
        step = 1e-5 / size * np.array([rng.uniform(-1, 1) for _ in range(3)])
        off = [_off_at_rest(state, force, part * step, C) for part in (1.0, 0.1, 1e-3)]
    except CartstiffError:
        return "refused"
    if None in off:
        return "answered"
    # Where it snaps over within a step, a smaller one still tells.
    if min(off) > 1e-3:  # type: ignore[type-var]
        raise FaultError(f"compliance at rest differs from where it comes to rest by {off}")
    return "compared"


def _off_at_rest(state: Any, force: Any, step: Any, C: Any) -> float | None:
    """How far the compliance is from half a difference of rests; None where the law has a kink."""
    import cartstiff
    from cartstiff import DeadForce
    from cartstiff.geometry import se3

    # The rest positions that were chosen stay; without them new ones would carry gravity.
    ends = [
        cartstiff.equilibrium(state.elastic, state.q, DeadForce(force + sign * step))
        for sign in (1, -1)
    ]
    slack = any(note.code == "slack" for end in (state, *ends) for note in end.notes)
    if slack or any(end.reactions.limits for end in ends):
        return None
    moved = se3.log(se3.inverse(ends[1].pose) @ ends[0].pose)
    expected = 2 * C[:, 3:] @ (state.pose[:3, :3].T @ step)
    # How far each rest is unsure, which its note says.
    unsure = sum(
        np.abs(end.posture.motion.jacobian) @ np.abs(note.values["uncertainty"])
        for end in ends
        for note in end.notes
        if note.code == "posture-unresolved"
    )
    missed = np.maximum(np.abs(moved - expected) - unsure, 0.0)
    return float(missed.max() / max(np.abs(expected).max(), 1e-12))
