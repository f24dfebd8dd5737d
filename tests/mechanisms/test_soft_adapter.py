"""A soft link behind a fixed joint: what it is fixed to does not move with it.

The same arm with a locked joint in place of the fixed one takes another way through the library:
there the soft link is the only one on its joint.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from tests.mechanisms.machines import joint, masses, write_file, write_urdf

from cartstiff import analyse, load
from cartstiff.mechanisms.elastic import ElasticMechanism

# Two ways through the same few rotations.
ROUNDING = 1e-12
K = np.diag([3e3, 4e3, 5e3, 2e5, 3e5, 4e5]) + 100.0
FRAMES = ("upper", "camera", "adapter", "tool", "spindle", "gripper")


def arm(folder: Path, kind: str, frame: str) -> ElasticMechanism:
    """Upper arm with a camera, a soft adapter, and on that a tool, a spindle and a gripper."""
    joints = [
        joint("lift", "base", "upper", axis=(0, 1, 0), at=(0, 0, 0.3)),
        joint("mount", "upper", "camera", kind="fixed", at=(0.2, 0.1, 0)),
        joint("bolts", "upper", "adapter", kind=kind, at=(0.5, 0, 0.1), rpy=(0.2, 0.1, 0.4)),
        joint("flange", "adapter", "tool", kind="fixed", at=(0, 0, 0.2)),
        joint("turn", "tool", "spindle", axis=(1, 0, 0), at=(0, 0.1, 0)),
        joint("side", "upper", "gripper", axis=(0, 0, 1), at=(0.4, 0, 0)),
    ]
    path = write_urdf(folder, *joints, name=kind)
    text = path.read_text(encoding="utf-8")
    path.write_text(masses(text, upper=2, camera=1, adapter=3, tool=4, spindle=5, gripper=6))
    content = {
        "kind": "closed-chain",
        "model": path.name,
        "frame": frame,
        "gravity": [0.3, -2, -9.81],
        "springs": {name: {"stiffness": 1e4} for name in ("lift", "turn", "side")},
        "flexible": {"adapter": {"stiffness": K.tolist(), "offset": {"xyz": [0, 0, 0.05]}}},
    }
    if kind != "fixed":
        content["locked"] = {"bolts": 0}
    return load(write_file(folder, kind, **content))


@pytest.mark.parametrize("frame", FRAMES)
def test_soft_adapter_behind_a_fixed_joint(frame: str, tmp_path: Path) -> None:
    soft, other = (arm(tmp_path, kind, frame) for kind in ("fixed", "revolute"))
    assert sorted(soft.names) == sorted(other.names)
    rng = np.random.default_rng(3)
    values = {n: 0.1 * rng.standard_normal() for n in soft.names}
    at = [np.array([values[n] for n in m.names]) for m in (soft, other)]
    order = [other.names.index(n) for n in soft.names]
    a, b = (m.mechanism.at(q) for m, q in zip((soft, other), at, strict=True))
    assert np.abs(a.pose - b.pose).max() < ROUNDING
    assert np.abs(a.motion.jacobian - b.motion.jacobian[:, order]).max() < ROUNDING
    theirs = b.gravity(np.array(other.gravity))
    mine = a.gravity(np.array(soft.gravity))
    assert np.abs(mine.gradient - theirs.gradient[order]).max() < ROUNDING * 100
    assert np.abs(mine.hessian - theirs.hessian[np.ix_(order, order)]).max() < ROUNDING * 100


def test_links_before_the_adapter_do_not_feel_it(tmp_path: Path) -> None:
    for frame in ("camera", "adapter", "gripper"):
        soft = arm(tmp_path, "fixed", frame)
        J = soft.mechanism.at(soft.q).motion.jacobian
        virtual = [i for i, n in enumerate(soft.names) if n.startswith("adapter.")]
        assert not J[:, virtual].any()
    tool = arm(tmp_path, "fixed", "tool")
    result = analyse(tool)
    assert result.reduction.rank == 6
