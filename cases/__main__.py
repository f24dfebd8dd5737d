"""``python -m cases``: run the published cases and write the table."""

from __future__ import annotations

import sys
import time
from pathlib import Path

import click

from cartstiff import CartstiffError, InputError
from cases.case import read_cases
from cases.run import run_case, table, tool


@click.command(
    context_settings={"help_option_names": ["-h", "--help"]},
    epilog="Example: python -m cases --with cases/plain_numpy.py",
)
@click.argument("folder", required=False, type=click.Path(path_type=Path))
@click.option(
    "--with",
    "files",
    multiple=True,
    type=click.Path(path_type=Path),
    help="Another tool: a Python file with a function answers(inputs, folder).",
)
@click.option("--only", multiple=True, help="Name of a case; the others are left out.")
def main(folder: Path | None, files: tuple[Path, ...], only: tuple[str, ...]) -> None:
    """Check published numbers about stiffness: FOLDER is one case, or holds many.

    The exit status is 1 if a value differs from what its case says.
    """
    started = time.monotonic()
    cases = list(read_cases(folder or Path(__file__).parent))
    names = {path.name for path, _ in cases}
    for name in only:
        if name not in names:
            raise InputError("no such case", where="--only", got=name)
    if only:
        cases = [(path, case) for path, case in cases if path.name in only]
    others = {path.stem: tool(path) for path in files}
    outcomes = []
    with click.progressbar(
        cases, label="cases", file=sys.stderr, hidden=not sys.stderr.isatty()
    ) as bar:
        for path, case in bar:
            outcomes += run_case(path, case, others)
    click.echo(table(cases, outcomes))
    wrong = [o for o in outcomes if not o.as_said]
    exact = sum(case.to_the_digit for _, case in cases)
    click.echo(
        f"\n{len(cases)} cases, {exact} of them to the printed digit; "
        f"{len({(o.case, o.asked.name) for o in outcomes})} values, "
        f"{len(wrong)} not as said, {time.monotonic() - started:.1f} s"
    )
    for o in wrong:
        click.echo(f"{o.case}, {o.asked.name}, {o.tool}: {o.words}", err=True)
    sys.exit(bool(wrong))


if __name__ == "__main__":
    try:
        main(standalone_mode=False)
    except click.ClickException as error:
        error.show()
        sys.exit(error.exit_code)
    except CartstiffError as error:
        click.echo(f"Error: {error}", err=True)
        sys.exit(2)
