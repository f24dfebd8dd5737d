"""Sensitivities against differences of frequencies, and shortcuts against what they leave out."""

from dataclasses import replace

import numpy as np
import pytest
from tests.doors import Parameters
from tests.identify.neighbours import neighbours
from tests.mechanisms.machines import write_file
from tests.mechanisms.oracle import ROBOTS
from tests.support.commands import answer
from tests.vibration.test_modes import LENGTH, M_1, K, column
from tests.vibration.test_response import arm_under_load

from cartstiff import InputError, UndefinedError, accuracy, analyse, load, modes, sensitivities
from cartstiff.analysis import Tolerances

#: Two rounds of central differences.
DIFFERENCES = 1e-5


def _by_differences(result, name, step):
    """df/dp from frequencies at a neighbouring parameter."""
    parameters = Parameters(result)
    nominal = parameters.value(name)
    ends = [modes(parameters.at({name: nominal + s * step})).frequencies for s in (1, -1)]
    return (ends[0] - ends[1]) / (2 * step)


CASES = {
    "arm": (arm_under_load, ["stiffness.j3", "placement.j2.x", "placement.j4.ry", "frame.rz"]),
    "dead moment": (
        lambda: analyse(load("ur5"), wrench=[20.0, -10.0, 30.0, 50.0, 100.0, -200.0]),
        ["stiffness.elbow_joint", "placement.wrist_1_joint.z"],
    ),
    "platform": (
        lambda: analyse(
            _uneven(), wrench=[3.0, 1.0, -2.0, 100.0, -50.0, -2000.0], load_kind="conservative"
        ),
        ["stiffness.leg2", "base.leg3.x", "platform.leg5.z"],
    ),
    "six legs": (
        lambda: analyse(load("6-ups")),
        ["stiffness.leg2_slide", "placement.leg3_slide.x"],
    ),
    "closed chain": (
        lambda: analyse(load("five-bar")),
        ["stiffness.left_motor", "placement.left_elbow.x", "closure.right_tip.y"],
    ),
}


def _uneven():
    """A platform without repeated modes."""
    elastic = load("stewart-simscape")
    return elastic.with_springs({"leg1": 15e6, "leg2": 17e6, "leg4": 30e6})


@pytest.mark.parametrize("case", CASES)
def test_against_differences(case):
    make, names = CASES[case]
    result = make()
    found = modes(result)
    known = sensitivities(found)
    for name in names:
        k = name.startswith("stiffness")
        step = 1e-4 * known.values[known.names.index(name)] if k else 1e-5
        wanted = _by_differences(result, name, step)
        size = np.abs(wanted).max()
        # Two frequencies of the six legs are near to each other, and turn into one another.
        least = 30 * DIFFERENCES if case == "six legs" else DIFFERENCES
        assert np.abs(known.of(name) - wanted).max() < least * size, name
    with pytest.raises(InputError, match="unknown parameter"):
        known.of("stiffness.nothing")
    of_posture = sensitivities(analyse(load("stewart-gough")))
    with pytest.raises(InputError, match="not of frequencies"):
        of_posture.of("stiffness.leg1")


def test_masses_against_differences():
    """A mass more at the tip, where the link's mass is."""
    elastic = column()
    known = sensitivities(modes(elastic), geometry=False)
    h = 1e-5
    ends = [modes(column(masses=(M_1, 1.25 + s * h))).frequencies for s in (1, -1)]
    assert known.of("mass.tip") == pytest.approx((ends[0] - ends[1]) / (2 * h), rel=1e-7)
    platform = sensitivities(modes(_uneven()), geometry=False)
    base = load("stewart-simscape").mechanism
    centre = base.mass_centre
    heavier, lighter = (modes(_uneven().with_payload(m, centre)).frequencies for m in (2e-4, 0.0))
    slope = (heavier - lighter) / 2e-4
    assert platform.of("mass.platform") == pytest.approx(slope, rel=1e-3, abs=1e-3)


