"""What measurements leave open of polynomial springs, in files and later answers.

Deflections by NumPy's roots, Jacobians by differences of poses, derivatives by differences.
"""

import numpy as np
import pytest
from tests.identify.campaigns import jacobian, load
from tests.identify.neighbours import neighbours
from tests.identify.test_polynomials import _campaign, _five_bar, _pulled
from tests.support import refused
from tests.support.commands import answer, run

import cartstiff
from cartstiff import DeadForce, analyse_posture
from cartstiff.extend import in_units
from cartstiff.identify import identify

Q = np.array([0.3, 0.5, 0.9, 0.2, 0.7, -0.3])
FORCE = np.array([0, 0, 0, 40.0, -30.0, -160.0])
_AXES = np.eye(3)


@pytest.fixture(scope="module")
def known(tmp_path_factory):
    """An arm of which the second joint's three coefficients were found besides five springs."""
    folder = tmp_path_factory.mktemp("bent")
    file = folder / "known.yaml"
    run("identify", *_campaign(folder, 2, 6e-5, rows=40), "--unknown joints --unknown j2 -o", file)
    return file


def _root(c, torque):
    """Deflection (real, nearest to zero) of ``c_1 x + c_2 x^2 + c_3 x^3``."""
    roots = np.roots([*c[::-1], -torque])
    real = roots.real[np.abs(roots.imag) < 1e-9]
    return real[np.argmin(np.abs(real))]


def _moved(elastic, theta, tangent=False, q=Q):
    """Displacement (3,) under FORCE for parameters (j1, j3, j4, j5, j6, 1/c_1, c_2, c_3)."""
    J = jacobian(elastic, q)
    torque = J.T @ FORCE
    x = np.insert(theta[:5], 1, 0.0) * torque
    c = np.array([1.0 / theta[5], *theta[6:]])
    x[1] = _root(c, torque[1])
    if tangent:
        x[1] = torque[1] / (c * [1, 2 * x[1], 3 * x[1] ** 2]).sum()
    return J[3:] @ x


def _deviation(elastic, along=_AXES, **settings):
    """Standard deviations to first order of displacements along columns."""
    found = elastic.identified
    theta, rows = np.array(found.values), []
    for p in range(len(theta)):
        step = 1e-4 * abs(theta[p]) * np.eye(len(theta))[p]
        ends = [_moved(elastic, theta + s * step, **settings) for s in (1, -1)]
        rows.append((ends[0] - ends[1]) / (2 * step[p]))
    L = along.T @ np.array(rows).T
    return np.sqrt(np.einsum("ip,pr,ir->i", L, found.covariance, L))


def test_the_file_holds_the_whole_covariance(known):
    elastic = load(known)
    assert elastic.identified.names == ("j1", "j3", "j4", "j5", "j6", "j2", "j2 x^2", "j2 x^3")
    law = elastic.springs.laws[1].coefficients
    assert elastic.identified.values[5:] == pytest.approx([1 / law[0], *law[1:]], rel=1e-12)
    s = np.sqrt(elastic.identified.covariance.diagonal())
    correlation = elastic.identified.covariance / np.multiply.outer(s, s)
    assert abs(correlation[5, 7]) > 0.5  # the powers are told apart by few rows
    assert s[7] < 0.3 * law[2]


def test_the_displacement_at_rest_is_as_uncertain_as_by_hand(known):
    elastic = load(known)
    state = cartstiff.equilibrium(elastic, Q, DeadForce(FORCE[3:] * 1e-2))  # small, and large
    assert state.displacement_deviation[3:].max() < 1e-5
    state = cartstiff.equilibrium(elastic, Q, DeadForce(FORCE[3:]))
    by_hand = _deviation(elastic)
    # The arm turns by up to a hundredth under the load, which is not in the formula by hand.
    assert state.displacement_deviation[3:] == pytest.approx(by_hand, rel=0.05)
    rng = np.random.default_rng(0)
    found = elastic.identified
    draws = rng.multivariate_normal(found.values, found.covariance, 800, method="cholesky")
    drawn = np.std([_moved(elastic, theta) for theta in draws], axis=0)
    assert state.displacement_deviation[3:] == pytest.approx(drawn, rel=0.1)
    # Exactly: equilibria of mechanisms with other coefficients.
    variance = 0.0
    for more, less, per in neighbours(elastic):
        ends = [cartstiff.equilibrium(m, Q, DeadForce(FORCE[3:])).pose for m in (more, less)]
        variance += (per * (ends[0] - ends[1])[:3, 3]) ** 2
    assert state.displacement_deviation[3:] == pytest.approx(np.sqrt(variance), rel=1e-5)


