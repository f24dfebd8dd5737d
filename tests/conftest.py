"""Settings shared by all tests."""

from __future__ import annotations

import gc
import os
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings

from cartstiff.recorded import execution

ROOT = Path(__file__).resolve().parents[1]
if str(ROOT) not in sys.path:  # `from tests.support import ...` works however pytest is started
    sys.path.insert(0, str(ROOT))

# Recorded programs are hundreds of thousands of objects that live long: the collector would look
# through them again and again. What is imported and collected stays for good.
gc.set_threshold(50_000, 20, 50)


# `make test` leaves the slow repetitions to `make thorough`, which sets this.
THOROUGH = os.environ.get("CARTSTIFF_THOROUGH", "") == "1"
# `make test ROOM=...` names files, and leaves their slow cases out as well.
QUICK = os.environ.get("CARTSTIFF_QUICK", "") == "1"
SLOW = frozenset(
    line
    for line in (ROOT / "tests/thorough.txt").read_text(encoding="utf-8").splitlines()
    if not line.startswith("#")
)


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Leave out what is marked `thorough` or listed in thorough.txt, unless a file is named."""
    is_file = any(Path(name.partition("::")[0]).suffix == ".py" for name in config.args)
    if (QUICK or not is_file) and not THOROUGH:
        is_later = [i.nodeid in SLOW or bool(i.get_closest_marker("thorough")) for i in items]
        later = [item for item, left in zip(items, is_later, strict=True) if left]
        config.hook.pytest_deselected(items=later)
        items[:] = [item for item, left in zip(items, is_later, strict=True) if not left]


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
