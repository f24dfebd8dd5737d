"""Which 6x6 do you mean? Spring elements of several programs, turned and loaded, beside cartstiff.

    python benchmarks/bushings.py

Between the room and a body stands a spring with the same six numbers in every program. The body is
held displaced and turned by 31 degrees; each program says with which wrench. Printed are its
moment, the principal rotational stiffnesses there (of K^B), how far the law is from having an
energy (the part of dW that no load explains, over the stiffness), and the work that a closed loop
takes in. A program that is not installed is left out. docs/howto/bushings.md explains the table.
"""

from __future__ import annotations

import ctypes
import importlib
import importlib.util
from collections.abc import Callable
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

import cartstiff
from cartstiff.extend import jacobian
from cartstiff.geometry import se3

Array = np.ndarray
#: Wrench (moment, force) that holds the body at a pose, in its own axes, about its own origin.
Law = Callable[[Array], Array]
Energy = Callable[[Array], float]

ROTATIONAL = np.array([40.0, 60.0, 90.0])  # N m/rad
TRANSLATIONAL = np.array([2e5, 3e5, 5e5])  # N/m
SAME = 60.0  # N m/rad, about every axis
POSE = se3.pose(Rotation.from_rotvec([0.3, -0.2, 0.4]).as_matrix(), np.array([2e-3, -1e-3, 3e-3]))
PACKAGES = ("mujoco", "drake", "exudyn", "openseespy")
#: Natural sizes of turns and displacements, for differences.
SCALE = np.array([1.0] * 3 + [0.01] * 3)


# -- energies that cartstiff is told -------------------------------------------------------------


def energy(turn: Callable[[Rotation], Array], rotational: Any = ROTATIONAL) -> Energy:
    """Half of k times the square of each coordinate: the place, and three that tell the turn."""

    def of_pose(T: Array) -> float:
        x = turn(Rotation.from_matrix(T[:3, :3]))
        return 0.5 * float(TRANSLATIONAL @ T[:3, 3] ** 2 + rotational @ x**2)

    return of_pose


def hinges(turn: Rotation) -> Array:
    """Angles of three hinges in a row, about x, y and z."""
    return turn.as_euler("XYZ")


def roll_pitch_yaw(turn: Rotation) -> Array:
    """Angles about the room's x, y, z in this order."""
    return turn.as_euler("xyz")


def rotation_vector(turn: Rotation) -> Array:
    """Axis times angle."""
    return turn.as_rotvec()


def screw(T: Array) -> float:
    """Half of the sum of k times the squares of the exponential coordinates of the whole motion."""
    return 0.5 * float(np.concatenate([ROTATIONAL, TRANSLATIONAL]) @ se3.log(T) ** 2)


def derived(of_pose: Energy) -> tuple[Array, Array]:
    """Wrench and K^A of an energy at `POSE`, by cartstiff."""
    _, W, K = cartstiff.PoseFunction(energy=of_pose, length=SCALE[3]).on_pose(POSE)
    return W, K - 0.5 * se3.bracket_form(W)


# -- programs ------------------------------------------------------------------------------------


def mujoco(ball: bool) -> Law:
    """Three slides, then three hinges, or one ball joint with its single stiffness."""
    mj = importlib.import_module("mujoco")
    axes = ("1 0 0", "0 1 0", "0 0 1")
    row = '<joint type="{}" axis="{}" stiffness="{}"/>'
    joints = [row.format("slide", a, k) for a, k in zip(axes, TRANSLATIONAL, strict=True)]
    if ball:
        joints.append(f'<joint type="ball" stiffness="{SAME}"/>')
    else:
        joints += [row.format("hinge", a, k) for a, k in zip(axes, ROTATIONAL, strict=True)]
    model = mj.MjModel.from_xml_string(
        '<mujoco><option gravity="0 0 0"/><compiler angle="radian"/><worldbody><body>'
        + "".join(joints)
        + '<inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/></body></worldbody></mujoco>'
    )
    data = mj.MjData(model)

    def law(T: Array) -> Array:
        turn = Rotation.from_matrix(T[:3, :3])
        x, y, z, w = turn.as_quat()
        data.qpos[:3], data.qpos[3:] = T[:3, 3], [w, x, y, z] if ball else hinges(turn)
        mj.mj_forward(model, data)
        # Forces in the joints are J^T times what acts on the body.
        J = np.zeros((6, model.nv))
        mj.mj_jacBody(model, data, J[3:], J[:3], 1)
        wrench = -np.linalg.solve(J.T, data.qfrc_passive)
        return np.concatenate([T[:3, :3].T @ wrench[:3], T[:3, :3].T @ wrench[3:]])

    return law


