"""`import_campaign`: logs of other software in, a campaign folder out, step by step."""

import dataclasses
import fnmatch
import itertools
from collections import Counter
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from glider.campaign.checks.frame import check_signs
from glider.campaign.checks.stamps import find_even_times
from glider.campaign.flight_table import Table, with_flights
from glider.campaign.importing.advice import ORDERS, advise
from glider.campaign.importing.clock_offset import join_clocks
from glider.campaign.importing.cutting import cut
from glider.campaign.importing.frame_posterior import rank_orders
from glider.campaign.importing.readers import read_recording, read_recordings
from glider.campaign.importing.recording import Column, Group, Recording
from glider.campaign.importing.selection import ServoLogs
from glider.campaign.importing.servo_logs import align_commands, make_servo, widen
from glider.campaign.importing.splitting import split_flights
from glider.campaign.importing.track import Track, angles_of, make_track, turn_along
from glider.campaign.logs import Campaign, ServoLog
from glider.campaign.settings import Mapping, read_settings
from glider.campaign.writer import save_campaign
from glider.errors import InputError, expect, printable
from glider.progress import Progress, announced, silent

_CLEARLY = 14.0  # Log odds above which an order is refused: a million to one.
_DOUBT = 3.0  # The same for a warning: twenty to one.
_REASONS = 3  # Number of reasons listed where recordings have no flight.


class _CutRecording(NamedTuple):
    """The flights of a recording, and notes on what was done to it."""

    path: Path
    flights: tuple[Table, ...]  #: Their times are on the clock of the recording.
    notes: tuple[str, ...]
    warnings: tuple[str, ...] = ()
    servo: ServoLog = ServoLog()


@dataclasses.dataclass(frozen=True, kw_only=True)
class ImportResult:
    """A campaign, and what was done to get it."""

    campaign: Campaign
    recordings: tuple[_CutRecording, ...]
    undecided: tuple[str, ...]  #: What the flights do not show of the mapping.

    @property
    def empty(self) -> str:
        """How many recordings gave no flight; "" where each gave one."""
        empty = sum(not recording.flights for recording in self.recordings)
        if not empty:
            return ""
        return f"{empty} of {_count(self.recordings, 'recording')} gave no flight"

    @property
    def warnings(self) -> list[str]:
        """What the flights do not show, and recordings without flights if most are."""
        flying = sum(bool(recording.flights) for recording in self.recordings)
        if 2 * flying < len(self.recordings):
            return [*self.undecided, f"{self.empty}; is 'frame:' right?"]
        return [*self.undecided]

    def report(self) -> dict[str, Any]:
        """All of it, as JSON has it; times are those of the recordings [s]."""
        flights: list[dict[str, Any]] = []
        for recording in self.recordings:
            for flight in recording.flights:
                begin, end = flight.span
                fields = {
                    "name": self.campaign.flights[len(flights)].name,
                    "recording": str(recording.path),
                    "begin": begin,
                    "end": end,
                    "rows": len(flight.columns["time"]),
                    "why": flight.why,
                }
                flights.append(fields)
        notes = {str(recording.path): recording.notes for recording in self.recordings}
        return {"warnings": self.warnings, "flights": flights, "notes": notes}

    def describe(self, *, details: bool = True) -> str:
        """Warnings, a line for each file, common notes; in detail all flights, too."""
        noted = [note for recording in self.recordings for note in recording.notes]
        counts = Counter(noted)
        lines = [f"warning: {words}" for words in self.warnings]
        for file, group in itertools.groupby(self.recordings, _file_of):
            parts = list(group)
            flights = [flight for part in parts for flight in part.flights]
            own = [n for part in parts for n in part.notes if counts[n] == 1]
            of = f" of {len(parts)} parts" if len(parts) > 1 else ""
            rows = sum(len(flight.columns["time"]) for flight in flights)
            words = "; ".join([f"{_count(flights)}{of}, {rows} rows", *own[:2]])
            lines.append(f"{file}: {words}")
        lines += [f"{n} recordings: {note}" for note, n in counts.items() if n > 1]
        if details:
            report = self.report()
            row = "{name}: {recording}, {begin:.3f}-{end:.3f} s, {rows} rows: {why}"
            lines += [row.format(**flight) for flight in report["flights"]]
            for path, notes in report["notes"].items():
                lines += [f"{path}: {note}" for note in notes]
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
    for pattern in ("campaign.yaml", "import.txt", "flight_*.csv"):
        for found in sorted(Path(out).glob(pattern)):
            if not force or found.resolve() in logs:
                raise InputError(
                    f"{found}: exists; expected a new folder (or --force)."
                )
    imported = read_flights(files, mapping, progress)
    save_campaign(out, imported.campaign, {"import.txt": imported.describe() + "\n"})
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

    def run(some: Sequence[Recording], claim: Mapping) -> tuple[Campaign, list[str]]:
        result = _import(some, claim, settings)
        return result.campaign, [*result.warnings, *_check_order(some, claim)]

    try:
        result = _import(recordings, claim, settings)
    except InputError as error:
        raise advise(error, recordings, claim, run) from None
    undecided = (*result.undecided, *_check_order(recordings, claim))
    campaign = dataclasses.replace(result.campaign, notes=undecided)
    return dataclasses.replace(result, campaign=campaign, undecided=undecided)


