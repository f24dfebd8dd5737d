"""Every refusal of the analysis: what it says, and the numbers it carries."""

import numpy as np
import pytest
from tests.doors import (
    PostureMatrices,
    Reading,
    centre_of_compliance,
    centre_of_elasticity,
    centre_of_stiffness,
    characteristic_length,
    ellipsoid,
    inertia_metric,
    joint_shares,
    length_from_inertia,
    move_compliance,
    move_stiffness,
    normal_form,
    point_of_least_coupling,
    stiffness_block,
    summarise,
    twist_compliant_axes,
)

import cartstiff
from cartstiff import InputError, UndefinedError, analysis
from cartstiff.core.errors import UnknownNameError

K = np.diag([1.0, 2.0, 3.0, 10.0, 20.0, 30.0])
J = np.eye(6)
LINE = np.diag([0.0, 0.0, 0.0, 0.0, 0.0, 5.0])  # one spring: K_tt has rank one
SKEW = K.copy()
SKEW[0, 1] = 0.5
NAN = np.full((6, 6), np.nan)
SOME = analysis.Tolerances(stiffness=0.1)


def _inverted():
    raise analysis.centres_of(LINE).reasons["compliance"]


def _summarised(wrench=(0.0,) * 6, K=K, length=None, mass=None, **others):
    given = PostureMatrices({"B": K}, wrench, **others)
    far = {} if mass is None else {"inertia": 1e-12 * np.eye(3), "mass_centre": (1e6, 3e5, 2e5)}
    return summarise(given, Reading(length, mass, **far))


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: analysis.natural_length(SKEW), r"not symmetric; expected .*K\^B.*asymmetry 0.5"),
        (
            lambda: move_stiffness(K, np.eye(3)),
            "frame has the wrong shape",
        ),
        (
            lambda: move_compliance(K, 2 * np.eye(4)),
            "frame is not a rigid motion",
        ),
        (lambda: ellipsoid(np.eye(2)), r"expected shape \(3, 3\)"),
        (lambda: analysis.stiffness_along(K, [0, 0, 0]), "direction must not be zero"),
        (lambda: length_from_inertia(0.0, np.eye(3)), "mass cannot be used"),
        (lambda: length_from_inertia(1.0, -np.eye(3)), "inertia is not positive definite"),
        (
            lambda: length_from_inertia(1.0, np.eye(3) + np.eye(3, k=1)),
            "inertia is not symmetric",
        ),
        (lambda: characteristic_length(K, mass=1.0), "mass and inertia go together"),
        (lambda: inertia_metric(-1.0, np.eye(3)), "mass cannot be used"),
        (lambda: inertia_metric(1.0, -np.eye(3)), "inertia is not positive definite"),
        (lambda: analysis.condition_numbers(K, 1.0), "list of lengths has the wrong count"),
        (lambda: analysis.compare_connections({"B": K}, threshold=0), "threshold cannot be used"),
        (lambda: analysis.cartesian_stiffness(J, [1, 2], np.zeros(6)), "joint stiffness has the"),
        (
            lambda: analysis.cartesian_stiffness(J, NAN, np.zeros(6)),
            "joint stiffness must be",
        ),
        (
            lambda: analysis.cartesian_stiffness(J, np.ones(6), [np.nan] * 6),
            "wrench must be finite",
        ),
        (
            lambda: analysis.joint_stiffness(K, np.eye(6, 7), null_space_stiffness=np.eye(2)),
            "null-space stiffness has the wrong shape",
        ),
        (lambda: analysis.Tolerances(length=np.nan), "tolerance of the length must be finite"),
        (lambda: analysis.Tolerances(angle=-1.0), "tolerance of the angle cannot be used"),
        (
            lambda: cartstiff.accuracy(cartstiff.analyse(cartstiff.load("cubic")), SOME, level=1.0),
            "level cannot be used",
        ),
        (lambda: _summarised(mass=1.0), "metric is not positive definite"),
        (lambda: _summarised(np.zeros(5)), "wrench has the wrong count"),
        (lambda: _summarised(K=NAN), "must be finite"),
        (
            lambda: _summarised(compliance=NAN),
            "compliance must be",
        ),
        (lambda: _summarised(length=-1.0), "a positive length"),
    ],
)
def test_input_errors(call, message):
    with pytest.raises(InputError, match=message):
        call()


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: stiffness_block(K, "turning", "free"), "unknown freedom"),  # type: ignore[arg-type]
        (lambda: stiffness_block(K, "rotation", "loose"), "unknown condition"),  # type: ignore[arg-type]
        (lambda: analysis.compare_connections({"A": K}), "unknown connection.*'B'"),
        (lambda: _summarised(connection="Z"), "unknown connection"),
    ],
)
def test_unknown_names(call, message):
    with pytest.raises(UnknownNameError, match=message):
        call()


