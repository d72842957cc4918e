"""The campaigns that ship with the package, and campaigns packed as .zip.

A packed campaign is unpacked into the user's cache folder, once for each content.
"""

import hashlib
import shutil
import tempfile
import zipfile
import zlib
from pathlib import Path
from typing import NamedTuple

from glider.errors import InputError
from glider.files import schema
from glider.files.writing import check_writable
from glider.paths import cache_folder, models_path

_FOLDER = "campaigns"
HOW_TO_IMPORT = "'glider import' makes one of other logs"
"""Where a campaign is expected and something else is given."""

_MOST_FILES = 10_000
_MOST_BYTES = 500_000_000  # Of an unpacked campaign: 10,000 flights of 1 s take 57 MB.
_MOST_RATIO = 100  # Of a file's size to that in the archive; the samples have 2.6.
_SMALL = 1_000_000  # Size below which any ratio passes [bytes].


class _Sample(NamedTuple):
    """A campaign that ships with the package."""

    name: str  #: That `load_campaign` and the command line take.
    holds: str  #: What its logs hold that a flat plate in still air lacks.
    flights: int  #: Number of them.


def sample_names() -> tuple[str, ...]:
    """Names of the samples."""
    return tuple(_read_list())


def _read_list() -> dict[str, str]:
    file = models_path(_FOLDER, "samples.yaml")
    return schema.load_yaml(dict[str, str], file, "the list of samples")


def list_samples() -> tuple[_Sample, ...]:
    """Lists the samples; nothing is unpacked."""
    found = []
    for name, holds in _read_list().items():
        with zipfile.ZipFile(models_path(_FOLDER, f"{name}.zip")) as archive:
            flights = sum(file.endswith(".csv") for file in archive.namelist())
        found.append(_Sample(name, holds, flights))
    return tuple(found)


def campaign_folder(campaign: Path | str) -> Path:
    """Finds the folder of a campaign; unpacks it if need be.

    Args:
        campaign: its folder; its .zip, with or without that suffix; or a sample's name.
    """
    path = Path(campaign)
    if path.is_dir():
        return path
    for archive in (path, path.with_name(f"{path.name}.zip")):
        if archive.suffix == ".zip" and archive.is_file():
            return _unpacked(archive)
    if str(path) in sample_names():
        return _unpacked(models_path(_FOLDER, f"{path}.zip"))
    found = "does not exist"
    how = ""
    if path.exists():
        found = "is not a folder"
        how = f" ({HOW_TO_IMPORT})"
    names = ", ".join(sample_names())
    expected = f"a campaign folder{how} or the name of a sample ({names})"
    raise InputError(f"{path}: {found}; expected {expected}.")


def copy_sample(name: str, out: Path) -> None:
    """Writes a sample as a new folder of CSV files, to look at or to start from."""
    if out.exists():
        raise InputError(f"{out}: exists; expected the name of a new folder.")
    source = campaign_folder(name)
    check_writable(out)
    out.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix=".", dir=out.parent) as part:
        shutil.copytree(source, Path(part, out.name)).rename(out)


def _unpacked(archive: Path) -> Path:
    """Folder of a packed campaign, which has the archive's name."""
    content = archive.read_bytes()
    digest = hashlib.sha256(content).hexdigest()[:12]
    place = cache_folder() / _FOLDER / digest / archive.stem
    if place.is_dir():
        return place
    place.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix=".", dir=place.parent) as part:
        try:
            with zipfile.ZipFile(archive) as packed:
                _extract(packed, Path(part, "all"), archive)
        except (zipfile.BadZipFile, zlib.error, EOFError, RuntimeError) as error:
            raise InputError(f"{archive}: cannot be unpacked: {error}.") from None
        inner = [p.parent for p in Path(part).rglob("campaign.yaml")]
        if len(inner) != 1:
            raise InputError(
                f"{archive}: holds {len(inner)} files campaign.yaml; expected one."
            )
        try:
            inner[0].rename(place)
        except OSError:
            if not place.is_dir():  # Another process may have done the same.
                raise
    return place


def _extract(packed: zipfile.ZipFile, folder: Path, archive: Path) -> None:
    """Unpacks an archive; refuses one that would fill the disk.

    The sizes in its directory are a claim, but Python's zipfile unpacks no more of a
    file than is claimed.
    """
    files = packed.infolist()
    size = sum(file.file_size for file in files)
    large = [file for file in files if file.file_size > _SMALL]
    ratio = max((f.file_size / max(f.compress_size, 1) for f in large), default=1.0)
    for what, found, most in (
        ("files", len(files), _MOST_FILES),
        ("bytes when unpacked", size, _MOST_BYTES),
        ("times its packed size in a file", round(ratio), _MOST_RATIO),
    ):
        if found > most:
            raise InputError(
                f"{archive}: has {found:,} {what}; expected at most {most:,}."
            )
    packed.extractall(folder)
