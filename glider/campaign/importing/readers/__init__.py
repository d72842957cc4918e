"""Readers of logs: each turns a file of one of `FORMATS` into a `Recording`.

`read_recordings` picks the reader by the file's name and beginning. `delimited` reads
text tables of any dialect, `camera_exports` those of motion capture, `tables` arrays
and .mat files, `topics` logs of PX4 and ROS; `c3d` and `dataflash` read what they say.
"""

from collections.abc import Callable
from pathlib import Path

from glider.campaign.importing.formats import FORMATS
from glider.campaign.importing.readers import c3d, dataflash, delimited, tables, topics
from glider.campaign.importing.readers.camera_exports import parse_export
from glider.campaign.importing.recording import Recording
from glider.errors import InputError

_DATAFLASH = "ArduPilot DataFlash"
_READERS: dict[str, Callable[[Path], Recording | list[Recording]]] = {
    "PX4 ULog": topics.read_ulog,
    _DATAFLASH: dataflash.read,
    "C3D": c3d.read,
    "MATLAB .mat": tables.read_mat,
    "MCAP": topics.read_mcap,
    "ROS bag": topics.read_bag,
}
"""Readers of the formats that `delimited` does not read."""

_FORMATS = {suffix: format.name for format in FORMATS for suffix in format.suffixes}
"""Names of formats by suffix."""


def read_recordings(path: Path) -> list[Recording]:
    """Reads a file of a known format, or the folder of a ROS 2 bag.

    A file without a suffix of a format may be a log of ArduPilot or any text.

    Returns:
        One recording, or one of each struct of an array in a .mat file.

    Raises:
        InputError: the file is missing or damaged, or none of the formats.
    """
    if not path.exists():
        raise InputError(f"{path}: does not exist; expected a log.")
    if path.is_dir():
        if not (path / "metadata.yaml").is_file():
            raise InputError(f"{path}: is a folder; expected a file, or a ROS 2 bag.")
        name = "ROS bag"
    else:
        name = _FORMATS.get(path.suffix.lower(), _DATAFLASH)
        if name == _DATAFLASH and not dataflash.is_one(path):
            name = "CSV"  # A .log may be any text.

    if name not in _READERS:
        text = delimited.decode(path)
        return [parse_export(path, text) or delimited.parse(path, text)]
    try:
        read = _READERS[name](path)
    except InputError:
        raise
    except Exception as error:  # Libraries raise whatever a damaged file makes them.
        reason = " ".join(str(error).split())[:200].rstrip(".") or type(error).__name__
        raise InputError(f"{path}: not readable as {name}: {reason}.") from None
    return read if isinstance(read, list) else [read]


def read_recording(path: Path) -> Recording:
    """Reads a file that is one recording; see `read_recordings`."""
    recordings = read_recordings(path)
    if len(recordings) > 1:
        raise InputError(f"{path}: holds {len(recordings)} recordings; expected one.")
    return recordings[0]
