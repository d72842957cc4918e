"""The command line `glider`, which is also `python -m glider`."""

import argparse
import importlib.metadata
import io
import os
import sys
import warnings
from collections.abc import Sequence
from types import ModuleType

from glider.commands import (
    check_funnel,
    close_the_loop,
    compare,
    doctor,
    import_logs,
    next_throw,
    rehearse,
    samples,
)
from glider.commands.parsing import CommandParser
from glider.errors import (
    INTERRUPTED,
    INTERRUPTED_CODE,
    InputError,
    os_error_line,
    print_warning,
)

_COMMANDS: dict[str, tuple[ModuleType | None, str]] = {
    "close-the-loop": (close_the_loop, "find what the model lacks, from flight logs"),
    "compare": (compare, "show what changed between the reports of two campaigns"),
    "next-throw": (next_throw, "propose the most informative next throws"),
    "rehearse": (rehearse, "tell which effects the flights of a campaign would show"),
    "import": (import_logs, "convert logs of other software into a campaign"),
    "fly": (None, "fly throws live, with a real or a simulated glider"),
    "lab": (None, "run a session in the lab, with the loop closed between throws"),
    "make-funnel": (None, "make a funnel of the launches from which a glider perches"),
    "check-funnel": (check_funnel, "check a saved funnel in exact arithmetic"),
    "samples": (samples, "list the campaigns that ship with this package"),
    "doctor": (doctor, "check this installation"),
}
"""Their modules and what they do, in the order of the help; a command of `diagrams` has
none here, but an entry point in pyproject.toml."""

_MISSING = (
    "the package diagrams is not installed, or registers no commands here: install "
    "drake-glider again (make setup, or pip install .)"
)


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs the command line; returns the exit code."""
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="replace")  # Of "±", where there is only ASCII.
    parser = make_parser()
    try:
        try:
            args = parser.parse_args(arguments)
            with warnings.catch_warnings():
                warnings.simplefilter("default", UserWarning)
                warnings.showwarning = print_warning
                return args.run(args)
        finally:
            sys.stdout.flush()
    except BrokenPipeError:  # The reader of our output has enough of it: `| head -1`.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1
    except InputError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    except OSError as error:
        print(f"error: {os_error_line(error)}", file=sys.stderr)
        return 2
    except ModuleNotFoundError as error:
        if error.name is None or error.name.split(".")[0] in ("glider", "diagrams"):
            raise
        print(f"error: {_not_installed(error.name)}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print(INTERRUPTED, file=sys.stderr)
        return INTERRUPTED_CODE


def _not_installed(module: str) -> str:
    """Advice where a library is missing: mostly, take another Python."""
    return (
        f"{module} is not installed for {sys.executable}; use the Python of the "
        "environment that drake-glider is installed in (.venv/bin/python after make "
        "setup), or install it here with pip install . "
        "(python -m glider doctor checks an installation)."
    )


class _Version(argparse.Action):
    """Prints the version, which only an installed package has."""

    def __call__(self, parser, *args):
        try:
            print(importlib.metadata.version("drake-glider"))
        except importlib.metadata.PackageNotFoundError:
            parser.exit(2, f"error: {_not_installed('drake-glider')}\n")
        parser.exit()


def make_parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="glider", description="A toolkit for a perching glider, built on Drake."
    )
    parser.add_argument("--version", action=_Version, nargs=0)
    commands = parser.add_subparsers(
        required=True, metavar="COMMAND", parser_class=CommandParser
    )
    registered = _registered()
    for name, (own, words) in _COMMANDS.items():
        command = own or registered.get(name)
        if command is None:
            # With another prefix, options of the command are arguments like any.
            subparser = commands.add_parser(
                name, help=_MISSING, add_help=False, prefix_chars="\0"
            )
            subparser.add_argument("ignored", nargs="*")
            subparser.set_defaults(run=_refuse)
            continue
        subparser = commands.add_parser(
            name,
            help=words,
            description=command.DESCRIPTION,
            epilog=getattr(command, "EPILOG", None),
            formatter_class=argparse.RawDescriptionHelpFormatter,
        )
        command.add_arguments(subparser)
        subparser.set_defaults(run=command.run)
    return parser


def _registered() -> dict[str, ModuleType]:
    """Returns the commands that the installed package registers, by their names."""
    try:
        points = importlib.metadata.distribution("drake-glider").entry_points
    except importlib.metadata.PackageNotFoundError:
        return {}
    found = {}
    for point in points.select(group="glider.commands"):
        try:
            found[point.name] = point.load()
        except ModuleNotFoundError as error:
            if (error.name or "").split(".")[0] != "diagrams":
                raise
    return found


def _refuse(args: argparse.Namespace) -> int:
    raise InputError(f"{_MISSING}.")


if __name__ == "__main__":
    sys.exit(main())
