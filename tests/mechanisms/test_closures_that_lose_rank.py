"""Closures that lose rank: branches that cross, shaky structures, and harmless repetition."""

import mpmath
import numpy as np
import pytest
from tests.mechanisms.machines import codes, joint, note, write_file, write_urdf
from tests.support import refused

from cartstiff import DeadForce, UndefinedError, analyse, equilibrium, load

# Files hold all digits: what is zero is zero to rounding.
ROUNDING = 1e-12
SAME = 1e-10


def _closed(folder, urdf, closures, q=None, springs=None, frame="tip", actuated=(), **more):
    return load(
        write_file(
            folder,
            urdf.stem,
            kind="closed-chain",
            model=urdf.name,
            frame=frame,
            q=q or {},
            closures=closures,
            springs=springs or {},
            actuated=list(actuated),
            **more,
        )
    )


def _tie(a, b, p, q, kind="point"):
    return {"frames": [a, b], "type": kind, "points": [p, q]}


def _parallelogram(folder, crank=0.3, coupler=0.5, q=None, kind="point"):
    """Four-bar with equal cranks; at q = 0 all its bars lie on one line."""
    joints = [
        joint("left", "base", "left_crank"),
        joint("middle", "left_crank", "tip", at=(crank, 0, 0)),
        joint("right", "base", "right_crank", at=(coupler, 0, 0)),
    ]
    end = "right_crank"
    where = [crank, 0, 0]
    if kind == "weld":
        joints.append(joint("pin", "right_crank", "pinned", at=(crank, 0, 0)))
        end, where = "pinned", [0, 0, 0]
    urdf = write_urdf(folder, *joints, name=f"four-bar-{kind}")
    return _closed(
        folder,
        urdf,
        [_tie("tip", end, [coupler, 0, 0], where, kind)],
        q=q,
        springs={"left": {"stiffness": 12.0}},
        actuated=["left"],
    )


def test_flat_parallelogram(tmp_path):
    """On one line the parallelogram and its crossed twin meet: two ways to go."""
    elastic = _parallelogram(tmp_path)
    result = analyse(elastic)
    found = note(result, "constraint-singularity")
    assert set(result.matrices.values()) == {None}
    assert result.wrench is None
    refused(r"branches of motion (cross|meet)", result.tensor, "A", kind=UndefinedError)
    assert found.values["rank"] == 1
    values = np.array(found.values["singular_values"])
    assert values[0] > 0.1
    assert values[1:].max() <= ROUNDING
    second = np.array(found.values["second_order"])
    assert second.min() < -0.01
    assert second.max() > 0.01
    # The parallelogram's own motion is among those named, and keeps the closure all the way.
    motions = np.array(found.values["motions"])
    order = [elastic.names.index(n) for n in ("left", "middle", "right")]
    parallel = np.empty(3)
    parallel[order] = [1.0, -1.0, 1.0]
    inside = motions.T @ np.linalg.lstsq(motions.T, parallel)[0]
    assert np.abs(inside - parallel).max() <= ROUNDING
    for t in (1e-3, 0.1, 1.0):
        assert np.abs(elastic.mechanism.at(t * parallel).residual).max() <= ROUNDING
    caught = refused("branches of motion", analyse, elastic, strict=True, kind=UndefinedError)
    assert caught.code == "constraint-singularity"


@pytest.mark.parametrize("kind", ["point", "weld"])
def test_open_parallelogram_is_not_flagged(tmp_path, kind):
    """Off the line one freedom is left; planar closures repeat rows and nothing is made of it."""
    a = 0.7
    q = {"left": a, "middle": -a, "right": a} | ({"pin": -a} if kind == "weld" else {})
    elastic = _parallelogram(tmp_path, q=q, kind=kind)
    result = analyse(elastic)
    closure = result.posture.closure.jacobian
    assert np.linalg.matrix_rank(closure) < len(closure)
    assert codes(result) == ["fewer-than-six-freedoms"]
    # The coupler moves on circles of the crank's radius: k / r^2 along the tangent.
    U, K = result.reduction.reachable, result.reduction.reachable_stiffness
    assert U.shape == (6, 1)
    tangent = U[:, 0]
    assert np.abs(tangent[[0, 1, 2, 5]]).max() <= ROUNDING
    assert K[0, 0] == pytest.approx(12.0 / 0.3**2 * (tangent @ tangent), rel=SAME)


