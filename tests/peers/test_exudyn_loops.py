"""Forces in the joints of two planar loops against Exudyn's multipliers: four bars, and five."""

from __future__ import annotations

import numpy as np
import pytest
import yaml
from tests.laws.test_balance_of_bodies import joint, link

import cartstiff as cs

GRAVITY = np.array([1.5, -9.81, 0.0])
STIFFNESS = 2e4
# Lengths of the links on both feet, the second foot, and the joints that drive.
LOOPS = {
    "four bars": {"left": (0.3, 0.5), "right": (0.35,), "foot": (0.5, 0.0), "drives": "l0"},
    "five bars": {"left": (0.3, 0.4), "right": (0.3, 0.4), "foot": (0.4, 0.1), "drives": "l0 r0"},
}


def loop(folder, kind: str):
    """Two branches in the x-y plane whose last links meet in a hinge."""
    own, rng = LOOPS[kind], np.random.default_rng(len(kind))
    parts, names = [link("ground", rng)], []
    for side, start in (("left", (0.0, 0.0)), ("right", own["foot"])):
        before, x, y = "ground", *start
        for i, length in enumerate(own[side]):
            name = f"{side[0]}{i}"
            parts += [link(f"{name}_link", rng)]
            ends = before, f"{name}_link"
            parts += [joint(name, ends, [x, y, 0, 0, 0, 0], [0, 0, 1])]
            before, x, y = f"{name}_link", length, 0.0
            names.append(name)
    (folder / "loop.urdf").write_text(f"<robot name='loop'>{''.join(parts)}</robot>")
    drives = own["drives"].split()
    last = [f"{side[0]}{len(own[side]) - 1}_link" for side in ("left", "right")]
    points = [[own[side][-1], 0, 0] for side in ("left", "right")]
    file = {
        "kind": "closed-chain", "model": "loop.urdf", "frame": last[0], "actuated": drives,
        "springs": {name: {"stiffness": STIFFNESS} for name in drives},
        "passive": [name for name in names if name not in drives],
        "q": dict(zip(names, [1.4, -1.2, 1.2, 1.0], strict=False)),
        "closures": [{"frames": last, "type": "hinge", "points": points}],
    }  # fmt: skip
    (folder / "loop.yaml").write_text(yaml.safe_dump(file))
    return cs.load(str(folder / "loop.yaml")).with_gravity(GRAVITY), own


class Peer:
    """The same links in Exudyn, held by springs that exert given torques at the posture."""

    def __init__(self) -> None:
        self.exu = pytest.importorskip("exudyn")
        self.items = pytest.importorskip("exudyn.itemInterface")
        self.system = self.exu.SystemContainer().AddSystem()
        self.ground = self.system.AddObject(self.items.ObjectGround())

    def link(self, pose, mass: float, centre) -> tuple[int, int]:
        """A body at a pose, with its weight; its node and its object."""
        items, system = self.items, self.system
        angle = float(np.arctan2(pose[1, 0], pose[0, 0]))
        place = [*pose[:2, 3].tolist(), angle]
        node = system.AddNode(items.NodeRigidBody2D(referenceCoordinates=place))
        body = system.AddObject(items.ObjectRigidBody2D(mass=1.0, inertia=1.0, nodeNumber=node))
        self.push(body, centre, mass * GRAVITY)
        return node, body

    def marker(self, body: int, point) -> int:
        at = [*map(float, point[:2]), 0.0]
        return int(
            self.system.AddMarker(self.items.MarkerBodyRigid(bodyNumber=body, localPosition=at))
        )

    def push(self, body: int, point, force) -> None:
        own = [*map(float, force[:2]), 0.0]
        at = self.marker(body, point)
        self.system.AddLoad(self.items.LoadForceVector(markerNumber=at, loadVector=own))

    def hinge(self, a: int, b: int) -> None:
        self.system.AddObject(self.items.ObjectJointRevolute2D(markerNumbers=[a, b]))

    def torque(self, node: int, before: int | None, size: float) -> None:
        """A spring between the angles of two links, or a link and the ground."""
        items, system = self.items, self.system
        first = system.AddNode(items.NodePointGround()) if before is None else before
        place = 0 if before is None else 2
        ends = [
            system.AddMarker(items.MarkerNodeCoordinate(nodeNumber=n, coordinate=c))
            for n, c in ((first, place), (node, 2))
        ]
        system.AddObject(
            items.CoordinateSpringDamper(
                markerNumbers=ends, stiffness=STIFFNESS, offset=size / STIFFNESS
            )
        )

    def solved(self) -> tuple[np.ndarray, np.ndarray]:
        """Motions of the links, and forces (k, 2) of the hinges on their second marker."""
        self.system.Assemble()
        settings = self.exu.SimulationSettings()
        settings.solution.file.write = False
        settings.staticSolver.verboseMode = 0
        settings.staticSolver.newton.relativeTolerance = 1e-12
        settings.staticSolver.newton.absoluteTolerance = 1e-10
        self.system.SolveStatic(settings)
        data = self.system.systemData
        multipliers = np.array(data.GetAECoordinates()).reshape(-1, 2)
        return np.array(data.GetODE2Coordinates()), multipliers


@pytest.mark.parametrize("kind", LOOPS)
def test_hinges_carry_the_same(tmp_path, kind):
    peer = Peer()
    elastic, own = loop(tmp_path, kind)
    push = np.array([70.0, -40.0, 0.0])
    result = cs.analyse(elastic, wrench=[0, 0, 0, *push], load_axes="world")
    model, posture = elastic.mechanism.tree.model, result.posture
    names = list(model.names)[1:]
    torques = {one.name: one.force for one in result.forces}
    said, last = [], {}
    for side, start in (("left", (0.0, 0.0)), ("right", own["foot"])):
        before, at = (None, peer.ground), start
        for i, length in enumerate(own[side]):
            k = names.index(f"{side[0]}{i}") + 1
            pose = posture.joint_poses([k])[0]
            inertia = model.inertias[k]
            node, body = peer.link(pose, inertia.mass, inertia.lever)
            peer.hinge(peer.marker(before[1], at), peer.marker(body, (0.0, 0.0)))
            if names[k - 1] in torques:
                peer.torque(node, before[0], torques[names[k - 1]])
            said += [one for one in result.wrenches if one.name == names[k - 1]]
            before, at = (node, body), (length, 0.0)
        last[side] = before[1], at
    peer.push(last["left"][0], (0.0, 0.0), push)
    peer.hinge(*(peer.marker(*last[side]) for side in ("left", "right")))
    said += [one for one in result.wrenches if one.kind == "closure"]
    moved, forces = peer.solved()
    found = np.array([one.in_room[3:5] for one in said])
    assert np.abs(moved).max() <= 1e-9
    # Both feet carry weight and push: forces are those on the second marker.
    weight = sum(model.inertias[k].mass for k in range(1, len(names) + 1)) * GRAVITY
    assert forces[0] + forces[len(own["left"])] == pytest.approx(-(weight + push)[:2], rel=1e-9)
    assert found == pytest.approx(forces, rel=1e-8, abs=1e-8 * np.abs(forces).max())
