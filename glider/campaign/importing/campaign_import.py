"""`import_campaign`: logs of other software in, a campaign folder out."""

import dataclasses
import fnmatch
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from glider.campaign.importing.extraction import (
    CutRecording,
    campaign_of_cuts,
    cut_recordings,
)
from glider.campaign.importing.mapping import Mapping
from glider.campaign.importing.readers import read_recording, read_recordings
from glider.campaign.importing.recording import Column, Recording
from glider.campaign.importing.sign_checks import CLEARLY, check_signs, misfit_of
from glider.campaign.logs import Campaign
from glider.campaign.settings import read_settings
from glider.campaign.writer import save_campaign
from glider.errors import InputError, printable

_ORDERS = ("XYZ", "ZYX", "YZX", "ZXY", "YXZ", "XZY")
_ROLLS = 0.1
"""Roll and yaw of flights up to which no order of rotations is refused [rad]."""
_MIN_FLIGHTS = 3  # One flight alone may fit anything.
RECORD = "import.txt"
"""File in the campaign's folder that reports what was done."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class ImportResult:
    """A campaign, and what was done to get it."""

    campaign: Campaign
    recordings: tuple[CutRecording, ...]
    undecided: tuple[str, ...]  # What the flights do not show of the mapping.

    def describe(self) -> str:
        """All of it as lines of text."""
        lines = []
        flights = iter(self.campaign.flights)
        for recording in self.recordings:
            lines.append(f"{recording.path}: {_count(recording.flights, 'flight')}")
            for cut in recording.flights:
                flight = next(flights)
                rows, span = len(flight.time), f"{cut.begin:.3f}-{cut.end:.3f} s"
                lines += [f"  {flight.name}  {span}, {rows} rows", f"    {cut.why}"]
            lines += [f"  {note}" for note in recording.notes]
        lines += [f"warning: {words}" for words in self.undecided]
        return "\n".join(map(printable, lines))


def import_campaign(
    files: Sequence[Path | str], mapping: Path | str, out: Path | str
) -> ImportResult:
    """Makes a campaign folder of logs, as a mapping specifies; reports what was done.

    Nothing is written unless all of it is right: the flights must fall down, nose
    ahead, and their forces and moments must have the signs that the mapping claims.

    Args:
        files: logs of any known format; each may hold several flights.
        mapping: the MAP file: `columns:`, `units:`, `frame:`, `vehicle:`, ...
        out: the folder to write.

    Raises:
        InputError: a log cannot be read or mapped, or the mapping is wrong.
    """
    imported = read_flights(files, mapping)
    out = Path(out)
    save_campaign(out, imported.campaign, {RECORD: imported.describe() + "\n"})
    return imported


def read_flights(files: Sequence[Path | str], mapping: Path | str) -> ImportResult:
    """Makes what `import_campaign` writes."""
    settings, claim = read_settings(Path(mapping))
    if claim is None:
        raise InputError(
            f"{mapping}: has no 'columns:'; expected a mapping of the logs' columns "
            "(--guess proposes one)."
        )
    recordings = _read_all([Path(file) for file in files], claim)
    cuts = cut_recordings(recordings, claim, settings)
    if not any(cut.flights for cut in cuts):
        reasons = "; ".join(f"{c.path.name}: {note}" for c in cuts for note in c.notes)
        raise InputError(
            f"{mapping}: no flight was found in {_count(cuts, 'recording')} "
            f"({reasons or 'nothing moves'}); is 'up' in 'frame:' right?"
        )
    settings = dataclasses.replace(settings, path=Path(mapping))
    campaign = campaign_of_cuts(settings, cuts)
    undecided = check_signs(campaign)
    _check_rotation(recordings, claim, campaign)
    return ImportResult(campaign=campaign, recordings=cuts, undecided=undecided)


def _check_rotation(
    recordings: Sequence[Recording], claim: Mapping, campaign: Campaign
) -> None:
    """Refuses an order of Euler angles where another makes better flights."""
    order = claim.frame.rotation
    own = misfit_of(campaign)
    few = len(campaign.flights) < _MIN_FLIGHTS
    if order is None or len(order) != 3 or few or own is None:
        return
    roll = _sideways(campaign)
    for other in _ORDERS:
        frame = dataclasses.replace(claim.frame, rotation=other)
        try:
            rival = dataclasses.replace(claim, frame=frame)
            turned = campaign_of_cuts(
                campaign, cut_recordings(recordings, rival, campaign)
            )
            misfit = misfit_of(turned)
        except InputError:
            continue
        if misfit is None:
            continue
        straighter = 2.0 * _sideways(turned) + _ROLLS < roll and misfit < own
        if straighter or misfit * CLEARLY < own:
            raise InputError(
                f"{claim.source}: frame: rotation: with {other} in place of {order} "
                f"the forces fit {own / misfit:.2g} times as well, and the flights "
                f"roll and yaw by {_sideways(turned):.2g} rad instead of {roll:.2g}."
            )


def _sideways(campaign: Campaign) -> float:
    """RMS of roll and yaw about their medians while the flights last [rad]."""
    swings = [
        flight.attitude[:, 1:] - np.median(flight.attitude[:, 1:], axis=0)
        for flight in campaign.flights
        if flight.attitude is not None
    ]
    return float(np.sqrt(np.mean(np.concatenate(swings) ** 2))) if swings else 0.0


def _count(things: Sequence, what: str) -> str:
    return f"{len(things)} {what}" + ("" if len(things) == 1 else "s")


def _read_all(files: Sequence[Path], mapping: Mapping) -> list[Recording]:
    """Reads the recordings in files, in the order of their names.

    With `join: [poses_*.csv, servo_*.csv]` the files with the same text for * are one,
    its groups are named by the patterns, and each file has a clock of its own.
    """
    if not mapping.join:
        return [r for file in sorted(files) for r in read_recordings(file)]
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
    return [_join(found, mapping.join) for _, found in sorted(parts.items())]


def _join(files: dict[str, Path], patterns: Sequence[str]) -> Recording:
    """One recording of several files; times of a calendar are from the earliest on."""
    parts = {pattern: read_recording(files[pattern]) for pattern in patterns}
    columns = [c for p in parts.values() for g in p.groups for c in g.columns.values()]
    start = min((c.epoch for c in columns if c.epoch is not None), default=0.0)

    def since_start(column: Column) -> Column:
        if column.epoch is None:
            return column
        values = column.values + (column.epoch - start)
        return dataclasses.replace(column, values=values, epoch=start)

    groups = tuple(
        dataclasses.replace(
            group,
            name=f"{pattern}:{group.name}" if group.name else pattern,
            columns={name: since_start(c) for name, c in group.columns.items()},
            clock=pattern,
        )
        for pattern, part in parts.items()
        for group in part.groups
    )
    rotations = [part.rotation for part in parts.values() if part.rotation]
    return Recording(
        path=files[patterns[0]],
        groups=groups,
        rotation=rotations[0] if rotations else None,
    )
