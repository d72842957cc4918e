"""Writes campaign folders that `glider.campaign.reader` reads."""

import io
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import yaml

from glider.campaign.logs import (
    ATTITUDE_COLUMNS,
    MAX_ANGLE,
    POSE_COLUMNS,
    SERVO_COLUMNS,
    Campaign,
    Flight,
)
from glider.errors import InputError
from glider.files.writing import replace_file, replace_files


def save_campaign(
    path: Path | str, campaign: Campaign, more: Mapping[str, str] | None = None
) -> None:
    """Writes a folder that load_campaign reads, all of it or nothing.

    Args:
        path: of the folder.
        campaign: its own path is not used.
        more: name of a file beside the flights to its text.
    """
    path = Path(path)
    names = {flight.name for flight in campaign.flights}
    if others := {file.name for file in path.glob("flight_*.csv")} - names:
        raise InputError(
            f"{path}: holds {min(others)}, which is not of this campaign; "
            "an empty folder is needed."
        )
    vehicle: dict = {name: float(value) for name, value in campaign.vehicle.items()}
    if campaign.elevator_limits is not None:
        vehicle["elevator_limits"] = [float(v) for v in campaign.elevator_limits]
    if campaign.elevator_rate_limit is not None:
        vehicle["elevator_rate_limit"] = float(campaign.elevator_rate_limit)
    if campaign.elevator != "servo":
        vehicle["elevator"] = campaign.elevator
    settings = {"vehicle": vehicle, "pose_rate": float(campaign.pose_rate)}
    if campaign.command_rate is not None:
        settings["command_rate"] = float(campaign.command_rate)
    text = yaml.safe_dump(settings, sort_keys=False)
    files = {flight.name: _csv_of(flight) for flight in campaign.flights}
    files |= {name: words.encode() for name, words in (more or {}).items()}
    files["campaign.yaml"] = text.encode()
    replace_files(path, files, last="campaign.yaml")


def save_flight(path: Path | str, flight: Flight) -> None:
    """Writes one flight_*.csv."""
    replace_file(Path(path), lambda file: file.write_bytes(_csv_of(flight)))


def _csv_of(flight: Flight) -> bytes:
    """Returns a flight's table, nine digits (time: fifteen, for epoch times).

    An angle that has tumbled beyond a full turn is wrapped into ±π, as motion
    capture logs it.
    """
    x, z, pitch = flight.pose.T
    names, columns = POSE_COLUMNS, [flight.time, x, z, _wrap(pitch)]
    if flight.elevator is not None and flight.command is not None:
        names += SERVO_COLUMNS
        columns += [flight.elevator, flight.command]
    if flight.attitude is not None:
        y, roll, yaw = flight.attitude.T
        names += ATTITUDE_COLUMNS
        columns += [y, _wrap(roll), _wrap(yaw)]
    buffer = io.BytesIO()
    np.savetxt(
        buffer,
        np.column_stack(columns),
        fmt=["%.15g"] + ["%.9g"] * (len(names) - 1),
        delimiter=",",
        header=",".join(names),
        comments="",
    )
    return buffer.getvalue()


def _wrap(angle: np.ndarray) -> np.ndarray:
    """Returns angles (n,) wrapped into ±π where they pass a full turn [rad]."""
    if np.any(np.abs(angle) > MAX_ANGLE):
        return np.angle(np.exp(1j * angle))
    return angle
