"""The promise is frozen: what users hold on to stands in a committed table, within bounds.

`python tests/surface.py --write` writes the table again; what is new shows in its diff.
"""

from __future__ import annotations

import pytest
import yaml

from tests import surface

#: Bounds on options, of which a command takes only what serves it: each pair may cross. `compare`
#: has the set-up, --output and --with: 21 occurrences and 210 pairs above 330 and 4400; --at-points
#: is an option of `report`.
MOST = {"different": 92, "occurrences": 353, "pairs": 4670, "pairs outside the set-up": 720}
COMMANDS = 15


@pytest.mark.parametrize("kind", ["options", "names", "file keys", "json keys", "note codes"])
def test_the_surface_is_that_of_the_table(kind: str) -> None:
    table = yaml.safe_load(surface.TABLE.read_text(encoding="utf-8"))[kind]
    found = surface.surface()[kind]
    if isinstance(found, dict):
        table = {f"{name} {one}" for name, some in table.items() for one in some}
        found = {f"{name} {one}" for name, some in found.items() for one in some}
    assert sorted(set(found) - set(table)) == [], "new: write the table again if it is meant"
    assert sorted(set(table) - set(found)) == [], "gone: write the table again if it is meant"


def test_options_stay_few() -> None:
    found = surface.options()
    counted = surface.counted(found)
    assert {what: n for what, n in counted.items() if n > MOST[what]} == {}
    assert len(found) <= COMMANDS


def test_pairs_are_counted() -> None:
    by_command = {"one": ["--json", "--load", "--x", "--y"], "two": ["--x"]}
    assert surface.counted(by_command) == {
        "different": 4,
        "occurrences": 5,
        "pairs": 6,
        "pairs outside the set-up": 1,
    }
