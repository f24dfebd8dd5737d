"""What hypothesis and seeded generators draw: twists, poses, wrenches."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from tests.support.oracles import exp_reference


def rotation(rng: np.random.Generator) -> np.ndarray:
    return Rotation.random(random_state=rng).as_matrix()


def random_pose(rng: np.random.Generator, size: float = 1.0) -> np.ndarray:
    T = np.eye(4)
    T[:3, :3] = rotation(rng)
    T[:3, 3] = rng.uniform(-size, size, 3)
    return T


_unit_floats = st.floats(-1, 1, allow_nan=False, width=64)
_axes = (
    st.tuples(_unit_floats, _unit_floats, _unit_floats)
    .map(np.array)
    .filter(lambda a: np.linalg.norm(a) > 0.1)
    .map(lambda a: a / np.linalg.norm(a))
)
_vectors = st.tuples(*[st.floats(-2, 2, allow_nan=False)] * 3).map(np.array)
_tiny = st.floats(-9, -3).map(lambda e: 10.0**e)
ROTATION_ANGLES = {
    "generic": st.floats(0.05, 3.0),
    "small": st.floats(1e-3, 0.2),  # where series hand over to closed forms
    "near identity": _tiny,
    "near pi": _tiny.map(lambda e: np.pi - e),
    "at pi": st.just(np.pi),
    "zero": st.just(0.0),
}


@st.composite
def twists(draw: Any, kinds: Sequence[str] = tuple(ROTATION_ANGLES)) -> np.ndarray:
    """Twists (omega, v) with generic, tiny, near-pi, exactly-pi and zero rotation angles."""
    angle = draw(ROTATION_ANGLES[draw(st.sampled_from(list(kinds)))])
    v = draw(_vectors)
    if draw(st.booleans()) and angle < 1e-2:
        v = v * angle  # the whole motion near the identity, not only its rotation
    return np.concatenate([angle * draw(_axes), v])


def poses(kinds: Sequence[str] = tuple(ROTATION_ANGLES)) -> st.SearchStrategy[np.ndarray]:
    return twists(kinds).map(exp_reference)


wrenches = st.tuples(*[st.floats(-5, 5, allow_nan=False)] * 6).map(np.array)
plain_twists = st.tuples(*[st.floats(-2, 2, allow_nan=False)] * 6).map(np.array)
seeds = st.integers(0, 2**32 - 1)