def drake() -> Law:
    """``LinearBushingRollPitchYaw``."""
    plants = importlib.import_module("pydrake.multibody.plant")
    tree = importlib.import_module("pydrake.multibody.tree")
    maths = importlib.import_module("pydrake.math")
    plant = plants.MultibodyPlant(0.0)
    inertia = tree.SpatialInertia(1.0, np.zeros(3), tree.UnitInertia(1, 1, 1))
    body = plant.AddRigidBody("body", inertia)
    none = np.zeros(3)
    plant.AddForceElement(
        tree.LinearBushingRollPitchYaw(
            plant.world_frame(), body.body_frame(), ROTATIONAL, none, TRANSLATIONAL, none
        )
    )
    plant.mutable_gravity_field().set_gravity_vector(none)
    plant.Finalize()
    context = plant.CreateDefaultContext()
    forces = tree.MultibodyForces(plant)

    def law(T: Array) -> Array:
        at = maths.RigidTransform(maths.RotationMatrix(T[:3, :3]), T[:3, 3])
        plant.SetFreeBodyPose(context, body, at)
        plant.CalcForceElementsContribution(context, forces)
        held = plant.CalcInverseDynamics(context, np.zeros(6), forces)
        return np.concatenate([T[:3, :3].T @ held[:3], T[:3, :3].T @ held[3:]])

    return law


def exudyn(intrinsic: bool = False) -> Law:
    """``ObjectConnectorRigidBodySpringDamper``."""
    exu = importlib.import_module("exudyn")
    items = importlib.import_module("exudyn.itemInterface")
    system = exu.SystemContainer().AddSystem()
    node = system.AddNode(items.NodeRigidBodyRxyz(referenceCoordinates=[0.0] * 6))
    body = system.AddObject(
        items.ObjectRigidBody(mass=1.0, inertia=[1.0, 1.0, 1.0, 0.0, 0.0, 0.0], nodeNumber=node)
    )
    ground = system.AddObject(items.ObjectGround())
    ends = [system.AddMarker(items.MarkerBodyRigid(bodyNumber=b)) for b in (ground, body)]
    system.AddObject(
        items.RigidBodySpringDamper(
            markerNumbers=ends,
            stiffness=np.diag(np.concatenate([TRANSLATIONAL, ROTATIONAL])),
            useIntrinsicFormulation=intrinsic,
        )
    )
    system.Assemble()
    settings = exu.SimulationSettings()
    settings.solution.file.write = False
    settings.staticSolver.verboseMode = 0
    solver = exu.MainSolverStatic()
    solver.InitializeSolver(system, settings)

    def law(T: Array) -> Array:
        angles = hinges(Rotation.from_matrix(T[:3, :3]))
        system.systemData.SetODE2Coordinates([*T[:3, 3], *angles])
        solver.ComputeODE2RHS(system)
        force = -np.array(solver.GetSystemResidual())
        # Columns: what each angle's rate makes of the body's angular velocity, in its own axes.
        y, z = (
            Rotation.from_euler(a, t).as_matrix() for a, t in zip("yz", angles[1:], strict=True)
        )
        rates = np.column_stack([(y @ z).T[:, 0], z.T[:, 1], [0.0, 0.0, 1.0]])
        return np.concatenate([np.linalg.solve(rates.T, force[3:]), T[:3, :3].T @ force[:3]])

    return law


def opensees() -> Law:
    """``zeroLength``; its node's three rotations are read as axis times angle."""
    # Libraries that the Linux wheel brings and does not find by itself, in order of their needs.
    wheel = importlib.util.find_spec("openseespylinux")
    if wheel is not None and wheel.origin is not None:
        for name in ("quadmath.so.0", "gfortran.so.4", "gomp.so.1", "blas.so.3", "lapack.so.3"):
            library = Path(wheel.origin).parent / "lib" / f"lib{name}"
            if library.exists():
                ctypes.CDLL(str(library), mode=ctypes.RTLD_GLOBAL)
    ops = importlib.import_module("openseespy.opensees")
    k = np.concatenate([TRANSLATIONAL, ROTATIONAL])
    ops.wipe()
    ops.model("basic", "-ndm", 3, "-ndf", 6)
    ops.node(1, 0.0, 0.0, 0.0)
    ops.node(2, 0.0, 0.0, 0.0)
    ops.fix(1, *[1] * 6)
    for i, stiffness in enumerate(k, start=1):
        ops.uniaxialMaterial("Elastic", i, float(stiffness))
    ops.element("zeroLength", 1, 1, 2, "-mat", *range(1, 7), "-dir", *range(1, 7))
    ops.timeSeries("Linear", 1)
    ops.pattern("Plain", 1, 1)
    moved = np.concatenate([POSE[:3, 3], rotation_vector(Rotation.from_matrix(POSE[:3, :3]))])
    ops.load(2, *map(float, k * moved))
    ops.system("FullGeneral")
    ops.constraints("Transformation")
    ops.numberer("Plain")
    ops.test("NormDispIncr", 1e-12, 20, 0)
    ops.algorithm("Newton")
    ops.integrator("LoadControl", 0.1)
    ops.analysis("Static")
    if ops.analyze(10) != 0 or not np.allclose(ops.nodeDisp(2), moved, rtol=1e-9):
        raise RuntimeError("OpenSees' element is no longer linear in its node's displacements")
    stiffness = np.reshape(ops.printA("-ret"), (6, 6))  # its tangent there
    ops.wipe()

    def law(T: Array) -> Array:
        turn = rotation_vector(Rotation.from_matrix(T[:3, :3]))
        force = stiffness @ np.concatenate([T[:3, 3], turn])
        return np.concatenate([T[:3, :3].T @ force[3:], T[:3, :3].T @ force[:3]])

    return law


