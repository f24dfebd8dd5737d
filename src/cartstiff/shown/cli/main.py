"""The command ``cartstiff``: its subcommands are imported when they are called."""

from __future__ import annotations

import atexit
import gc
import io
import os
import sys
from importlib import import_module
from typing import Any

import click

from cartstiff.core.errors import CartstiffError, UndefinedError, check_name, one_line
from cartstiff.shown.cli.output import say
from cartstiff.version import __version__

EXIT_INPUT = 2
EXIT_UNDEFINED = 3
EXIT_INTERNAL = 70

# Name: (module, one line of help). The modules import numpy and Pinocchio; --help does
# not.
_COMMANDS = {
    "analyse": (
        "cartstiff.shown.cli.analyse",
        "Stiffness at a posture: matrices, deflection, share of each joint, softest "
        "direction.",
    ),
    "equilibrium": (
        "cartstiff.shown.cli.equilibrium",
        "Where a mechanism comes to rest under a load, and whether it is stable there.",
    ),
    "compare": (
        "cartstiff.shown.cli.compare",
        "Two mechanisms, or one with other parameters, side by side with ratios.",
    ),
    "view": (
        "cartstiff.shown.cli.view",
        "Open a page in the browser: move the mechanism, see its stiffness.",
    ),
    "export": (
        "cartstiff.shown.cli.view",
        "Write the page of `view` as one file for any browser.",
    ),
    "report": (
        "cartstiff.shown.cli.view",
        "Write a report to send on: the answer, pictures, numbers in one HTML file.",
    ),
    "map": (
        "cartstiff.shown.cli.map",
        "Stiffness over a grid, a trajectory or random postures, in a file and "
        "a picture.",
    ),
    "path": (
        "cartstiff.shown.cli.path",
        "The stiffest postures along a path.",
    ),
    "modes": (
        "cartstiff.shown.cli.modes",
        "Natural frequencies under load, response, damping for an impedance controller.",
    ),
    "identify": (
        "cartstiff.shown.cli.identify",
        "Joint stiffness from measured loads and deflections, and what to measure.",
    ),
    "workspace": (
        "cartstiff.shown.cli.reach",
        "Workspace of a platform or cable robot, and the limits that end it.",
    ),
    "assemble": (
        "cartstiff.shown.cli.reach",
        "All poses of a platform or closed chain with the same leg lengths or drives.",
    ),
    "design": (
        "cartstiff.shown.cli.design",
        "Vary the parameters of a mechanism file, and find the best geometry.",
    ),
    "frames": (
        "cartstiff.shown.cli.frames",
        "Frames, joints, limits, springs and masses of a mechanism, as a tree.",
    ),
    "models": (
        "cartstiff.shown.cli.frames",
        "Names of mechanisms, example robots and published joint springs.",
    ),
}


#: Other spellings of commands.
_SPELLINGS = {"analyze": "analyse"}


class _LazyGroup(click.Group):
    def list_commands(self, ctx: click.Context) -> list[str]:  # noqa: ARG002
        return list(_COMMANDS)

    def get_command(self, ctx: click.Context, name: str) -> click.Command | None:  # noqa: ARG002
        name = _SPELLINGS.get(name, name)
        if name not in _COMMANDS:
            return None
        values = vars(import_module(_COMMANDS[name][0])).values()
        return next(v for v in values if isinstance(v, click.Command) and v.name == name)

    def resolve_command(self, ctx: click.Context, args: list[str]) -> Any:
        """Refuse an unknown command with the closest ones."""
        if args[0] not in _SPELLINGS and not args[0].startswith("-"):
            check_name("command", args[0], _COMMANDS)
        return super().resolve_command(ctx, args)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:  # noqa: ARG002
        with formatter.section("Commands"):
            formatter.write_dl([(name, text) for name, (_, text) in _COMMANDS.items()])


_HELP = """Compute how far a load moves a robot's tool, and why: the Cartesian stiffness of arms,
platforms, closed chains and cable robots, for every affine connection on SE(3).

\b
Examples:
  cartstiff analyse ur5 --load 0,0,0,0,0,-100 --world     # N, down, in the room's axes
  cartstiff equilibrium my_arm.urdf --springs kuka-kr210/gbt-adl-2023 --load 0,0,0,0,0,-300
  cartstiff models                                        # names of mechanisms and springs
  cartstiff analyse --help
"""  # noqa: E501


@click.group(
    name="cartstiff",
    cls=_LazyGroup,
    help=_HELP,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100},
)
@click.version_option(__version__, prog_name="cartstiff")
def command() -> None:
    """Group of all commands."""


def main(arguments: list[str] | None = None) -> None:
    """Run the command line; every refusal is one line on standard error.

    Exit codes: 0 done, 2 input that cannot be used, 3 with ``--strict`` something that
    does not exist, 70 a fault of cartstiff itself.
    """
    # Imports create many permanent objects: to look through them for garbage, while they
    # are made and once more at the end, would take a quarter of a short command.
    gc.set_threshold(400_000)
    atexit.register(gc.freeze)
    os.environ.setdefault(
        "PYDANTIC_DISABLE_PLUGINS", "__all__"
    )  # a search through all packages
    _open_closed_streams()
    for stream in (sys.stdout, sys.stderr):  # file names may not be valid text
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")
    try:
        code = command.main(arguments, prog_name="cartstiff", standalone_mode=False)
        sys.stdout.flush()
    except click.exceptions.Exit as error:
        code = error.exit_code
    except click.Abort:
        _say("interrupted")
        code = 130
    except click.exceptions.NoArgsIsHelpError:
        _say("no command was given (see 'cartstiff --help')")
        code = EXIT_INPUT
    except click.ClickException as error:
        context = error.ctx if isinstance(error, click.UsageError) else None
        see = f" (see '{context.command_path} --help')" if context else ""
        _say(one_line(error.format_message(), 600) + see)
        code = EXIT_INPUT
    except CartstiffError as error:
        name, code = "", EXIT_INPUT
        if isinstance(error, UndefinedError):
            name, code = f"{error.code}: ", EXIT_UNDEFINED
        _say(one_line(f"{name}{error}", 600))
    except SystemExit:  # raised by click for a closed pipe
        code = 0
    except BrokenPipeError:
        # The reader has closed the pipe (head, less); Python must not report it at exit.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        code = 0
    except OSError as error:  # a full disk, a path that is too long
        place = f"{one_line(error.filename, 200)}: " if error.filename else ""
        _say(f"{place}{one_line(error.strerror or str(error), 300)}")
        code = EXIT_INPUT
    except Exception as error:
        if os.environ.get("CARTSTIFF_TRACEBACK"):
            raise
        kind = type(error).__name__
        _say(
            f"internal error, please report it: {kind}: {one_line(str(error), 300)} "
            "(CARTSTIFF_TRACEBACK=1 shows where)"
        )
        code = EXIT_INTERNAL
    sys.exit(code if isinstance(code, int) else 0)


def _open_closed_streams() -> None:
    """Open streams that the caller has closed, so that no file gets their number."""
    for number, name in ((1, "stdout"), (2, "stderr")):
        if getattr(sys, name) is None:
            null = os.open(os.devnull, os.O_WRONLY)
            try:
                os.fstat(number)
            except OSError:
                os.dup2(null, number)
            setattr(sys, name, os.fdopen(null, "w"))


def _say(message: str) -> None:
    say(f"cartstiff: {message}", error=True)


if __name__ == "__main__":
    main()
