"""Tables in the pages are those that were measured, and say so if that is long ago."""

import dataclasses
import hashlib
import re
import types

import pytest

from benchmarks import code_digest, tables
from benchmarks.table_rows import TABLES
from glider.errors import InputError
from glider.paths import models_path

NAMES = sorted(path.stem for path in tables.RECORDS.glob("*.json"))
NUMBER = re.compile(r"-?\d+(?:\.\d+)?")


def test_every_table_of_a_page_was_measured():
    named = {
        name
        for page in tables.PAGES
        for name in re.findall(r"<!-- table (\w+) -->", page.read_text("utf-8"))
    }
    assert named == set(NAMES) == set(TABLES)


@pytest.mark.parametrize("name", NAMES)
def test_pages_have_what_was_measured_and_say_with_which_code(name):
    """Neither edited by hand nor left behind, and nothing old is taken for new."""
    text = tables.markdown(tables.load_record(name), TABLES[name].code)
    for page, blocks in tables.blocks_of(name).items():
        assert blocks == [text], f"{page.name}: python -m benchmarks.tables --mark"


@pytest.mark.parametrize("name", NAMES)
def test_what_was_measured_still_ships(name):
    """A row is out of date where a file that it was measured with has changed."""
    for row, measured in tables.load_record(name).rows.items():
        for path, digest in measured.inputs.items():
            now = hashlib.sha256(models_path(path).read_bytes()).hexdigest()
            command = f"python -m benchmarks.tables {name}/{row}"
            assert now == digest, f"models/{path} has changed: {command}"


def test_a_page_edited_by_hand_is_noticed(tmp_path, monkeypatch):
    text = tables.markdown(tables.load_record("samples"), "")
    page = tmp_path / "page.md"
    page.write_text(f"<!-- table samples -->\n{text}<!-- end -->\n")
    monkeypatch.setattr(tables, "PAGES", (page,))
    assert tables.blocks_of("samples") == {page: [text]}
    page.write_text(page.read_text().replace("effect_found", "effect_lost", 1))
    assert tables.blocks_of("samples") != {page: [text]}
    tables.write_into_pages("samples", text)
    assert tables.blocks_of("samples") == {page: [text]}


# ------------------------------------------------------- rows of earlier code


def make_record(**codes):
    old = tables.load_record("perches").rows["head_wind"]
    rows = {
        name: dataclasses.replace(old, cells=[f"`{name}`", "1 mm"], code=code)
        for name, code in codes.items()
    }
    return tables.Record(columns=["truth", "miss"], rows=rows)


def test_a_table_of_earlier_code_says_so_and_of_which_rows():
    date = next(iter(make_record(a="old").rows.values())).date
    assert "earlier" not in tables.markdown(make_record(a="new", b="new"), "new")
    text = tables.markdown(make_record(a="old", b="old"), "new")
    assert text.endswith(f"|\n\n*Measured {date} with earlier code.*\n")
    text = tables.markdown(make_record(a="new", b="old"), "new")
    assert text.endswith(f"\n*Measured {date} with earlier code: `b`.*\n")


def test_a_run_goes_on_where_it_was_ended(tmp_path, monkeypatch):
    """Row by row is recorded; without names, what is out of date is measured."""
    monkeypatch.setattr(tables, "RECORDS", tmp_path)
    monkeypatch.setattr(tables, "PAGES", ())
    table = tables.Table(
        columns=("name", "size"),
        rows=("a", "b", "c"),
        measure=lambda name: [name, "1 mm"],
        inputs=("truths/head_wind.yaml",),
    )
    monkeypatch.setitem(vars(table), "code", "new")
    known = {"sizes": table}
    assert len(list(tables.asked_rows([], known))) == 3
    for name in ("c", "a"):
        tables.save_row("sizes", table, name, tables.measure(table, name))
    assert list(tables.load_record("sizes").rows) == ["a", "c"]
    assert list(tables.asked_rows([], known)) == [("sizes", "b")]
    assert list(tables.asked_rows(["sizes/c"], known)) == [("sizes", "c")]
    vars(table)["code"] = "newer"
    assert len(list(tables.asked_rows([], known))) == 3
    for unknown in ("sizes/d", "size"):
        with pytest.raises(InputError, match="expected one of"):
            list(tables.asked_rows([unknown], known))


