"""Struts between flexures: each condensed, against the machine with every joint written out."""

import json

import numpy as np
from tests.doors import Flexure, FlexureStruts
from tests.mechanisms.machines import joint, write_file, write_urdf
from tests.support import (
    absolute_error,
    refused,
    relative_error,
)

import cartstiff
from cartstiff import LineSprings, UndefinedError, after_command, analyse, load
from cartstiff.geometry import se3

# Two ways through 13 coordinates a leg, the longer one through 60 closures.
SAME = 1e-10
LOWER = {"axial": 1.2e8, "shear": 1.1e7, "bending": 33.0, "torsion": 236.0, "offset": 0.008}
UPPER = {"axial": 0.9e8, "shear": 2.1e7, "bending": 53.0, "torsion": 136.0, "offset": 0.005}
LAYOUT = {
    "base": {"radius": 0.115, "half_angle": np.pi / 18, "height": 0.015},
    "platform": {"radius": 0.09, "half_angle": np.pi / 18},
    "height": 0.075,
}
AXIAL = 2e7
BODY = [0.01, -0.02, 0.06]


def _short(folder, **keys):
    legs = {"strut": {"axial": AXIAL, "lower": LOWER, "upper": UPPER}, **keys}
    return load(
        write_file(
            folder, "short", kind="stewart-gough", layout=LAYOUT, legs=legs, frame={"xyz": BODY}
        )
    )


def _matrix(f):
    return np.diag([f["bending"], f["bending"], f["torsion"], f["shear"], f["shear"], f["axial"]])


def _long(folder, short):
    """The same machine as six chains: a joint for each motion of each flexure."""
    T_F_M = short.mechanism.pose_of(short.q)
    legs = []
    for i, (foot, made) in enumerate(zip(short.springs.feet, short.springs.made, strict=True)):
        low, bar = LOWER["offset"], made - LOWER["offset"] - UPPER["offset"]
        write_urdf(
            folder,
            joint("bolts", "base", "lower", at=(0, 0, low), kind="fixed"),
            joint("far", "lower", "rod", kind="fixed"),
            joint("slide", "rod", "slider", kind="prismatic"),
            joint("top", "slider", "upper", at=(0, 0, bar), kind="fixed"),
            joint("glue", "upper", "tip", kind="fixed"),
            name=f"leg{i}",
        )
        tip = se3.inverse(T_F_M) @ foot @ se3.pose(translation=[0, 0, low + bar])
        pose = {"xyz": foot[:3, 3], "rpy": se3.roll_pitch_yaw(foot)}
        legs.append(
            {
                "kind": "serial",
                "model": f"leg{i}.urdf",
                "frame": "tip",
                "base": pose,
                "grip": {"xyz": tip[:3, 3], "rpy": se3.roll_pitch_yaw(tip)},
                "springs": {"slide": {"stiffness": AXIAL}},
                "flexible": {
                    "lower": {"stiffness": _matrix(LOWER)},
                    "upper": {"stiffness": _matrix(UPPER)},
                },
            }
        )
    return load(write_file(folder, "long", kind="parallel", legs=legs))


def test_it_is_the_machine_with_all_its_joints(tmp_path):
    short = _short(tmp_path)
    long = _long(tmp_path, short)
    assert len(long.names) == 78
    # As made, and under preloads that turn every joint: the load's part is a tenth and more.
    loaded = []
    for rest in (0.0, 1e-4):
        rests = rest * np.array([1.0, -0.5, 2.0, 0.7, -1.0, 0.3])
        told = short.with_springs(
            rest=dict(zip(short.spring_names, short.springs.made + rests, strict=True))
        )
        one = cartstiff.equilibrium(told, cartstiff.DeadForce([30.0, -20.0, 300.0]))
        drives = {f"leg{i + 1}/slide": x for i, x in enumerate(rests)}
        full = long.with_springs(rest={n: drives.get(n, 0.0) for n in long.names})
        other = cartstiff.equilibrium(full, cartstiff.DeadForce([30.0, -20.0, 300.0]))
        assert absolute_error(one.pose, other.pose) <= 1e-11
        assert relative_error(one.stiffness.B.matrix, other.stiffness.B.matrix) <= SAME
        loaded.append(one.stiffness.B.matrix)
    assert relative_error(*loaded) > 1e-3


