"""Measures tables of the README and of the docs, and writes them into the pages.

    python -m benchmarks.tables             # make tables: what is out of date
    python -m benchmarks.tables samples perches/head_wind    # these, again
    python -m benchmarks.tables --check     # lists what is out of date
    python -m benchmarks.tables --mark      # says so in the pages

A table stands in each page between the lines `<!-- table NAME -->` and `<!-- end -->`.
Each row is recorded in docs/tables/NAME.json when it is measured, so that a run that
was ended goes on where it was: its cells, version, date, inputs, and a digest of the
code that measured it. All rows take over an hour. A row that was measured with other
code than today's is out of date: the table in the page then ends with a note, which
--mark writes, and which goes when the row is measured again. tests/docs/test_tables.py
demands the note and compares pages, records and inputs; in make nightly it refuses
rows that are out of date and measures one again.
"""

import argparse
import dataclasses
import datetime
import functools
import hashlib
import importlib.metadata
import platform
import re
import time
from collections.abc import Callable, Iterator
from pathlib import Path

from benchmarks.code_digest import digest_of
from glider.errors import InputError, expect
from glider.files import schema
from glider.files.writing import write_text
from glider.paths import models_path

ROOT = Path(__file__).parents[1]
RECORDS = ROOT / "docs" / "tables"
PAGES = (ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md")))
_BLOCK = r"<!-- table {name} -->\n(.*?)<!-- end -->"


@dataclasses.dataclass(frozen=True, kw_only=True)
class Row:
    """A row as it was measured.

    Attributes:
        cells: of the table.
        code: digest of the code that measured it.
        inputs: file of models/ to its SHA-256.
        version: of this package, Drake and Python.
        date: ISO 8601.
    """

    cells: list[str]
    code: str
    inputs: dict[str, str]
    version: str
    date: str


@dataclasses.dataclass(frozen=True, kw_only=True)
class Record:
    """A table as it was measured: headings, and the rows by their names."""

    columns: list[str]
    rows: dict[str, Row]


@dataclasses.dataclass(frozen=True, kw_only=True)
class Table:
    """How a table is measured.

    Attributes:
        columns: headings.
        rows: names of its rows.
        measure: name of a row to its cells.
        inputs: files of models/ that a row depends on, with {row} for its name.
    """

    columns: tuple[str, ...]
    rows: tuple[str, ...]
    measure: Callable[[str], list[str]]
    inputs: tuple[str, ...]

    @functools.cached_property
    def code(self) -> str:
        """Digest of the code that measures it."""
        return digest_of(self.measure)


def measure(table: Table, name: str) -> Row:
    """Measures a row."""
    code = table.code  # Of the files as they are now, when they are imported.
    cells = table.measure(name)
    ours, drake = (importlib.metadata.version(p) for p in ("drake-glider", "drake"))
    return Row(
        cells=cells,
        code=code,
        inputs=hashes(table, name),
        version=f"{ours}, Drake {drake}, Python {platform.python_version()}",
        date=datetime.date.today().isoformat(),
    )


def hashes(table: Table, name: str) -> dict[str, str]:
    """Computes the SHA-256 of each input of a row."""
    paths = [path.format(row=name) for path in table.inputs]
    return {p: hashlib.sha256(models_path(p).read_bytes()).hexdigest() for p in paths}


def stale_rows(record: Record, code: str) -> dict[str, Row]:
    """Returns the rows that were measured with other code than that of a digest."""
    return {name: row for name, row in record.rows.items() if row.code != code}


def line_of(cells: list[str]) -> str:
    """Formats a row in Markdown."""
    return f"| {' | '.join(cells)} |"


def markdown(record: Record, code: str) -> str:
    """Formats a table in Markdown, with a note where it is out of date.

    Args:
        record: of the table.
        code: digest of today's code.
    """
    lines = [line_of(record.columns), "|---" * len(record.columns) + "|"]
    lines += [line_of(row.cells) for row in record.rows.values()]
    if stale := stale_rows(record, code):
        dates = sorted({row.date for row in stale.values()})
        when = " to ".join(dict.fromkeys((dates[0], dates[-1])))
        which = ""
        if len(stale) < len(record.rows):
            which = ": " + ", ".join(row.cells[0] for row in stale.values())
        lines += ["", f"*Measured {when} with earlier code{which}.*"]
    return "\n".join(lines) + "\n"


def load_record(name: str) -> Record:
    """Reads what was measured."""
    return schema.load_json(Record, RECORDS / f"{name}.json", "a measured table")


def blocks_of(name: str) -> dict[Path, list[str]]:
    """Finds a table in the pages: page to its texts there."""
    pattern = re.compile(_BLOCK.format(name=name), re.DOTALL)
    found = {p: pattern.findall(p.read_text(encoding="utf-8")) for p in PAGES}
    return {page: texts for page, texts in found.items() if texts}


def write_into_pages(name: str, text: str) -> None:
    """Writes a table into each page that has it."""
    pattern = re.compile(_BLOCK.format(name=name), re.DOTALL)
    block = f"<!-- table {name} -->\n{text}<!-- end -->"
    for page in blocks_of(name):
        whole = page.read_text(encoding="utf-8")
        write_text(page, pattern.sub(lambda _: block, whole))


def asked_rows(names: list[str], tables: dict[str, Table]) -> Iterator[tuple[str, str]]:
    """Yields table and row of each NAME and NAME/ROW; without any, what is out of date.

    Raises:
        InputError: there is no such table or row.
    """
    for name in names:
        table, _, row = name.partition("/")
        expect(table in tables, "the table", table, f"one of {', '.join(tables)}")
        rows = tables[table].rows
        good = row == "" or row in rows
        expect(good, f"the row of {table}", row, f"one of {', '.join(rows)}")
        yield from ((table, own) for own in ([row] if row else rows))
    for name, table in {} if names else tables.items():
        current = set()
        if (RECORDS / f"{name}.json").exists():
            record = load_record(name)
            current = record.rows.keys() - stale_rows(record, table.code)
        yield from ((name, row) for row in table.rows if row not in current)


def save_row(name: str, table: Table, row: str, measured: Row) -> None:
    """Records a row and writes its table into the pages."""
    file, rows = RECORDS / f"{name}.json", {}
    if file.exists():
        rows = load_record(name).rows
    rows[row] = measured
    kept = {own: rows[own] for own in table.rows if own in rows}
    record = Record(columns=list(table.columns), rows=kept)
    RECORDS.mkdir(exist_ok=True)
    write_text(file, schema.json_text(record) + "\n")
    write_into_pages(name, markdown(record, table.code))


def main() -> None:
    """Measures rows and writes them, or says which are out of date."""
    from benchmarks.table_rows import TABLES

    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    words = f"NAME or NAME/ROW of {', '.join(TABLES)} (default: what is out of date)"
    parser.add_argument("names", nargs="*", metavar="NAME", help=words)
    words = "list what is out of date; the exit code is 1 if anything is"
    parser.add_argument("--check", action="store_true", help=words)
    words = "write or remove the notes of tables that are out of date"
    parser.add_argument("--mark", action="store_true", help=words)
    args = parser.parse_args()
    try:
        asked = list(asked_rows(args.names, TABLES))
    except InputError as error:
        parser.error(str(error))
    if args.mark:
        for name, table in TABLES.items():
            write_into_pages(name, markdown(load_record(name), table.code))
    if args.check:
        print("\n".join(f"{name}/{row}" for name, row in asked) or "All are current.")
        parser.exit(bool(asked))
    for name, row in () if args.mark else asked:
        began = time.monotonic()
        measured = measure(TABLES[name], row)
        save_row(name, TABLES[name], row, measured)
        print(f"{name} {time.monotonic() - began:6.0f} s  {line_of(measured.cells)}")


if __name__ == "__main__":
    main()
