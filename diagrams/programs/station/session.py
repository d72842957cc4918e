"""The folder of a session: the records of its throws, and their campaign."""

import contextlib
import dataclasses
import datetime
import functools
import importlib.metadata
import platform
from collections.abc import Callable
from pathlib import Path

from diagrams.programs.station.controllers import Guidance
from diagrams.programs.station.scenario import Scenario
from diagrams.programs.station.throw_log import ThrowLog, flight_of, read_throw
from glider.campaign.logs import ServoLog, campaign_of
from glider.campaign.settings import read_settings
from glider.campaign.writer import flight_csv, save_campaign
from glider.errors import InputError
from glider.errors import show as show_value
from glider.files import schema
from glider.files.lock import FolderLock
from glider.files.writing import replace_file, write_text
from glider.physics.model import model_text

_SAME = (
    *("vehicle", "elevator", "elevator_limits", "elevator_rate_limit"),
    *("pose_rate", "command_rate", "servo"),
)
"""What all flights of a folder have in common."""


class Session:
    """Numbers throws and makes them flights of a campaign that close-the-loop reads.

    In the folder campaign.yaml stands from the start, throw_NNN.mcap grows from the
    moment the station is ready, and flight_NNN.csv appears whole when a throw is over.
    Records that a killed process left become flights when the folder is opened again,
    or before the next throw; damaged ones stay as they are, and are shown.

    Args:
        folder: of the session; it may hold throws of the same glider.
        scenario: what is flown.
        guidance: plan and model.
        show: is given each line for the operator.

    Raises:
        InputError: the folder holds another campaign, or another station writes to it.
    """

    def __init__(
        self,
        folder: Path,
        scenario: Scenario,
        guidance: Guidance,
        show: Callable[[str], object] = print,
    ) -> None:
        self.folder = folder
        self._show = show
        self._useless: set[Path] = set()  # Records without a flight.
        truth = scenario.truth
        self._facts = {
            "scenario": schema.yaml_text(scenario),
            "model": model_text(guidance.model),
            "truth": model_text(truth) if truth else "",
            "plan": schema.json_text(guidance.plan, indent=0),
            "versions": schema.yaml_text(_versions()),
        }
        campaign = campaign_of(
            folder.name,
            guidance.model.parameters,
            (),
            scenario.sensors.rate,
            scenario.command_rate or scenario.sensors.rate,
        )
        error = scenario.sensors.clock_std
        log = ServoLog(command_std=error)
        if not scenario.sensors.elevator:
            log = ServoLog(angle="reconstructed", clock_std=error)
        campaign = dataclasses.replace(campaign, servo=log)
        file = folder / "campaign.yaml"
        if file.exists():
            known, _ = read_settings(file)
            for name in _SAME:
                ours = getattr(campaign, name)
                theirs = getattr(known, name)
                if ours != theirs:
                    raise InputError(
                        f"{file}: is of another session (its {name} is "
                        f"{show_value(theirs)}, ours {show_value(ours)}); expected a "
                        "new folder."
                    )
        else:
            save_campaign(folder, campaign)
            text = f"# Begun {_now()}.\n{file.read_text(encoding='utf-8')}"
            write_text(file, text)
        self._lock = FolderLock(folder / ".station", folder, "station")
        self._check_truth()
        self.recover()

    def close(self) -> None:
        """Lets another station have the folder."""
        self._lock.close()

    def _check_truth(self) -> None:
        """Refuses throws of another simulated glider, or of a real one."""
        records = self._records()
        ours = self._facts["truth"]
        # No station has recorded these, so they may be of a real glider.
        lone = ours and not records
        others = sorted(self.folder.glob("flight_*.csv")) if lone else []
        for record in records:
            with contextlib.suppress(InputError):
                if read_throw(record)[0].get("truth", ours) != ours:
                    others.append(record)
        if others:
            self.close()
            raise InputError(
                f"{others[0]}: is of another glider (simulated with other effects, or "
                "real); expected a new folder."
            )

    def _records(self) -> list[Path]:
        return sorted(self.folder.glob("throw_*.mcap"))

    def recover(self) -> None:
        """Makes flights of records that were not closed."""
        for record in self._records():
            known = record in self._useless
            if not known and not (self.folder / _flight_name(record)).exists():
                try:
                    self.save(record)
                except InputError as error:
                    self._useless.add(record)
                    self._show(f"skipped: {error}")

    def new_log(self) -> ThrowLog:
        """Begins the record of the next throw."""
        self.recover()
        # A flight without a record keeps its number, too.
        files = [*self._records(), *self.folder.glob("flight_*.csv")]
        names = [file.stem.partition("_")[2] for file in files]
        numbers = [int(name) for name in names if name.isdecimal()]
        number = max(numbers, default=0) + 1
        facts = self._facts | {"begun": _now()}
        return ThrowLog(self.folder / f"throw_{number:03d}.mcap", facts)

    def save(self, record: Path) -> Path | None:
        """Writes the flight of a record; None where there is too little of one."""
        flight = flight_of(record)
        if flight is None:
            self._useless.add(record)
            return None
        file = self.folder / flight.name
        text = flight_csv(flight)
        replace_file(file, functools.partial(Path.write_bytes, data=text))
        return file


def _flight_name(record: Path) -> str:
    return record.with_suffix(".csv").name.replace("throw", "flight")


def _now() -> str:
    """The time of day, with its date and time zone."""
    return datetime.datetime.now().astimezone().isoformat("T", "seconds")


def _versions() -> dict[str, str]:
    names = ("drake-glider", "drake", "numpy", "numba", "mcap")
    found = {name: importlib.metadata.version(name) for name in names}
    return {"python": platform.python_version()} | found
