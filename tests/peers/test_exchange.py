"""Stiffnesses written for other programs are read back, by those programs' readers if they can."""

from __future__ import annotations

import csv
import re
from dataclasses import replace

import numpy as np
import pytest
from tests.support import relative_error

import cartstiff
from cartstiff.cli.main import main
from cartstiff.errors import InputError, UndefinedError
from cartstiff.mechanisms.contract import SI, convert_length
from cartstiff.potentials.springs import PolynomialLaw
from cartstiff.report.output import write_result

ORDER = [3, 4, 5, 0, 1, 2]


def _of_the_node(result, K):
    turned = np.kron(np.eye(2), result.pose[:3, :3])
    return turned @ K[np.ix_(ORDER, ORDER)] @ turned.T


LOAD = [5.0, -3.0, 2.0, 100.0, -50.0, -300.0]


@pytest.fixture(scope="module")
def result():
    platform = cartstiff.load("stewart-simscape")
    return cartstiff.analyse(platform, platform.q + [0, 0, 0, 0.1, -0.2, 0.3], wrench=LOAD)  # noqa: RUF005


def _dmig(text, name):
    """A small reader of large fields, by the columns that the program reads."""
    K, column = np.zeros((6, 6)), 0
    for line in text.splitlines():
        if line.startswith("DMIG*") and line[8:24].strip() == name:
            column = int(line[40:56])
        elif line.startswith("DMIG"):
            column = 0
        elif line.startswith("*") and column:
            value = re.sub(r"(?<=\d)([+-]\d+)$", r"E\1", line[40:56].strip())
            row = int(line[24:40])
            K[row - 1, column - 1] = K[column - 1, row - 1] = float(value)
    return K


def test_nastran_reads_the_symmetric_part(result, tmp_path):
    write_result(result, tmp_path / "K.nas")
    text = (tmp_path / "K.nas").read_text()
    K = _of_the_node(result, result.B.matrix)
    assert relative_error(_dmig(text, "KBODY"), K) <= 1e-9
    M = _of_the_node(result, result.posture.mass_matrix())
    assert relative_error(_dmig(text, "MBODY"), M) <= 1e-9
    assert "under the wrench" in text
    assert max(map(len, text.splitlines())) <= 100
    plain = cartstiff.analyse(cartstiff.load("stewart-simscape"))
    write_result(plain, tmp_path / "free.bdf")
    text = (tmp_path / "free.bdf").read_text()
    squares = np.linalg.eigvals(np.linalg.solve(_dmig(text, "MBODY"), _dmig(text, "KBODY")))
    hertz = np.sort(np.sqrt(squares.real)) / (2 * np.pi)
    assert hertz == pytest.approx([780.6, 780.6, 903.9, 1061.4, 1061.4, 1269.66], abs=0.05)


def test_mujoco_has_the_stiffness(tmp_path):
    """Forces of its tendons at small motions, in millimetres and under a load."""
    mujoco = pytest.importorskip("mujoco")
    body = {"mass": 3.0, "com": [1.0, 2.0, -3.0], "inertia": np.diag([2e4, 3e4, 4e4]).tolist()}
    ring = {"radius": 200.0, "half_angle": 0.2}
    platform = cartstiff.hexapod(
        base=ring,
        platform={**ring, "radius": 120.0},
        height=250.0,
        body=body,
        turn=0.8,
        legs={"stiffness": 2e3, "preload": [100.0, -50.0, 30.0, 20.0, 10.0, -70.0]},
        units={"length": "mm", "force": "N"},
        frame={"xyz": [3.0, -2.0, 10.0]},
    )
    q = platform.q + np.array([5.0, -3.0, 4.0, 0.1, 0.05, -0.2])
    result = cartstiff.analyse(platform, q)
    write_result(result, tmp_path / "machine.xml")
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "machine.xml"))
    data = mujoco.MjData(model)

    def wrench(x):
        """Of the springs on the body's coordinates: force in the room, moment in the body."""
        data.qpos[:] = model.qpos0
        mujoco.mj_integratePos(model, data.qpos, np.concatenate([x[3:], x[:3]]), 1.0)
        mujoco.mj_forward(model, data)
        R = np.zeros(9)
        mujoco.mju_quat2Mat(R, data.qpos[3:])
        force = R.reshape(3, 3).T @ data.qfrc_spring[:3]
        return -np.concatenate([data.qfrc_spring[3:], force])

    h = 1e-5
    R = result.pose[:3, :3]
    rates = []
    for i in range(6):
        x = np.zeros(6)
        x[i] = h
        x[3:] = R @ x[3:]  # its translations are along the room's axes
        rates.append((wrench(x) - wrench(-x)) / (2 * h))
    sizes = np.repeat([1e-3, 1.0], 3)
    W = result.wrench * sizes
    assert relative_error(wrench(np.zeros(6)), W) <= 1e-9
    K = result.A.matrix * np.outer(sizes, np.repeat([1.0, 1e3], 3))
    assert np.abs(np.array(rates).T - K).max() <= 1e-8 * np.abs(K).max()
    assert model.body("platform").mass[0] == 3.0


