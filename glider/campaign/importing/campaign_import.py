"""The import: logs of other software in, a campaign folder out.

`read_flights` takes the steps in turn: `joining` reads the recordings, `cut_recordings`
makes tracks of them and flights of these, and the checks of `glider.campaign.checks`
refuse what contradicts the mapping. `import_campaign` writes what comes of it.
"""

import dataclasses
import itertools
from collections import Counter
from collections.abc import Sequence
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
from glider.campaign.importing.joining import as_files, read_logs
from glider.campaign.importing.picking import make_track
from glider.campaign.importing.recording import Column, Group, Recording
from glider.campaign.importing.servo_logs import align_commands, make_servo, widen
from glider.campaign.importing.splitting import split_flights
from glider.campaign.importing.track import (
    ServoLogs,
    Track,
    angles_of,
    turn_along,
    within_pi,
)
from glider.campaign.logs import Campaign, ServoLog
from glider.campaign.settings import ColumnMapping, read_settings
from glider.campaign.writer import save_campaign
from glider.errors import InputError, expect, printable
from glider.files import schema
from glider.progress import Progress, silent

_CLEARLY = 14.0  # Log odds above which an order is refused: a million to one.
_DOUBT = 3.0  # The same for a warning: twenty to one.
_REASONS = 3  # Number of reasons listed where recordings have no flight.


class _CutRecording(NamedTuple):
    """The flights of a recording, and notes on what was done to it.

    Attributes:
        path: of the recording.
        flights: their times are on the clock of the recording [s].
        notes: sentences, each of them once.
    """

    path: Path
    flights: tuple[Track, ...]
    notes: tuple[str, ...]


@dataclasses.dataclass(frozen=True, kw_only=True)
class ImportResult:
    """A campaign, and what was done to get it.

    Attributes:
        campaign: its notes are what the flights do not show of the mapping.
        recordings: as they were cut, with the campaign's flights in their order.
    """

    campaign: Campaign
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
        warnings = list(self.campaign.notes)
        flying = sum(bool(recording.flights) for recording in self.recordings)
        if 2 * flying < len(self.recordings):
            warnings.append(f"{self.empty}; is 'frame:' right?")
        return warnings

    @property
    def reasons(self) -> str:
        """The first notes on recordings, as on why they have no flight."""
        notes = (note for recording in self.recordings for note in recording.notes)
        noted = list(dict.fromkeys(notes))
        listed = "; ".join(noted[:_REASONS])
        return f"{listed}; ..." if len(noted) > _REASONS else listed

    def report(self) -> dict[str, Any]:
        """Returns all of it, as JSON has it; times are those of the recordings [s]."""
        notes = {str(recording.path): recording.notes for recording in self.recordings}
        cuts = [(own.path, piece) for own in self.recordings for piece in own.flights]
        flights = []
        for flight, (path, piece) in zip(self.campaign.flights, cuts, strict=True):
            flights.append(
                {
                    "name": flight.name,
                    "recording": str(path),
                    "begin": piece.span[0],
                    "end": piece.span[1],
                    "rows": len(piece.time),
                    "why": piece.why,
                }
            )
        return {"warnings": self.warnings, "flights": flights, "notes": notes}

    def describe(self) -> str:
        """Returns warnings, a line for each file, and the notes that several have."""
        counts = Counter(note for own in self.recordings for note in own.notes)
        lines = [f"warning: {words}" for words in self.warnings]
        for file, parts in itertools.groupby(self.recordings, _file_of):
            lines.append(f"{file}: {_describe_file(list(parts), counts)}")
        for note, count in counts.items():
            if count > 1:
                lines.append(f"{count} recordings: {note}")
        return "\n".join(map(printable, lines))


def _file_of(recording: _CutRecording) -> Path:
    """The file of a recording, which may be a part of it."""
    path = recording.path
    return next((p for p in (path, *path.parents) if p.exists()), path)


def _describe_file(parts: Sequence[_CutRecording], counts: Counter[str]) -> str:
    """Flights and rows in a file, and the first notes that are of its parts alone."""
    flights = [flight for part in parts for flight in part.flights]
    rows = sum(len(flight.time) for flight in flights)
    of = f" of {len(parts)} parts" if len(parts) > 1 else ""
    words = [f"{_count(flights)}{of}, {rows} rows"]
    notes = [note for part in parts for note in part.notes if counts[note] == 1]
    return "; ".join(words + notes[:2])


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
    expect(isinstance(out, (str, Path)), "out", out, "the path of the folder to write")
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
    """Makes what `import_campaign` writes.

    Where a check refuses it, the error tells which changes of the mapping pass all of
    them, if any do.
    """
    expect(
        isinstance(mapping, (str, Path)),
        "the mapping",
        mapping,
        "the path of a MAP file",
    )
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
        """Cuts and checks; other mappings than the file's are tried for advice."""
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
    """Compares the mapping's order of Euler angles with all others.

    Returns:
        A warning where the flights make another order `_DOUBT` likelier.

    Raises:
        InputError: they make it `_CLEARLY` likelier.
    """
    own = claim.frame.rotation or ("ZYX" if "roll" in claim.columns else "")
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
    if odds <= _DOUBT:
        return []
    words = (
        f"frame: rotation: with {best} in place of {own} forces and the "
        f"direction of flight are {np.exp(min(odds, 99.0)):.3g} times as likely"
    )
    if odds > _CLEARLY:
        raise InputError(f"{claim.source}: {words}.")
    return [f"{words}: check which it is"]


