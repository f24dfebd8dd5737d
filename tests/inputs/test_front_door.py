"""What a short script writes: names on arms and results, short names of outputs, tables."""

import copy
import pickle

import numpy as np
import pinocchio as pin
import pytest

import cartstiff
from cartstiff import InputError, UndefinedError
from cartstiff.core.errors import UnknownNameError

LOAD = [1.0, -2.0, 3.0, 40.0, -50.0, 60.0]


@pytest.fixture(scope="module")
def arm():
    return cartstiff.load("ur5")


@pytest.fixture(scope="module")
def loaded(arm):
    return cartstiff.analyse(arm, wrench=LOAD)


@pytest.mark.parametrize(
    "verb",
    [
        lambda source: cartstiff.analyse(source),
        lambda source: cartstiff.analyse_many(source, np.zeros((1, 6))),
        lambda source: cartstiff.equilibrium(source),
        lambda source: cartstiff.load_curve(source, wrench=LOAD),
        lambda source: cartstiff.compensate(source, np.zeros((2, 6)), LOAD),
        lambda source: cartstiff.inverse_kinematics(source, np.eye(4)),
        lambda source: cartstiff.show(source),
    ],
)
def test_a_name_in_place_of_a_mechanism_is_told_what_to_do(verb):
    with pytest.raises(InputError, match=r"expected cartstiff\.load\('ur5'\), got str"):
        verb("ur5")
    with pytest.raises(InputError, match=r"expected cartstiff\.load\(.*got Model"):
        verb(pin.Model())


def test_matrices_are_indexed_as_arrays(loaded):
    K = loaded.K
    np.testing.assert_array_equal(K[3:, 3:], K.matrix[3:, 3:])
    np.testing.assert_array_equal(K.T, K.matrix.T)
    np.testing.assert_array_equal(K.compliance()[0], K.compliance().matrix[0])


def test_frame_and_units_of_a_result(loaded):
    assert loaded.frame == "tool0"
    assert (loaded.units.length, loaded.units.force) == ("m", "N")


def test_compliance_is_that_under_the_load(loaded):
    C = loaded.compliance
    np.testing.assert_allclose(C.matrix @ loaded.tangent, np.eye(6), atol=1e-9)
    assert C.frame == loaded.frame


def test_compliance_exists_where_stiffness_does_not(arm):
    straight = cartstiff.analyse(arm, np.zeros(6))
    assert straight.reduction.stiffness is None
    assert np.isfinite(straight.compliance.matrix).all()
    free = arm.with_springs({"elbow_joint": 0.0})
    with pytest.raises(UndefinedError):
        _ = cartstiff.analyse(free).compliance


def test_limits_masses_and_frames_of_an_arm(arm):
    mechanism = arm.mechanism
    assert arm.limits == {c.name: (c.lower, c.upper) for c in mechanism.coordinates}
    assert arm.masses == mechanism.masses()
    assert {"world", "body", "tool0", "wrist_3_link"} <= set(arm.frames)
    assert "universe" not in arm.frames


def test_limits_of_a_platform_are_those_of_its_legs():
    free, limited = (cartstiff.load(name) for name in ("stewart-gough", "hexapod"))
    assert free.limits == {}
    assert list(limited.limits) == [f"leg{i}" for i in range(1, 7)]
    assert np.array(list(limited.limits.values())) == pytest.approx(limited.mechanism.limits)
    assert free.frames == ("world", "body")


def test_gravity_is_added_and_taken_away(arm):
    heavy = arm.with_gravity()
    np.testing.assert_array_equal(heavy.gravity, [0.0, 0.0, -9.81])
    with pytest.raises(ValueError, match="read-only"):
        heavy.gravity[0] = 1.0
    bent = cartstiff.analyse(heavy.with_springs(rest=arm.q)).wrench
    assert np.abs(bent).max() > 10.0
    for none in (None, [0.0, 0.0, 0.0]):
        assert heavy.with_gravity(none).gravity is None
    platform = cartstiff.load("stewart-gough")
    assert [n.code for n in platform.with_gravity().notes] == ["weightless"]
    assert platform.with_gravity().with_gravity(None).notes == ()
    with pytest.raises(InputError, match=r"gravity is in m/s\^2.*got 981"):
        arm.with_gravity([0.0, 0.0, -981.0])
    with pytest.raises(InputError, match=r"gravity is in m/s\^2"):
        platform.with_gravity([0.0, 0.0, -981.0])  # lengths in cm


