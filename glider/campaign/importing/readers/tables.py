"""Arrays as columns, and those of MATLAB's .mat files.

`to_columns` serves tables in memory, such as data frames; `read_mat` searches the
variables of a file, and the structs and cells in them, for vectors and narrow matrices.
"""

import warnings
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from glider.campaign.importing.readers.delimited import make_column
from glider.campaign.importing.recording import Column, Group, Recording, need
from glider.campaign.importing.splitting import FEWEST_ROWS
from glider.errors import InputError

_WIDEST = 16  # Columns of a matrix that is looked into.
_NUMBERS = "fiub"  # Kinds of NumPy's types of real numbers, integers and bools.

_Array = tuple[int, str, np.ndarray]
"""Number of the cell that an array is in, from 1, or 0 if it is in none; its name,
with dots after structs; its values."""


def to_columns(name: str, values: Any) -> dict[str, Column]:
    """Makes columns of what stands under one name in a table.

    Args:
        name: of the table's column.
        values: (n,) or (n, k) numbers, or (n,) durations, dates or texts. What is
            masked is missing.

    Returns:
        The columns by name, those of a matrix as name[0], name[1]; times are in
        seconds since the first row.
    """
    array = np.asarray(values)
    is_number = array.dtype.kind in _NUMBERS
    is_time = array.dtype.kind in "mM"
    if isinstance(values, np.ma.MaskedArray):
        known = values.astype(float) if is_number else values
        array = np.ma.filled(known, "NaT" if is_time else np.nan)

    if is_time:
        seconds = (array - array[:1]) / np.timedelta64(1, "s")
        return {name: Column(seconds, "s")}
    if is_number:
        return {label: Column(vector) for label, vector in _vectors(name, array)}

    # Texts, dates or numbers of any kind are read as the cells of a text table.
    rows = []
    for i, cell in enumerate(array.ravel().tolist()):
        is_date = hasattr(cell, "isoformat")
        text = cell.isoformat() if is_date else str(cell).strip()
        rows.append((i, [text]))
    return {name: make_column(name, rows, 0, None)}


def read_mat(path: Path) -> list[Recording]:
    """Reads arrays, named as in MATLAB: log.x, matrix[0]; a struct's are a group.

    Returns:
        A recording of each element of an array of structs or of a cell array, together
        with the arrays that are in none; without such, one recording.

    Raises:
        InputError: the file has no vector of numbers, or is an export of QTM.
    """
    arrays = list(_arrays("", 0, _load_mat(path)))
    cells = {cell for cell, _, _ in arrays if cell}

    recordings = []
    for cell in sorted(cells) or [0]:
        # The vectors of a struct that have the same length are a group.
        columns: dict[tuple[str, int], dict[str, Column]] = defaultdict(dict)
        for own, name, array in arrays:
            if own in (0, cell):  # What is in no cell belongs to all recordings.
                struct, _, last = name.rpartition(".")
                for label, values in _vectors(last, array):
                    columns[struct, len(values)][label] = Column(values)
        groups = [Group(struct, found) for (struct, _), found in columns.items()]
        if groups:
            place = path / str(cell) if cell else path
            recordings.append(Recording(place, tuple(groups)))
    if not recordings:
        raise InputError(
            f"{path}: holds no vector of numbers, or matrix of up to {_WIDEST} columns;"
            " expected these in variables or structs, several flights as an array of "
            "structs, and of a table or timetable table2struct(T, 'ToScalar', true)."
        )
    return recordings


def _load_mat(path: Path) -> dict[str, Any]:
    """Variables of a file by name: structs as dicts, cells as lists or arrays.

    SciPy, which is always installed, reads all versions but 7.3.
    """
    try:
        content = need("scipy.io", path).loadmat(path, simplify_cells=True)
    except NotImplementedError:  # What SciPy raises for version 7.3.
        with warnings.catch_warnings(action="ignore"):
            content = need("pymatreader", path).read_mat(path)
    for value in content.values():
        if isinstance(value, dict) and {"FrameRate", "Frames"} <= value.keys():
            raise InputError(
                f"{path}: is a .mat file of QTM, whose arrays have no times and no "
                "names; expected its 6D data as TSV (Export > To TSV)."
            )
    return content


def _arrays(name: str, cell: int, content: object) -> Iterator[_Array]:
    """Yields the arrays of numbers in a variable, a field or a cell.

    An array that is in no cell counts if it is as long as a flight; those in cells
    count if one of them is.

    Args:
        name: of the variable, with those of its fields after dots; "" for all
            variables.
        cell: number of the cell that it is in, from 1; 0 if it is in none.
        content: numbers, a struct as a dict, cells as a list or an array of objects.
    """
    if isinstance(content, dict):
        # pymatreader's order of names changes from run to run.
        for field, value in sorted(content.items()):
            if not field.startswith(("__", "#")):
                yield from _arrays(f"{name}.{field}" if name else field, cell, value)
    elif isinstance(content, np.ndarray) and content.dtype.kind in _NUMBERS:
        if cell or _is_long(content):
            yield cell, name, content
    elif isinstance(content, (list, np.ndarray)) and not cell:
        cells = content if isinstance(content, list) else np.ravel(content).tolist()
        inside: list[_Array] = []
        for number, value in enumerate(cells, 1):
            inside += _arrays(name, number, value)
        if any(_is_long(array) for _, _, array in inside):
            yield from inside


def _is_long(array: np.ndarray) -> bool:
    """Whether an array has as many rows or columns as a flight has rows."""
    return max(array.shape, default=0) >= FEWEST_ROWS


def _vectors(name: str, array: np.ndarray) -> Iterator[tuple[str, np.ndarray]]:
    """Yields the columns of an array by name.

    A vector is one column. A matrix of up to `_WIDEST` columns gives name[0], name[1],
    ...; it is turned if it has few rows and many columns. Rotations (3, 3, n) or
    (n, 3, 3) give nine columns, row by row. Other arrays give none.
    """
    array = array.squeeze()
    if array.shape[:-1] == (3, 3):
        array = array.reshape(9, -1).T
    elif array.shape[1:] == (3, 3):
        array = array.reshape(-1, 9)

    if array.ndim == 1 and len(array) > 1:
        yield name, array.astype(float)
    elif array.ndim == 2:
        if array.shape[0] <= _WIDEST < array.shape[1]:
            array = array.T
        if array.shape[1] <= _WIDEST:
            for i, values in enumerate(array.T):
                yield f"{name}[{i}]", values.astype(float)