def test_two_bars_at_full_stretch(tmp_path):
    """Rigid to second order only: it gives a little, and its closure forces are undetermined."""
    urdf = write_urdf(
        tmp_path,
        joint("a", "base", "one"),
        joint("b", "one", "tip", at=(0.5, 0, 0)),
        name="shaky",
    )
    ties = [_tie("tip", "base", [0.3, 0, 0], [0.8, 0, 0])]
    springs = {"a": {"stiffness": 5.0}, "b": {"stiffness": 2.0}}
    result = analyse(_closed(tmp_path, urdf, ties, springs=springs))
    assert codes(result) == ["non-regular-redundancy"]
    assert result.matrices["B"] is None
    found = note(result, "non-regular-redundancy")
    values = np.array(found.values["singular_values"])
    assert values[found.values["rank"] :].max() <= ROUNDING * values[0]
    second = np.array(found.values["second_order"])
    assert np.abs(second).max() > 0.01
    assert (second.min() > 0.0) != (second.max() < 0.0)
    # b turns so that the ends stay: (l1 + l2) a + l2 b = 0.
    (motion,) = np.array(found.values["motions"])
    assert motion @ [0.8, 0.3] == pytest.approx(0.0, abs=ROUNDING)
    assert abs(motion[0]) > 0.1


# Pivots and ends, on one line, of the three bars that carry a body.
PIVOTS = np.array([0.0, 0.4, -0.3])
ENDS = np.array([0.5, 0.7, 0.9])


def _three_bars(folder):
    joints = [joint("a", "base", "one"), joint("b", "one", "tip", at=(ENDS[0], 0, 0))]
    ties = []
    for i in (1, 2):
        joints.append(joint(f"c{i}", "base", f"bar{i}", at=(PIVOTS[i], 0, 0)))
        at_tip, along_bar = ENDS[i] - ENDS[0], ENDS[i] - PIVOTS[i]
        ties.append(_tie("tip", f"bar{i}", [at_tip, 0, 0], [along_bar, 0, 0]))
    urdf = write_urdf(folder, *joints, name="three-bars")
    springs = {"a": {"stiffness": 5.0}}
    return _closed(folder, urdf, ties, springs=springs, passive=["b", "c1", "c2"])


def test_three_bars_in_line_block_to_second_order(tmp_path):
    """One combination of the two lost rows is definite: nothing moves, no branches cross.

    With y, phi the body's motion across and about the line, bar i of length l_i at s_i along the
    body gives x = s_i phi^2 / 2 - (y + s_i phi)^2 / (2 l_i), and the x of two bars must agree.
    """

    def form(i):
        s, length = ENDS[i] - ENDS[0], ENDS[i] - PIVOTS[i]
        across = np.array([1.0, s])
        return np.diag([0.0, s]) - np.outer(across, across) / length

    assert np.linalg.eigvalsh(form(2) - form(0)).min() > 0.1
    result = analyse(_three_bars(tmp_path))
    assert codes(result) == ["non-regular-redundancy"]
    assert result.matrices["B"] is None
    assert note(result, "non-regular-redundancy").values["rank"] == 2


@pytest.mark.parametrize(("tilt", "held"), [(1e-7, 3), (1e-9, 2), (1e-11, 0)])
def test_axes_that_are_not_quite_parallel_are_named(tmp_path, tilt, held):
    """The plate of a planar machine askew by a rounded angle: three closures hold by that alone."""
    circle = {"base": {"radius": 0.4}, "platform": {"radius": 0.1}, "crank": 0.25, "rod": 0.25}
    legs = {"chain": "RRR", "symmetry": 4, "stiffness": 2e4, **circle}
    askew, straight = (
        load(
            write_file(
                tmp_path,
                f"m{i}",
                kind="parallel",
                legs=legs,
                pose={"xyz": [0, 0, 0], "rpy": [roll, 0, 0.2]},
            )
        )
        for i, roll in enumerate((tilt, 0.0))
    )
    elastic = askew
    rest = equilibrium(elastic, DeadForce([1.0, -2.0, 0.0]))
    chain = elastic.mechanism.at(elastic.q)
    mp = mpmath.mp.clone()
    mp.dps = 50
    # Angles beside distances over the length: welds have three rows of each.
    sizes = np.tile(np.repeat([1.0, chain.length], 3), len(chain.closure.jacobian) // 6)
    scaled = chain.closure.jacobian * chain.coordinate_lengths / sizes[:, None]
    exact = mp.svd_r(mp.matrix(scaled), compute_uv=False)
    for result in (analyse(elastic), rest.stiffness):
        said = note(result, "near-constraint-singularity").values
        assert (said["held"], said["free"]) == (held, 3 - held)
        shares = np.array(said["singular_values"]) / said["singular_values"][0]
        expected = [float(exact[i] / exact[0]) for i in range(12)]
        np.testing.assert_allclose(shares[:9], expected[:9], rtol=1e-3)
        np.testing.assert_allclose(shares[9:], expected[9:], rtol=1e-3, atol=1e-15)
    assert "near-constraint-singularity" not in codes(analyse(straight))
