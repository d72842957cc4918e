"""Arrays as columns, and those of MATLAB's .mat files."""

import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from glider.campaign.importing.readers import delimited
from glider.campaign.importing.recording import Column, Group, Recording, need
from glider.campaign.importing.splitting import FEWEST_ROWS
from glider.errors import InputError

_WIDEST = 16  # Columns of a matrix that is looked into.


def to_columns(name: str, values: Any) -> dict[str, Column]:
    """Columns of numbers, times or texts; matrices become name[0], name[1].

    Masked values are missing.
    """
    array = np.asarray(values)
    if isinstance(values, np.ma.MaskedArray):
        known: Any = values.astype(float) if values.dtype.kind in "iub" else values
        array = known.filled("NaT" if values.dtype.kind in "mM" else np.nan)
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
        content = need("scipy.io", path).loadmat(path, simplify_cells=True)
    except NotImplementedError:  # Of version 7.3, says SciPy.
        with warnings.catch_warnings(action="ignore"):
            content = need("pymatreader", path).read_mat(path)
    for own in content.values():
        if isinstance(own, dict) and {"FrameRate", "Frames"} <= own.keys():
            raise InputError(
                f"{path}: is a .mat file of QTM, whose arrays have no times and no "
                "names; expected its 6D data as TSV (Export > To TSV)."
            )
    arrays = [*_arrays("", None, content)]
    found = {place for place, _, _ in arrays if place is not None}
    places: list[int | None] = [*sorted(found)]
    recordings = []
    for place in places or [None]:
        groups: dict[tuple[str, int], dict[str, Column]] = {}
        for own, name, array in arrays:
            if own in (None, place):
                parent, _, last = name.rpartition(".")
                for label, values in _vectors(last, array):
                    groups.setdefault((parent, len(values)), {})[label] = Column(values)
        here = path if place is None else path / str(place + 1)
        if groups:
            named = tuple(Group(name, own) for (name, _), own in groups.items())
            recordings.append(Recording(here, named))
    if not recordings:
        raise InputError(
            f"{path}: holds no vector of numbers, or matrix of up to {_WIDEST} columns;"
            " expected these in variables or structs, several flights as an array of "
            "structs, and of a table or timetable table2struct(T, 'ToScalar', true)."
        )
    return recordings


def _arrays(
    name: str, place: int | None, content: object
) -> Iterator[tuple[int | None, str, np.ndarray]]:
    """Yields the arrays of numbers, each with the index of the cell that it is in."""
    if isinstance(content, dict):
        # pymatreader's order of names changes from run to run.
        for field, value in sorted(content.items()):
            if not field.startswith(("__", "#")):
                yield from _arrays(f"{name}.{field}" if name else field, place, value)
    elif isinstance(content, np.ndarray) and content.dtype.kind in "fiub":
        if place is not None or max(content.shape, default=0) >= FEWEST_ROWS:
            yield place, name, content
    elif isinstance(content, (list, np.ndarray)) and place is None:
        cells = content if isinstance(content, list) else np.ravel(content).tolist()
        inside = [a for i, cell in enumerate(cells) for a in _arrays(name, i, cell)]
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
