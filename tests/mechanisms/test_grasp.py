"""Fingers that squeeze: internal forces change the stiffness and leave no load behind."""

import numpy as np
import pytest
from ruamel.yaml import YAML
from tests.mechanisms.machines import write_file
from tests.mechanisms.oracle import ROBOTS, Held, missed
from tests.support.printed import text_of

from cartstiff import UndefinedError, analyse, analyse_many, analyse_posture, load
from cartstiff.geometry import CARTAN_PLUS

# Differences of the reduced energy and of the load, step 0.005.
DIFFERENCES = 1e-9
# What is left of the load when contact forces cancel.
CANCELLED = 1e-9
# Rounded numbers of the file (twelve digits) in rest positions.
FILE = 1e-8


def _grasp(folder, squeeze, contact="point"):
    """The bundled grasp, its rest positions moved in proportion to `squeeze`."""
    data = YAML(typ="safe").load((ROBOTS / "grasp.yaml").read_text(encoding="utf-8"))
    for leg in data["legs"]:
        leg["model"] = str(ROBOTS / leg["model"])
        leg["contact"] = contact
        for name, spring in leg["springs"].items():
            if "rest" in spring:
                q = leg["q"][name]
                spring["rest"] = q + squeeze * (spring["rest"] - q)
    return load(write_file(folder, f"grasp-{squeeze}-{contact}", **data))


def _contact_force(result):
    """Force between the second finger and the object, along the line of contacts."""
    points = []
    for leg in (1, 2):
        T, _ = result.posture.relative("world", f"leg{leg}/contact")
        points.append(T[:3, 3])
    # The second contact force by statics of its own finger: torques at its three joints.
    _, to_tip = result.posture.relative("world", "leg2/contact")
    names = result.elastic.names
    mine = [i for i, n in enumerate(names) if n.startswith("leg2/") and "contact" not in n]
    torque = result.elastic.springs.torque(result.q)[mine]
    T, _ = result.posture.relative("world", "leg2/contact")
    J = T[:3, :3] @ to_tip.jacobian[3:][:, mine]
    force = np.linalg.solve(J.T, torque)
    u = (points[0] - points[1]) / np.linalg.norm(points[0] - points[1])
    return force, u, float(np.linalg.norm(points[0] - points[1]))


def test_fingers_push_towards_each_other():
    result = analyse(load("grasp"))
    force, u, apart = _contact_force(result)
    assert apart == pytest.approx(0.04, rel=FILE)
    # The finger's springs push along the line, towards the other finger.
    along = -force @ u
    assert along > 1.0
    assert np.abs(force + along * u).max() <= FILE * along
    assert np.abs(result.wrench).max() <= CANCELLED * along


@pytest.mark.parametrize("squeeze", [0.0, 1.0, -3.0, 4.0])
def test_squeeze_against_energy_differences(tmp_path, squeeze):
    """Pressed or pulled: K^A, K^B and K^K follow the reduced energy."""
    result = analyse(_grasp(tmp_path, squeeze))
    size = np.abs(result.closure_forces).max()
    # Twelve digits of the file: 1e-12 of the stiffness is there without any squeeze.
    assert np.abs(result.wrench).max() <= CANCELLED * max(size, 1.0)
    assert max(missed(result, Held(result.elastic, result.q), 0.005)[:2]) <= DIFFERENCES


def test_what_the_squeeze_does(tmp_path):
    """Stiffness is linear in the squeeze: it turns with contact forces, which are.

    Between point contacts a distance d apart pressed by f the object rolls away: for fingers that
    only translate at their tips, -f d enters the rotations across the line.
    """
    results = {s: analyse(_grasp(tmp_path, s)) for s in (0.0, 1.0, 2.0)}
    K = {s: r.matrices["B"] for s, r in results.items()}
    change = K[1.0] - K[0.0]
    assert np.abs(change[:3, :3]).max() > 0.01 * np.abs(K[0.0][:3, :3]).max()
    # The passive balls and springs stay as they are; only forces double.
    first = np.abs(K[2.0] - K[0.0] - 2 * change).max()
    assert first <= 0.05 * np.abs(change).max() * 3
    rotation = {s: np.linalg.eigvalsh(k[:3, :3]) for s, k in K.items()}
    assert rotation[2.0][1] < rotation[1.0][1] < rotation[0.0][1]