def test_joints_of_a_published_platform_take_a_quarter_of_its_stiffness():
    """Stewart-simscape's joints: 120 N/um along each, 20 N/um in the strut between them."""
    flexure = {"axial": 1.2e8, "shear": 1.1e7, "bending": 33.0, "torsion": 236.0}
    legs = {"axial": AXIAL, "lower": flexure, "upper": flexure}
    real = cartstiff.hexapod(**LAYOUT, legs={"strut": legs}, frame={"xyz": [0, 0, 0.06]})
    ideal = cartstiff.hexapod(**LAYOUT, legs=AXIAL, frame={"xyz": [0, 0, 0.06]})
    ratio = analyse(real).B.matrix[5, 5] / analyse(ideal).B.matrix[5, 5]
    assert round(ratio, 3) == 0.751


def _one(axial=1e5, k=(1e6, 1e4, 3.0, 2.0), length=0.2, **keys):
    ends = [Flexure(*k), Flexure(*k)]
    T = se3.pose(translation=[0.0, 0.0, length])
    return FlexureStruts.between(
        np.zeros((1, 3)), np.zeros((1, 3)), T, np.array([axial]), *ends, np.array([length])
    ), T


def test_a_strut_buckles_at_its_load():
    """A bar turns by phi between hinges kb; its ends give by x and y, x + y = -l phi, on springs.

    The upper spring's axes turn with the bar, which lengthens by l phi^2 / 2 + y phi. With y chosen
    best the energy is (kb + ks l^2 / 4 - P^2 / (4 ks)) phi^2.
    """
    ks, kb, length = 1e4, 3.0, 0.2
    critical = np.sqrt(4.0 * ks * kb + (ks * length) ** 2)
    # Between, the iteration for the strut's shape ends or does not, from place to place.
    for share, stands in ((0.999, True), (1.02, False)):
        strut, T = _one(axial=1e5, k=(np.inf, ks, kb, 2.0))
        # The spring pushes: the body's end stays where it was made.
        pushed = strut.replaced(strut.stiffness, 0.2 + np.array([share * critical / 1e5]))
        if stands:
            pushed.on_pose(T)
            continue
        caught = refused("strut 1 has buckled", pushed.on_pose, T, kind=UndefinedError)
        assert caught.code == "strut-buckled"


def test_a_buckled_strut_is_a_state_wherever_postures_are_read(tmp_path):
    flexure = {"axial": 1.2e8, "shear": 1e5, "bending": 33.0, "torsion": 236.0}
    strut = {"axial": AXIAL, "lower": flexure, "upper": flexure}
    keys = {"kind": "stewart-gough", "layout": LAYOUT}
    legs = {"strut": strut, "limits": [0.07, 0.12]}
    elastic = load(write_file(tmp_path, "weak", **keys, legs=legs))
    made, k = elastic.springs.made, elastic.springs.stiffness
    found = analyse(elastic.with_springs(rest=made + np.eye(6)[2] * 1.2e4 / k))
    assert found.matrices["B"] is None
    states = {note.code: note.values for note in found.notes}
    assert states["strut-buckled"] == {"strut": 3}
    assert found.to_dict()["energy"] is None
    refused(
        "strut 3 has buckled",
        analyse,
        found.elastic.with_springs(rest=found.elastic.springs.rest),
        strict=True,
        kind=UndefinedError,
    )
    held = elastic.with_springs(rest=made)
    many = cartstiff.analyse_many(held, held.q + np.array([[0.0] * 6, [0, 0, -5e-3, 0, 0, 0]]))
    assert many.counts() == {"regular": 1, "strut-buckled": 1}
    reached = cartstiff.workspace(held, directions=8, scan=4, fits=False)
    limits = reached.positions.limit.tolist()
    assert "flexures" in limits
    last = reached.boundary[limits.index("flexures")] - reached.centre
    # Between, the iteration for the strut's shape ends or does not, from place to place.
    for share, stands in ((0.999, True), (1.02, False)):
        at = held.mechanism.coordinates_of(se3.pose(translation=share * last) @ reached.pose)
        assert (analyse(held, at).matrices["B"] is not None) == stands