def test_scaling_laws():
    """All stiffnesses by a factor: f by its root; all masses: by the inverse root."""
    found = modes(_uneven())
    known = sensitivities(found, geometry=False)
    per_share = known.values[:, None] * known.frequencies
    springs = np.array([name.startswith("stiffness") for name in known.names])
    assert per_share[springs].sum(axis=0) == pytest.approx(0.5 * found.frequencies, rel=1e-10)
    # The body's own moments of inertia are no parameter; those of point masses are.
    one = column(masses=(M_1,), stiffness=(K,))
    known = sensitivities(modes(one), geometry=False)
    f = np.sqrt(K / M_1) / (2 * np.pi * LENGTH)
    assert known.of("mass.tip") == pytest.approx([-0.5 * f / M_1])
    assert known.of("stiffness.joint1") == pytest.approx([0.5 * f / K])


def test_repeated_modes_part_as_a_subspace():
    """A softer leg parts the pair: the slopes are those of the subspace, whatever its basis."""
    known = sensitivities(modes(load("stewart-simscape")), geometry=False)
    elastic = load("stewart-simscape")
    h = 2e3
    ends = [modes(elastic.with_springs({"leg1": 20e6 + s * h})).frequencies for s in (1, -1)]
    slopes = (ends[0] - modes(elastic).frequencies) / h
    assert known.of("stiffness.leg1")[:2] == pytest.approx(slopes[:2], rel=1e-3, abs=1e-9)


def test_intervals():
    found = modes(column(masses=(M_1,), stiffness=(K,)))
    f = found.frequencies
    band = accuracy(found, Tolerances(stiffness=0.1)).interval
    assert band.deviations == pytest.approx(0.05 * f)
    assert band.high - f == pytest.approx(1.959964 * 0.05 * f)
    with pytest.raises(InputError, match="level"):
        accuracy(found, Tolerances(stiffness=0.1), level=1.0)
    with pytest.raises(UndefinedError, match="tolerance"):
        accuracy(found)


def test_intervals_of_repeated_modes_hold_for_both():
    """Softer and stiffer legs part the pair; drawn legs stay within."""
    elastic, rng = load("stewart-simscape"), np.random.default_rng(3)
    found = modes(elastic)
    band = accuracy(found, Tolerances(stiffness=0.02)).interval
    assert band.deviations[0] == pytest.approx(band.deviations[1])
    drawn = np.array(
        [
            modes(elastic.with_springs(20e6 * (1 + 0.02 * rng.normal(size=6)))).frequencies
            for _ in range(400)
        ]
    )
    sd = np.sqrt(((drawn - found.frequencies) ** 2).mean(axis=0))
    assert (sd < 1.1 * band.deviations).all()
    assert (sd > 0.5 * band.deviations).all()
    alone = [2, 5]
    assert sd[alone] == pytest.approx(band.deviations[alone], rel=0.1)


def test_measured_springs_give_intervals_by_themselves(tmp_path):
    """Covariances in the file, also of a tie, against differences of the modes."""
    names = ["shoulder_lift_joint", "elbow_joint"]
    tied = [["wrist_1_joint"] * 2 + [1.0], ["wrist_2_joint"] * 2 + [1.0]]
    compliances = [
        *({"name": n, "value": 1e-5} for n in names),
        {"name": "wrists", "value": 1e-4, "elements": tied},
    ]
    roots = np.array([[1e-6, 0.0, 0.0], [4e-7, 8e-7, 0.0], [3e-6, -2e-6, 5e-6]])
    springs = {n: {"stiffness": 1e5} for n in load("ur5").names}
    springs |= {n: {"stiffness": 1e4} for n in ("wrist_1_joint", "wrist_2_joint")}
    file = write_file(
        tmp_path,
        "measured",
        kind="serial",
        model="ur5",
        springs=springs,
        identified={
            "compliances": compliances,
            "covariance": (roots @ roots.T).tolist(),
            "degrees": 20.0,
            "level": 0.9,
        },
    )
    arm, W = load(file), [0.0, 20.0, 0.0, 0.0, 300.0, -500.0]
    band = accuracy(modes(arm, wrench=W)).interval
    variance = sum(
        (n.per * (modes(n.more, wrench=W).frequencies - modes(n.less, wrench=W).frequencies)) ** 2
        for n in neighbours(arm)
    )
    assert band.deviations == pytest.approx(np.sqrt(variance), rel=1e-5)
    assert (band.high - band.low) / 2 == pytest.approx(1.724718 * band.deviations, rel=1e-6)
    # Another level keeps the degrees of freedom: Student's t with 20 of them.
    assert accuracy(modes(arm, wrench=W), level=0.99).factor == pytest.approx(2.845340, rel=1e-6)
    told = answer("modes", file)["intervals"]
    assert told["level"] == 0.9


