"""Writes campaign folders that `glider.campaign.reader` reads."""

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


def save_campaign(path: Path | str, campaign: Campaign) -> None:
    """Writes a folder that load_campaign reads; campaign.path is not used."""
    path = Path(path)
    path.mkdir(parents=True, exist_ok=True)
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
    (path / "campaign.yaml").write_text(text, encoding="utf-8")
    for flight in campaign.flights:
        save_flight(path / flight.name, flight)


def save_flight(path: Path | str, flight: Flight) -> None:
    """Writes one flight_*.csv, nine digits (time: fifteen, for epoch times).

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
    np.savetxt(
        path,
        np.column_stack(columns),
        fmt=["%.15g"] + ["%.9g"] * (len(names) - 1),
        delimiter=",",
        header=",".join(names),
        comments="",
    )


def _wrap(angle: np.ndarray) -> np.ndarray:
    """Returns angles (n,) wrapped into ±π where they pass a full turn [rad]."""
    if np.any(np.abs(angle) > MAX_ANGLE):
        return np.angle(np.exp(1j * angle))
    return angle
