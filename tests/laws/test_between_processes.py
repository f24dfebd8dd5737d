"""Errors and results go from one process to another with everything that they carry."""

import copy
import multiprocessing
import pickle
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

import cartstiff
from cartstiff import DeadForce
from cartstiff.core import errors

ERRORS = [
    errors.InputError("stiffness is wrong", where="--stiffness", expected="1", got=2),
    errors.UnknownNameError("joint", "elbo", ("elbow", "wrist"), where="--q"),
    errors.UndefinedError("it is singular", code="singular", values={"rank": 5}),
    errors.ConvergenceError("it did not end", iterations=7, residual=0.25),
    errors.MissingDependencyError("zarr", "keeping a map", "maps"),
]


@pytest.mark.parametrize("error", ERRORS, ids=lambda e: type(e).__name__)
def test_errors_are_sent_whole(error):
    error.add_note("seen in a worker")
    for found in (pickle.loads(pickle.dumps(error)), copy.copy(error)):
        assert type(found) is type(error)
        assert str(found) == str(error)
        assert vars(found) == vars(error)


def _raise(number):
    raise ERRORS[number]


def test_a_pool_hears_of_errors():
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        for number, error in enumerate(ERRORS):
            with pytest.raises(type(error), match=str(error)[:12]) as caught:
                pool.apply(_raise, (number,))
            assert str(caught.value) == str(error)


@pytest.mark.parametrize("name", ["ur5", "stewart-gough", "cubic", "five-bar", "delta", "3-rrr"])
def test_results_are_sent_whole(name):
    elastic = cartstiff.load(name)
    for read_before in (False, True):
        result = cartstiff.analyse(elastic)
        if read_before:
            result.to_dict()
        found = pickle.loads(pickle.dumps(result))
        assert found.to_dict() == result.to_dict()
    rest = cartstiff.equilibrium(elastic, DeadForce([0.0, 0.0, -1.0]))
    found = pickle.loads(pickle.dumps(rest))
    assert found.to_dict() == rest.to_dict()
    many = cartstiff.analyse_many(elastic, [elastic.q], outputs=["pose", "wrench"])
    found = pickle.loads(pickle.dumps(many))
    np.testing.assert_array_equal(found["pose"], many["pose"])


def test_curves_are_sent_whole():
    curve = cartstiff.load_curve(cartstiff.load("ur5"), DeadForce([0.0, 0.0, -50.0]))
    found = pickle.loads(pickle.dumps(curve))
    assert found.to_dict() == curve.to_dict()


def _modes():
    return cartstiff.modes(cartstiff.load("stewart-simscape"))


def _assembly():
    return cartstiff.assemble(cartstiff.load("hexapod"))


def _workspace():
    return cartstiff.workspace(cartstiff.load("hexapod"), directions=20, scan=4)


def _machine():
    return cartstiff.analyse(cartstiff.load("6-pus"), wrench=[0, 0, 0, 0, 0, -10.0])


def _study():
    study = {
        "mechanism": "inclined-hexapod",
        "variables": {"sz": {"low": 0.4, "high": 0.6, "count": 2}},
        "poses": {"grid": {"z": [0.0, 0.1, 2]}, "about_home": True},
        "objectives": {"softest": {"quantity": "translation_held_min"}},
    }
    return cartstiff.design(study)


@pytest.mark.parametrize("made", [_modes, _assembly, _workspace, _machine, _study])
def test_answers_about_machines_are_sent_whole(made):
    answer = made()
    found = pickle.loads(pickle.dumps(answer))
    assert found.to_dict() == answer.to_dict()


def test_machines_are_read_in_threads():
    with ThreadPoolExecutor(4) as pool:
        found = list(pool.map(lambda _: _machine().to_dict(), range(8)))
    assert all(each == found[0] for each in found)
