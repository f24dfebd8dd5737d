"""A finite-element matrix of a beam, reduced to the spring of a link, against the beam itself."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from tests.mechanisms.beams import element
from tests.mechanisms.machines import joint, write_file, write_urdf
from tests.support.commands import refuses

from cartstiff import analyse, load
from cartstiff.errors import InputError
from cartstiff.mechanisms.superelement import superelement_spring

E, G, AREA, IY, IZ, J = 2e11, 8e10, 1e-4, 1e-9, 2e-9, 2e-9
# Two ways that are both exact without load: rounding of matrices with condition 1e7.
ROUNDING = 1e-9
NODES = np.array([[0.0, 0, 0], [0.2, 0, 0], [0.35, 0, 0], [0.6, 0, 0]])


SECTION = {"E": E, "G": G, "area": AREA, "Iy": IY, "Iz": IZ, "J": J}


def beam_matrix(places, of=lambda length: element(SECTION, length)):
    """Of a beam along x with nodes at some places."""
    K = np.zeros((6 * len(places),) * 2)
    for i, length in enumerate(np.diff(places)):
        K[6 * i : 6 * i + 12, 6 * i : 6 * i + 12] += of(length)
    return K


@pytest.fixture(scope="module")
def matrix():
    return beam_matrix(NODES[:, 0])


def test_spring_of_a_beam_is_the_beam(matrix, tmp_path):
    section = {**SECTION, "length": 0.6}
    spring = superelement_spring(matrix, NODES)
    found = []
    np.savetxt(tmp_path / "K.txt", matrix, delimiter=",", header="a comment")
    turned = np.kron(np.eye(8), Rotation.from_euler("z", -90, degrees=True).as_matrix())
    np.savetxt(tmp_path / "turned.txt", turned @ matrix @ turned.T)
    upright = NODES @ Rotation.from_euler("z", 90, degrees=True).as_matrix()
    for name, give in (
        ("beam", {"beam": section}),
        ("file", {"superelement": {"K": "K.txt", "nodes": NODES.tolist()}}),
        (
            "turned",
            {
                "superelement": {"K": "turned.txt", "nodes": upright.tolist()},
                "offset": {"rpy": [0, 0, np.pi / 2]},
            },
        ),
        ("spring", {"stiffness": spring.tolist(), "offset": {"xyz": [0.6, 0, 0]}}),
    ):
        end = joint("end", "bar", "tool", kind="fixed", at=(0.6, 0.1, 0))
        write_urdf(tmp_path, joint("wall", "base", "bar", kind="fixed"), end, name=name)
        path = write_file(
            tmp_path,
            name,
            kind="serial",
            model=f"{name}.urdf",
            frame="tool",
            flexible={"bar": give},
        )
        found.append(analyse(load(path)).B.matrix)
    size = np.sqrt(np.outer(np.diag(found[0]), np.diag(found[0])))
    for other in found[1:]:
        assert np.abs((found[0] - other) / size).max() <= ROUNDING


@pytest.mark.parametrize(
    ("text", "change", "match"),
    [
        (None, {}, r"K\.txt.*cannot be read"),
        ("1 2\n3 x\n", {}, "no matrix of numbers"),
        ("1 0\n0 1\n", {}, "stiffness of the superelement"),
        ("good", {"nodes": (1e3 * NODES).tolist()}, "resists a motion as a whole"),
    ],
)
def test_files_that_are_refused(text, change, match, matrix, tmp_path):
    if text == "good":
        np.savetxt(tmp_path / "K.txt", matrix)
    elif text is not None:
        (tmp_path / "K.txt").write_text(text)
    write_urdf(tmp_path, joint("turn", "base", "bar"), name="arm")
    give = {"superelement": {"K": "K.txt", "nodes": NODES.tolist()} | change}
    path = write_file(
        tmp_path, "arm", kind="serial", model="arm.urdf", frame="bar", flexible={"bar": give}
    )
    with pytest.raises(InputError, match=match) as error:
        load(path)
    assert "\n" not in str(error.value)
    assert "arm.yaml" in str(error.value)


def test_other_orders_nodes_and_axes(matrix):
    spring = superelement_spring(matrix, NODES)
    swap = (6 * np.arange(4)[:, None] + [3, 4, 5, 0, 1, 2]).ravel()
    other = superelement_spring(matrix[np.ix_(swap, swap)], NODES, order="angular-linear")
    assert np.abs(other - spring).max() <= ROUNDING * np.abs(spring).max()
    back = np.arange(24).reshape(4, 6)[::-1].ravel()
    other = superelement_spring(matrix[np.ix_(back, back)], NODES[::-1], base=3, tip=0)
    assert np.abs(other - spring).max() <= ROUNDING * np.abs(spring).max()
    R = Rotation.from_rotvec([0.3, -0.4, 0.5]).as_matrix()
    turned, two = np.kron(np.eye(8), R), np.kron(np.eye(2), R)
    other = superelement_spring(turned @ matrix @ turned.T, NODES @ R.T + [1, 2, 3])
    assert np.abs(other - two @ spring @ two.T).max() <= ROUNDING * np.abs(spring).max()


@pytest.mark.parametrize(
    ("change", "word"),
    [
        ({"nodes": 1000 * NODES}, "resists a motion as a whole"),  # millimetres
        ({"order": "angular-linear"}, "resists a motion as a whole"),
        ({"order": "zyx"}, "unknown order"),
        ({"tip": 4}, "no such node: tip"),
        ({"tip": 1.5}, "no such node: tip"),
        ({"base": True}, "no such node: base"),
        ({"base": -1}, "the same node"),
        ({"nodes": NODES[:3]}, "stiffness of the superelement"),
    ],
)
def test_what_is_refused(matrix, change, word):
    given = {"stiffness": matrix, "nodes": NODES, **change}
    with pytest.raises(InputError, match=word):
        superelement_spring(given.pop("stiffness"), given.pop("nodes"), **given)


def test_held_lopsided_and_loose_matrices_are_refused(matrix):
    held = matrix + np.diag([1e6, *np.zeros(23)])
    lopsided = matrix.copy()
    lopsided[0, 6] *= 1.01
    loose = np.zeros((30, 30))
    loose[:24, :24] = matrix
    refuses("resists a motion as a whole", superelement_spring, held, NODES)
    refuses("must be symmetric", superelement_spring, lopsided, NODES)
    refuses(
        "can move without a force", superelement_spring, loose, np.vstack([NODES, [0, 1, 0]]), tip=3
    )


@pytest.mark.parametrize("ratio", [1e3, 1e8, 1e12, 1e15])
def test_a_stiff_part_beside_soft_ones_is_their_sum_or_refused(ratio):
    """Compliances of beams one after the other add up, each moved to the tip."""
    lengths, K, expected = np.diff(NODES[:, 0]), np.zeros((24, 24)), np.zeros((6, 6))
    for i, length in enumerate(lengths):
        part = element(SECTION, length) * (ratio if i == 1 else 1.0)
        K[6 * i : 6 * i + 12, 6 * i : 6 * i + 12] += part
        to_tip = np.eye(6)
        to_tip[3:, :3] = np.cross(NODES[3] - NODES[i + 1], np.eye(3))
        own = np.linalg.inv(superelement_spring(part, NODES[i : i + 2]))
        expected += to_tip @ own @ to_tip.T
    if ratio > 1e10:
        with pytest.raises(InputError, match="digits of the soft ones are lost"):
            superelement_spring(K, NODES)
        return
    C = np.linalg.inv(superelement_spring(K, NODES))
    assert np.abs(C - expected).max() <= 1e-14 * ratio * np.abs(expected).max()


def test_nodes_that_are_pushed_away_are_refused(matrix):
    """As of a part beyond its buckling load: nothing would hold the reduced spring."""
    with pytest.raises(InputError, match="pushed away from rest"):
        superelement_spring(-matrix, NODES)
