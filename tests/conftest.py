"""Settings shared by all tests."""

from __future__ import annotations

import gc
import sys
from pathlib import Path

from hypothesis import HealthCheck, settings

ROOT = Path(__file__).resolve().parents[1]
if str(ROOT) not in sys.path:  # `from tests.support import ...` works however pytest is started
    sys.path.insert(0, str(ROOT))

# Recorded programs are hundreds of thousands of objects that live long: the collector would look
# through them again and again. What is imported and collected stays for good.
gc.set_threshold(50_000, 20, 50)


def pytest_collection_finish() -> None:
    """Nothing that exists by now is garbage later."""
    gc.freeze()


# No deadline: a slow machine is not a wrong result. Derandomised: a run can be repeated.
settings.register_profile(
    "cartstiff",
    deadline=None,
    derandomize=True,
    database=None,
    max_examples=40,
    suppress_health_check=[HealthCheck.too_slow],
)
settings.load_profile("cartstiff")
