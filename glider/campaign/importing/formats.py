"""The formats of logs that an import reads, in the order in which they are listed."""

from typing import NamedTuple


class _Format(NamedTuple):
    """A format of files."""

    name: str  #: As it stands in lists and messages.
    suffixes: tuple[str, ...] = ()  #: Of files; (): those of CSV.
    library: str = ""  #: That reads them; "": none but what is always installed.


FORMATS = (
    _Format("CSV", (".csv", ".txt", ".tsv")),
    _Format("OptiTrack Motive CSV"),
    _Format("Vicon CSV"),
    _Format("Qualisys TSV"),
    _Format("C3D", (".c3d",), "ezc3d"),
    _Format("PX4 ULog", (".ulg",), "pyulog"),
    _Format("ArduPilot DataFlash", (".bin", ".log"), "pymavlink"),
    _Format("MATLAB .mat", (".mat",), "pymatreader"),
    _Format("MCAP", (".mcap",), "mcap"),
    _Format("ROS bag", (".bag", ".db3"), "rosbags"),
)

SUFFIXES = tuple(suffix for format in FORMATS for suffix in format.suffixes)
FORMAT_NAMES = ", ".join(format.name for format in FORMATS)
"""For sentences."""
