"""Measures tables of the README and of the docs, and writes them into the pages.

    python -m tests.benchmarks.tables [NAME ...]     # make tables: all; over an hour

A table stands in each page between the lines `<!-- table NAME -->` and `<!-- end -->`.
What was measured is recorded in docs/tables/NAME.json with its version and inputs;
tests/docs/test_tables.py compares pages, records and inputs, and measures one row of a
table again.
"""

import argparse
import dataclasses
import datetime
import hashlib
import importlib.metadata
import platform
import re
from collections.abc import Callable
from pathlib import Path

from glider.files import schema
from glider.files.writing import write_text
from glider.paths import models_path

ROOT = Path(__file__).parents[2]
RECORDS = ROOT / "docs" / "tables"
PAGES = (ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md")))
_BLOCK = r"<!-- table {name} -->\n(.*?)<!-- end -->"


@dataclasses.dataclass(frozen=True, kw_only=True)
class Record:
    """A table as it was measured.

    Attributes:
        columns: headings.
        rows: name of a row to its cells.
        inputs: file of models/ to its SHA-256.
        version: of this package, Drake and Python.
        date: ISO 8601.
    """

    columns: list[str]
    rows: dict[str, list[str]]
    inputs: dict[str, str]
    version: str
    date: str


@dataclasses.dataclass(frozen=True, kw_only=True)
class Table:
    """How a table is measured.

    Attributes:
        columns: headings.
        rows: names of its rows.
        measure: name of a row to its cells.
        inputs: files of models/ that the rows depend on.
    """

    columns: tuple[str, ...]
    rows: tuple[str, ...]
    measure: Callable[[str], list[str]]
    inputs: tuple[str, ...]


def measure(table: Table) -> Record:
    """Measures a table, a row after the other."""
    rows = {}
    for name in table.rows:
        rows[name] = table.measure(name)
        print(line_of(rows[name]), flush=True)
    versions = (importlib.metadata.version(p) for p in ("drake-glider", "drake"))
    ours, drake = versions
    return Record(
        columns=list(table.columns),
        rows=rows,
        inputs=hashes(table),
        version=f"{ours}, Drake {drake}, Python {platform.python_version()}",
        date=datetime.date.today().isoformat(),
    )


def hashes(table: Table) -> dict[str, str]:
    """Computes the SHA-256 of each input of a table."""
    return {
        name: hashlib.sha256(models_path(name).read_bytes()).hexdigest()
        for name in table.inputs
    }


def line_of(cells: list[str]) -> str:
    """Formats a row in Markdown."""
    return f"| {' | '.join(cells)} |"


def markdown(record: Record) -> str:
    """Formats a table in Markdown."""
    heading = [line_of(record.columns), "|---" * len(record.columns) + "|"]
    return "\n".join([*heading, *map(line_of, record.rows.values())]) + "\n"


def load_record(name: str) -> Record:
    """Reads what was measured."""
    return schema.load_json(Record, RECORDS / f"{name}.json", "a measured table")


def blocks_of(name: str) -> dict[Path, list[str]]:
    """Finds a table in the pages: page to its texts there."""
    pattern = re.compile(_BLOCK.format(name=name), re.DOTALL)
    found = {p: pattern.findall(p.read_text(encoding="utf-8")) for p in PAGES}
    return {page: texts for page, texts in found.items() if texts}


def write_into_pages(name: str, record: Record) -> None:
    """Writes a table into each page that has it."""
    pattern = re.compile(_BLOCK.format(name=name), re.DOTALL)
    block = f"<!-- table {name} -->\n{markdown(record)}<!-- end -->"
    for page in blocks_of(name):
        text = page.read_text(encoding="utf-8")
        write_text(page, pattern.sub(lambda _: block, text))


def main() -> None:
    """Measures the named tables, or all, and writes them."""
    from tests.benchmarks.table_rows import TABLES

    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("names", nargs="*", metavar="NAME", help=", ".join(TABLES))
    names = parser.parse_args().names or list(TABLES)
    if unknown := sorted(set(names) - set(TABLES)):
        parser.error(f"no table {unknown[0]!r}; expected one of {', '.join(TABLES)}")
    for name in names:
        print(f"\n{name}")
        record = measure(TABLES[name])
        RECORDS.mkdir(exist_ok=True)
        write_text(RECORDS / f"{name}.json", schema.json_text(record) + "\n")
        write_into_pages(name, record)


if __name__ == "__main__":
    main()
