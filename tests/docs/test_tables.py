"""Tables in the pages are those that were measured, of files that still ship."""

import hashlib
import re

import pytest

from glider.paths import models_path
from tests.benchmarks import tables

NAMES = sorted(path.stem for path in tables.RECORDS.glob("*.json"))
NUMBER = re.compile(r"-?\d+(?:\.\d+)?")


def test_every_table_of_a_page_was_measured():
    named = {
        name
        for page in tables.PAGES
        for name in re.findall(r"<!-- table (\w+) -->", page.read_text("utf-8"))
    }
    assert named == set(NAMES)


@pytest.mark.parametrize("name", NAMES)
def test_pages_have_what_was_measured(name):
    """Neither edited by hand nor left behind: `make tables` writes both."""
    text = tables.markdown(tables.load_record(name))
    for page, blocks in tables.blocks_of(name).items():
        assert blocks == [text], f"{page.name} differs from docs/tables/{name}.json"


@pytest.mark.parametrize("name", NAMES)
def test_what_was_measured_still_ships(name):
    """A table is out of date where a file that it was measured with has changed."""
    for path, digest in tables.load_record(name).inputs.items():
        assert hashlib.sha256(models_path(path).read_bytes()).hexdigest() == digest, (
            f"models/{path} has changed: python -m tests.benchmarks.tables {name}"
        )


def test_a_page_edited_by_hand_is_noticed(tmp_path, monkeypatch):
    record = tables.load_record("samples")
    page = tmp_path / "page.md"
    page.write_text(f"<!-- table samples -->\n{tables.markdown(record)}<!-- end -->\n")
    monkeypatch.setattr(tables, "PAGES", (page,))
    assert tables.blocks_of("samples") == {page: [tables.markdown(record)]}
    page.write_text(page.read_text().replace("effect_found", "effect_lost", 1))
    assert tables.blocks_of("samples") != {page: [tables.markdown(record)]}
    tables.write_into_pages("samples", record)
    assert tables.blocks_of("samples") == {page: [tables.markdown(record)]}


@pytest.mark.nightly
@pytest.mark.parametrize(("name", "row"), [("samples", "slow_servo")])
def test_a_row_measured_again_is_the_same(name, row):
    """The code of today still measures it, but for the last digit."""
    from tests.benchmarks.table_rows import TABLES

    then, now = tables.load_record(name).rows[row], TABLES[name].measure(row)
    for old, new in zip(then, now, strict=True):
        assert NUMBER.sub("#", new) == NUMBER.sub("#", old)
        numbers = [[float(n) for n in NUMBER.findall(cell)] for cell in (new, old)]
        assert numbers[0] == pytest.approx(numbers[1], rel=0.05, abs=0.1)
