"""Files that are left out or run first are there."""

from tests.helpers.legs import FILES, FOLDERS
from tests.helpers.order import LONGEST, TESTS, place_of


def test_what_is_named_is_there():
    assert [name for name in (*FILES, *LONGEST) if not (TESTS / name).is_file()] == []
    assert [name for name in FOLDERS if not (TESTS / name).is_dir()] == []


def test_the_longest_come_first():
    places = [place_of(TESTS / name) for name in (*LONGEST, "test_paths.py")]
    assert places == sorted(set(places))
