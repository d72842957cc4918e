"""What the commands share: how one is added, and arguments that several have."""

import argparse
from collections.abc import Callable
from pathlib import Path

from glider.errors import InputError
from glider.files.writing import check_writable

Commands = argparse._SubParsersAction
"""What `ArgumentParser.add_subparsers` returns."""


def add_command(
    commands: Commands,
    name: str,
    run: Callable[[argparse.Namespace], int],
    *,
    help: str,
    description: str,
    epilog: str | None = None,
) -> argparse.ArgumentParser:
    """Adds a command, whose `run` returns the exit code; texts keep their layout."""
    parser = commands.add_parser(
        name,
        help=help,
        description=description,
        epilog=epilog,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.set_defaults(run=run)
    return parser


def names(text: str) -> list[str]:
    """Splits names at commas."""
    return [name.strip() for name in text.split(",") if name.strip()]


def check_seed(seed: int) -> None:
    """Raises InputError where a seed is none."""
    if seed < 0:
        raise InputError(f"--seed is {seed}; expected 0 or more.")


def output_folder(out: Path | None, campaign: Path, *parts: str) -> Path:
    """The folder to write to, --out or out/CAMPAIGN/parts, checked to be writable."""
    name = campaign.resolve().name.removesuffix(".zip")
    folder = out or Path("out", name, *parts)
    if folder.exists() and not folder.is_dir():
        raise InputError(f"--out {folder}: is a file; expected a folder.")
    check_writable(folder)
    return folder