@pytest.mark.parametrize("name", ["6-pus", "3-rps", "tricept", "five-bar", "ur5"])
def test_mujoco_moves_a_chain_as_we_do(tmp_path, name):
    """Its poses, and the compliance by its own Jacobians: springs under its closures.

    The posture is a little off the file's.
    """
    mujoco = pytest.importorskip("mujoco")
    elastic = cartstiff.load(name)
    if elastic.mechanism.kind != "serial":
        drives = [elastic.names.index(n) for n in elastic.spring_names if n in elastic.names]
        q = elastic.q.copy()
        q[drives] += 0.02 * np.arange(len(drives)) / len(drives)
        result = cartstiff.analyse(elastic, elastic.mechanism.closed(q).q)
    else:
        result = cartstiff.analyse(elastic, elastic.q + 0.1)
    write_result(result, tmp_path / "machine.xml")
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "machine.xml"))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    assert np.allclose(data.qpos, result.q, atol=1e-12)
    site = data.site("M")
    assert np.allclose(site.xpos, result.pose[:3, 3], atol=1e-9)
    R = site.xmat.reshape(3, 3)
    assert np.allclose(R, result.pose[:3, :3], atol=1e-9)
    linear, angular = np.zeros((3, model.nv)), np.zeros((3, model.nv))
    mujoco.mj_jacSite(model, data, linear, angular, model.site("M").id)
    J = np.vstack([R.T @ angular, R.T @ linear])
    ties = data.efc_J.reshape(-1, model.nv)[data.efc_type == mujoco.mjtConstraint.mjCNSTR_EQUALITY]
    free = np.eye(model.nv)
    if len(ties):
        _, s, V = np.linalg.svd(ties)
        free = V[np.sum(s > 1e-9 * s[0]) :].T
    k = free.T @ np.diag(model.jnt_stiffness) @ free
    C = J @ free @ np.linalg.solve(k, (J @ free).T)
    assert relative_error(C, result.compliances["B"]) <= 1e-7
    assert np.abs(data.qfrc_spring).max() <= 1e-9 * model.jnt_stiffness.max()
    again = cartstiff.analyse(cartstiff.load(tmp_path / "machine.xml", frame="M"))
    assert np.allclose(again.pose, result.pose, atol=1e-9)
    assert relative_error(again.compliances["B"], result.compliances["B"]) <= 1e-7


def test_springs_in_mujoco_carry_the_load(tmp_path):
    mujoco = pytest.importorskip("mujoco")
    elastic = cartstiff.load("ur5")
    result = cartstiff.analyse(elastic, elastic.q + 0.1, wrench=LOAD)
    write_result(result, tmp_path / "machine.xml")
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "machine.xml"))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    assert np.allclose(-data.qfrc_spring, result.jacobian.T @ result.wrench, rtol=1e-9)


def test_what_a_program_cannot_have_is_refused(tmp_path):
    with pytest.raises(InputError, match=r"springs in joints alone.*got Beam"):
        write_result(cartstiff.analyse(cartstiff.load("delta")), tmp_path / "a.xml")
    with pytest.raises(InputError, match="straight legs, got legs that bend"):
        write_result(cartstiff.analyse(cartstiff.load("flexure-hexapod")), tmp_path / "a.xml")
    with pytest.raises(InputError, match="tendons have no mass"):
        write_result(cartstiff.analyse(cartstiff.load("stewart-simscape")), tmp_path / "a.xml")
    with pytest.raises(UndefinedError, match="needs a mass"):
        write_result(cartstiff.analyse(cartstiff.load("hexapod")), tmp_path / "a.xml")
    flat = cartstiff.load("five-bar")
    with pytest.raises(UndefinedError):
        write_result(cartstiff.analyse(flat), tmp_path / "K.nas")
    assert not list(tmp_path.iterdir())


