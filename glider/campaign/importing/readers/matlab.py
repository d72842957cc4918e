"""MATLAB's .mat files: arrays and structs of them, of version 7.3 (HDF5) too.

A column is named as in MATLAB, log.x; the columns of a matrix are name[0], name[1], ...
"""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import scipy.io

from glider.campaign.importing.optional import need
from glider.campaign.importing.raw import Column, Group, RawTable
from glider.errors import InputError

_WIDEST = 16  # Columns of a matrix that is looked into.


def read(path: Path) -> RawTable:
    """Returns the arrays of a file; those of one struct and length are a group.

    Raises:
        InputError: it is no .mat file, or it needs h5py.
    """
    try:
        content = scipy.io.loadmat(path, simplify_cells=True)
        arrays = list(_flatten("", content))
    except NotImplementedError:  # Of version 7.3, says SciPy.
        arrays = list(_read_hdf5(path))
    except (ValueError, TypeError, OSError) as error:
        raise InputError(f"{path}: not readable as a .mat file: {error}.") from None
    groups: dict[tuple[str, int], dict[str, Column]] = {}
    for name, array in arrays:
        parent, _, own = name.rpartition(".")
        for label, values in _columns(own, np.asarray(array)):
            group = groups.setdefault((parent, len(values)), {})
            group[label] = Column(values=values)
    if not groups:
        raise InputError(f"{path}: holds no array of numbers; at least one is needed.")
    return RawTable(
        path=path,
        groups=tuple(Group(name=n, columns=c) for (n, _), c in groups.items()),
    )


def _flatten(prefix: str, content: object) -> Iterator[tuple[str, np.ndarray]]:
    if isinstance(content, dict):
        for name, value in content.items():
            if not name.startswith("__"):
                yield from _flatten(f"{prefix}.{name}" if prefix else name, value)
    elif isinstance(content, np.ndarray) and content.dtype.kind in "fiub":
        yield prefix, content


def _read_hdf5(path: Path) -> Iterator[tuple[str, np.ndarray]]:
    """Yields the arrays of a file of version 7.3, whose matrices lie transposed."""
    h5py = need("h5py", path)
    found: list[tuple[str, np.ndarray]] = []

    def visit(name: str, item: object) -> None:
        numbers = isinstance(item, h5py.Dataset) and item.dtype.kind in "fiu"
        if numbers and not name.startswith("#"):
            found.append((name.replace("/", "."), np.asarray(item).T))

    with h5py.File(path, "r") as file:
        file.visititems(visit)
    yield from found


def _columns(name: str, array: np.ndarray) -> Iterator[tuple[str, np.ndarray]]:
    """Yields the columns of a vector or of a matrix of few columns."""
    array = array.squeeze()
    if array.ndim == 1 and len(array) > 1:
        yield name, array.astype(float)
    elif array.ndim == 2:
        if array.shape[0] <= _WIDEST < array.shape[1]:
            array = array.T
        if array.shape[1] <= _WIDEST:
            for i, values in enumerate(array.T):
                yield f"{name}[{i}]", values.astype(float)