# -- what is asked of a law ----------------------------------------------------------------------


@dataclass(frozen=True)
class Element:
    """A spring element: the program's law, and the energy that it should have, if it has one."""

    name: str
    law: Callable[[], Law] | None
    energy: Energy | None


ELEMENTS = (
    Element("MuJoCo, three slides and three hinges", lambda: mujoco(False), energy(hinges)),
    Element("Drake, LinearBushingRollPitchYaw", drake, None),
    Element("cartstiff, energy of the screw", None, screw),
    Element("cartstiff, energy of the rotation vector", None, energy(rotation_vector)),
    Element("Exudyn, RigidBodySpringDamper", exudyn, None),
    Element("Exudyn, useIntrinsicFormulation", lambda: exudyn(True), None),
    Element("OpenSees, zeroLength", opensees, None),
    Element(
        "MuJoCo, three slides and a ball (60, 60, 60)",
        lambda: mujoco(True),
        energy(rotation_vector, np.full(3, SAME)),
    ),
)


def tangent(law: Law, T: Array = POSE) -> tuple[Array, Array]:
    """Wrench and K^A: how the wrench's components change in the body's axes, by differences."""
    return law(T), jacobian(lambda x: law(T @ se3.exp(x)), SCALE)


def without_energy(W: Array, K: Array) -> float:
    """Part of dW that the load does not explain, over the stiffness; 0 if there is an energy."""
    size = np.sqrt(np.concatenate([ROTATIONAL, TRANSLATIONAL]))
    return float(np.abs((K - K.T + se3.bracket_form(W)) / np.outer(size, size)).max())


def principal(K: Array) -> Array:
    """Principal rotational stiffnesses of K^B, ascending."""
    return np.linalg.eigvalsh(0.5 * (K + K.T)[:3, :3])


def work_of_a_loop(law: Law, points: int = 24) -> float:
    """Work, in joule, for two motions, one after the other, and both undone in the same order."""
    nodes, weights = np.polynomial.legendre.leggauss(points)
    first = np.array([0.4, 0, 0, 0, 4e-3, 0])  # rotation vector and place
    second = np.array([0, 0.4, 0, 4e-3, 0, 0])
    corners = np.stack([0 * first, first, first + second, second, 0 * first])
    step, total = 1e-4, 0.0

    def at(x: Array) -> Array:
        return se3.pose(Rotation.from_rotvec(x[:3]).as_matrix(), x[3:])

    for a, b in pairwise(corners):
        for s, weight in zip(0.5 + 0.5 * nodes, 0.5 * weights, strict=True):
            here = a + s * (b - a)
            ends = [at(here + sign * step * (b - a)) for sign in (-1, 1)]
            twist = se3.log(np.linalg.inv(ends[0]) @ ends[1]) / (2 * step)
            total += weight * float(law(at(here)) @ twist)
    return total


def _version(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return "not installed"


def main() -> dict[str, tuple[Array, Array, float | None]]:
    """Print the table; wrench, K^A and work of the loop by element."""
    found: dict[str, tuple[Array, Array, float | None]] = {}
    laws = []
    print(", ".join(f"{name} {_version(name)}" for name in PACKAGES))
    print(
        f"{'element':<46} {'moment, N m':>22} {'K^B, N m/rad':>20} {'no energy':>9} {'loop, J':>8}"
    )
    for element in ELEMENTS:
        work = None
        if element.law is None:
            W, K = derived(element.energy)
        else:
            try:
                law = element.law()
            except ImportError:
                print(f"{element.name:<46} not installed")
                continue
            (W, K), work = tangent(law), work_of_a_loop(law)
            if "ball" not in element.name:
                laws.append(law)
        found[element.name] = W, K, work
        numbers = " ".join(f"{x:7.3f}" for x in W[:3]), " ".join(f"{x:6.2f}" for x in principal(K))
        defect = without_energy(W, K)
        print(
            f"{element.name:<46} {numbers[0]:>23} {numbers[1]:>20} "
            f"{defect if defect > 1e-7 else 0:9.4f} "
            f"{'' if work is None else f'{work:8.4f}'}".rstrip()
        )
    for degrees in (1, 3, 10, 30):
        turn = Rotation.from_matrix(POSE[:3, :3]).as_rotvec()
        turn *= np.radians(degrees) / np.linalg.norm(turn)
        T = se3.pose(Rotation.from_rotvec(turn).as_matrix())
        moments = [law(T)[:3] for law in laws]
        apart = max((np.linalg.norm(a - b) for a in moments for b in moments), default=np.nan)
        share = 100 * apart / np.linalg.norm(np.mean(moments, axis=0))
        print(f"turned by {degrees:2d} degrees: moments differ by up to {share:4.1f} %")
    return found


if __name__ == "__main__":
    main()
