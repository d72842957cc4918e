"""Tables that a library reads: Parquet, MATLAB's .mat, sheets of .xlsx workbooks."""

import contextlib
import dataclasses
import itertools
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import scipy.io

from glider.campaign.importing.readers import delimited
from glider.campaign.importing.recording import Column, Group, Recording, need
from glider.campaign.importing.splitting import FEWEST_ROWS
from glider.errors import InputError

_WIDEST = 16  # Columns of a matrix that is looked into.


def read_parquet(path: Path) -> Recording:
    """Reads one table; structs become a.b."""
    parquet = need("pyarrow.parquet", path)
    types = need("pyarrow.types", path)
    table = parquet.read_table(path)
    while any(types.is_struct(field.type) for field in table.schema):
        table = table.flatten()
    columns: dict[str, Column] = {}
    for name in table.column_names:
        bare, unit = delimited.split_unit(name)
        for own, column in to_columns(bare, table[name].to_numpy()).items():
            columns[own] = dataclasses.replace(column, unit=column.unit or unit)
    return Recording(path, (Group("", columns),))


def to_columns(name: str, values: Any) -> dict[str, Column]:
    """Columns of numbers, times or texts; matrices become name[0], name[1].

    Masked values are missing.
    """
    array = np.asarray(values)
    if isinstance(values, np.ma.MaskedArray):
        missing = np.datetime64("NaT") if array.dtype.kind in "mM" else np.nan
        kind = float if array.dtype.kind in "iub" else array.dtype
        array = np.where(np.ma.getmaskarray(values), missing, array.astype(kind))
    if array.dtype.kind in "mM":
        return {name: Column((array - array[:1]) / np.timedelta64(1, "s"), "s")}
    if array.dtype.kind in "fiub":
        return {own: Column(part) for own, part in _vectors(name, array)}
    cells = array.ravel().tolist()  # Texts, dates or numbers of any kind.
    rows = [(i, [delimited.as_text(cell)]) for i, cell in enumerate(cells)]
    return {name: delimited.make_column(name, rows, 0, None)}


def read_mat(path: Path) -> list[Recording]:
    """Reads arrays, named as in MATLAB: log.x, matrix[0]; a struct's are a group.

    Each element of an array of structs, or cell of arrays, is a recording; arrays that
    are in none belong to all. SciPy, which is there anyway, reads all versions but 7.3.
    """
    try:
        content = scipy.io.loadmat(path, simplify_cells=True)
    except NotImplementedError:  # Of version 7.3, says SciPy.
        with warnings.catch_warnings(action="ignore"):
            content = need("pymatreader", path).read_mat(path)
    for own in content.values():
        if isinstance(own, dict) and {"FrameRate", "Frames"} <= own.keys():
            raise InputError(
                f"{path}: is a .mat file of QTM, whose arrays have no times and no "
                "names; expected its 6D data as TSV (Export > To TSV)."
            )
    arrays = list(_arrays("", (), content))
    places = sorted({place for place, _, _ in arrays})
    recordings = []
    for place in places:
        if any(place == other[: len(place)] for other in places if other != place):
            continue  # Others are within it.
        groups: dict[tuple[str, int], dict[str, Column]] = {}
        for own, name, array in arrays:
            if own == place[: len(own)]:
                parent, _, last = name.rpartition(".")
                for label, values in _vectors(last, array):
                    groups.setdefault((parent, len(values)), {})[label] = Column(values)
        here = path.joinpath(*(str(index + 1) for index in place))
        named = tuple(Group(n, c) for (n, _), c in groups.items())
        recordings += [Recording(here, named)] if named else []
    if not recordings:
        raise InputError(
            f"{path}: holds no vector of numbers, or matrix of up to {_WIDEST} columns;"
            " expected these in variables or structs, several flights as an array of "
            "structs, and of a table or timetable table2struct(T, 'ToScalar', true)."
        )
    return recordings


def _arrays(
    name: str, place: tuple[int, ...], content: object
) -> Iterator[tuple[tuple[int, ...], str, np.ndarray]]:
    """Yields the arrays of numbers, each with the indices of cells around it."""
    if isinstance(content, dict):
        # pymatreader's order of names changes from run to run.
        for field, value in sorted(content.items()):
            if not field.startswith(("__", "#")):
                yield from _arrays(f"{name}.{field}" if name else field, place, value)
    elif isinstance(content, np.ndarray) and content.dtype.kind in "fiub":
        if place or max(content.shape, default=0) >= FEWEST_ROWS:
            yield place, name, content
    elif isinstance(content, (list, np.ndarray)):
        cells = content if isinstance(content, list) else np.ravel(content).tolist()
        parts = (_arrays(name, (*place, i), cell) for i, cell in enumerate(cells))
        inside = list(itertools.chain.from_iterable(parts))
        if any(max(array.shape, default=0) >= FEWEST_ROWS for _, _, array in inside):
            yield from inside


def _vectors(name: str, array: np.ndarray) -> Iterator[tuple[str, np.ndarray]]:
    """Yields a vector, or the columns of a matrix of few columns.

    Of rotations (3, 3, n) or (n, 3, 3) it has nine, row by row.
    """
    array = array.squeeze()
    if array.ndim == 3 and array.shape[:2] == (3, 3):
        array = array.reshape(9, -1).T
    elif array.ndim == 3 and array.shape[1:] == (3, 3):
        array = array.reshape(-1, 9)
    if array.ndim == 1 and len(array) > 1:
        yield name, array.astype(float)
    elif array.ndim == 2:
        if array.shape[0] <= _WIDEST < array.shape[1]:
            array = array.T
        if array.shape[1] <= _WIDEST:
            for i, values in enumerate(array.T):
                yield f"{name}[{i}]", values.astype(float)


def read_workbook(path: Path) -> list[Recording]:
    """Reads the sheets of a workbook that have numbers, each a recording."""
    openpyxl = need("openpyxl", path)
    recordings = []
    reason = InputError(f"{path}: has no sheet of cells.")
    opened = openpyxl.load_workbook(path, read_only=True, data_only=True)
    with contextlib.closing(opened) as book:
        sheets = [sheet for sheet in book.worksheets if sheet.max_row != 0]
        for sheet in sheets:
            place = path / sheet.title if len(sheets) > 1 else path
            cells = sheet.iter_rows(values_only=True)
            rows = [
                ["" if v is None else delimited.as_text(v) for v in r] for r in cells
            ]
            try:
                recordings.append(delimited.parse_rows(place, rows))
            except InputError as error:
                reason = error
    if not recordings:
        raise reason
    return recordings