def test_small_motions_under_the_load_are_too(known):
    """`analyse` looks at the tangent: what more of the load would do."""
    elastic = load(known)
    R = elastic.mechanism.at(Q).pose[:3, :3]
    body = np.kron(np.eye(2), R.T) @ FORCE
    result = cartstiff.analyse(elastic, Q, wrench=body)
    numbers = analyse_posture(result)["uncertainty"]
    assert "coefficient.j2 x^3" in numbers["parameters"]
    spread = [numbers["numbers"][f"deflection.displacement[{i}]"]["deviation"] for i in range(3)]
    # By hand there is no geometric stiffness.
    each = _deviation(elastic, R, tangent=True)
    assert np.array(spread) == pytest.approx(each, rel=0.03)


def test_frequencies_under_the_weight(known):
    elastic = load(known).with_gravity([0, 0, -9.81])
    found = cartstiff.modes(elastic, Q)
    variance = 0.0
    for more, less, per in neighbours(elastic):
        ends = [cartstiff.modes(m, Q).frequencies for m in (more, less)]
        variance += (per * (ends[0] - ends[1])) ** 2
    assert cartstiff.accuracy(found).interval.deviations == pytest.approx(
        np.sqrt(variance), rel=1e-4
    )


def test_other_units_change_nothing(known):
    elastic = load(known)
    here = cartstiff.equilibrium(elastic, Q, DeadForce(FORCE[3:]))
    small = in_units(elastic, "mm")
    there = cartstiff.equilibrium(small, Q, DeadForce(FORCE[3:]))
    assert there.displacement_deviation == pytest.approx(
        here.displacement_deviation * [1, 1, 1, 1e3, 1e3, 1e3], rel=1e-6
    )
    assert small.identified.values[5:] == pytest.approx(
        elastic.identified.values[5:] * [1e-3, 1e3, 1e3], rel=1e-12
    )


def test_a_loop_with_a_motor_that_stiffens(tmp_path):
    """Rest positions open or given: equilibria of mechanisms with other coefficients say it."""
    true = _five_bar(tmp_path, "true.yaml", [900.0, 0.0, 2.0e4], 700.0)
    guess = _five_bar(tmp_path, "guess.yaml", [700.0, 0.0, 1.0e4], 800.0)
    measured = _pulled(true, 12, 5, 150.0)
    noise = np.random.default_rng(1).normal(size=(2, 12)) * 1e-4
    for values, errors in zip(measured.values.values(), noise, strict=True):
        values += errors
    result = identify(guess, measured, sought=("joints", "left_motor"))
    open_ = result.mechanism
    motors = [open_.names[j] for j in open_.mechanism.actuated]
    told = {name: open_.q[open_.names.index(name)] + 0.05 for name in motors}
    for elastic in (open_, open_.with_springs(rest=told)):
        load_ = DeadForce([60.0, -90.0, 0.0])
        state = cartstiff.equilibrium(elastic, load_, limits=False)
        variance = 0.0
        for more, less, per in neighbours(elastic):
            ends = [cartstiff.equilibrium(m, load_, limits=False).pose for m in (more, less)]
            variance += (per * (ends[0] - ends[1])[:2, 3]) ** 2
        assert np.all(variance > 0)
        assert state.displacement_deviation[3:5] == pytest.approx(np.sqrt(variance), rel=1e-4)


def test_what_does_not_fit_the_file_is_refused(known, tmp_path):
    text = known.read_text("utf-8").replace("elbow.urdf", str(known.with_name("elbow.urdf")))
    other = tmp_path / "other.yaml"
    for old, new, words in (
        ("polynomial: [j2, 2]", "polynomial: [j2, 4]", "unknown spring"),
        ("polynomial: [j2, 2]", "polynomial: [j3, 2]", "unknown spring"),
        ("polynomial: [j2, 2]", "polynomial: [j2, 1]", "is not that of the file's spring"),
        ("polynomial: [j2, 2]", "polynomial: [j2, 2]\n    elements: [[j1, j1, 1]]", "one of both"),
    ):
        assert old in text
        other.write_text(text.replace(old, new), "utf-8")
        caught = refused(words, load, other)
        assert "identified" in str(caught)


def test_the_command_line_tells_intervals(known):
    load_ = "--load 0,0,0,0,0,-100"
    found = answer("analyse", known, load_)["analysis"]["uncertainty"]["parameters"]
    assert found["coefficient.j2 x^2"]["deviation"] > 0
    assert max(answer("equilibrium", known, load_)["displacement_uncertainty"]["sd"]) > 0