def test_the_command_writes_it(tmp_path, capfd):
    with pytest.raises(SystemExit) as left:
        main(["analyse", "cubic", "--analysis", "none", "-o", str(tmp_path / "K.nas")])
    assert left.value.code in (0, None)
    assert "DMIG" in (tmp_path / "K.nas").read_text()
    capfd.readouterr()


@pytest.mark.parametrize(
    "name", ["stewart-gough", "stewart-simscape", "6-pus", "tricept", "five-bar", "hexaglide"]
)
def test_a_tree_with_closures_is_the_same_machine(tmp_path, name):
    """Pinocchio reads the tree, the closures stand beside it; also from centimetres."""
    elastic = cartstiff.load(name)
    found = cartstiff.analyse(elastic)
    write_result(found, tmp_path / "machine.urdf")
    other = cartstiff.load(tmp_path / "machine.yaml")
    again = cartstiff.analyse(other)
    metres, newtons = convert_length(elastic.units, SI)
    sizes = np.repeat([metres, 1.0], 3)
    which = "matrices" if found.matrices["B"] is not None else "compliances"
    K, K_again = getattr(found, which)["B"], getattr(again, which)["B"]
    scale = newtons / metres if which == "matrices" else metres / newtons
    K = K * scale * (np.outer(sizes, sizes) if which == "matrices" else 1 / np.outer(sizes, sizes))
    assert relative_error(K_again, K) <= 1e-12
    assert np.allclose(again.pose[:3, 3], metres * found.pose[:3, 3], atol=1e-14)
    if name == "stewart-simscape":  # with the masses of its legs, and a preload
        one, two = cartstiff.modes(elastic), cartstiff.modes(other)
        assert np.allclose(one.frequencies, two.frequencies, rtol=1e-9)
    if elastic.mechanism.kind == "stewart-gough":
        given = elastic.with_springs(rest=0.99 * elastic.mechanism.leg_lengths(elastic.q))
        write_result(cartstiff.analyse(given), tmp_path / "machine.urdf")
        W = cartstiff.analyse(cartstiff.load(tmp_path / "machine.yaml")).wrench
        sizes = np.repeat([metres, 1.0], 3) * newtons
        assert relative_error(W, cartstiff.analyse(given).wrench * sizes) <= 1e-10


def test_a_tree_holds_no_beams_and_no_cables(tmp_path):
    for name, words in (
        ("delta", "Beam"),
        ("cable-robot", "LineSprings"),
        ("flexure-hexapod", "Flex"),
    ):
        with pytest.raises(InputError, match=f"got {words}"):
            write_result(cartstiff.analyse(cartstiff.load(name)), tmp_path / "machine.urdf")
        assert not list(tmp_path.iterdir())


def test_springs_of_nastran_add_up_to_the_stiffness(tmp_path):
    """The cards are read by their columns and assembled with the rigid element's motions."""
    elastic = cartstiff.load("hexapod")
    result = cartstiff.analyse(elastic, elastic.q + np.array([0.01, 0, 0.02, 0.1, -0.2, 0.1]))
    write_result(result, tmp_path / "legs.dat")
    cards = (tmp_path / "legs.dat").read_text().splitlines()

    def number(text):
        return float(re.sub(r"(?<=\d)([+-]\d+)$", r"E\1", text.strip()))

    grid, k, ends = {}, {}, []
    for card, more in zip(cards, [*cards[1:], ""], strict=True):
        if card.startswith("GRID*"):
            x, y, z = number(card[40:56]), number(card[56:72]), number(more[8:24])
            grid[int(card[8:24])] = np.array([x, y, z])
            assert (more[40:56].strip() == "123456") == (int(card[8:24]) <= 6)
        elif card.startswith("PBUSH*"):
            k[int(card[8:24])] = number(card[40:56])
        elif card.startswith("CBUSH"):
            ends.append([int(card[8 * i : 8 * i + 8]) for i in (2, 3, 4)])
    # Bulk data alone: it can be included in any deck, and is read as it is.
    assert {card[:8].strip() for card in cards if card[0] != "$"} == {
        "GRID*",
        "*",
        "PBUSH*",
        "CBUSH",
        "RBE2",
        "",
    }
    rigid = "".join(c[8:] for c in cards[cards.index(next(c for c in cards if "RBE2" in c)) :])
    assert rigid.split()[:9] == ["7", "13", "123456", "7", "8", "9", "10", "11", "12"]
    K = np.zeros((6, 6))
    for spring, a, b in ends:
        u = (grid[b] - grid[a]) / np.linalg.norm(grid[b] - grid[a])
        g = np.append(np.cross(grid[b] - grid[13], u), u)
        K += k[spring] * np.outer(g, g)
    turned = np.kron(np.eye(2), result.pose[:3, :3])
    assert relative_error(turned.T @ K @ turned, result.B.matrix) <= 1e-9


