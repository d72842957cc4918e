"""Files that one of the two Drakes leaves out are there."""

from types import SimpleNamespace

import pytest

from tests import conftest
from tests.helpers.legs import FILES, FOLDERS, TESTS


def test_what_is_named_is_there():
    assert [name for name in FILES if not (TESTS / name).is_file()] == []
    assert [name for name in FOLDERS if not (TESTS / name).is_dir()] == []


@pytest.mark.parametrize(("asked", "is_ignored"), [("", True), ("sysid", None)])
def test_all_but_what_is_left_out_is_imported(monkeypatch, asked, is_ignored):
    monkeypatch.setattr(conftest, "IS_LEFT_OUT", True)
    config = SimpleNamespace(args=[str(TESTS / asked)])
    for path in (TESTS / "sysid", TESTS / FILES[0]):
        assert conftest.pytest_ignore_collect(path, config) is is_ignored
    for path in (TESTS, TESTS / "systems", TESTS / "systems" / "test_plant.py"):
        assert conftest.pytest_ignore_collect(path, config) is None
