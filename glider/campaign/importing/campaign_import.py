"""`import_campaign`: logs of other software in, a campaign folder out, step by step."""

import dataclasses
import fnmatch
import itertools
from collections import Counter
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from glider.campaign.checks.signs import check_signs
from glider.campaign.checks.stamps import find_even_times
from glider.campaign.flights import with_flights
from glider.campaign.importing.advice import ORDERS, advise
from glider.campaign.importing.clock_offset import join_clocks
from glider.campaign.importing.cutting import cut
from glider.campaign.importing.frame_posterior import fly_all, judge
from glider.campaign.importing.readers import read_recording, read_recordings
from glider.campaign.importing.recording import Column, Group, Recording
from glider.campaign.importing.servo_logs import align_commands, make_servo, widen
from glider.campaign.importing.splitting import split_flights
from glider.campaign.importing.track import (
    ServoLogs,
    Track,
    angles_of,
    make_track,
    turn_along,
    within_pi,
)
from glider.campaign.logs import Campaign, ServoLog
from glider.campaign.settings import ColumnMapping, read_settings
from glider.campaign.writer import save_campaign
from glider.errors import InputError, expect, printable
from glider.files import schema
from glider.progress import Progress, announced, silent

_CLEARLY = 14.0  # Log odds above which an order is refused: a million to one.
_DOUBT = 3.0  # The same for a warning: twenty to one.
_REASONS = 3  # Number of reasons listed where recordings have no flight.


class _CutRecording(NamedTuple):
    """The flights of a recording, and notes on what was done to it."""

    path: Path
    flights: tuple[Track, ...]  #: Their times are on the clock of the recording.
    notes: tuple[str, ...]


@dataclasses.dataclass(frozen=True, kw_only=True)
class ImportResult:
    """A campaign, and what was done to get it."""

    campaign: Campaign  #: Its notes are what the flights do not show of the mapping.
    recordings: tuple[_CutRecording, ...]

    @property
    def empty(self) -> str:
        """How many recordings gave no flight; "" where each gave one."""
        empty = sum(not recording.flights for recording in self.recordings)
        if not empty:
            return ""
        return f"{empty} of {_count(self.recordings, 'recording')} gave no flight"

    @property
    def warnings(self) -> list[str]:
        """The campaign's notes, and recordings without flights if most are."""
        flying = sum(bool(recording.flights) for recording in self.recordings)
        few = 2 * flying < len(self.recordings)
        return [*self.campaign.notes, *[f"{self.empty}; is 'frame:' right?"] * few]

    @property
    def reasons(self) -> str:
        """The first notes on recordings, as on why they have no flight."""
        notes = (note for own in self.recordings for note in own.notes)
        noted = [*dict.fromkeys(notes)]
        return "; ".join([*noted[:_REASONS], "..."][: len(noted)])

    def report(self) -> dict[str, Any]:
        """All of it, as JSON has it; times are those of the recordings [s]."""
        cuts = [(own.path, piece) for own in self.recordings for piece in own.flights]
        flights = [
            {
                "name": flight.name,
                "recording": str(path),
                "begin": piece.span[0],
                "end": piece.span[1],
                "rows": len(piece.time),
                "why": piece.why,
            }
            for flight, (path, piece) in zip(self.campaign.flights, cuts, strict=True)
        ]
        notes = {str(recording.path): recording.notes for recording in self.recordings}
        return {"warnings": self.warnings, "flights": flights, "notes": notes}

    def describe(self) -> str:
        """Warnings, a line for each file, and the notes that several have."""
        counts = Counter(note for own in self.recordings for note in own.notes)
        lines = [f"warning: {words}" for words in self.warnings]
        for file, group in itertools.groupby(self.recordings, _file_of):
            parts = list(group)
            flights = [flight for part in parts for flight in part.flights]
            own = [n for part in parts for n in part.notes if counts[n] == 1]
            of = f" of {len(parts)} parts" if len(parts) > 1 else ""
            rows = sum(len(flight.time) for flight in flights)
            words = "; ".join([f"{_count(flights)}{of}, {rows} rows", *own[:2]])
            lines.append(f"{file}: {words}")
        lines += [f"{n} recordings: {note}" for note, n in counts.items() if n > 1]
        return "\n".join(map(printable, lines))


def _file_of(recording: _CutRecording) -> Path:
    """The file of a recording, which may be a part of it."""
    path = recording.path
    return next((p for p in (path, *path.parents) if p.exists()), path)