def test_a_table_of_geometry_places_legs_and_joints(tmp_path):
    elastic = cartstiff.load("stewart-simscape")
    write_result(cartstiff.analyse(elastic), tmp_path / "legs.csv")
    rows = list(csv.DictReader((tmp_path / "legs.csv").read_text().splitlines()))
    for row in rows:
        ends = [np.array([float(row[f"{e}_{a} [m]"]) for a in "xyz"]) for e in ("foot", "head")]
        assert np.isclose(np.linalg.norm(ends[1] - ends[0]), float(row["length [m]"]), rtol=1e-12)
    arm = cartstiff.load("ur5")
    write_result(cartstiff.analyse(arm), tmp_path / "joints.csv")
    rows = list(csv.DictReader((tmp_path / "joints.csv").read_text().splitlines()))
    # The Jacobian of the last point follows from axes and places.
    result, columns = cartstiff.analyse(arm), []
    for row in rows:
        place = np.array([float(row[f"{a} [m]"]) for a in "xyz"])
        axis = np.array([float(row[f"axis_{a}"]) for a in "xyz"])
        columns.append(np.append(axis, np.cross(axis, result.pose[:3, 3] - place)))
    J = np.kron(np.eye(2), result.pose[:3, :3]).T @ np.array(columns).T
    assert relative_error(J, result.jacobian) <= 1e-12


def test_a_rigid_joint_is_rigid_in_the_files(tmp_path):
    """The tree is the same machine; MuJoCo holds the joint where its file begins."""
    arm = cartstiff.load("ur5").with_springs({"elbow_joint": np.inf})
    result = cartstiff.analyse(arm, wrench=LOAD)
    write_result(result, tmp_path / "arm.urdf")
    again = cartstiff.load(tmp_path / "arm.yaml")
    assert again.mechanism.rigid == arm.mechanism.rigid == {2}
    C = cartstiff.analyse(again, wrench=LOAD).compliances["B"]
    assert relative_error(C, result.compliances["B"]) <= 1e-12
    write_result(result, tmp_path / "arm.csv")
    with (tmp_path / "arm.csv").open() as file:
        cells = {row["joint"]: row["stiffness [N m/rad or N/m]"] for row in csv.DictReader(file)}
    assert (cells["elbow_joint"], cells["wrist_1_joint"]) == ("rigid", "5000.0")
    laws = {4: PolynomialLaw((1e4, 0.0, 1e6))}
    nonlinear = replace(arm, springs=replace(arm.springs, laws=laws))
    write_result(cartstiff.analyse(nonlinear, wrench=LOAD), tmp_path / "laws.csv")
    with (tmp_path / "laws.csv").open() as file:
        cells = {row["joint"]: row["stiffness [N m/rad or N/m]"] for row in csv.DictReader(file)}
    assert (cells["wrist_2_joint"], cells["wrist_1_joint"]) == ("", "5000.0")
    mujoco = pytest.importorskip("mujoco")
    write_result(result, tmp_path / "arm.xml")
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "arm.xml"))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    assert model.joint("elbow_joint").stiffness[0] == 0.0
    assert np.abs(data.efc_pos) == pytest.approx([0.0], abs=1e-12)
