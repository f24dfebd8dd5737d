"""What a posture that is singular in more than one way says instead of numbers."""

from __future__ import annotations

import numpy as np
import pytest
from tests.inner import _inverse

from cartstiff import UndefinedError


def test_motions_that_cannot_be_told_apart_are_named():
    with pytest.raises(UndefinedError, match="singular in more than one way") as refused:
        _inverse(np.array([[1.0, 0.0], [0.0, 0.0]]), np.ones(2))
    assert refused.value.code == "ill-conditioned"
