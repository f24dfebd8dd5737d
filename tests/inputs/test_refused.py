"""What every command refuses: the rows of refusals.yaml, each asked in a folder of files."""

import pytest
from tests.identify.campaigns import SPRINGS, arm, load, random_campaign, table_of
from tests.inputs.refusals import cases, write

CASES = list(cases())


@pytest.fixture(scope="module")
def elbow(tmp_path_factory):
    """Files of a six-jointed arm, and a table of measurements of its springs."""
    folder = tmp_path_factory.mktemp("elbow")
    table_of(
        folder / "good.csv", *random_campaign(load(arm("elbow", folder)), SPRINGS["elbow"], 8, 1)
    )
    return {path.name: path.read_text(encoding="utf-8") for path in folder.iterdir()}


@pytest.mark.parametrize(
    ("section", "run", "says", "files"),
    CASES,
    ids=[f"{section}-{' '.join(run)[-40:]}-{says[0]}" for section, run, says, _ in CASES],
)
def test_what_is_refused(section, run, says, files, elbow, refused):
    write(elbow if section.startswith("identify") else {})
    write(files)
    refused(run, words=says)