def import_campaign(
    files: Sequence[Path | str],
    mapping: Path | str,
    out: Path | str,
    *,
    force: bool = False,
    progress: Progress = silent,
) -> ImportResult:
    """Makes a campaign folder of logs, as a mapping specifies; reports what was done.

    Nothing is written unless all of it is right: the flights must fall down, nose
    ahead, and their forces and moments must have the signs that the mapping claims.

    Args:
        files: logs of any known format; each may hold several flights.
        mapping: the MAP file: `columns:`, `units:`, `frame:`, `vehicle:`, ...
        out: the folder to write.
        force: whether to overwrite a campaign there; logs are never overwritten.
        progress: called with each file that is read, and what comes after.

    Raises:
        InputError: a log cannot be read or mapped, or the mapping is wrong.
    """
    logs = {file.resolve() for file in as_files(files)}
    known = isinstance(out, (str, Path))
    expect(known, "out", out, "the path of the folder to write")
    for pattern in ("campaign.yaml", "import.json", "flight_*.csv"):
        for found in sorted(Path(out).glob(pattern)):
            if not force or found.resolve() in logs:
                raise InputError(
                    f"{found}: exists; expected a new folder (or --force)."
                )
    imported = read_flights(files, mapping, progress)
    report = schema.json_text(imported.report())
    save_campaign(out, imported.campaign, {"import.json": report + "\n"})
    return imported


def read_flights(
    files: Sequence[Path | str], mapping: Path | str, progress: Progress = silent
) -> ImportResult:
    """Makes what `import_campaign` writes."""
    known = isinstance(mapping, (str, Path))
    expect(known, "the mapping", mapping, "the path of a MAP file")
    settings, claim = read_settings(Path(mapping))
    if claim is None:
        raise InputError(
            f"{mapping}: has no 'columns:'; expected a mapping of the logs' columns "
            "(--guess proposes one)."
        )
    recordings = read_logs(as_files(files), claim, progress)
    progress("cutting the flights out, checking their axes and signs")
    settings = dataclasses.replace(settings, path=Path(mapping))

    def run(some: Sequence[Recording], claim: ColumnMapping) -> ImportResult:
        result = cut_recordings(some, claim, settings)
        campaign = result.campaign
        if not campaign.flights:
            raise InputError(
                f"{mapping}: no flight was found in "
                f"{_count(result.recordings, 'recording')}: {result.reasons} (are 'up' "
                "and the units right?)."
            )
        shown = [*check_signs(campaign), *_check_order(some, claim)]
        notes = tuple(dict.fromkeys((*campaign.notes, *shown)))
        campaign = dataclasses.replace(campaign, notes=notes)
        return dataclasses.replace(result, campaign=campaign)

    try:
        return run(recordings, claim)
    except InputError as error:
        raise advise(error, recordings, claim, run) from None


def _check_order(recordings: Sequence[Recording], claim: ColumnMapping) -> list[str]:
    """Warns of an order of Euler angles where another is likelier; refuses others."""
    own = claim.frame.rotation or ("ZYX" if "roll" in claim.columns else None)
    if own not in ORDERS:
        return []
    logs = [part for r in recordings for part in split_flights(r, claim.columns)]
    scores = {}
    for order in ORDERS:
        frame = dataclasses.replace(claim.frame, rotation=order)
        flights = fly_all(logs, dataclasses.replace(claim, frame=frame))
        scores[order] = judge(flights) if flights else 0.0
    best = max(scores, key=lambda order: scores[order])
    odds = scores[best] - scores[own]
    words = (
        f"frame: rotation: with {best} in place of {own} forces and the "
        f"direction of flight are {np.exp(min(odds, 99.0)):.3g} times as likely"
    )
    if odds > _CLEARLY:
        raise InputError(f"{claim.source}: {words}.")
    return [f"{words}: check which it is"] if odds > _DOUBT else []


def as_files(files: Iterable[Path | str]) -> list[Path]:
    """Paths of logs; InputError where there are none."""
    one = isinstance(files, (str, Path)) or not isinstance(files, Iterable)
    expect(not one, "files", files, "a list of paths of logs")
    listed = list(files)
    if not listed:
        raise InputError("no files were given; expected one log or more.")
    for file in listed:
        expect(isinstance(file, (str, Path)), "files", file, "paths of logs")
    return [Path(file) for file in listed]


