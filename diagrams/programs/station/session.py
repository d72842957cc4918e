"""The folder of a session: the records of its throws, and their campaign.

The record of the throw that runs takes messages at any time, and writes them when
nothing is more urgent.
"""

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
from diagrams.programs.station.throw import Throw
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
        self._log: ThrowLog | None = None  # The record of the throw that runs.
        self._waiting: list[tuple[str, float, dict[str, object]]] = []
        self.fault = ""  #: Why nothing can be recorded.
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
        self._recover()

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
            self._lock.close()
            raise InputError(
                f"{others[0]}: is of another glider (simulated with other effects, or "
                "real); expected a new folder."
            )

    def _records(self) -> list[Path]:
        return sorted(self.folder.glob("throw_*.mcap"))

    def _recover(self) -> None:
        """Makes flights of records that were not closed."""
        for record in self._records():
            known = record in self._useless
            if not known and not (self.folder / _flight_name(record)).exists():
                try:
                    self._save(record)
                except InputError as error:
                    self._useless.add(record)
                    self._show(f"skipped: {error}")

    def open(self) -> bool:
        """Begins a record, unless one has begun; returns whether there is one."""
        try:
            self._log = self._log or self._new_log()
        except OSError as error:
            self.fault = f"no record can be written: {error.strerror}"
            return False
        self.fault = ""
        return True

    def add(self, topic: str, when: float, **values: object) -> None:
        """Takes a message of a time by our clock [s]."""
        if self._log is not None:
            self._waiting.append((topic, when, values))

    def write(self) -> None:
        """Writes what has been taken; where that fails, there is no record any more."""
        waiting = self._waiting
        self._waiting = []
        if self._log is None:
            return
        try:
            for topic, when, values in waiting:
                self._log.add(topic, when, **values)
        except OSError as error:
            self.fault = f"the record cannot be written: {error.strerror}"
            self._log.abandon()
            self._log = None

    def finish(self, throw: Throw, now: float) -> None:
        """Ends the record of a throw, and makes it a flight."""
        self.add("/event", now, **vars(throw.result))
        self.write()
        throw.reason = throw.reason or self.fault
        log = self._log
        self._log = None
        if log is None:
            return
        try:
            log.close()
            throw.file = self._save(log.path)
        except (OSError, InputError) as error:
            throw.reason = throw.reason or f"its record ends early: {error}"

    def close(self) -> None:
        """Removes a record that holds no throw; another station may have the folder."""
        if self._log is not None:
            with contextlib.suppress(OSError):
                self._log.close()
            self._log.path.unlink(missing_ok=True)
            self._log = None
        self._lock.close()

    def _new_log(self) -> ThrowLog:
        """Begins the record of the next throw."""
        self._recover()
        # A flight without a record keeps its number, too.
        files = [*self._records(), *self.folder.glob("flight_*.csv")]
        names = [file.stem.partition("_")[2] for file in files]
        numbers = [int(name) for name in names if name.isdecimal()]
        number = max(numbers, default=0) + 1
        facts = self._facts | {"begun": _now()}
        return ThrowLog(self.folder / f"throw_{number:03d}.mcap", facts)

    def _save(self, record: Path) -> Path | None:
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
