"""`import_campaign`: logs of other software in, a campaign folder out."""

import dataclasses
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from glider.campaign.importing.flights import (
    CutRecording,
    campaign_of_cuts,
    cut_recordings,
)
from glider.campaign.importing.mapping import Mapping
from glider.campaign.importing.raw import RawTable
from glider.campaign.importing.recordings import read_recordings
from glider.campaign.importing.signs import CLEARLY, check_signs, misfit_of
from glider.campaign.logs import Campaign
from glider.campaign.settings import read_settings
from glider.campaign.writer import save_campaign
from glider.errors import InputError

_ORDERS = ("XYZ", "ZYX", "YZX", "ZXY", "YXZ", "XZY")
_ROLLS = 0.1
"""Roll and yaw that flights may have by which they tell no wrong rotation [rad]."""
_MIN_FLIGHTS = 3  # One flight alone may fit anything.
RECORD = "import.txt"
"""File in the campaign's folder that tells what was done."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class ImportResult:
    """A campaign, and what there is to tell of how it came about."""

    campaign: Campaign
    recordings: tuple[CutRecording, ...]
    undecided: tuple[str, ...]  # What the flights do not tell of the mapping.

    def describe(self) -> str:
        """Returns all of it as lines of text."""
        lines = []
        names = iter(flight.name for flight in self.campaign.flights)
        for recording in self.recordings:
            lines.append(
                f"{recording.path}: {_count(len(recording.flights), 'flight')}"
            )
            for flight in recording.flights:
                lines.append(
                    f"  {next(names)}  {flight.begin:.3f}-{flight.end:.3f} s, "
                    f"{flight.rows} rows"
                )
                lines.append(f"    {flight.why}")
            lines += [f"  {words}" for words in recording.told]
        lines += [f"warning: {words}" for words in self.undecided]
        return "\n".join(lines)


def import_campaign(
    files: Sequence[Path | str], mapping: Path | str, out: Path | str
) -> ImportResult:
    """Makes a campaign folder of logs, as a mapping says, and tells what was done.

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
    """Returns what `import_campaign` writes."""
    settings, claim = read_settings(Path(mapping))
    if claim is None:
        raise InputError(
            f"{mapping}: has no 'columns:'; a mapping names the columns of the logs "
            "(--guess proposes one)."
        )
    raws = read_recordings([Path(file) for file in files], claim)
    recordings = cut_recordings(raws, claim, settings)
    if not any(recording.flights for recording in recordings):
        reasons = "; ".join(f"{r.path.name}: {w}" for r in recordings for w in r.told)
        raise InputError(
            f"{mapping}: no flight was found in {_count(len(recordings), 'recording')} "
            f"({reasons or 'nothing moves'}); is 'up' in 'frame:' right?"
        )
    settings = dataclasses.replace(settings, path=Path(mapping))
    campaign = campaign_of_cuts(settings, recordings)
    undecided = check_signs(campaign)
    _check_rotation(raws, claim, campaign)
    return ImportResult(campaign=campaign, recordings=recordings, undecided=undecided)


def _check_rotation(
    raws: Sequence[RawTable], claim: Mapping, campaign: Campaign
) -> None:
    """Refuses an order of Euler angles where another makes better flights."""
    told = claim.frame.rotation
    if told is None or len(told) != 3 or len(campaign.flights) < _MIN_FLIGHTS:
        return
    own, roll = misfit_of(campaign), _sideways(campaign)
    for order in _ORDERS:
        other = dataclasses.replace(
            claim, frame=dataclasses.replace(claim.frame, rotation=order)
        )
        try:
            cuts = cut_recordings(raws, other, campaign)
            rival = campaign_of_cuts(campaign, cuts)
            misfit = misfit_of(rival)
        except InputError:
            continue
        if own is None or misfit is None:
            continue
        straighter = 2.0 * _sideways(rival) + _ROLLS < roll and misfit < own
        if straighter or misfit * CLEARLY < own:
            raise InputError(
                f"{claim.source}: frame: rotation: with {order} in place of {told} the "
                f"forces fit {own / misfit:.2g} times as well, and the flights roll "
                f"and yaw by {_sideways(rival):.2g} rad instead of {roll:.2g}."
            )


def _sideways(campaign: Campaign) -> float:
    """Returns how much flights roll and yaw while they fly, as an RMS [rad]."""
    swings = [
        flight.attitude[:, 1:] - np.median(flight.attitude[:, 1:], axis=0)
        for flight in campaign.flights
        if flight.attitude is not None
    ]
    return float(np.sqrt(np.mean(np.concatenate(swings) ** 2))) if swings else 0.0


def _count(number: int, what: str) -> str:
    return f"{number} {what}" + ("" if number == 1 else "s")
