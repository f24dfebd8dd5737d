"""Settings shared by all tests."""

from __future__ import annotations

import gc
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings

from cartstiff.batch import execution

ROOT = Path(__file__).resolve().parents[1]
if str(ROOT) not in sys.path:  # `from tests.support import ...` works however pytest is started
    sys.path.insert(0, str(ROOT))

# Recorded programs are hundreds of thousands of objects that live long: the collector would look
# through them again and again. What is imported and collected stays for good.
gc.set_threshold(50_000, 20, 50)


def pytest_collection_finish() -> None:
    """Nothing that exists by now is garbage later."""
    gc.freeze()


@pytest.fixture(scope="module", autouse=True)
def _machine_code(request: pytest.FixtureRequest) -> Iterator[None]:
    """Our vector code as it is: LLVM takes five times as long to make a third of its steps fewer.

    Files with ``OPTIMISED = True`` have the machine code that users have.
    """
    wanted = execution.OPTIMISATION
    execution.OPTIMISATION = wanted if getattr(request.module, "OPTIMISED", False) else 0
    yield
    execution.OPTIMISATION = wanted


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
