"""Many nonlinear parameters of a closed chain, as in `benchmarks/identify_many_unknowns.py`."""

from scipy import stats
from tests.doors import unknowns_of
from tests.identify.campaigns import LOOP_UNKNOWNS, bent_loop

from cartstiff.identify import identify


def test_the_fit_of_a_loop_with_many_unknowns_ends(tmp_path):
    """What the rows hardly feel holds up nothing; what they determine comes back."""
    guess, true, measured = bent_loop(tmp_path, 16)
    steps = []
    result = identify(
        guess,
        measured,
        sought=LOOP_UNKNOWNS,
        loaded=True,
        progress=lambda step, size: steps.append((step, size)),
    )
    truth = unknowns_of(true, LOOP_UNKNOWNS).nominal
    assert len(truth) == 34
    assert steps[-1][1] < steps[0][1]
    chi, freedom = result.checks.chi_squared, result.checks.freedom
    assert stats.chi2.sf(chi, freedom) > 1e-3
    far = [
        abs(e.compliance - c) / e.deviation
        for e, c in zip(result.estimates, truth, strict=True)
        if e.verdict == "determined"
    ]
    assert len(far) >= 12
    assert max(far) < 4.0