def cut_recordings(
    recordings: Sequence[Recording],
    mapping: ColumnMapping,
    settings: Campaign,
    *,
    are_flights: bool = False,
) -> ImportResult:
    """Cuts the flights out of recordings, and makes a campaign of them.

    Args:
        recordings: of any number of flights each.
        mapping: of their columns.
        settings: the campaign without its flights.
        are_flights: whether each recording is one flight, from its first row to its
            last; the campaign's flights then have the names of the files.

    Returns:
        The campaign, which may be empty, and the recordings as they were cut.
    """
    parts = _split(recordings, mapping, are_flights)
    tracks = [make_track(part, mapping) for part in parts]
    tracks, jittering = _restore_even_times(tracks, settings.pose_rate)

    flights = []
    notes = []
    for track in tracks:
        pieces, why = ([track], []) if are_flights else cut(track, settings.gravity)
        flights.append(pieces)
        notes.append(why)
    tracks, warnings = join_clocks(tracks, flights, mapping)
    if jittering:
        warnings.append(jittering)

    cuts = []
    tables = []
    servo_logs = []
    for track, pieces, why in zip(tracks, flights, notes, strict=True):
        for piece in pieces:
            table, log = _make_table(track, piece, mapping, settings)
            tables.append(table)
        if pieces:
            servo_logs.append(log)  # Flights of a log share it.
        noted = dict.fromkeys([*why, *track.notes])
        cuts.append(_CutRecording(track.path, tuple(pieces), tuple(noted)))

    servo = max(servo_logs, key=lambda log: log.clock_std, default=settings.servo)
    campaign = dataclasses.replace(settings, servo=servo, notes=tuple(warnings))
    if tables:
        names = [f"flight_{k:03d}.csv" for k in range(len(tables))]
        campaign = with_flights(campaign, tables, () if are_flights else names)
        if servo.command == "converted":
            campaign = align_commands(campaign)
    return ImportResult(campaign=campaign, recordings=tuple(cuts))


def _split(
    recordings: Sequence[Recording], mapping: ColumnMapping, are_flights: bool
) -> list[Recording]:
    """The parts of recordings, some of which hold several flights in a table."""
    parts = []
    for recording in recordings:
        own = split_flights(recording, mapping.columns)
        if are_flights and len(own) > 1:
            raise InputError(
                f"{recording.path}: holds {len(own)} flights (by its column "
                "'flight', or its time); expected one in each file (glider import "
                "splits them)."
            )
        parts += own
    return parts


def _restore_even_times(
    tracks: Sequence[Track], rate: float | None
) -> tuple[list[Track], str]:
    """Restores even steps where the stamps of poses jitter.

    A log of the servo that has most of its stamps from the poses is restored with them.

    Args:
        tracks: of the recordings.
        rate: of the cameras [Hz]; None: what the stamps show.

    Returns:
        The tracks, and the sentence that reports it; "" where no stamps jitter.
    """
    poses = [(track.time, track.position) for track in tracks]
    found, jittering = find_even_times(poses, rate)
    restored = []
    for track, even in zip(tracks, found, strict=True):
        if even is None:
            restored.append(track)
            continue
        logs = []
        for log in track.servo:
            moved = log
            if log and np.mean(np.isin(log.time, track.time)) > 0.5:
                moved = log._replace(time=even.at(log.time))
            logs.append(moved)
        restored.append(
            dataclasses.replace(
                track,
                time=even.at(track.time),
                servo=ServoLogs(*logs),
                jitter=even.jitter,
            )
        )
    return restored, jittering


def _make_table(
    track: Track, piece: Track, mapping: ColumnMapping, settings: Campaign
) -> tuple[Recording, ServoLog]:
    """Makes the columns of a campaign's file of a flight.

    Args:
        track: the recording, with the servo's logs on its clock.
        piece: a flight of it.
        mapping: of its columns.
        settings: the campaign; a log of the servo that it specifies counts.

    Returns:
        A table with times from 0 [s], and where its columns of the servo come from.
    """
    flight = turn_along(dataclasses.replace(piece, servo=track.servo))
    pitch, roll_and_yaw = angles_of(flight)
    x, y, z = flight.position.T
    since = flight.time - flight.time[0]
    values = {"time": since, "x": x, "z": z, "pitch": within_pi(pitch)}
    if roll_and_yaw is not None:
        roll, yaw = within_pi(roll_and_yaw.T)
        values |= {"y": y, "roll": roll, "yaw": yaw}
    log = settings.servo
    servo = make_servo(flight, settings, mapping.source)
    if servo is not None:
        values["elevator"] = servo.elevator
        values["elevator_rate_command"] = servo.command
        if log == ServoLog():  # Otherwise it is specified.
            log = widen(servo.log, track)
    columns = {name: Column(own) for name, own in values.items()}
    return Recording(track.path, (Group("", columns),)), log


def _count(things: Sequence, what: str = "flight") -> str:
    """A number of things in words: "no flight", "1 flight", "2 flights"."""
    number = len(things)
    return f"{number or 'no'} {what}{'s' * (number > 1)}"
