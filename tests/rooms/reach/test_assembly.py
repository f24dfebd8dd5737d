"""Solutions of leg lengths, singular architectures, and starts of the search for assembly modes."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.inner import architecture_of, orientation_rank, poses_of_lengths
from tests.inner import platform_assembly as study
from tests.mechanisms.test_assembly_modes import FICHTER, _random_platform

import cartstiff


@given(st.integers(0, 10_000))
@settings(max_examples=4)
def test_a_pose_is_among_those_of_its_own_lengths(seed):
    """Real solutions are even in number, complex ones come in pairs; nothing is lost."""
    platform, q = _random_platform(seed)
    poses, counts, paths, _ = poses_of_lengths(platform, platform.leg_lengths(q))
    assert paths.is_complete
    assert paths.single == 40
    assert paths.real % 2 == 0
    assert len(poses) == paths.real == counts.sum()
    assert np.abs(poses - platform.pose_of(q)).max(axis=(1, 2)).min() < 1e-7


def test_the_start_platform_is_solved():
    Q, x = study.general_platform()
    assert x.shape == (40, 8)
    assert np.abs(study.values(Q, x)).max() < 1e-11
    overlap = np.abs(x.conj() @ x.T) - np.eye(40)
    assert overlap.max() < 1 - 1e-4


def test_regular_architectures_and_singular_orientations():
    fichter = cartstiff.load(FICHTER)
    platform = fichter.mechanism
    assert not architecture_of(platform).is_singular
    assert orientation_rank(platform, platform.pose_of(fichter.q)[:3, :3]) == 5
    assert orientation_rank(platform, np.eye(3)) == 6
    assert not architecture_of(cartstiff.load("hexapod").mechanism).is_singular


@pytest.mark.parametrize("name", ["five-bar", "delta"])
def test_starts_closed_at_once_end_where_the_engine_ends(name, monkeypatch):
    """Where recorded steps close a start, the mode is one of those found one by one."""
    from tests.inner import assembly

    elastic, seen = cartstiff.load(name), []
    monkeypatch.setattr(assembly, "_MAX_SINGLE_STARTS", 0)
    quick = cartstiff.assemble(elastic, starts=25, progress=lambda *far: seen.append(far))
    assert (seen[0], seen[-1]) == ((1, 26), (26, 26))
    none = np.zeros(26, bool)
    monkeypatch.setattr(
        assembly, "Closer", lambda *_, **__: lambda q: (q, none[: len(q)], none[: len(q)])
    )
    slow = cartstiff.assemble(elastic, starts=25)
    assert 2 <= len(quick) <= len(slow)
    for mode in quick:
        assert mode.residual < 1e-9
        assert np.abs(slow.poses - mode.pose).max(axis=(1, 2)).min() < 1e-7
    np.testing.assert_allclose(quick[0].q, slow[0].q, atol=1e-9)
