"""Responses: against full matrices, closed forms, statics at frequency zero."""

from dataclasses import replace

import numpy as np
import pytest
from tests.doors import Units, convert_length, damping_matrix, poles, transmissibility
from tests.support import loaded_arm, relative_error
from tests.support.commands import answer, refuses
from tests.vibration.test_modes import LENGTH, M_1, K, column

from cartstiff import analyse, load, modes
from cartstiff.vibration import Damping, frequency_response

#: Two ways through the same matrices.
AGREE = 1e-9


def arm_under_load():
    arm = loaded_arm("RRPRRR", seed=4)
    return analyse(arm.elastic, arm.q, wrench=arm.wrench, load_kind="conservative")


def _damped_platform():
    elastic = load("stewart-simscape").with_springs({"leg1": 15e6, "leg4": 30e6})
    return replace(elastic, damping=np.array([500.0, 0.0, 300.0, 100.0, 0.0, 200.0]))


SUBJECTS = {
    "arm under load": arm_under_load,
    "platform with dampers": _damped_platform,
    "closed chain": lambda: load("five-bar"),
    "massless motions": lambda: load("3-rrr"),
    "dead moment": lambda: analyse(load("ur5"), wrench=[20.0, -10.0, 30.0, 50.0, 100.0, -200.0]),
}
DAMPINGS = {
    "one ratio": Damping(0.02),
    "Rayleigh": Damping(0.0, mass=0.7, stiffness=1e-4),
    "both": Damping(0.01, mass=0.1, stiffness=1e-5),
}


@pytest.mark.parametrize("subject", SUBJECTS)
@pytest.mark.parametrize("damping", DAMPINGS)
def test_responses_are_those_of_the_full_matrices(subject, damping):
    found, how = modes(SUBJECTS[subject]()), DAMPINGS[damping]
    hertz = np.linspace(0.0, 1.3 * found.frequencies[-1], 25)
    at = np.array([0.01, 0.02, -0.03])
    length, force = convert_length(Units(), found.elastic.units)
    M, C = found.mass * (force / length), damping_matrix(found, how)
    J = found.posture.motion.jacobian @ found.basis
    J = np.vstack([J[:3], J[3:] + np.cross(J[:3].T, at).T])
    moved = found.posture.pose[:3, :3] @ J[3:]
    A = found._momentum[0] @ found.basis * (force / length)
    a = frequency_response(found, hertz, how, at=at).matrix
    b = transmissibility(found, hertz, how, at=at).matrix
    for w, x, y in zip(2 * np.pi * hertz, a, b, strict=True):
        D = np.linalg.inv(found.stiffness - w**2 * M + 1j * w * C)
        assert np.abs(x - J @ D @ J.T).max() < AGREE * np.abs(x).max()
        assert np.abs(y - np.eye(3) - w**2 * moved @ D @ A.T).max() < AGREE * np.abs(y).max()


@pytest.mark.parametrize("subject", ["arm under load", "platform with dampers", "massless motions"])
def test_static_compliance_at_zero(subject):
    subject = SUBJECTS[subject]()
    result = subject if hasattr(subject, "wrench") else analyse(subject)
    H = frequency_response(modes(result), [0.0], 0.05).matrix[0]
    assert relative_error(H.real, result.tangent_compliance) < 1e-9
    assert np.abs(H.imag).max() < 1e-12 * np.abs(H).max()


def test_one_mass_on_a_spring():
    """H = l^2 / (k - omega^2 m l^2 + i omega c), and its derivatives."""
    c = 0.3
    elastic = replace(column(masses=(M_1,), stiffness=(K,)), damping=np.array([c]))
    hertz = np.array([0.1, 0.2, 0.35, 1.0])
    w = 2 * np.pi * hertz
    H = LENGTH**2 / (K - w**2 * M_1 * LENGTH**2 + 1j * w * c)
    for kind, power in (("receptance", 0), ("mobility", 1), ("accelerance", 2)):
        found = frequency_response(modes(elastic), hertz, kind=kind)
        assert found.along([0, 1, 0]) == pytest.approx((1j * w) ** power * H, rel=1e-12)
    T = transmissibility(modes(elastic), hertz).along([0, 1, 0])
    k, d = K / LENGTH**2, c / LENGTH**2
    assert pytest.approx((k + 1j * w * d) / (k - w**2 * M_1 + 1j * w * d), rel=1e-12) == T
    f, ratio = poles(modes(elastic), Damping())
    own = np.sqrt(K / M_1) / LENGTH
    zeta = c / (2 * M_1 * LENGTH**2 * own)
    assert ratio == pytest.approx([zeta])
    assert f == pytest.approx([own * np.sqrt(1 - zeta**2) / (2 * np.pi)])


def test_reciprocity_and_notes():
    found = modes(_damped_platform())
    H = frequency_response(found, [50.0, 700.0], 0.01).matrix
    assert relative_error(np.abs(H - H.swapaxes(1, 2)), np.zeros_like(H.real)) < 1e-9 * 1e300
    assert np.abs(H - H.swapaxes(1, 2)).max() < 1e-12 * np.abs(H).max()
    bare = modes(load("stewart-simscape"))
    assert [n.code for n in frequency_response(bare, [1.0]).notes] == ["undamped-response"]
    at_pole = frequency_response(column_at_pole := modes(column(stiffness=(0.0, K))), [0.0])
    assert np.isnan(at_pole.matrix).all()
    assert column_at_pole.frequencies[0] == 0.0


def test_what_is_refused_and_written():
    found = modes(column())
    refuses("kind of response", frequency_response, found, [1.0], kind="inertance")
    refuses("frequencies", frequency_response, found, [-1.0])
    refuses(
        "wrong count of damping ratios", frequency_response, found, [1.0], Damping([0.1, 0.2, 0.3])
    )
    refuses("damping ratios", Damping, -0.1)
    refuses("Rayleigh", Damping, mass=-1.0)
    response = frequency_response(found, [1.0, 2.0], 0.02)
    lines = response.to_csv().splitlines()
    assert lines[0].startswith("frequency [Hz],real_x [m/N],imaginary_x [m/N]")
    row = [float(x) for x in lines[2].split(",")]
    assert row[3] + 1j * row[4] == response.along([0, 1, 0])[1]
    assert response.unit == "m/N"


def test_rayleigh_on_the_command_line_is_a_ratio_of_each_mode():
    """alpha M + beta K damps a mode of angular frequency w by (alpha / w + beta w) / 2."""
    command = "modes stewart-simscape --response 500:1300:5 --point 0,0,0.05"
    w = 2.0 * np.pi * modes(load("stewart-simscape")).frequencies
    ratios = ",".join(repr(float(x)) for x in (20.0 / w + 1e-5 * w) / 2.0)
    one, other = (
        answer(command, how)["response"] for how in ("--rayleigh 20,1e-5", f"--damping {ratios}")
    )
    assert one["damping"]["rayleigh"] == [20.0, 1e-5]
    for axis, curve in one["curves"].items():
        assert relative_error(np.array(curve), np.array(other["curves"][axis])) < AGREE
