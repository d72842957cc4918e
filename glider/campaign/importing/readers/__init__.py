"""One reader for each of `FORMATS`; each gives a `Recording`.

read_recordings: picks the reader by the file's name and beginning. delimited: text of
any dialect. camera_exports: text of motion capture. Others read what their names say.
"""

from collections.abc import Callable
from pathlib import Path

from glider.campaign.importing.formats import FORMATS
from glider.campaign.importing.readers import c3d, dataflash, delimited, tables, topics
from glider.campaign.importing.readers.camera_exports import parse_export
from glider.campaign.importing.recording import Recording
from glider.errors import InputError

_Reader = Callable[[Path], Recording | list[Recording]]

_DATAFLASH = "ArduPilot DataFlash"
_READERS: dict[str, _Reader] = {
    "PX4 ULog": topics.read_ulog,
    _DATAFLASH: dataflash.read,
    "C3D": c3d.read,
    "MATLAB .mat": tables.read_mat,
    "MCAP": topics.read_mcap,
    "ROS bag": topics.read_bag,
}
"""Readers of what is no text, by format."""
_FORMATS = {suffix: format.name for format in FORMATS for suffix in format.suffixes}


def read_recordings(path: Path) -> list[Recording]:
    """Reads a file of a known format: one recording, or one of each struct."""
    if not path.exists():
        raise InputError(f"{path}: does not exist; expected a log.")
    what = _FORMATS.get(path.suffix.lower(), "")
    if path.is_dir():
        if not (path / "metadata.yaml").is_file():
            raise InputError(f"{path}: is a folder; expected a file, or a ROS 2 bag.")
        what = "ROS bag"
    elif what in ("", _DATAFLASH):  # A .log may be any text.
        what = _DATAFLASH if dataflash.is_one(path) else "CSV"
    if what not in _READERS:
        text = delimited.decode(path)
        return [parse_export(path, text) or delimited.parse(path, text)]
    try:
        read = _READERS[what](path)
    except InputError:
        raise
    except Exception as error:  # Libraries raise whatever a damaged file makes them.
        reason = " ".join(str(error).split())[:200].rstrip(".") or type(error).__name__
        raise InputError(f"{path}: not readable as {what}: {reason}.") from None
    return read if isinstance(read, list) else [read]


def read_recording(path: Path) -> Recording:
    """Reads a file that is one recording; see `read_recordings`."""
    recordings = read_recordings(path)
    if len(recordings) > 1:
        raise InputError(f"{path}: holds {len(recordings)} recordings; expected one.")
    return recordings[0]
