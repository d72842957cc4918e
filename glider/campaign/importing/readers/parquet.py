"""Parquet files: one table; a column of short lists is name[0], name[1], ..."""

from pathlib import Path

import numpy as np

from glider.campaign.importing.optional import need
from glider.campaign.importing.raw import Column, Group, RawTable
from glider.campaign.importing.readers.delimited import split_unit
from glider.errors import InputError


def read(path: Path) -> RawTable:
    """Returns the table of a file; structs are flattened to a.b.

    Raises:
        InputError: it is no Parquet file, or pyarrow is missing.
    """
    parquet, types = need("pyarrow.parquet", path), need("pyarrow.types", path)
    arrow = need("pyarrow", path)
    try:
        table = parquet.read_table(path)
        while any(types.is_struct(field.type) for field in table.schema):
            table = table.flatten()
    except (arrow.ArrowException, OSError) as error:
        reason = str(error).splitlines()[0]
        raise InputError(f"{path}: not readable as Parquet: {reason}") from None
    columns: dict[str, Column] = {}
    for name, values in zip(table.column_names, table.columns, strict=True):
        kind = values.type
        bare, unit = split_unit(name)
        if types.is_timestamp(kind) or types.is_duration(kind):
            numbers = values.cast(arrow.int64()).to_numpy().astype(float)
            columns[name] = Column(values=numbers, unit=kind.unit)
        elif types.is_integer(kind) or types.is_floating(kind):
            numbers = values.to_numpy().astype(float)
            columns[bare] = Column(values=numbers, unit=unit)
        elif types.is_list(kind) or types.is_fixed_size_list(kind):
            rows = values.to_pylist()
            if len({len(row) for row in rows if row is not None}) == 1:
                matrix = np.array(rows, dtype=float)
                for i, column in enumerate(matrix.T):
                    columns[f"{name}[{i}]"] = Column(values=column)
    return RawTable(path=path, groups=(Group(name="", columns=columns),))
