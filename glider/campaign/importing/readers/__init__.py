"""One reader for each file format; each gives a `RawTable`.

read_raw: picks the reader by the file's name and beginning. delimited: CSV of any
dialect. motive, vicon: exports of motion capture. ulog: PX4. matlab: .mat. mcap, bags:
MCAP and ROS. parquet. messages: what MCAP and ROS have in common.
"""

from collections.abc import Callable
from pathlib import Path

from glider.campaign.importing.raw import RawTable
from glider.campaign.importing.readers import (
    bags,
    delimited,
    matlab,
    mcap,
    motive,
    parquet,
    ulog,
    vicon,
)
from glider.errors import InputError

_READERS: dict[str, Callable[[Path], RawTable]] = {
    ".ulg": ulog.read,
    ".mat": matlab.read,
    ".mcap": mcap.read,
    ".bag": bags.read,
    ".db3": bags.read,
    ".parquet": parquet.read,
}
_TEXTS = (motive, vicon)


def read_raw(path: Path) -> RawTable:
    """Returns what a file of any known format holds.

    Raises:
        InputError: it cannot be read, or the library for its format is missing.
    """
    if not path.exists():
        raise InputError(f"{path}: does not exist; a log is needed.")
    if path.is_dir():
        if (path / "metadata.yaml").is_file():
            return bags.read(path)
        raise InputError(f"{path}: is a folder; a file is needed, or a ROS 2 bag.")
    reader = _READERS.get(path.suffix.lower())
    if reader is not None:
        return reader(path)
    text = delimited.decode(path)
    for module in _TEXTS:
        if module.recognizes(text):
            return module.parse(path, text)
    return delimited.parse(path, text)
