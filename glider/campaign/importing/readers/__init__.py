"""One reader for each file format; each gives a `Recording`.

read_recordings: picks the reader by the file's name and beginning. delimited: CSV of
any dialect. camera_exports: CSV of motion capture. c3d: C3D. topics: PX4 ULog, MCAP and
ROS bags. tables: Parquet, .mat, .xlsx.
"""

from collections.abc import Callable
from pathlib import Path

from glider.campaign.importing.readers import c3d, delimited, tables, topics
from glider.campaign.importing.readers.camera_exports import parse_export
from glider.campaign.importing.recording import Recording
from glider.errors import InputError

Reader = Callable[[Path], Recording | list[Recording]]

_READERS: dict[str, tuple[str, Reader]] = {
    ".ulg": ("a PX4 ULog", topics.read_ulog),
    ".mat": ("a .mat file", tables.read_mat),
    ".mcap": ("MCAP", topics.read_mcap),
    ".bag": ("a ROS bag", topics.read_bag),
    ".db3": ("a ROS bag", topics.read_bag),
    ".parquet": ("Parquet", tables.read_parquet),
    ".c3d": ("C3D", c3d.read),
    ".xlsx": ("a workbook", tables.read_workbook),
    ".xlsm": ("a workbook", tables.read_workbook),
}
"""What a file is, and its reader, by the suffix of its name."""


def read_recordings(path: Path) -> list[Recording]:
    """Reads a file of a known format: one recording, or one of each sheet or struct."""
    if not path.exists():
        raise InputError(f"{path}: does not exist; expected a log.")
    what, reader = _READERS.get(path.suffix.lower(), ("", None))
    if path.is_dir():
        if not (path / "metadata.yaml").is_file():
            raise InputError(f"{path}: is a folder; expected a file, or a ROS 2 bag.")
        what, reader = _READERS[".bag"]
    if reader is None:
        text = delimited.decode(path, list(_READERS))
        return [parse_export(path, text) or delimited.parse(path, text)]
    try:
        read = reader(path)
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
