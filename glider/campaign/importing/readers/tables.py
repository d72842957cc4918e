"""Tables that a library reads: Parquet, MATLAB's .mat, sheets of .xlsx workbooks."""

import contextlib
import datetime
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import scipy.io

from glider.campaign.importing.readers import delimited
from glider.campaign.importing.recording import Column, Group, Recording, need
from glider.errors import InputError

_WIDEST = 16  # Columns of a matrix that is looked into.
_DAY_ZERO = datetime.datetime(1970, 1, 1)


def read_parquet(path: Path) -> Recording:
    """Reads one table; structs become a.b, a column of short lists name[0], name[1]."""
    parquet, types = need("pyarrow.parquet", path), need("pyarrow.types", path)
    arrow = need("pyarrow", path)
    table = parquet.read_table(path)
    while any(types.is_struct(field.type) for field in table.schema):
        table = table.flatten()
    columns: dict[str, Column] = {}
    for name, values in zip(table.column_names, table.columns, strict=True):
        kind = values.type
        bare, unit = delimited.split_unit(name)
        if types.is_timestamp(kind) or types.is_duration(kind):
            numbers = values.cast(arrow.int64()).to_numpy().astype(float)
            columns[name] = Column(numbers, kind.unit)
        elif types.is_integer(kind) or types.is_floating(kind):
            columns[bare] = Column(values.to_numpy().astype(float), unit)
        elif types.is_list(kind) or types.is_fixed_size_list(kind):
            rows = values.to_pylist()
            if len({len(row) for row in rows if row is not None}) == 1:
                for i, column in enumerate(np.array(rows, dtype=float).T):
                    columns[f"{name}[{i}]"] = Column(column)
    return Recording(path, (Group("", columns),))


def read_mat(path: Path) -> Recording:
    """Reads arrays, named as in MATLAB: log.x, matrix[0]; a struct's are a group.

    SciPy, which is there anyway, reads all versions but 7.3.
    """
    try:
        content = scipy.io.loadmat(path, simplify_cells=True)
    except NotImplementedError:  # Of version 7.3, says SciPy.
        content = need("pymatreader", path).read_mat(path)
    groups: dict[tuple[str, int], dict[str, Column]] = {}
    for name, array in _arrays("", content):
        parent, _, own = name.rpartition(".")
        for label, values in _vectors(own, array):
            groups.setdefault((parent, len(values)), {})[label] = Column(values)
    if not groups:
        raise InputError(
            f"{path}: holds no vector or matrix of numbers; expected one at least, in "
            "a variable or a struct (of an array of structs, write one file each)."
        )
    return Recording(path, tuple(Group(n, c) for (n, _), c in groups.items()))


def _arrays(prefix: str, content: object) -> Iterator[tuple[str, np.ndarray]]:
    if isinstance(content, dict):
        # pymatreader's order of names changes from run to run.
        for name, value in sorted(content.items()):
            if not name.startswith(("__", "#")):
                yield from _arrays(f"{prefix}.{name}" if prefix else name, value)
    elif isinstance(content, np.ndarray) and content.dtype.kind in "fiub":
        yield prefix, content


def _vectors(name: str, array: np.ndarray) -> Iterator[tuple[str, np.ndarray]]:
    """Yields a vector, or the columns of a matrix of few columns."""
    array = array.squeeze()
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
    recordings, reason = [], InputError(f"{path}: has no sheet of cells.")
    opened = openpyxl.load_workbook(path, read_only=True, data_only=True)
    with contextlib.closing(opened) as book:
        sheets = [sheet for sheet in book.worksheets if sheet.max_row != 0]
        for sheet in sheets:
            place = path / sheet.title if len(sheets) > 1 else path
            rows = [
                [_text(v) for v in row] for row in sheet.iter_rows(values_only=True)
            ]
            try:
                recordings.append(delimited.parse_rows(place, rows))
            except InputError as error:
                reason = error
    if not recordings:
        raise reason
    return recordings


def _text(value: object) -> str:
    """Text of a cell; a date, or a time of a day, in ISO 8601."""
    if isinstance(value, datetime.timedelta):  # A time beyond 24 h.
        value = _DAY_ZERO + value
    if isinstance(value, (datetime.datetime, datetime.time)):
        return value.isoformat()
    return "" if value is None else str(value).strip()