def cut_recordings(
    recordings: Sequence[Recording],
    mapping: ColumnMapping,
    settings: Campaign,
    *,
    are_flights: bool = False,
) -> ImportResult:
    """Cuts the flights out of recordings, unless they are flights.

    Their campaign may be empty. Even steps are restored where the stamps of poses
    jitter, also to logs of the servo that have the same stamps.
    """
    parts = []
    for recording in recordings:
        flights = split_flights(recording, mapping.columns)
        if are_flights and len(flights) > 1:
            raise InputError(
                f"{recording.path}: holds {len(flights)} flights (by its column "
                "'flight', or its time); expected one in each file (glider import "
                "splits them)."
            )
        parts += flights
    tracks = [make_track(part, mapping) for part in parts]
    poses = [(track.time, track.position) for track in tracks]
    restored, jittering = find_even_times(poses, settings.pose_rate)
    for k, even in enumerate(restored):
        if even is not None:
            track = tracks[k]
            moved = [
                log._replace(time=even.at(log.time))
                if log and np.mean(np.isin(log.time, track.time)) > 0.5
                else log
                for log in track.servo
            ]
            tracks[k] = dataclasses.replace(
                track,
                time=even.at(track.time),
                servo=ServoLogs(*moved),
                jitter=even.jitter,
            )
    found = [
        ([track], []) if are_flights else cut(track, settings.gravity)
        for track in tracks
    ]
    tracks, warnings = join_clocks(tracks, [pieces for pieces, _ in found], mapping)
    cuts = []
    tables = []
    servo_logs = []
    for track, (pieces, notes) in zip(tracks, found, strict=True):
        own = [_make_table(track, piece, mapping, settings) for piece in pieces]
        tables += [table for table, _ in own]
        servo_logs += [log for _, log in own[-1:]]  # Flights of a log share it.
        noted = dict.fromkeys([*notes, *track.notes])
        cuts.append(_CutRecording(track.path, tuple(pieces), tuple(noted)))
    servo = max(servo_logs, key=lambda log: log.clock_std, default=settings.servo)
    shown = tuple(words for words in (*warnings, jittering) if words)
    campaign = dataclasses.replace(settings, servo=servo, notes=shown)
    if tables:
        names = [f"flight_{k:03d}.csv" for k in range(len(tables))]
        campaign = with_flights(campaign, tables, () if are_flights else names)
        if servo.command == "converted":
            campaign = align_commands(campaign)
    return ImportResult(campaign=campaign, recordings=tuple(cuts))


def _make_table(
    track: Track, piece: Track, mapping: ColumnMapping, settings: Campaign
) -> tuple[Recording, ServoLog]:
    """A flight of a recording in a campaign's columns, and its servo's log."""
    flight = turn_along(dataclasses.replace(piece, servo=track.servo))
    pitch, sideways = angles_of(flight)
    x, y, z = flight.position.T
    since = flight.time - flight.time[0]
    columns = {"time": since, "x": x, "z": z, "pitch": within_pi(pitch)}
    if sideways is not None:
        roll, yaw = within_pi(sideways.T)
        columns |= {"y": y, "roll": roll, "yaw": yaw}
    log = settings.servo
    servo = make_servo(flight, settings, mapping.source)
    if servo is not None:
        columns["elevator"] = servo.elevator
        columns["elevator_rate_command"] = servo.command
        if log == ServoLog():  # Otherwise it is specified.
            log = widen(servo.log, track)
    group = Group("", {name: Column(values) for name, values in columns.items()})
    return Recording(track.path, (group,)), log


def _count(things: Sequence, what: str = "flight") -> str:
    return f"{len(things) or 'no'} {what}" + ("" if len(things) < 2 else "s")


def read_logs(
    files: Sequence[Path], mapping: ColumnMapping, progress: Progress
) -> list[Recording]:
    """Reads the recordings in files, in the order of their names.

    With `join: [poses_*.csv, servo_*.csv]` the files with the same text for * are one,
    its groups are named by the patterns, and each file has a clock of its own.
    """
    if not mapping.join:
        in_turn = announced(sorted(set(files)), "reading", progress)
        return [r for f in in_turn for r in read_recordings(f)]
    takes: dict[str, dict[str, Path]] = {}
    for pattern, file in itertools.product(mapping.join, sorted(files)):
        if fnmatch.fnmatch(file.name, pattern):
            before, _, after = pattern.partition("*")
            key = file.name.removeprefix(before).removesuffix(after)
            takes.setdefault(key, {})[pattern] = file
    whole = {key: own for key, own in takes.items() if len(own) == len(mapping.join)}
    alone = set(files).difference(*(own.values() for own in whole.values()))
    for file in sorted(alone):
        raise InputError(
            f"{file}: it makes no recording by 'join' in {mapping.source}; expected a "
            f"file for each of {', '.join(mapping.join)} with the same text for *."
        )
    keys = announced(sorted(whole), "reading", progress)
    return [_join(whole[key]) for key in keys]


def _join(files: dict[str, Path]) -> Recording:
    """One recording of several files; times of a calendar are from the earliest on."""
    parts = {pattern: read_recording(file) for pattern, file in files.items()}
    groups = [(pattern, own) for pattern, part in parts.items() for own in part.groups]
    logged = [column for _, group in groups for column in group.columns.values()]
    start = min((c.epoch for c in logged if c.epoch is not None), default=0.0)
    joined = []
    for pattern, group in groups:
        name = f"{pattern}:{group.name}" if group.name else pattern
        columns = {}
        for own, column in group.columns.items():
            since = 0.0 if column.epoch is None else column.epoch - start
            columns[own] = dataclasses.replace(column, values=column.values + since)
        joined.append(Group(name, columns, group.time, clock=pattern))
    posed = max(parts.values(), key=lambda part: (bool(part.rotation), part.up))
    path = next(iter(files.values()))
    return Recording(path, tuple(joined), posed.rotation, up=posed.up)
