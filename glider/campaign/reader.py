"""Reads and checks campaign folders of flight logs.

What cannot be right is refused with one sentence (InputError) that names the file, the
column or field, the row (a line of the file; the header is line 1), what was found and
what was expected. Irregular times and missing rows are fine. What campaign.yaml omits
stays unknown.
"""

from collections.abc import Sequence
from pathlib import Path

from glider.campaign.flights import with_flights
from glider.campaign.importing.readers import read_recording
from glider.campaign.importing.recording import Recording
from glider.campaign.logs import Campaign
from glider.campaign.samples import HOW_TO_IMPORT, campaign_folder
from glider.campaign.settings import ColumnMapping, read_settings
from glider.errors import InputError, expect, show


def load_campaign(
    path: Path | str, *, flights: Sequence[str] | None = None
) -> Campaign:
    """Loads a campaign; only the chosen flights are read and checked.

    Angles are unwrapped. Files in other units, axes and columns are converted to SI as
    campaign.yaml specifies, and their signs are checked.

    Args:
        path: the folder, or the name of a sample.
        flights: file names, with or without ".csv"; None for all.

    Raises:
        InputError: the campaign cannot be used.
    """
    expect(
        isinstance(path, (str, Path)),
        "the campaign",
        path,
        "the path of its folder, or a Campaign",
    )
    path = campaign_folder(path)
    file = path / "campaign.yaml"
    if not file.is_file():
        raise InputError(
            f"{path}: no campaign.yaml in it; "
            f"expected a folder with campaign.yaml and flight_*.csv ({HOW_TO_IMPORT})."
        )
    campaign, mapping = read_settings(file)
    try:
        logs = [read_recording(path / name) for name in _choose(path, flights)]
        return make_campaign(campaign, mapping, logs)
    except InputError as error:
        text = str(error).removesuffix(".")
        if flights or not text.startswith(f"{path / 'flight_'}"):
            raise
        advice = "to leave the file out, name others with --flights"
        raise InputError(f"{text}; {advice}.") from None


def make_campaign(
    campaign: Campaign, mapping: ColumnMapping | None, recordings: Sequence[Recording]
) -> Campaign:
    """Adds flights, one in each recording, in its own columns or as a mapping says."""
    if mapping is None:
        return with_flights(campaign, recordings)
    # SciPy's rotations are slow to import: only where there is a mapping.
    from glider.campaign.checks.signs import check_signs
    from glider.campaign.importing.campaign_import import cut_recordings

    made = cut_recordings(recordings, mapping, campaign, are_flights=True).campaign
    check_signs(made)
    return made


def _choose(folder: Path, flights: Sequence[str] | None) -> list[str]:
    """Names of the chosen files, sorted."""
    found = {file.name for file in folder.glob("flight_*.csv")}
    if not found:
        raise InputError(f"{folder}: no flight_*.csv in it; expected at least one.")
    if flights is None:
        return sorted(found)
    chosen = {name.removesuffix(".csv") + ".csv" for name in flights}
    for unknown in sorted(chosen - found):
        raise InputError(
            f"{folder}: flight {show(unknown)} is not in this folder; "
            f"expected the name of one of its {len(found)} flights."
        )
    if not chosen:
        raise InputError(f"{folder}: no flight is chosen; expected at least one.")
    return sorted(chosen)