def _import(
    recordings: Sequence[Recording], claim: Mapping, settings: Campaign
) -> ImportResult:
    """The campaign that recordings make by a mapping, checked."""
    cuts = cut_recordings(recordings, claim, settings)
    _check_flights(cuts, str(settings.path))
    campaign = campaign_of_cuts(settings, cuts)
    undecided = list(dict.fromkeys(words for cut in cuts for words in cut.warnings))
    undecided += check_signs(campaign)
    noted = dataclasses.replace(campaign, notes=tuple(undecided))
    return ImportResult(campaign=noted, recordings=cuts, undecided=tuple(undecided))


def _check_order(recordings: Sequence[Recording], claim: Mapping) -> list[str]:
    """Warns of an order of Euler angles where another is likelier; refuses others."""
    own = claim.frame.rotation or ("ZYX" if "roll" in claim.columns else None)
    if own not in ORDERS:
        return []
    orders = [own, *(order for order in ORDERS if order != own)]
    frames = [dataclasses.replace(claim.frame, rotation=order) for order in orders]
    claims = [dataclasses.replace(claim, frame=frame) for frame in frames]
    logs = [part for r in recordings for part in split_flights(r, claim.columns)]
    scores = rank_orders(logs, claims)
    best = int(np.argmax(scores))
    odds = scores[best] - scores[0]
    words = (
        f"frame: rotation: with {orders[best]} in place of {own} forces and the "
        f"direction of flight are {np.exp(min(odds, 99.0)):.3g} times as likely"
    )
    if odds > _CLEARLY:
        raise InputError(f"{claim.source}: {words}.")
    return [f"{words}: check which it is"] if odds > _DOUBT else []


def _check_flights(cuts: Sequence[_CutRecording], source: str) -> None:
    """Refuses recordings without a flight, with the reasons."""
    if any(cut.flights for cut in cuts):
        return
    count = _count(cuts, "recording")
    reasons = list(dict.fromkeys(note for cut in cuts for note in cut.notes))
    if len(reasons) > _REASONS:
        reasons[_REASONS:] = ["..."]
    raise InputError(
        f"{source}: no flight was found in {count}: {'; '.join(reasons)} (are 'up' and "
        "the units right?)."
    )


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


def map_flight(
    recording: Recording, mapping: Mapping, settings: Campaign
) -> tuple[Table, ServoLog]:
    """Converts a recording that is one flight to a table in SI; nothing is cut."""
    parts = split_flights(recording, mapping.columns)
    if len(parts) > 1:
        raise InputError(
            f"{recording.path}: holds {len(parts)} flights (by its column 'flight', or "
            "its time); expected one in each file (glider import splits them)."
        )
    track = make_track(recording, mapping)
    [made] = _extract([track], [([track], [])], mapping, settings)
    return made.flights[0], made.servo


def cut_recordings(
    recordings: Sequence[Recording], mapping: Mapping, settings: Campaign
) -> tuple[_CutRecording, ...]:
    """Finds the flights in recordings."""
    parts = (split_flights(r, mapping.columns) for r in recordings)
    tracks = [make_track(r, mapping) for r in itertools.chain.from_iterable(parts)]
    tracks, warnings = _with_even_times(tracks, settings.pose_rate)
    found = [cut(track, settings.gravity) for track in tracks]
    return _extract(tracks, found, mapping, settings, warnings)


def _with_even_times(
    tracks: Sequence[Track], rate: float | None
) -> tuple[list[Track], tuple[str, ...]]:
    """Restores even steps of recordings whose stamps jitter, and warns of them.

    Logs of the servo that have the same stamps are restored with them.
    """
    found, words = find_even_times([(t.time, t.position) for t in tracks], rate)
    restored = [*tracks]
    for k, even in enumerate(found):
        if even is None:
            continue
        track = tracks[k]
        servo = track.servo._asdict()
        for name, log in servo.items():
            if log is not None and np.mean(np.isin(log.time, track.time)) > 0.5:
                servo[name] = log._replace(time=even.at(log.time))
        restored[k] = dataclasses.replace(
            track,
            time=even.at(track.time),
            servo=ServoLogs(**servo),
            jitter=even.jitter,
        )
    return restored, (words,) if words else ()


def campaign_of_cuts(
    settings: Campaign, recordings: Sequence[_CutRecording]
) -> Campaign:
    """A campaign of the flights of recordings, numbered in their order."""
    tables: list[Table] = []
    for flight in (f for recording in recordings for f in recording.flights):
        columns = {**flight.columns, "time": flight.columns["time"] - flight.span[0]}
        name = f"flight_{len(tables):03d}.csv"
        tables.append(dataclasses.replace(flight, name=name, columns=columns))
    logs = (recording.servo for recording in recordings if recording.flights)
    servo = max(logs, key=lambda log: log.clock_std, default=settings.servo)
    campaign = with_flights(dataclasses.replace(settings, servo=servo), tables)
    return align_commands(campaign) if servo.command == "converted" else campaign


