"""What a Meshcat holds, read from the messages that it keeps for browsers."""

import struct

import numpy as np
from pydrake.geometry import Meshcat


def place_of(meshcat: Meshcat, path: str) -> np.ndarray:
    """Returns the translation of a path against its parent, (3,)."""
    # An array of 16 doubles, the matrix column by column.
    return _doubles(meshcat._GetPackedTransform(path), b"\xdc\x00\x10", 16)[12:15]


def property_of(meshcat: Meshcat, path: str, name: str) -> np.ndarray:
    """Returns a property that is a vector of three."""
    return _doubles(meshcat._GetPackedProperty(path, name), b"value\x93", 3)


def _doubles(packed: bytes, before: bytes, count: int) -> np.ndarray:
    """Reads doubles, each after a byte that says so, that follow some bytes."""
    first = packed.index(before) + len(before)
    numbers = packed[first : first + 9 * count]
    return np.array([v for _, v in struct.iter_unpack(">cd", numbers)])
