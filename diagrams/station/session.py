"""The folder of a session: the records of its throws, and the campaign of them."""

import dataclasses
import functools
import importlib.metadata
import platform
from pathlib import Path

from diagrams.station.controllers import Guidance
from diagrams.station.scenario import Scenario
from diagrams.station.throw_log import ThrowLog, flight_of
from glider.campaign.logs import ServoLog, campaign_of
from glider.campaign.settings import read_settings
from glider.campaign.writer import flight_csv, save_campaign
from glider.errors import InputError
from glider.files import schema
from glider.files.writing import replace_file
from glider.physics.model import model_text


class Session:
    """Numbers throws and makes them flights of a campaign that close-the-loop reads.

    In the folder campaign.yaml stands from the start, throw_NNN.mcap grows from the
    moment the station is ready, and flight_NNN.csv appears whole when a throw is over.
    Records that a killed process left become flights when the folder is opened again,
    or before the next throw.

    Args:
        folder: of the session; it may hold throws of the same glider.
        scenario: what is flown.
        guidance: plan and model.

    Raises:
        InputError: the folder holds another campaign.
    """

    def __init__(self, folder: Path, scenario: Scenario, guidance: Guidance) -> None:
        self.folder = folder
        self._facts = {
            "scenario": schema.yaml_text(scenario),
            "model": model_text(guidance.model),
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
        if not scenario.sensors.elevator:
            log = ServoLog(angle="reconstructed")
            campaign = dataclasses.replace(campaign, servo=log)
        file = folder / "campaign.yaml"
        if file.exists():
            known, _ = read_settings(file)
            if (known.vehicle, known.servo) != (campaign.vehicle, campaign.servo):
                raise InputError(
                    f"{file}: is of another glider; expected a new folder."
                )
        else:
            save_campaign(folder, campaign)
        self.recover()

    def recover(self) -> None:
        """Makes flights of records that were not closed."""
        for record in sorted(self.folder.glob("throw_*.mcap")):
            if not (self.folder / _flight_name(record)).exists():
                self.save(record)

    def new_log(self) -> ThrowLog:
        """Begins the record of the next throw."""
        self.recover()
        numbers = [
            int(name)
            for file in self.folder.glob("throw_*.mcap")
            if (name := file.stem.removeprefix("throw_")).isdecimal()
        ]
        number = max(numbers, default=0) + 1
        return ThrowLog(self.folder / f"throw_{number:03d}.mcap", self._facts)

    def save(self, record: Path) -> Path | None:
        """Writes the flight of a record; None where there is too little of one."""
        flight = flight_of(record)
        if flight is None:
            return None
        file, text = self.folder / flight.name, flight_csv(flight)
        replace_file(file, functools.partial(Path.write_bytes, data=text))
        return file


def _flight_name(record: Path) -> str:
    return record.with_suffix(".csv").name.replace("throw", "flight")


def _versions() -> dict[str, str]:
    names = ("drake-glider", "drake", "numpy", "numba", "mcap")
    found = {name: importlib.metadata.version(name) for name in names}
    return {"python": platform.python_version()} | found
