"""Soft links behind fixed joints: what they are fixed to does not move with them.

The same arm with locked joints in place of the fixed ones takes another way through the library:
there each soft link is the only one on its joint.
"""

import numpy as np
import pytest
from tests.mechanisms.machines import joint, masses, write_file, write_urdf
from tests.support import absolute_error

from cartstiff import DeadForce, analyse, equilibrium, load

# Two ways through the same few rotations.
ROUNDING = 1e-12
K = np.diag([3e3, 4e3, 5e3, 2e5, 3e5, 4e5]) + 100.0
FRAMES = ("upper", "camera", "adapter", "tool", "spindle", "gripper")


def arm(folder, kind, frame, soft=("adapter",)):
    """Upper arm with a camera, an adapter, on that a tool and a spindle, and a gripper.

    The gripper's joint comes before those beyond the adapter: the tree is not in one piece.
    """
    joints = [
        joint("lift", "base", "upper", axis=(0, 1, 0), at=(0, 0, 0.3)),
        joint("mount", "upper", "camera", kind=kind, at=(0.2, 0.1, 0)),
        joint("bolts", "upper", "adapter", kind=kind, at=(0.5, 0, 0.1), rpy=(0.2, 0.1, 0.4)),
        joint("flange", "adapter", "tool", kind=kind, at=(0, 0, 0.2)),
        joint("turn", "tool", "spindle", axis=(1, 0, 0), at=(0, 0.1, 0)),
        joint("aside", "upper", "gripper", axis=(0, 0, 1), at=(0.4, 0, 0)),
    ]
    path = write_urdf(folder, *joints, name=kind)
    text = path.read_text(encoding="utf-8")
    path.write_text(masses(text, upper=2, camera=1, adapter=3, tool=4, spindle=5, gripper=6))
    content = {
        "kind": "closed-chain",
        "model": path.name,
        "frame": frame,
        "gravity": [0.3, -2, -9.81],
        "springs": {name: {"stiffness": 1e4} for name in ("lift", "turn", "aside")},
        "flexible": {
            name: {"stiffness": (i * K).tolist(), "offset": {"xyz": [0.01 * i, 0, 0.05]}}
            for i, name in enumerate(soft, start=1)
        },
    }
    if kind != "fixed":
        content["locked"] = {"mount": 0, "bolts": 0, "flange": 0}
    return load(write_file(folder, kind, **content))


# In a row, beside each other, and named from the tip to the base.
SOFT = (("adapter",), ("tool", "adapter", "upper"), ("adapter", "camera"))


@pytest.mark.parametrize("links", SOFT, ids="-".join)
@pytest.mark.parametrize("frame", FRAMES)
def test_soft_links_behind_fixed_joints(frame, links, tmp_path):
    soft, other = (arm(tmp_path, kind, frame, links) for kind in ("fixed", "revolute"))
    assert sorted(soft.names) == sorted(other.names)
    rng = np.random.default_rng(3)
    values = {n: 0.1 * rng.standard_normal() for n in soft.names}
    at = [np.array([values[n] for n in m.names]) for m in (soft, other)]
    order = [other.names.index(n) for n in soft.names]
    a, b = (m.mechanism.at(q) for m, q in zip((soft, other), at, strict=True))
    assert absolute_error(a.pose, b.pose) < ROUNDING
    assert absolute_error(a.motion.jacobian, b.motion.jacobian[:, order]) < ROUNDING
    theirs = b.gravity(np.array(other.gravity))
    mine = a.gravity(np.array(soft.gravity))
    assert absolute_error(mine.gradient, theirs.gradient[order]) < ROUNDING * 100
    assert absolute_error(mine.hessian, theirs.hessian[np.ix_(order, order)]) < ROUNDING * 100
    assert absolute_error(a.mass_matrix(), b.mass_matrix()[np.ix_(order, order)]) < ROUNDING
    assert absolute_error(a.momentum()[0], b.momentum()[0][:, order]) < ROUNDING


def test_links_before_the_adapter_do_not_feel_it(tmp_path):
    for frame in ("camera", "adapter", "gripper"):
        soft = arm(tmp_path, "fixed", frame)
        J = soft.mechanism.at(soft.q).motion.jacobian
        virtual = [i for i, n in enumerate(soft.names) if n.startswith("adapter.")]
        assert not J[:, virtual].any()
    tool = arm(tmp_path, "fixed", "tool")
    result = analyse(tool)
    assert result.reduction.rank == 6


@pytest.mark.parametrize("mass", [0.0, 7800.0])
def test_two_beams_in_a_row_are_one_of_two_segments(mass, tmp_path):
    """Stiffness and weight of a cantilever, in one link and in two that are fixed together."""
    section = {
        "E": 2e11,
        "G": 8e10,
        "area": 1e-4,
        "Iy": 1e-9,
        "Iz": 2e-9,
        "J": 2e-9,
        "density": mass,
    }
    whole = [
        joint("wall", "base", "bar", kind="fixed"),
        joint("end", "bar", "tip", kind="fixed", at=(1, 0, 0)),
    ]
    halves = [
        joint("wall", "base", "near", kind="fixed"),
        joint("weld", "near", "far", kind="fixed", at=(0.5, 0, 0)),
        joint("end", "far", "tip", kind="fixed", at=(0.5, 0, 0)),
    ]
    give = {"bar": {"beam": {**section, "length": 1.0, "segments": 2}}}
    both = {name: {"beam": {**section, "length": 0.5}} for name in ("far", "near")}
    found = []
    for name, joints, flexible in (("one", whole, give), ("two", halves, both)):
        write_urdf(tmp_path, *joints, name=name)
        path = write_file(
            tmp_path,
            name,
            kind="serial",
            model=f"{name}.urdf",
            frame="tip",
            gravity=[0, -3, -9.81],
            flexible=flexible,
        )
        rest = equilibrium(load(path), DeadForce([-200.0, 30.0, 50.0]))
        found.append((rest.pose, rest.stiffness.matrices["B"]))
    assert absolute_error(found[0][0], found[1][0]) <= 1e-10
    assert absolute_error(found[0][1] / found[1][1], 1) <= 1e-6
