"""Flights of a recording: the steps of an import in their order, in memory."""

import dataclasses
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from glider.campaign.flight_reader import with_flights
from glider.campaign.flight_table import Table
from glider.campaign.importing.clock import find_offsets, shift
from glider.campaign.importing.cutting import Cut, cut
from glider.campaign.importing.mapping import Mapping
from glider.campaign.importing.readers import read_recording
from glider.campaign.importing.recording import Recording
from glider.campaign.importing.selection import Stream, select
from glider.campaign.importing.servo_logs import make_servo
from glider.campaign.importing.track import Track, angles_of, make_track, turn_along
from glider.campaign.logs import Campaign
from glider.physics.parameters import GliderParameters


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
    track = make_track(
        select(read_recording(file), mapping), mapping.frame, mapping.source
    )
    whole = Cut(track=track, begin="", end="")
    [(track, _)] = _on_one_clock([track], [[whole]], mapping)
    flight = turn_along(track) if track.along_throw else track
    columns, _ = _columns(flight, settings, mapping.source)
    return Table(path=file, columns=columns)


def cut_recordings(
    raws: Sequence[Recording], mapping: Mapping, settings: Campaign
) -> tuple[CutRecording, ...]:
    """Returns the flights in recordings.

    Raises:
        InputError: one cannot be mapped, or its clocks do not fit.
    """
    tracks = [
        make_track(select(raw, mapping), mapping.frame, mapping.source) for raw in raws
    ]
    gravity = settings.vehicle.get("gravity", GliderParameters().gravity)
    cuts = [cut(track, gravity) for track in tracks]
    clocked = _on_one_clock(tracks, [flights for flights, _ in cuts], mapping)
    return tuple(
        _cut_recording(track, flights, told + words, mapping, settings)
        for (track, words), (flights, told) in zip(clocked, cuts, strict=True)
    )


def campaign_of_cuts(
    settings: Campaign, recordings: Sequence[CutRecording]
) -> Campaign:
    """Returns the flights of recordings as a campaign, numbered in their order.

    Raises:
        InputError: one cannot be a flight in SI.
    """
    tables = [flight.table for recording in recordings for flight in recording.flights]
    campaign = with_flights(settings, tables)
    flights = tuple(
        dataclasses.replace(flight, name=f"flight_{i:03d}.csv")
        for i, flight in enumerate(campaign.flights)
    )
    return dataclasses.replace(campaign, flights=flights)


def _cut_recording(
    track: Track, cuts: list[Cut], told: list[str], mapping: Mapping, settings: Campaign
) -> CutRecording:
    flights = []
    for found in cuts:
        whole = dataclasses.replace(
            found.track,
            elevator=track.elevator,
            rate_command=track.rate_command,
            angle_command=track.angle_command,
        )
        flight = turn_along(whole) if track.along_throw else whole
        columns, of_servo = _columns(flight, settings, mapping.source)
        told = told + [word for word in of_servo if word not in told]
        begin, end = float(flight.time[0]), float(flight.time[-1])
        columns["time"] = columns["time"] - begin
        flights.append(
            CutFlight(
                table=Table(path=track.path, name="flight", columns=columns),
                rows=len(flight.time),
                begin=begin,
                end=end,
                why=f"{found.begin}; {found.end}",
            )
        )
    return CutRecording(path=track.path, flights=tuple(flights), told=tuple(told))


def _on_one_clock(
    tracks: list[Track], flights: list[list[Cut]], mapping: Mapping
) -> list[tuple[Track, list[str]]]:
    """Returns recordings with all logs on their poses' clocks, and what was done."""
    clock = mapping.clock or ("find" if any(map(_has_two_clocks, tracks)) else "same")
    if clock == "same":
        return [(track, []) for track in tracks]
    if clock != "find":
        told = [f"clock: shifted by {clock:g} s, as told"]
        return [(shift(track, float(clock)), told) for track in tracks]
    flying = [i for i, cuts in enumerate(flights) if cuts and _has_servo(tracks[i])]
    result: list[tuple[Track, list[str]]] = [(track, []) for track in tracks]
    if not flying:
        return result
    offsets = find_offsets([(tracks[i], [c.track for c in flights[i]]) for i in flying])
    for i, offset in zip(flying, offsets, strict=True):
        error = "" if offset.std is None else f" ± {offset.std:.3f}"
        words = (
            f"clock: the elevator's is {offset.seconds:+.3f}{error} s ahead of that of "
            f"the poses (correlation {offset.correlation:.2f}); it was shifted back"
        )
        if tracks[i].elevator is None or not _has_two_clocks(tracks[i]):
            words += ", and a delay of the servo, if any, with it"
        result[i] = (shift(tracks[i], offset.seconds), [words])
    return result


def _logs(track: Track) -> list[Stream]:
    logs = (track.elevator, track.rate_command, track.angle_command)
    return [stream for stream in logs if stream is not None]


def _has_two_clocks(track: Track) -> bool:
    return any(stream.clock != track.clock for stream in _logs(track))


def _has_servo(track: Track) -> bool:
    """Whether there is something that another log could follow."""
    measured = track.elevator is not None and track.elevator.clock == track.clock
    return len(_logs(track)) > int(measured) and (
        measured or track.elevator is not None or track.angle_command is not None
    )


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