def _extract(
    tracks: list[Track],
    found: list[tuple[list[Track], list[str]]],
    mapping: Mapping,
    settings: Campaign,
    warnings: tuple[str, ...] = (),
) -> tuple[_CutRecording, ...]:
    """Makes tables of the flights that were cut out of recordings."""
    shifted, of_clocks = join_clocks(tracks, [cuts for cuts, _ in found], mapping)
    recordings = []
    for track, (cuts, of_cuts) in zip(shifted, found, strict=True):
        notes = [*of_cuts, *track.notes]
        log = settings.servo
        flights = []
        for piece in cuts:
            flight = turn_along(dataclasses.replace(piece, servo=track.servo))
            columns = _pose_columns(flight)
            servo = make_servo(flight, settings, mapping.source)
            if servo is not None:
                columns["elevator"] = servo.elevator
                columns["elevator_rate_command"] = servo.command
                if settings.servo == ServoLog():  # Otherwise it is specified.
                    log = widen(servo.log, track)
                if servo.note:
                    notes.append(f"servo: {servo.note}")
            flights.append(Table(path=track.path, columns=columns, why=piece.why))
        made = _CutRecording(
            path=track.path,
            flights=tuple(flights),
            notes=tuple(dict.fromkeys(notes)),
            warnings=of_clocks + warnings,
            servo=log,
        )
        recordings.append(made)
    return tuple(recordings)


def _pose_columns(flight: Track) -> dict[str, np.ndarray]:
    """Columns of time and pose as a campaign's file has them."""
    pitch, sideways = angles_of(flight)
    x, y, z = flight.position.T
    columns = {"time": flight.time, "x": x, "z": z, "pitch": _wrap(pitch)}
    if sideways is not None:
        roll, yaw = _wrap(sideways.T)
        columns |= {"y": y, "roll": roll, "yaw": yaw}
    return columns


def _wrap(angle: np.ndarray) -> np.ndarray:
    """Angles (n,) within ±π: a campaign's are below one turn [rad]."""
    return np.angle(np.exp(1j * angle))


def _count(things: Sequence, what: str = "flight") -> str:
    return f"{len(things) or 'no'} {what}" + ("" if len(things) < 2 else "s")


def read_logs(
    files: Sequence[Path], mapping: Mapping, progress: Progress
) -> list[Recording]:
    """Reads the recordings in files, in the order of their names.

    With `join: [poses_*.csv, servo_*.csv]` the files with the same text for * are one,
    its groups are named by the patterns, and each file has a clock of its own.
    """
    if not mapping.join:
        in_turn = announced(sorted(set(files)), "reading", progress)
        return [r for f in in_turn for r in read_recordings(f)]
    parts: dict[str, dict[str, Path]] = {}
    for file in sorted(files):
        pattern = next((p for p in mapping.join if fnmatch.fnmatch(file.name, p)), None)
        if pattern is None:
            raise InputError(
                f"{file}: its name fits none of {', '.join(mapping.join)}, the "
                f"patterns of 'join' in {mapping.source}."
            )
        before, _, after = pattern.partition("*")
        key = file.name.removeprefix(before).removesuffix(after)
        parts.setdefault(key, {})[pattern] = file
    for key, found in parts.items():
        lacking = [p.replace("*", key) for p in mapping.join if p not in found]
        if lacking:
            raise InputError(
                f"{next(iter(found.values()))}: there is no {lacking[0]} to join it "
                f"with, as {mapping.source} says."
            )
    joined = [parts[key] for key in announced(sorted(parts), "reading", progress)]
    return [_join(found, mapping.join) for found in joined]


def _join(files: dict[str, Path], patterns: Sequence[str]) -> Recording:
    """One recording of several files; times of a calendar are from the earliest on."""
    parts = {pattern: read_recording(files[pattern]) for pattern in patterns}
    logged = [c for p in parts.values() for g in p.groups for c in g.columns.values()]
    start = min((c.epoch for c in logged if c.epoch is not None), default=0.0)

    def since_start(column: Column) -> Column:
        if column.epoch is None:
            return column
        values = column.values + (column.epoch - start)
        return dataclasses.replace(column, values=values, epoch=start)

    groups = []
    for pattern, part in parts.items():
        for group in part.groups:
            name = f"{pattern}:{group.name}" if group.name else pattern
            columns = {n: since_start(c) for n, c in group.columns.items()}
            groups.append(Group(name, columns, group.time, clock=pattern))
    rotation = next((p.rotation for p in parts.values() if p.rotation), None)
    up = next((p.up for p in parts.values() if p.up), "")
    return Recording(files[patterns[0]], tuple(groups), rotation, up=up)
