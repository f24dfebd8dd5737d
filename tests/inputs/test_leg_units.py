"""Legs by name in millimetres: the same machine as in metres, whatever its file states."""

import json

import numpy as np
import pytest

import cartstiff
from cartstiff import InputError, analyse

#: Powers of the length in the numbers of a file, by key.
POWERS = {
    "radius": 1, "height": 1, "points": 1, "rod": 1, "crank": 1, "diameter": 1, "xyz": 1, "com": 1,
    "rest_length": 1, "offset": 0, "E": -2, "G": -2, "length": 1, "area": 2, "Iy": 4, "Iz": 4,
    "J": 4, "density": -3,
}  # fmt: skip
RINGS = {
    "base": {"radius": 0.3, "half_angle": 0.25},
    "platform": {"radius": 0.12, "half_angle": 0.8},
}
BEAM = {"E": 7e10, "G": 2.6e10, "length": 0.3, "area": 6e-4, "Iy": 4.5e-8, "Iz": 2e-8, "J": 5e-8}
LINE = {"frames": ["world", "leg1/rod"], "points": [[0, 0, 1], [0.01, 0, 0]], "rest_length": 0.4}
RODS = {"chain": "PUS", **RINGS, "rod": 0.6, "diameter": 0.01}
CRANKS = {"chain": "RUS", **RINGS, "rod": 0.6, "crank": 0.1, "axis": "radial"}
POSE = {"xyz": [0.01, 0.02, 0.5], "rpy": [0.02, 0.01, 0.1]}

#: Files in metres, each with the values that differ otherwise in millimetres.
FILES = {
    "slides": (
        {
            "pose": POSE,
            "legs": RODS,
            "payload": {"mass": 3, "com": [0, 0, 0.1]},
            "gravity": [0, 0, -9.81],
        },
        {"legs.stiffness": (1e6, 1e3), "legs.limits": ([-0.4, 0.4], [-400, 400])},
    ),
    "cranks": (
        {"pose": POSE, "legs": CRANKS, "offset": {"xyz": [0, 0, 0.05]}},
        {"legs.stiffness": (500.0, 5e5), "legs.limits": ([-3, 3], [-3, 3])},
    ),
    "springs": (
        {"pose": POSE, "legs": RODS, "lines": [LINE]},
        {
            "legs.stiffness": ("20 N/um", "20 N/um"),
            "legs.springs": (
                {
                    "s1": {"stiffness": 2.0, "rest": 0.1},
                    "u1": {"table": [[-1, -3], [0, 0], [1, 6]]},
                },
                {
                    "s1": {"stiffness": 2e3, "rest": 0.1},
                    "u1": {"table": [[-1, -3e3], [0, 0], [1, 6e3]]},
                },
            ),
            "lines.0.stiffness": (1e4, "10 N/mm"),
        },
    ),
    "laws of slides": (
        {"pose": POSE, "legs": RODS},
        {
            "legs.springs": (
                {"slide": {"polynomial": [1e6, 0, 1e9], "damping": 30, "rest": -0.1}},
                {"slide": {"polynomial": [1e3, 0, 1.0], "damping": 0.03, "rest": -100}},
            )
        },
    ),
    "links": (
        {"pose": POSE, "legs": RODS | {"flexible": {"rod": {"beam": BEAM | {"density": 2700}}}}},
        {"legs.stiffness": ("rigid", "rigid")},
    ),
}


def scaled(data, a, power=0):
    """A file's numbers with lengths a times as large."""
    if isinstance(data, dict):
        return {k: scaled(x, a, POWERS.get(k, 0)) for k, x in data.items()}
    if isinstance(data, list):
        return [scaled(x, a, power) for x in data]
    return data * a**power if isinstance(data, (int, float)) else data


def with_values(data, values, i):
    data = json.loads(json.dumps(data))
    for way, pair in values.items():
        *steps, last = [int(s) if s.isdigit() else s for s in way.split(".")]
        holder = data
        for step in steps:
            holder = holder[step]
        holder[last] = pair[i]
    return data


def written(folder, name, data):
    path = folder / f"{name}.yaml"
    path.write_text(json.dumps({"kind": "parallel", **data}), encoding="utf-8")
    return path


@pytest.fixture(params=FILES.values(), ids=FILES)
def files(request, tmp_path):
    """The file in metres, and in millimetres."""
    data, values = request.param
    metres = written(tmp_path, "metres", with_values(data, values, 0))
    own = scaled(data, 1000.0) | {"units": {"length": "mm"}}
    return metres, written(tmp_path, "millimetres", with_values(own, values, 1))


#: K in mm over K in m, in the order (moment or rotation, force or translation).
FACTORS = np.outer(np.repeat([1e3, 1.0], 3), np.repeat([1.0, 1e-3], 3))


def test_the_same_machine(files):
    one, other = map(cartstiff.load, files)
    assert (other.units.length, other.units.force) == ("mm", "N")
    a, b = analyse(one), analyse(other)
    np.testing.assert_allclose(b.pose[:3, 3], 1e3 * a.pose[:3, 3], rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(b.wrench, a.wrench * np.repeat([1e3, 1], 3), rtol=1e-7, atol=1e-6)
    if a.matrices["B"] is not None:
        K = a.matrices["B"] * FACTORS
        np.testing.assert_allclose(b.matrices["B"], K, rtol=1e-7, atol=1e-9 * np.abs(K).max())
    sizes = np.where([c.is_length for c in one.mechanism.coordinates], 1e3, 1.0)
    limits = [[(c.lower, c.upper) for c in e.mechanism.coordinates] for e in (one, other)]
    np.testing.assert_allclose(limits[1], np.array(limits[0]) * sizes[:, None], rtol=1e-12)


def test_tools_and_stiffnesses_that_are_given_are_in_the_units_of_the_file(files):
    one, other = files
    a = analyse(cartstiff.load(one, tcp=[0.01, 0.0, 0.03]))
    b = analyse(cartstiff.load(other, tcp=[10.0, 0.0, 30.0]))
    np.testing.assert_allclose(b.pose[:3, 3], 1e3 * a.pose[:3, 3], rtol=1e-9, atol=1e-9)


def test_parameters_with_units(tmp_path):
    data = {"pose": POSE, "legs": RODS | {"stiffness": "=2*k"}, "parameters": {"k": "10 N/um"}}
    one = cartstiff.load(written(tmp_path, "metres", data))
    own = scaled({key: x for key, x in data.items() if key != "parameters"}, 1000.0)
    own |= {"units": {"length": "mm"}, "parameters": data["parameters"]}
    other = cartstiff.load(written(tmp_path, "millimetres", own))
    np.testing.assert_allclose(other.springs.stiffness, one.springs.stiffness / 1e3, rtol=1e-12)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"units": {"length": "mm", "force": "kN"}}, "key units.force: cannot be used; expected N"),
        ({"units": {"length": "mm"}, "legs": [{"model": "ur5"}]}, "units are for legs by name"),
        ({"units": {"length": "yard"}}, "units.length"),
    ],
)
def test_what_has_no_units(tmp_path, change, words):
    data = {"pose": POSE, "legs": RODS | {"stiffness": 1e6}}
    with pytest.raises(InputError, match=words):
        cartstiff.load(written(tmp_path, "file", data | change))