def test_flutter_has_no_sensitivities():
    W = [0.0, 0.0, 0.0, -3.0 * K / LENGTH, 0.0, 0.0]
    with pytest.raises(UndefinedError, match="flutter"):
        sensitivities(modes(column(), wrench=W, load_kind="follower"))


@pytest.mark.parametrize("wrench", [None, [0.0, 0.0, 0.0, 200.0, -300.0, 0.0]])
def test_more_springs_than_freedoms_share_the_load_as_analyse_does(tmp_path, wrench):
    """Open rest positions of a closed chain: differences of whole answers, masses and springs."""
    text = (ROBOTS / "five-bar.yaml").read_text("utf-8")
    more = "\n  left_elbow: {stiffness: 300}\n  right_elbow: {stiffness: 200}\ngravity: [0,-9.81,0]"
    last = "  right_motor: {stiffness: 800}"
    assert last in text
    text = text.replace(last, last + more).replace("five-bar.urdf", str(ROBOTS / "five-bar.urdf"))
    (tmp_path / "five.yaml").write_text(text)
    elastic = load(tmp_path / "five.yaml")
    known = sensitivities(analyse(elastic, wrench=wrench))
    masses = elastic.mechanism.masses()

    def squares(group, name, value):
        if group == "mass":
            other = replace(elastic, mechanism=elastic.mechanism.with_masses({name: value}))
        else:
            other = elastic.with_springs(stiffness={name: value})
        return modes(other, wrench=wrench).squares

    seen = 0
    for i, name in enumerate(known.names):
        group, _, what = name.partition(".")
        if group not in ("mass", "stiffness"):
            continue
        x = masses[what] if group == "mass" else known.values[i]
        ends = [squares(group, what, x * (1 + h)) for h in (1e-4, -1e-4)]
        slope = (ends[0] - ends[1]) / (2e-4 * x)
        assert known.squares[i] == pytest.approx(slope, rel=1e-6), name
        seen += 1
    assert seen == 8


def test_more_lines_than_motions_share_the_load_as_analyse_does(tmp_path):
    """Eight lines whose rest lengths are open: the preload of least norm changes with a spring."""
    rng = np.random.default_rng(3)
    anchors, points = rng.uniform(-1, 1, (8, 3)), 0.2 * rng.uniform(-1, 1, (8, 3))

    def lines(anchors, points, stiffness):
        data = {"kind": "springs", "base": anchors.tolist(), "platform": points.tolist()}
        return load(write_file(tmp_path, **data, legs={"stiffness": stiffness.tolist()}))

    elastic = lines(anchors, points, 10 ** rng.uniform(4, 5, 8))
    wrench = [1.0, -2.0, 3.0, 400.0, -300.0, 900.0]
    known = sensitivities(analyse(elastic, wrench=wrench))
    names = [n for n in known.names if n.startswith(("stiffness", "platform.leg2"))]
    assert len(names) == 11
    for name in names:
        i = known.index(name)

        def K(x, name=name):
            p = points.copy()
            k = elastic.springs.stiffness.copy()
            if name.startswith("platform"):
                p[1, "xyz".index(name[-1])] = x
            else:
                k[int(name[-1]) - 1] = x
            other = lines(anchors, p, k)
            return analyse(other, wrench=wrench).A.matrix

        x = known.values[i]
        h = 1e-4 * (abs(x) if name.startswith("stiffness") else 1.0)
        slope = (K(x + h) - K(x - h)) / (2 * h)
        assert np.abs(known.stiffness["A"][i] - slope).max() <= 2e-6 * np.abs(slope).max(), name