def test_without_bending_it_is_a_line(tmp_path):
    free = {"bending": 0.0, "torsion": 0.0}
    strut = {"axial": AXIAL, "lower": {**free, "torsion": "rigid"}, "upper": free}
    legs = {"strut": strut, "preload": [3e3, -2e3, 1e3, 0.0, -1e3, 2e3]}
    keys = {"kind": "stewart-gough", "layout": LAYOUT, "frame": {"xyz": BODY}}
    flexures = load(write_file(tmp_path, "struts", **keys, legs=legs))
    legs = {"stiffness": AXIAL, "preload": legs["preload"]}
    lines = load(write_file(tmp_path, "lines", **keys, legs=legs))
    assert type(lines.springs) is LineSprings
    q = lines.q + np.array([1e-3, -2e-3, 5e-3, 0.05, -0.1, 0.08])
    one, other = analyse(flexures, q), analyse(lines, q)
    assert relative_error(one.wrench, other.wrench) <= 1e-10
    assert relative_error(one.B.matrix, other.B.matrix) <= SAME


def test_a_command_lengthens_its_strut(tmp_path):
    elastic = _short(tmp_path)
    moved = after_command(elastic, {"leg2": 1e-4})
    lengths = moved.elastic.mechanism.leg_lengths(moved.q) - elastic.springs.made
    # The flexures hold the platform back a little.
    assert np.allclose(lengths, np.eye(6)[1] * 1e-4, atol=4e-6)
    assert not np.allclose(lengths, np.eye(6)[1] * 1e-4, atol=1e-8)


def test_a_search_that_runs_away_is_refused_in_words(tmp_path, recwarn):
    ends = {
        "base": {"radius": 0.235, "half_angle": 0.65},
        "platform": {"radius": 1.9e-7, "half_angle": 1.0},
        "height": -0.74,
    }
    joint = {"axial": 1.2e8, "shear": 1e7, "bending": 3331, "torsion": 236}
    strut = {"axial": AXIAL, "lower": joint, "upper": joint | {"bending": 3.3e-3, "offset": 0.01}}
    elastic = load(
        write_file(tmp_path, "odd", kind="stewart-gough", layout=ends, legs={"strut": strut})
    )
    refused(
        "no rest lengths of the struts balance",
        analyse,
        elastic,
        [-3e-7, 1e-7, 0.74, 0.1, 3.1, 0.4],
    )
    assert not recwarn.list


def test_assembly_modes_of_struts_are_those_at_rest(tmp_path):
    elastic = _short(tmp_path, limits=[0.08, 0.12])
    lengths = elastic.mechanism.leg_lengths(elastic.q) + np.eye(6)[1] * 1e-4
    found = cartstiff.assemble(elastic, lengths)
    told = after_command(elastic, {"leg2": 1e-4})
    assert absolute_error(found[0].pose, told.pose) <= 1e-10
    assert relative_error(found[0].result.B.matrix, told.stiffness.B.matrix) <= 1e-8
    assert found[0].stable
    # Where ideal joints would let it, flexures are bent by more than they stand.
    assert len(found) == 8
    for mode in found.modes[1:]:
        assert mode.stable is None
        assert mode.notes[0].code == "struts-not-in-equilibrium"


def test_moments_of_flexures_are_in_newton_metres_whatever_the_units(tmp_path):
    """One machine in a file of metres and in one of millimetres, with the same N m/rad."""
    units = {"m": 1.0, "mm": 1e3}
    found = {}
    for unit, a in units.items():
        flexure = {"axial": 1e9 / a, "shear": 2e7 / a, "bending": 3000.0, "torsion": 4000.0}
        ring = {"radius": 0.6 * a, "half_angle": 0.2}
        keys = {
            "kind": "stewart-gough",
            "units": {"length": unit, "force": "N"},
            "layout": {"base": ring, "platform": ring, "height": 0.5 * a},
            "legs": {"strut": {"axial": 1.6e8 / a, "lower": flexure, "upper": flexure}},
        }
        (tmp_path / f"{unit}.yaml").write_text(json.dumps(keys), encoding="utf-8")
        K = cartstiff.analyse(cartstiff.load(tmp_path / f"{unit}.yaml")).matrices["K"]
        sizes = np.repeat([1.0, a], 3)
        found[unit] = K * np.outer(sizes, sizes) / a
    assert relative_error(found["mm"], found["m"]) < 1e-12
    # Without bending the struts' own lengths remain: it is a share that an error would show.
    assert found["m"][2, 2] > 6 * 4000.0 * 0.5