def test_contacts_that_hold_more_are_stiffer(tmp_path):
    """Point, soft-finger and rigid contacts, on the motions that the stiffer one still allows."""
    results = {c: analyse(_grasp(tmp_path, 0.0, c)) for c in ("point", "soft-finger", "rigid")}
    ranks = [r.reduction.rank for r in results.values()]
    assert ranks == sorted(ranks, reverse=True)
    assert ranks[0] == 6 > ranks[-1]
    spin = np.zeros(6)
    for softer, stiffer in (("point", "soft-finger"), ("soft-finger", "rigid")):
        K_s = _on_all(results[softer])
        U, K = (
            results[stiffer].reduction.reachable,
            results[stiffer].reduction.reachable_stiffness,
        )
        more = np.linalg.eigvalsh(K - U.T @ K_s @ U)
        assert more.min() >= -1e-9 * np.abs(K).max()
    _, u, _ = _contact_force(analyse(_grasp(tmp_path, 1.0)))
    spin[:3] = results["point"].pose[:3, :3].T @ u
    assert spin @ _on_all(results["soft-finger"]) @ spin > 1e-3


def _on_all(result):
    """Stiffness as a form on all twists, zero on those that the contacts do not allow."""
    U, K = result.reduction.reachable, result.reduction.reachable_stiffness
    back = np.linalg.pinv(U)
    return back.T @ K @ back


@pytest.mark.parametrize("squeeze", [0.5, 1.0, 2.0])
def test_a_load_leaves_the_spin_about_the_contacts_to_its_lever(tmp_path, squeeze):
    """A dead force f at h over the line of contacts resists the spin by f h alone: 0 on the line.

    What f adds to K^B, and the change to K^load takes off again, leaves no stiffness behind.
    """
    elastic = _grasp(tmp_path, squeeze)
    for f in (-5.0, 3.0):
        result = analyse(elastic, wrench=[0, 0, 0, 0, 0, f])
        assert not {"wrench-ignored"} & {note.code for note in result.notes}
        assert not result.tangent[1].any()
        assert result.tangent_compliance is None
        assert "under the load is singular" in str(result.notes[-1])
        assert analyse_posture(result, connection="load")["definiteness"] != "positive"
        over = analyse(elastic, wrench=[0, 0, 0, 0, 0, f], load_at=(0, 0, 0.01))
        assert over.tangent[1, 1] == pytest.approx(0.01 * f, rel=1e-12)
        text = text_of(result)
        assert "e-3" not in text.split("Pose of the body frame")[0]  # what is 0 to rounding
        found = analyse_many(elastic, [result.q], wrench=[0, 0, 0, 0, 0, f])
        assert found.codes[found.state[0]] == "singular-stiffness"


@pytest.mark.parametrize("size", [1e-6, 1e-4, 1e-3, 1e-2])
def test_a_spin_on_which_nothing_works_has_no_compliance_under_the_cartan_connection(size):
    """Energy does not change along the line of contacts, y of the body: that row of K^A is zero.

    Its column is the bracket with W, and K^B has half of each, so that only C^B exists.
    """
    elastic = load("grasp")
    step = size * np.cos(7.0 * np.arange(elastic.q.size))
    result = analyse(elastic, elastic.q + step)
    K, W = result.matrices, result.wrench
    assert np.abs(K["A"][1]).max() < 1e-12
    bracket = [-W[2], 0.0, W[0], -W[5], 0.0, W[3]]
    assert np.abs(W).max() > 10 * size
    assert np.abs(K["A"][:, 1]) == pytest.approx(np.abs(bracket), abs=1e-12)
    assert result.compliances["A"] is None
    for tensor in (result.A, result.tensor("+"), result.tensor(CARTAN_PLUS)):
        with pytest.raises(UndefinedError, match="singular"):
            tensor.to_frame(np.eye(4)).to_units("mm").compliance()
    assert result.compliances["B"] @ K["B"] == pytest.approx(np.eye(6), abs=1e-5)
    many = analyse_many(elastic, result.q[None], outputs=["compliance_A"])
    assert np.isnan(many["compliance_A"]).all()
    assert many.codes[many.state[0]] == "singular-stiffness"
