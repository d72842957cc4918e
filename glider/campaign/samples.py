"""The campaigns that ship with the package.

They are packed, and unpacked into the user's cache folder, once for each content.
"""

import contextlib
import hashlib
import shutil
import tempfile
import zipfile
from pathlib import Path
from typing import NamedTuple

from glider.errors import InputError
from glider.files import schema
from glider.files.writing import check_writable
from glider.paths import cache_folder, models_path

_FOLDER = "campaigns"
HOW_TO_IMPORT = "'glider import' makes one of other logs"
"""Where a campaign is expected and something else is given."""


class _Sample(NamedTuple):
    """A campaign that ships with the package.

    Attributes:
        name: that `load_campaign` and the command line take.
        holds: what its logs hold that a flat plate in still air lacks.
        flights: number of them.
    """

    name: str
    holds: str
    flights: int


def sample_names() -> tuple[str, ...]:
    """Returns the names of the samples, in the order of their list."""
    return tuple(_read_list())


def _read_list() -> dict[str, str]:
    """What each sample holds, by its name."""
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
    """Finds the folder of a campaign, or of a sample by its name.

    A folder of that name comes first. A sample is unpacked if it is not yet.

    Raises:
        InputError: it is neither.
    """
    path = Path(campaign)
    if path.is_dir():
        return path
    names = sample_names()
    if str(path) in names:
        return _unpacked(models_path(_FOLDER, f"{path}.zip"))
    samples = f"or the name of a sample ({', '.join(names)})"
    if path.exists():
        raise InputError(
            f"{path}: is not a folder; expected a campaign folder ({HOW_TO_IMPORT}) "
            f"{samples}."
        )
    raise InputError(f"{path}: does not exist; expected a campaign folder {samples}.")


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
    """Folder of a sample in the cache, which is unpacked once for each content.

    It is unpacked beside its place and renamed: no other process finds half of it.
    """
    digest = hashlib.sha256(archive.read_bytes()).hexdigest()[:12]
    place = cache_folder() / _FOLDER / digest / archive.stem
    if not place.is_dir():
        place.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(prefix=".", dir=place.parent) as part:
            shutil.unpack_archive(archive, part)
            [file] = Path(part).rglob("campaign.yaml")
            with contextlib.suppress(OSError):  # Another process may have been faster.
                file.parent.rename(place)
    return place