LOADED_WHERE_SOFT = np.diag([1.0, 2.0, 3.0, 0.0, 20.0, 30.0])
LOADED_WHERE_SOFT[0, 3] = LOADED_WHERE_SOFT[3, 0] = 1.0


@pytest.mark.parametrize(
    ("call", "code", "message"),
    [
        (_inverted, "singular", "stiffness is singular"),
        (
            lambda: stiffness_block(LOADED_WHERE_SOFT, "rotation", "free"),
            "singular",
            "no balance exists",
        ),
        (
            lambda: analysis.stiffness_about(LOADED_WHERE_SOFT, [1, 0, 0], others="free"),
            "singular",
            "other freedoms free does not exist",
        ),
        (lambda: analysis.natural_length(LINE), "no-natural-length", "no natural length"),
        (lambda: analysis.natural_length(-K), "no-natural-length", "no natural length"),
        (lambda: centre_of_stiffness(LINE), "no-centre-of-stiffness", "not a single"),
        (lambda: centre_of_compliance(LINE), "no-centre-of-compliance", "not a single"),
        (lambda: centre_of_elasticity(LINE), "no-centre-of-elasticity", "not a single"),
        (
            lambda: point_of_least_coupling(LINE),
            "no-point-of-least-coupling",
            "not a single",
        ),
        (lambda: normal_form(LINE), "no-centre-of-stiffness", "not a single"),
        (lambda: analysis.decoupling_frame(LINE), "no-point-of-least-coupling", "not a"),
        (lambda: twist_compliant_axes(LINE), "singular", "do not exist"),
        (lambda: analysis.best_conditioned_length(LINE), "not-positive", "no best length"),
        (
            lambda: analysis.compare_connections({"B": None, "A": K}),
            "no-reference",
            "nothing to compare with",
        ),
        (
            lambda: analysis.cartesian_stiffness(np.eye(6, 5), np.ones(5), np.zeros(6)),
            "fewer-than-six-freedoms",
            "all six directions",
        ),
        (lambda: analysis.joint_stiffness(K, LINE), "singular", "all six directions"),
        (
            lambda: analysis.cartesian_stiffness(np.eye(6, 7), [1, 1, 1, 1, 1, 1, -1], np.zeros(6)),
            "buckled",
            "self-motion is unstable",
        ),
        (
            lambda: joint_shares(J, np.zeros((6, 6)), np.ones(6)),
            "singular",
            "a motion of the joints is free",
        ),
    ],
)
def test_states_in_which_nothing_exists(call, code, message):
    with pytest.raises(UndefinedError, match=message) as caught:
        call()
    assert caught.value.code == code


def test_undefined_errors_carry_their_numbers():
    with pytest.raises(UndefinedError, match="singular") as caught:
        _inverted()
    shown = caught.value.values["singular_values"]
    assert isinstance(shown, list)
    assert len(shown) == 6
    with pytest.raises(UndefinedError, match="natural") as caught:
        analysis.natural_length(LINE)
    assert caught.value.values["translational"] == [0.0, 0.0, 5.0]
    assert caught.value.values["free_rotational"] is None


def test_results_cannot_be_changed():
    found = analysis.stiffness_ellipsoid(K, "translation", "held")
    with pytest.raises(ValueError, match="read-only"):
        found.axes[0, 0] = 2.0
    with pytest.raises(AttributeError, match="cannot assign"):
        found.radii = found.axes  # type: ignore[misc]