def test_gravity_acts_on_a_model_without_frames():
    model = pin.Model()
    joint = model.addJoint(0, pin.JointModelRY(), pin.SE3.Identity(), "hinge")
    model.appendBodyToJoint(
        joint, pin.Inertia(2.0, np.array([1.0, 0.0, 0.0]), np.eye(3)), pin.SE3.Identity()
    )
    model.addFrame(pin.Frame("tip", joint, pin.SE3.Identity(), pin.FrameType.OP_FRAME))
    tree = cartstiff.load(model, frame="tip")
    tree.mechanism.tree.frames.pop("tip")
    assert tree.masses == {"hinge": 2.0}
    assert "weightless" not in [n.code for n in tree.with_gravity().notes]


def test_outputs_by_their_letters(arm):
    q = arm.q + np.linspace(0.0, 0.1, 3)[:, None]
    postures = cartstiff.analyse_many(arm, q, wrench=LOAD, outputs=["K", "load", "compliance_B"])
    for name in ("K", "load"):
        long = cartstiff.analyse_many(arm, q, wrench=LOAD, outputs=[f"stiffness_{name}"])
        np.testing.assert_array_equal(postures[name], long[f"stiffness_{name}"])
        np.testing.assert_array_equal(getattr(postures, name), postures[name])
    mine = np.empty((3, 6, 6))
    cartstiff.analyse_many(arm, q, wrench=LOAD, outputs=["K"], out={"K": mine})
    np.testing.assert_array_equal(mine, postures.K)
    with pytest.raises(UnknownNameError):
        cartstiff.analyse_many(arm, q, outputs=["Z"])
    with pytest.raises(AttributeError, match=r"no output 'F'; there are stiffness_K.*: outputs="):
        _ = postures.F
    for other in (pickle.loads(pickle.dumps(postures)), copy.copy(postures)):
        np.testing.assert_array_equal(other.K, postures.K)


def test_tables_of_matrices(arm, loaded):
    pytest.importorskip("xarray")
    table = loaded.A.to_pandas()
    assert table.loc["mx", "y"] == loaded.A[0, 4]
    swapped = loaded.A.to_order("linear-angular").to_pandas()
    assert swapped.loc["mx", "y"] == table.loc["mx", "y"]
    C = loaded.compliance.to_xarray()
    assert C.dims == ("motion", "wrench")
    assert float(C.sel(motion="z", wrench="fx")) == loaded.compliance[5, 3]

    q = np.tile(arm.q, (2, 1))
    outputs = ["A", "compliance_A", "wrench", "pose", "jacobian", "energy"]
    postures = cartstiff.analyse_many(arm, q, wrench=LOAD, outputs=outputs)
    data = postures.to_xarray()
    assert data.K_A.dims == ("posture", "wrench", "motion")
    np.testing.assert_array_equal(data.W, postures.wrench)
    np.testing.assert_array_equal(data.given_wrench.sel(wrench=["mx", "fz"]), np.take(LOAD, [0, 5]))
    each = cartstiff.analyse_many(arm, q, wrench=[LOAD, np.zeros(6)]).to_xarray()
    assert each.given_wrench.sel(posture=1).values.tolist() == [0.0] * 6
    units = {name: each[name].attrs["units"] for name in ("q", "given_wrench")}
    assert units == {"q": "rad", "given_wrench": "N m, N"}
    assert "given_wrench" not in cartstiff.analyse_many(arm, q).to_xarray()
    assert data.q.sel(coordinate="elbow_joint")[1] == arm.q[2]
    assert list(data.state.values) == ["regular"] * 2
    entries = postures.to_pandas()
    assert entries.loc[(1, "fx", "rz"), "K_A"] == postures.A[1, 3, 2]
    assert entries.loc[(1, "fx", "rz"), "C_A"] == postures["compliance_A"][1, 2, 3]
    with pytest.raises(InputError, match="no matrices are among the outputs"):
        cartstiff.analyse_many(arm, q, outputs=["pose"]).to_pandas()


def test_the_stiffness_where_a_mechanism_rests(arm):
    state = cartstiff.equilibrium(arm, wrench=[0.0, 0.0, 0.0, 0.0, 0.0, -10.0])
    np.testing.assert_array_equal(state.K.matrix, state.stiffness.K.matrix)
