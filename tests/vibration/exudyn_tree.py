"""Small vibrations of an MJCF tree by Exudyn: its masses, and differences of its forces.

The file is read here, body by body, and built as Exudyn's kinematic tree. A loop's point is held by
the two forces that its closure carries, each of constant direction on its own body.
"""

from xml.etree import ElementTree as ET

import numpy as np
import pytest

STEP = 1e-3
_WEIGHTS = {1: 4 / 5, 2: -1 / 5, 3: 4 / 105, 4: -1 / 280}


def _vector(text, default="0 0 0"):
    return np.array((text or default).split(), float)


def _onto(axis):
    """A rotation that takes z to an axis."""
    z = axis / np.linalg.norm(axis)
    x = np.cross([0.3, -0.8, 0.52], z)
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(z, x), z], axis=1)


class ExudynTree:
    """Hinges and slides of an MJCF with dead forces at its site `tip`."""

    def __init__(self, xml, dead):
        self.exu = pytest.importorskip("exudyn")
        self.items = pytest.importorskip("exudyn.itemInterface")
        root = ET.fromstring(xml)
        self.names = []
        self.at = {}
        self._links = {
            key: []
            for key in ("types", "parents", "turns", "offsets", "inertias", "centres", "masses")
        }
        self.k = []
        self.rest = []
        self.armature = []
        self._home = {}
        self._frames = {}
        self._bodies = []
        for body in root.find("worldbody").findall("body"):
            self._read(body, -1, np.eye(3))
        gravity = _vector(root.find("option").get("gravity"))
        self.ties = []
        for tie in root.iter("connect"):
            anchor = _vector(tie.get("anchor"))
            one, other = tie.get("body1"), tie.get("body2")
            T = np.linalg.inv(self._home[other]) @ self._home[one]
            ends = ((one, anchor), (other, T[:3, :3] @ anchor + T[:3, 3]))
            self.ties.append([(self.at[n][0], self._frames[n].T @ point) for n, point in ends])
        self._build(gravity, np.asarray(dead, float))

    def _read(self, body, parent, turned):
        """One joint a body; the link's frame has its z along the joint's axis."""
        link, (joint,) = len(self.names), body.findall("joint")
        name, pos = body.get("name"), _vector(body.get("pos"))
        R = _onto(_vector(joint.get("axis"), "0 0 1"))
        kinds = self.exu.JointType
        slides = joint.get("type") == "slide"
        inertial = body.find("inertial")
        rows = self._links
        rows["types"].append(kinds.PrismaticZ if slides else kinds.RevoluteZ)
        rows["parents"].append(parent)
        # From the parent link's frame to this one's.
        rows["turns"].append(turned.T @ R)
        rows["offsets"].append(turned.T @ pos)
        rows["inertias"].append(R.T @ np.diag(_vector(inertial.get("diaginertia"))) @ R)
        rows["centres"].append(R.T @ _vector(inertial.get("pos")))
        rows["masses"].append(float(inertial.get("mass")))
        self.names.append(joint.get("name"))
        self.k.append(float(joint.get("stiffness")))
        self.rest.append(float(joint.get("springref")))
        self.armature.append(float(joint.get("armature", "0")))
        self._frames[name] = R
        self.at[name] = link, np.zeros(3)
        # Where the body stands at zero, by its own axes.
        before = np.eye(4) if parent < 0 else self._home[self._bodies[parent]]
        T = before.copy()
        T[:3, 3] += before[:3, :3] @ pos
        self._home[name] = T
        self._bodies.append(name)
        for site in body.findall("site"):
            self.at[site.get("name")] = link, R.T @ _vector(site.get("pos"))
        for child in body.findall("body"):
            self._read(child, link, R)

    def _build(self, gravity, dead):
        exu, items, rows = self.exu, self.items, self._links
        n = len(self.names)
        self.container = exu.SystemContainer()
        self.system = self.container.AddSystem()
        node = self.system.AddNode(
            items.NodeGenericODE2(
                referenceCoordinates=[0.0] * n,
                initialCoordinates=[0.0] * n,
                initialCoordinates_t=[0.0] * n,
                numberOfODE2Coordinates=n,
            )
        )
        tree = self.system.AddObject(
            items.ObjectKinematicTree(
                nodeNumber=node,
                jointTypes=rows["types"],
                linkParents=rows["parents"],
                jointTransformations=exu.Matrix3DList(rows["turns"]),
                jointOffsets=exu.Vector3DList(rows["offsets"]),
                linkInertiasCOM=exu.Matrix3DList(rows["inertias"]),
                linkCOMs=exu.Vector3DList(rows["centres"]),
                linkMasses=rows["masses"],
                baseOffset=[0.0, 0.0, 0.0],
                gravity=list(gravity),
            )
        )

        def load(link, point, force):
            marker = self.system.AddMarker(
                items.MarkerKinematicTreeRigid(
                    objectNumber=tree, linkNumber=link, localPosition=list(point)
                )
            )
            return self.system.AddLoad(
                items.LoadForceVector(markerNumber=marker, loadVector=list(map(float, force)))
            )

        load(*self.at["tip"], dead)
        self.pulls = [[load(link, point, np.zeros(3)) for link, point in tie] for tie in self.ties]
        self.system.Assemble()
        self.settings = exu.SimulationSettings()
        self.settings.solution.file.write = False
        self.solver = exu.MainSolverStatic()
        self.solver.InitializeSolver(self.system, self.settings)

    def force(self, q):
        """Generalised forces of weights, loads and springs."""
        self.system.systemData.SetODE2Coordinates(list(q))
        self.system.systemData.SetODE2Coordinates_t([0.0] * len(q))
        self.solver.ComputeODE2RHS(self.system)
        pushed = np.array(self.solver.GetSystemResidual())[: len(q)]
        return pushed - np.array(self.k) * (q - np.array(self.rest))

    def _carry(self, multipliers):
        for (one, other), lam in zip(self.pulls, multipliers.reshape(-1, 3), strict=True):
            for load, sign in ((one, 1.0), (other, -1.0)):
                self.system.SetLoadParameter(load, "loadVector", list(sign * lam))

    def squares(self, q):
        """omega^2 about q, and what nothing balances there."""
        n, m = len(q), 3 * len(self.ties)
        self._carry(np.zeros(m))
        bare = self.force(q)
        C = np.empty((m, n))
        for row, e in zip(C, np.eye(m), strict=True):
            self._carry(e)
            row[:] = self.force(q) - bare
        lam = np.linalg.lstsq(C.T, -bare, rcond=1e-10)[0] if m else np.zeros(0)
        self._carry(lam)
        left = float(np.abs(self.force(q)).max())
        self.system.systemData.SetODE2Coordinates(list(q))
        self.solver.ComputeMassMatrix(self.system)
        M = np.array(self.solver.GetSystemMassMatrix())[:n, :n] + np.diag(self.armature)
        K = np.zeros((n, n))
        for i, e in enumerate(np.eye(n)):
            for count, weight in _WEIGHTS.items():
                h = count * STEP
                K[:, i] -= weight * (self.force(q + h * e) - self.force(q - h * e)) / STEP
        N = np.eye(n)
        if m:
            _, values, rows = np.linalg.svd(C)
            N = rows[int((values > 1e-9 * values[0]).sum()) :].T
        K, M = N.T @ K @ N, N.T @ M @ N
        found = np.linalg.eigvals(np.linalg.solve(M, 0.5 * (K + K.T)))
        return np.sort(found.real), left
