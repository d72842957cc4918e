"""Reports say what they said: sentences, tables and fields of report.json."""

import pytest

from tests.report.results import VARIANTS
from tests.report.snapshots import file_of, snapshot


@pytest.mark.parametrize("name", VARIANTS)
def test_a_report_is_as_it_was_read_last(name):
    """`python -m tests.report.snapshots` writes the file again."""
    assert snapshot(name) == file_of(name).read_text(encoding="utf-8")
