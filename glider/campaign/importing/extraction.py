"""The steps of an import in their order, in memory: from recordings to flights."""

import dataclasses
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from glider.campaign.flight_reader import with_flights
from glider.campaign.flight_table import Table
from glider.campaign.importing.clock_offset import find_offsets, is_measured, shift
from glider.campaign.importing.cutting import Cut, cut
from glider.campaign.importing.mapping import Mapping
from glider.campaign.importing.readers import read_recording
from glider.campaign.importing.recording import Recording
from glider.campaign.importing.selection import select
from glider.campaign.importing.servo_logs import make_servo
from glider.campaign.importing.track import Track, angles_of, make_track, turn_along
from glider.campaign.logs import Campaign


@dataclasses.dataclass(frozen=True, kw_only=True)
class CutFlight:
    """A flight of a recording, as a table in SI and the axes of this project."""

    table: Table
    begin: float  # On the clock of the recording [s].
    end: float
    why: str  # Why it begins and ends there.


@dataclasses.dataclass(frozen=True, kw_only=True)
class CutRecording:
    """The flights of a recording, and notes on what was done to it."""

    path: Path
    flights: tuple[CutFlight, ...]
    notes: tuple[str, ...]


def map_flight(file: Path, mapping: Mapping, settings: Campaign) -> Table:
    """Converts a file that is one flight to a table in SI; nothing is cut."""
    track = make_track(select(read_recording(file), mapping), mapping)
    whole = Cut(track=track, why="")
    [(track, _)] = _on_one_clock([track], [[whole]], mapping)
    flight = turn_along(track) if track.along_throw else track
    columns, _ = _columns(flight, settings, mapping.source)
    return Table(path=file, columns=columns)


def cut_recordings(
    recordings: Sequence[Recording], mapping: Mapping, settings: Campaign
) -> tuple[CutRecording, ...]:
    """Finds the flights in recordings."""
    tracks = [make_track(select(r, mapping), mapping) for r in recordings]
    cuts = [cut(track, settings.gravity) for track in tracks]
    clocked = _on_one_clock(tracks, [flights for flights, _ in cuts], mapping)
    return tuple(
        _extract(track, flights, notes + of_clock, mapping, settings)
        for (track, of_clock), (flights, notes) in zip(clocked, cuts, strict=True)
    )


def campaign_of_cuts(
    settings: Campaign, recordings: Sequence[CutRecording]
) -> Campaign:
    """A campaign of the flights of recordings, numbered in their order."""
    tables = [flight.table for recording in recordings for flight in recording.flights]
    named = [
        dataclasses.replace(table, name=f"flight_{i:03d}.csv")
        for i, table in enumerate(tables)
    ]
    return with_flights(settings, named)


def _extract(
    track: Track,
    cuts: list[Cut],
    notes: list[str],
    mapping: Mapping,
    settings: Campaign,
) -> CutRecording:
    """Makes tables of the flights that were cut out of a recording."""
    flights = []
    for found in cuts:
        flight = dataclasses.replace(found.track, servo=track.servo)
        if track.along_throw:
            flight = turn_along(flight)
        columns, of_servo = _columns(flight, settings, mapping.source)
        notes = notes + [note for note in of_servo if note not in notes]
        begin, end = float(flight.time[0]), float(flight.time[-1])
        columns["time"] = columns["time"] - begin
        table = Table(path=track.path, columns=columns)
        flights.append(CutFlight(table=table, begin=begin, end=end, why=found.why))
    return CutRecording(path=track.path, flights=tuple(flights), notes=tuple(notes))


def _on_one_clock(
    tracks: list[Track], flights: list[list[Cut]], mapping: Mapping
) -> list[tuple[Track, list[str]]]:
    """Recordings with all logs on their poses' clocks, each with notes on it."""
    clock = mapping.clock or ("find" if any(map(_has_two_clocks, tracks)) else "same")
    result: list[tuple[Track, list[str]]] = [(track, []) for track in tracks]
    if clock == "same":
        return result
    if clock != "find":
        notes = [f"clock: shifted by {clock:g} s, as specified"]
        return [(shift(track, float(clock)), notes) for track in tracks]
    flying = [i for i, cuts in enumerate(flights) if cuts and _has_servo(tracks[i])]
    if not flying:
        return result
    offsets = find_offsets([(tracks[i], [c.track for c in flights[i]]) for i in flying])
    for i, offset in zip(flying, offsets, strict=True):
        error = "" if offset.std is None else f" ± {offset.std:.3f}"
        note = (
            f"clock: the elevator's is {offset.seconds:+.3f}{error} s ahead of that of "
            f"the poses (correlation {offset.correlation:.2f}); it was shifted back"
        )
        if tracks[i].servo.elevator is None or not _has_two_clocks(tracks[i]):
            note += ", and a delay of the servo, if any, with it"
        result[i] = (shift(tracks[i], offset.seconds), [note])
    return result


def _has_two_clocks(track: Track) -> bool:
    return any(log.clock != track.clock for log in track.servo.given)


def _has_servo(track: Track) -> bool:
    """Whether the elevator, or a command, can be compared with another log."""
    if is_measured(track):
        return len(track.servo.given) > 1
    return bool(track.servo.elevator or track.servo.angle_command)


def _columns(
    flight: Track, settings: Campaign, source: str
) -> tuple[dict[str, np.ndarray], list[str]]:
    """Columns of a campaign's file, and notes on what was made of servo logs."""
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
    return columns, [f"servo: {servo.note}"] if servo and servo.note else []


def _centered(angle: np.ndarray) -> np.ndarray:
    """An unwrapped angle (n,) without whole turns in its mean [rad]."""
    turn = 2.0 * np.pi
    return angle - turn * np.round(np.mean(angle) / turn)
