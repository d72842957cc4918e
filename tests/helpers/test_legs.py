"""Files that one of the two Drakes leaves out are there."""

from tests.helpers.legs import FILES, FOLDERS, TESTS


def test_what_is_named_is_there():
    assert [name for name in FILES if not (TESTS / name).is_file()] == []
    assert [name for name in FOLDERS if not (TESTS / name).is_dir()] == []
