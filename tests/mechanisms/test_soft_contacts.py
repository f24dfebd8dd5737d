"""Contacts of a grasp with their own stiffness, against compliances in series."""

import numpy as np
import pytest
from ruamel.yaml import YAML
from scipy.spatial.transform import Rotation
from tests.mechanisms.machines import write_file
from tests.mechanisms.oracle import ROBOTS, Held, missed
from tests.support import relative_error

from cartstiff import InputError, analyse, analyse_many, equilibrium, load
from cartstiff.geometry import se3

# Linear algebra of well-conditioned matrices.
ROUNDING = 1e-9
AXES = [0.2, -0.4, 0.7]


def data_of(contact_stiffness, contact="point", squeeze=0.0):
    """The bundled grasp, with a third finger so that every motion is resisted."""
    data = YAML(typ="safe").load((ROBOTS / "grasp.yaml").read_text(encoding="utf-8"))
    third = {
        key: dict(value) if isinstance(value, dict) else value
        for key, value in data["legs"][0].items()
    }
    turn = Rotation.from_euler("x", 60, degrees=True)
    shift = np.array([0.03, 0.0, 0.0])
    for key, centre in (("base", np.array([0.0, 0.0, 0.085])), ("grip", np.zeros(3))):
        own = third[key]
        R = turn * Rotation.from_euler("xyz", own["rpy"])
        third[key] = {
            "xyz": (centre + turn.apply(own["xyz"] - centre) + shift).tolist(),
            "rpy": R.as_euler("xyz").tolist(),
        }
    data["legs"].append(third)
    for leg in data["legs"]:
        leg["model"] = str(ROBOTS / leg["model"])
        leg["contact"] = contact
        if contact_stiffness is not None:
            leg["contact_stiffness"] = contact_stiffness
        leg["springs"] = {name: dict(spring) for name, spring in leg["springs"].items()}
        for name, spring in leg["springs"].items():
            if "rest" in spring:
                q = leg["q"][name]
                spring["rest"] = q + squeeze * (spring["rest"] - q)
    return data


def grasp(folder, *args, **kwargs):
    return load(write_file(folder, "grasp", **data_of(*args, **kwargs)))


def by_hand(result, kx, ky, kn, rpy):
    """K of the body: per contact, fingers' and contact's compliances in series, no squeeze."""
    posture, names, K = result.posture, result.elastic.names, np.zeros((6, 6))
    T_F_M, springs = result.pose, result.elastic.springs
    for leg in (1, 2, 3):
        T, tip = posture.relative("world", f"leg{leg}/fingertip")
        mine = [i for i, n in enumerate(names) if n.startswith(f"leg{leg}/") and "." not in n]
        J = tip.jacobian[3:][:, mine]  # axes of the fingertip
        R = Rotation.from_euler("xyz", rpy).as_matrix()
        C = J @ np.diag(1 / springs.stiffness[mine]) @ J.T
        C = C + R @ np.diag([1 / kx, 1 / ky, 1 / kn]) @ R.T
        T_M_tip = se3.inverse(T_F_M) @ T
        p, turn = T_M_tip[:3, 3], T_M_tip[:3, :3]
        G = np.vstack([np.cross(p, turn.T).T, turn])  # wrench of a force at the contact
        K += G @ np.linalg.inv(C) @ G.T
    return K


@pytest.mark.parametrize("rpy", [[0.0, 0.0, 0.0], AXES])
def test_contact_and_finger_are_springs_in_series(tmp_path, rpy):
    soft = {"normal": 3000, "tangential": [1500, 2500], "rpy": rpy}
    result = analyse(grasp(tmp_path, soft))
    expected = by_hand(result, 1500, 2500, 3000, rpy)
    assert np.abs(result.wrench).max() < 1e-9
    got = result.matrices["B"]
    assert relative_error(got, expected) <= ROUNDING
    hard = analyse(grasp(tmp_path, None)).matrices["B"]
    inf = by_hand(result, np.inf, np.inf, np.inf, rpy)
    assert relative_error(hard, inf) <= ROUNDING
    assert np.linalg.eigvalsh(hard - got).min() > 0.0


def test_units_and_rigid_directions(tmp_path):
    soft = {"normal": "3 N/mm", "tangential": "rigid"}
    result = analyse(grasp(tmp_path, soft))
    expected = by_hand(result, np.inf, np.inf, 3000, [0.0, 0.0, 0.0])
    assert relative_error(result.matrices["B"], expected) <= ROUNDING
    assert "leg1/contact.tz" in result.elastic.names
    assert "leg1/contact.tx" not in result.elastic.names


@pytest.mark.parametrize("squeeze", [1.0, -2.0])
def test_a_squeeze_goes_through_soft_contacts(tmp_path, squeeze):
    """K^A, K^B, K^K against differences of the reduced energy and of the load."""
    soft = {"normal": 3000, "tangential": 2000, "spin": 0.5, "rpy": AXES}
    result = analyse(grasp(tmp_path, soft, squeeze=squeeze))
    assert max(missed(result, Held(result.elastic, result.q), 0.005)[:2]) <= 1e-8


def test_the_spin_of_a_contact_has_a_spring(tmp_path):
    free, held = (
        analyse(grasp(tmp_path, {"spin": spin, "rpy": AXES}, contact="soft-finger"))
        for spin in (0, 0.8)
    )
    i = held.elastic.names.index("leg2/contact.z")
    assert held.elastic.springs.stiffness[i] == 0.8
    assert held.elastic.springs.stiffness.sum() - free.elastic.springs.stiffness.sum() == (
        pytest.approx(2.4)
    )


def test_doors_agree(tmp_path):
    """One posture, many postures, equilibrium under a small force, another stiffness by name."""
    soft = {"normal": 3000, "tangential": 2000}
    elastic = grasp(tmp_path, soft)
    one = analyse(elastic)
    many = analyse_many(elastic, elastic.q[None], outputs=("stiffness_B",))
    np.testing.assert_allclose(many["stiffness_B"][0], one.matrices["B"], rtol=1e-8, atol=1e-6)
    load_ = np.array([0.0, 0.0, 0.0, 1e-4, 2e-4, -1e-4])
    moved = equilibrium(elastic, wrench=load_, load_axes="body").displacement
    expected = np.linalg.solve(one.matrices["B"], load_)
    np.testing.assert_allclose(moved, expected, rtol=1e-3, atol=1e-11)
    changed = elastic.with_springs({f"leg{i}/contact.tz": 9000 for i in (1, 2, 3)})
    other = grasp(tmp_path, {"normal": 9000, "tangential": 2000})
    np.testing.assert_allclose(
        analyse(changed).matrices["B"], analyse(other).matrices["B"], rtol=1e-9, atol=1e-9
    )


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"contact": "rigid"}, "contact_stiffness is of a contact: soft-finger or point"),
        ({"contact_stiffness": {"normal": 0}}, "contact_stiffness.normal.*above zero"),
        ({"contact_stiffness": {"normal": "3 N m/rad"}}, "N/m"),
        ({"contact_stiffness": {"radial": 3}}, "unknown key"),
        (
            {"contact_stiffness": {"spin": 3}, "passive": ["contact.z"]},
            "contact_stiffness has the spring of contact.z: give it once",
        ),
    ],
)
def test_what_does_not_fit_is_refused(tmp_path, change, words):
    data = data_of({"normal": 3000})
    data["legs"][0] |= change
    with pytest.raises(InputError, match=words):
        load(write_file(tmp_path, "grasp", **data))
