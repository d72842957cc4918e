"""The formats of logs that an import reads, in the order in which they are listed."""

from typing import NamedTuple


class Format(NamedTuple):
    """A format of files."""

    name: str  #: As it stands in lists and messages.
    suffixes: tuple[str, ...] = ()  #: Of files; (): those of CSV.
    library: str = ""  #: That reads them; "": none but what is always installed.


FORMATS = (
    Format("CSV", (".csv", ".txt", ".tsv")),
    Format("Excel .xlsx", (".xlsx", ".xlsm"), "openpyxl"),
    Format("OptiTrack Motive CSV"),
    Format("Vicon CSV"),
    Format("Qualisys TSV"),
    Format("OpenSim TRC", (".trc",)),
    Format("C3D", (".c3d",), "ezc3d"),
    Format("PX4 ULog", (".ulg",), "pyulog"),
    Format("ArduPilot DataFlash", (".bin", ".log"), "pymavlink"),
    Format("MATLAB .mat", (".mat",), "pymatreader"),
    Format("MCAP", (".mcap",), "mcap"),
    Format("ROS bag", (".bag", ".db3"), "rosbags"),
    Format("Parquet", (".parquet",), "pyarrow"),
)

SUFFIXES = tuple(suffix for format in FORMATS for suffix in format.suffixes)
FORMAT_NAMES = ", ".join(format.name for format in FORMATS)
"""For sentences."""
