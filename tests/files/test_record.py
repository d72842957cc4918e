"""A sealed record counts only with a key of its user's."""

import dataclasses

import pytest

from glider.errors import InputError
from glider.files import record


@dataclasses.dataclass(frozen=True)
class Header:
    work: str


@dataclasses.dataclass(frozen=True)
class Line:
    number: int
    seal: str = ""


@pytest.fixture
def cache(tmp_path, monkeypatch):
    folder = tmp_path / "cache"
    folder.mkdir()
    monkeypatch.setattr(record, "cache_folder", lambda: folder)
    return folder


def read(path):
    return record.read_sealed(path, Header("a"), Line, "a proof", "funnel")


def test_lines_are_read_as_they_were_appended(cache, tmp_path):
    path = tmp_path / "record"
    assert read(path) == []
    for number in (3, 5):
        record.append_sealed(path, Header("a"), Line(number))
    assert [line.number for line in read(path)] == [3, 5]
    path.write_text(path.read_text().replace("5", "6", 1))
    with pytest.raises(InputError, match="was not written by --resume"):
        read(path)


def test_a_key_that_anyone_knows_seals_nothing(cache, tmp_path):
    """Where a program broke off before it wrote one, the file is empty."""
    (cache / "proof_key").write_bytes(b"")
    with pytest.raises(InputError, match=r"proof_key: .* is 0; expected 32 bytes"):
        record.append_sealed(tmp_path / "record", Header("a"), Line(1))
