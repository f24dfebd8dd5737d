"""A sweep is refined where its curves break off, jump, or may do so between two postures."""

from __future__ import annotations

import numpy as np

from cartstiff.page.refining import widest_jump

MISSING = {"reason": "not reached"}


def row(value, margin=1.0):
    values = None if value is None else [value] * 3
    return {"translation": values, "rotation": values, "margins": [margin]}


def refined(function, count=61, finest=64):
    """Where a sweep of [0, 1] is computed."""
    rows = {float(x): function(x) for x in np.linspace(0, 1, count)}
    for _ in range(2 * count):
        x = widest_jump(rows, 1 / (count - 1) / finest)
        if x is None:
            break
        rows[x] = function(x)
    return sorted(rows)


def test_smooth_curves_need_no_more():
    assert len(refined(lambda x: row(1 + x))) == 61
    assert len(refined(lambda x: MISSING)) == 61


def test_a_curve_that_breaks_off_is_followed_to_its_end():
    at = refined(lambda x: row(1.0) if x < 0.4321 else MISSING)
    assert min(abs(x - 0.4321) for x in at) < 1 / 60 / 64


def test_a_spike_is_followed():
    at = np.array(refined(lambda x: row(1 / (abs(x - 0.5031) + 1e-3))))
    assert np.abs(at - 0.5031).min() < 2e-3


def test_a_band_between_two_postures_is_found_by_its_margin():
    """A cable is taut within 0.003 of 0.508, between 0.5 and 0.5167."""
    at = refined(
        lambda x: row(10.0 if abs(x - 0.508) < 0.003 else 1.0, 0.003**2 - (x - 0.508) ** 2)
    )
    inside = [x for x in at if abs(x - 0.508) < 0.003]
    assert len(inside) > 2
