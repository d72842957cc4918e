"""Writes campaign folders that `glider.campaign.reader` reads.

What is unknown, or as it is by default, is omitted from campaign.yaml.
"""

import dataclasses
import io
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from glider.campaign import logs
from glider.campaign.logs import Campaign, Flight, ServoLog
from glider.errors import InputError
from glider.files import schema
from glider.files.writing import replace_files
from glider.physics.parameters import MAX_ANGLE

_TIMES = {"time", logs.COMMAND_TIME}


def save_campaign(
    path: Path | str, campaign: Campaign, more: Mapping[str, str] | None = None
) -> None:
    """Writes a folder that load_campaign reads, all of it or nothing.

    Args:
        path: of the folder.
        campaign: to write; its path is not used.
        more: texts of other files, by name.

    Raises:
        InputError: the folder has flights that are not of this campaign.
    """
    path = Path(path)
    names = {flight.name for flight in campaign.flights}
    if others := {file.name for file in path.glob("flight_*.csv")} - names:
        raise InputError(
            f"{path}: holds {min(others)}, which is not of this campaign; "
            "expected an empty folder."
        )
    limits = campaign.elevator_limits
    vehicle = campaign.vehicle | {
        "elevator_limits": list(limits) if limits else None,
        "elevator_rate_limit": campaign.elevator_rate_limit,
        "elevator": None if campaign.elevator == "servo" else campaign.elevator,
    }
    is_usual = campaign.servo == ServoLog()
    fields = {
        "vehicle": {name: own for name, own in vehicle.items() if own is not None},
        "pose_rate": campaign.pose_rate,
        "command_rate": campaign.command_rate,
        "servo": None if is_usual else dataclasses.asdict(campaign.servo),
        "notes": list(campaign.notes) or None,
    }
    files = {flight.name: flight_csv(flight) for flight in campaign.flights}
    files |= {name: words.encode() for name, words in (more or {}).items()}
    files["campaign.yaml"] = schema.yaml_text(fields).encode()
    replace_files(path, files, last="campaign.yaml")


def flight_csv(flight: Flight) -> bytes:
    """Returns the CSV of a flight, with its names of columns in the first line.

    Numbers have nine digits, times 15. Angles of a tumble are in ±π.
    """
    x, z, pitch = flight.pose.T
    names = logs.POSE_COLUMNS
    columns = [flight.time, x, z, _wrap(pitch)]
    if flight.elevator is not None and flight.command is not None:
        names += logs.SERVO_COLUMNS
        columns += [flight.elevator, flight.command]
        if flight.command_time is not None:
            names += (logs.COMMAND_TIME,)
            columns.append(flight.command_time)
    if flight.attitude is not None:
        y, roll, yaw = flight.attitude.T
        names += logs.ATTITUDE_COLUMNS
        columns += [y, _wrap(roll), _wrap(yaw)]
    buffer = io.BytesIO()
    np.savetxt(
        buffer,
        np.column_stack(columns),
        fmt=["%.15g" if name in _TIMES else "%.9g" for name in names],
        delimiter=",",
        header=",".join(names),
        comments="",
    )
    return buffer.getvalue()


def _wrap(angle: np.ndarray) -> np.ndarray:
    """Angles (n,), wrapped into ±π where they pass a full turn [rad]."""
    if np.any(np.abs(angle) > MAX_ANGLE):
        return np.angle(np.exp(1j * angle))
    return angle
