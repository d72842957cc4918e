"""Flights of a recording: the steps of an import in their order, in memory."""

import dataclasses
from pathlib import Path

import numpy as np

from glider.campaign.csv_table import Table, table_of
from glider.campaign.importing.clock import find_offset, shift
from glider.campaign.importing.cutting import cut
from glider.campaign.importing.mapping import Mapping
from glider.campaign.importing.raw import RawTable
from glider.campaign.importing.readers import read_raw
from glider.campaign.importing.selection import select
from glider.campaign.importing.servo import make_servo
from glider.campaign.importing.track import (
    Track,
    angles_of,
    make_track,
    turn_along,
)
from glider.campaign.logs import Campaign


@dataclasses.dataclass(frozen=True, kw_only=True)
class CutFlight:
    """A flight of a recording, as a table in SI and the axes of this project."""

    table: Table
    rows: int
    begin: float  # On the clock of the recording [s].
    end: float
    why: str  # Why it begins and ends there.


@dataclasses.dataclass(frozen=True, kw_only=True)
class CutRecording:
    """The flights of a recording, and what there is to tell of it."""

    path: Path
    flights: tuple[CutFlight, ...]
    told: tuple[str, ...]


def map_flight(file: Path, mapping: Mapping, settings: Campaign) -> Table:
    """Returns a file that is one flight as a table in SI; nothing is cut.

    Args:
        file: of any text dialect.
        mapping: of its columns.
        settings: what is known of the vehicle.

    Raises:
        InputError: it cannot be mapped.
    """
    track = make_track(select(read_raw(file), mapping), mapping.frame, mapping.source)
    track, _ = _on_one_clock(track, [track], mapping)
    flight = turn_along(track) if track.along_throw else track
    columns, _ = _columns(flight, settings, mapping.source)
    return table_of(file, columns)


def cut_recording(raw: RawTable, mapping: Mapping, settings: Campaign) -> CutRecording:
    """Returns the flights in a recording.

    Raises:
        InputError: it cannot be mapped, or its clocks do not fit.
    """
    track = make_track(select(raw, mapping), mapping.frame, mapping.source)
    cuts, told = cut(track)
    track, words = _on_one_clock(track, [c.track for c in cuts], mapping)
    told += words
    flights = []
    for found in cuts:
        whole = dataclasses.replace(
            found.track,
            elevator=track.elevator,
            rate_command=track.rate_command,
            angle_command=track.angle_command,
        )
        flight = turn_along(whole) if track.along_throw else whole
        columns, words = _columns(flight, settings, mapping.source)
        told += [word for word in words if word not in told]
        begin, end = float(flight.time[0]), float(flight.time[-1])
        columns["time"] = columns["time"] - begin
        flights.append(
            CutFlight(
                table=table_of(raw.path, columns),
                rows=len(flight.time),
                begin=begin,
                end=end,
                why=f"{found.begin}; {found.end}",
            )
        )
    return CutRecording(path=raw.path, flights=tuple(flights), told=tuple(told))


def _on_one_clock(
    track: Track, flights: list[Track], mapping: Mapping
) -> tuple[Track, list[str]]:
    """Returns a recording with all logs on the clock of its poses, and what was done."""
    others = (track.elevator, track.rate_command, track.angle_command)
    foreign = any(s is not None and s.clock != track.clock for s in others)
    clock = mapping.clock or ("find" if foreign else "same")
    if clock == "same" or not flights:
        return track, []
    if clock != "find":
        return shift(track, float(clock)), [f"clock: shifted by {clock:g} s, as told"]
    offset = find_offset(track, flights)
    if offset is None:
        return track, []
    words = (
        f"clock: the elevator's is {offset.seconds:+.3f} s ahead of that of the poses "
        f"(correlation {offset.correlation:.2f}); it was shifted back"
    )
    if track.elevator is None or track.elevator.clock == track.clock:
        words += ", and a delay of the servo, if any, with it"
    return shift(track, offset.seconds), [words]


def _columns(
    flight: Track, settings: Campaign, source: str
) -> tuple[dict[str, np.ndarray], list[str]]:
    """Returns the columns of a campaign's file, and what was made of servo logs."""
    pitch, sideways = angles_of(flight)
    columns = {
        "time": flight.time,
        "x": flight.position[:, 0],
        "z": flight.position[:, 2],
        "pitch": _centered(pitch),
    }
    servo = make_servo(flight, settings, source)
    if servo is not None:
        columns |= {"elevator": servo.elevator, "elevator_rate_command": servo.command}
    if sideways is not None:
        columns |= {
            "y": flight.position[:, 1],
            "roll": _centered(sideways[:, 0]),
            "yaw": _centered(sideways[:, 1]),
        }
    return columns, [f"servo: {servo.told}"] if servo and servo.told else []


def _centered(angle: np.ndarray) -> np.ndarray:
    """Returns an unwrapped angle (n,) without whole turns in its mean [rad]."""
    turn = 2.0 * np.pi
    return angle - turn * np.round(np.mean(angle) / turn)
