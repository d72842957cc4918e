"""Arguments that several commands have."""

import argparse
import math
from pathlib import Path
from typing import NoReturn

from glider.errors import InputError
from glider.files.writing import check_writable


def names(text: str) -> list[str]:
    """Splits names at commas; each counts once."""
    parts = (name.strip() for name in text.split(","))
    return list(dict.fromkeys(filter(None, parts)))


class CommandParser(argparse.ArgumentParser):
    """A parser with arguments that several commands have."""

    def add_campaign(self) -> None:
        """Adds the campaign that a command works on."""
        words = "folder of flight logs, or the name of a sample"
        self.add_argument("campaign", type=Path, help=words)

    def add_effects(self, name: str, words: str) -> None:
        """Adds an option for names of effects."""
        self.add_argument(name, metavar="NAME,...", type=names, help=words)

    def add_path(self, name: str, metavar: str, words: str) -> None:
        """Adds an option for a file or folder."""
        self.add_argument(name, type=Path, metavar=metavar, help=words)

    def add_out(self, files: str, default: str) -> None:
        """Adds --out, the folder of what a command writes."""
        self.add_path("--out", "DIR", f"where to write {files} (default: {default})")

    def add_switch(self, name: str, words: str) -> None:
        """Adds an option without a value."""
        self.add_argument(name, action="store_true", help=words)

    def add_json(self, words: str) -> None:
        """Adds --json, which prints that instead of text for people."""
        self.add_switch("--json", f"print {words}")

    def add_number(
        self,
        name: str,
        words: str,
        default: float | None = None,
        *,
        kind: type[int] | type[float] = int,
        least: float = 0,
        most: float = math.inf,
    ) -> None:
        """Adds an option for an integer, or a finite float, within bounds."""
        expected = "an integer" if kind is int else "a number"
        expected += f" of at least {least}"
        if most < math.inf:
            expected += f" and at most {most}"

        def read(text: str) -> float:
            try:
                value = kind(text)
            except ValueError:
                value = math.nan
            if not (least <= value <= most and math.isfinite(value)):
                raise argparse.ArgumentTypeError(f"{text} is not {expected}")
            return value

        self.add_argument(name, metavar="N", type=read, default=default, help=words)

    def add_cluster(self) -> None:
        """Adds --cluster, whose workers do what is done in parallel."""
        words = (
            "scheduler of Dask, such as tcp://host:8786, whose workers do what is done "
            "in parallel (default: threads of this computer)"
        )
        self.add_argument("--cluster", metavar="ADDRESS", help=words)

    def add_seed(self, words: str) -> None:
        """Adds --seed, of what is drawn at random."""
        self.add_number("--seed", f"{words} (default: 0)", 0)

    def error(self, message: str) -> NoReturn:
        """Raises InputError where arguments cannot be parsed."""
        raise InputError(f"{message}.")


def default_folder(campaign: Path, *parts: str) -> Path:
    """The folder out/CAMPAIGN/parts, where what is made of a campaign is written."""
    return Path("out", campaign.resolve().name, *parts)


def output_folder(out: Path | None, campaign: Path, *parts: str) -> Path:
    """The folder to write to, --out or out/CAMPAIGN/parts, checked to be writable."""
    folder = out or default_folder(campaign, *parts)
    if folder.exists() and not folder.is_dir():
        raise InputError(f"--out {folder}: is a file; expected a folder.")
    foreign = (folder / "model.yaml").exists() > (folder / "report.json").exists()
    if foreign or (folder / "campaign.yaml").exists():
        raise InputError(
            f"--out {folder}: has a campaign.yaml, or a model.yaml without the report "
            "that it belongs to; expected another folder."
        )
    check_writable(folder)
    return folder
