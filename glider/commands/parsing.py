"""What the commands share: how one is added, and arguments that several have."""

import argparse
from collections.abc import Callable, Iterable
from pathlib import Path

from glider.errors import InputError, expect
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


Completer = Callable[..., Iterable[str]]
"""Proposes words for the TAB key; the keyword `prefix` is what is typed already."""


def complete(argument: argparse.Action, completer: Completer) -> None:
    """Sets what the TAB key proposes for an argument, which is files otherwise."""
    argument.completer = completer  # type: ignore[attr-defined]


def complete_sample(**typed: object) -> Iterable[str]:
    """Proposes the samples."""
    from glider.campaign.samples import sample_names

    return sample_names()


def complete_campaign(prefix: str, **typed: object) -> Iterable[str]:
    """Proposes the samples, folders and .zip files."""
    from argcomplete.completers import FilesCompleter

    return [*complete_sample(), *FilesCompleter("zip")(prefix)]


def complete_effects(prefix: str, **typed: object) -> Iterable[str]:
    """Proposes effects that the list has not."""
    from glider.physics.effects import KINDS

    before, comma, _ = prefix.rpartition(",")
    return [before + comma + kind for kind in KINDS if kind not in before.split(",")]


def names(text: str) -> list[str]:
    """Splits names at commas."""
    return [name.strip() for name in text.split(",") if name.strip()]


def add_out(parser: argparse.ArgumentParser, files: str, default: str) -> None:
    """Adds --out, the folder of what a command writes."""
    words = f"where to write {files} (default: {default})"
    parser.add_argument("--out", type=Path, metavar="DIR", help=words)


def add_json(parser: argparse._ActionsContainer, words: str) -> None:
    """Adds --json, which prints that instead of text for people."""
    parser.add_argument("--json", action="store_true", help=f"print {words}")


def add_seed(parser: argparse.ArgumentParser, words: str) -> None:
    """Adds --seed, of what is drawn at random; see `check_seed`."""
    help = f"{words} (default: 0)"
    parser.add_argument("--seed", metavar="N", type=int, default=0, help=help)


def check_seed(seed: int) -> None:
    """Raises InputError where a seed is negative."""
    expect(seed >= 0, "--seed", seed, "0 or more")


def output_folder(out: Path | None, campaign: Path, *parts: str) -> Path:
    """The folder to write to, --out or out/CAMPAIGN/parts, checked to be writable."""
    name = campaign.resolve().name.removesuffix(".zip")
    folder = out or Path("out", name, *parts)
    if folder.exists() and not folder.is_dir():
        raise InputError(f"--out {folder}: is a file; expected a folder.")
    check_writable(folder)
    return folder