SOURCES = {
    "row.py": (
        "from lib import used, unused\nfrom typing import TYPE_CHECKING\n\n"
        "FACTOR = 2\n\n\ndef row(name):\n    return helper(name) * FACTOR\n\n\n"
        "def helper(name):\n    return used.size(name)\n\n\n"
        "def other(name):\n    return unused.size(name)\n"
    ),
    "lib/__init__.py": "",
    "lib/used.py": (
        '"""Sizes."""\n\n\ndef size(name):\n    """A size."""\n'
        "    from lib import deep\n\n    return deep.LENGTH  # [m]\n"
    ),
    "lib/deep.py": "LENGTH = 1.0\n",
    "lib/unused.py": "def size(name):\n    return 3.0\n",
}


@pytest.mark.parametrize(
    ("file", "old", "new", "changes"),
    [
        ("row.py", "FACTOR = 2", "FACTOR = 3", True),
        ("row.py", "return helper(name)", "return -helper(name)", True),
        ("row.py", "return used.size(name)", "return 1 + used.size(name)", True),
        ("row.py", "unused.size(name)", "unused.size(name) + 1", False),
        ("lib/deep.py", "1.0", "1.5", True),
        ("lib/__init__.py", "", "START = 1\n", True),
        ("lib/unused.py", "3.0", "4.0", False),
        ("lib/used.py", "Sizes.", "The sizes.", False),
        ("lib/used.py", "A size.", "One size.", False),
        ("lib/used.py", "# [m]", "# In meters.", False),
    ],
)
def test_the_digest_is_of_the_code_that_a_row_runs(
    tmp_path, monkeypatch, file, old, new, changes
):
    def digest():
        for cached in (code_digest._file, code_digest._is_lazy, code_digest._module):
            cached.cache_clear()
        return code_digest.digest_of(row)

    monkeypatch.setattr(code_digest, "FOLDERS", (tmp_path,))
    row = types.FunctionType((lambda name: name).__code__, {}, "row")
    row.__module__ = "row"
    (tmp_path / "lib").mkdir()
    for name, text in SOURCES.items():
        (tmp_path / name).write_text(text)
    before = digest()
    assert digest() == before
    text = SOURCES[file].replace(old, new, 1)
    assert text != SOURCES[file]
    (tmp_path / file).write_text(text)
    assert (digest() != before) == changes


def test_the_digest_follows_names_that_are_loaded_lazily():
    """As examples import them; and other packages' imports for type checkers not."""
    imported = set(code_digest._module("examples.perch_corrected")[1])
    assert {"glider.sysid.pipeline", "diagrams.loops"} <= imported
    assert "glider.report.folder" not in imported
    assert code_digest._module("glider") == ("", ())
    assert code_digest._module("numpy") == ("", ())


@pytest.mark.nightly
def test_no_table_is_out_of_date():
    """`make tables` measures what is."""
    assert list(tables.asked_rows([], TABLES)) == []


@pytest.mark.nightly
@pytest.mark.parametrize(("name", "row"), [("samples", "slow_servo")])
def test_a_row_measured_again_is_the_same(name, row):
    """The code of today still measures it, but for the last digit."""
    then, now = tables.load_record(name).rows[row].cells, TABLES[name].measure(row)
    for old, new in zip(then, now, strict=True):
        assert NUMBER.sub("#", new) == NUMBER.sub("#", old)
        numbers = [[float(n) for n in NUMBER.findall(cell)] for cell in (new, old)]
        assert numbers[0] == pytest.approx(numbers[1], rel=0.05, abs=0.1)
