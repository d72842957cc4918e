"""A half-written file never stands in the place of a whole one."""

import errno
import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

from glider.errors import InputError
from glider.files import writing
from glider.files.writing import check_writable, replace_file, replace_files

OLD = {"a": b"old a", "sub/b": b"old b", "last": b"old"}
NEW = {"a": b"new a", "sub/b": None, "sub/c": b"new c", "last": b"new"}


def files_of(folder):
    return {
        str(p.relative_to(folder)): p.read_bytes()
        for p in folder.rglob("*")
        if p.is_file()
    }


@pytest.fixture
def folder(tmp_path):
    """A folder with files of an earlier run, and one of the user's."""
    folder = tmp_path / "report"
    replace_files(folder, OLD, last="last")
    (folder / "mine").write_bytes(b"mine")
    return folder


def test_new_files_replace_old_ones_and_leave_others(folder):
    replace_files(folder, NEW, last="last")
    expected = {"mine": b"mine", "a": b"new a", "sub/c": b"new c", "last": b"new"}
    assert files_of(folder) == expected


@pytest.mark.parametrize("stop", range(3))
@pytest.mark.parametrize("error", [OSError(errno.EIO, "broken"), KeyboardInterrupt()])
def test_where_the_moving_is_cut_short_the_last_file_is_not_there(
    folder, monkeypatch, stop, error
):
    replace, moved = Path.replace, []

    def fail_once(path, target):
        moved.append(path)
        if len(moved) == stop + 1:
            raise error
        return replace(path, target)

    monkeypatch.setattr(Path, "replace", fail_once)
    with pytest.raises(type(error)):
        replace_files(folder, NEW, last="last")
    assert len(moved) == stop + 1
    left = files_of(folder)
    assert "last" not in left
    assert left["mine"] == b"mine"
    assert not [name for name in left if name.startswith(writing._PREFIX)]


def test_a_disk_that_fills_up_leaves_the_folder_as_it_was(folder, monkeypatch):
    before, write = files_of(folder), Path.write_bytes

    def fill_the_disk(path, data):
        if path.name == "last":
            raise OSError(errno.ENOSPC, "No space left on device")
        return write(path, data)

    monkeypatch.setattr(Path, "write_bytes", fill_the_disk)
    with pytest.raises(OSError, match=rf"No space left on device: '{folder}'"):
        replace_files(folder, NEW, last="last")
    assert files_of(folder) == before


def test_a_folder_that_could_not_be_filled_is_not_left_behind(tmp_path, monkeypatch):
    def fill_the_disk(path, data):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(Path, "write_bytes", fill_the_disk)
    with pytest.raises(OSError, match="No space left"):
        replace_files(tmp_path / "report", OLD, last="last")
    assert not (tmp_path / "report").exists()


SLOW = """
import sys, time
from pathlib import Path
from glider.files import writing

write = Path.write_bytes

def write_slowly(path, content):
    write(path, content)
    print("begun", flush=True)
    sys.stdin.readline()

Path.write_bytes = write_slowly
writing.replace_files(Path(sys.argv[1]), {"last": b"other"}, last="last")
"""


@pytest.fixture
def writer(folder):
    """Another process, in the middle of writing the folder."""
    process = subprocess.Popen(
        [sys.executable, "-c", SLOW, str(folder)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
    )
    assert process.stdout.readline() == b"begun\n"
    yield process
    process.kill()
    process.communicate()


def test_killed_in_the_middle_the_old_files_stay(folder, writer):
    before = files_of(folder)
    writer.kill()
    writer.wait()
    kept = {n: c for n, c in before.items() if not n.startswith(writing._PREFIX)}
    assert kept == {**OLD, "mine": b"mine"}
    for left in folder.glob(f"{writing._PREFIX}*"):  # As they are a day later.
        os.utime(left, (0.0, 0.0))
    replace_files(folder, NEW, last="last")
    assert not list(folder.glob(f"{writing._PREFIX}*"))


def test_a_run_leaves_what_another_one_is_writing(folder, writer):
    replace_files(folder, NEW, last="last")
    writer.communicate(b"\n")
    assert writer.returncode == 0
    assert files_of(folder)["last"] == b"other"


def test_a_file_is_written_whole_or_not_at_all(tmp_path):
    path = tmp_path / "file.txt"
    path.write_text("old")

    def half(place):
        place.write_text("ha")
        raise OSError(errno.ENOSPC, "No space left on device")

    with pytest.raises(OSError, match=r"file\.txt"):
        replace_file(path, half)
    assert files_of(tmp_path) == {"file.txt": b"old"}


def test_what_cannot_be_written_is_reported_before_the_work(tmp_path):
    (tmp_path / "file").touch()
    check_writable(tmp_path / "new" / "folder")
    assert files_of(tmp_path) == {"file": b""}
    with pytest.raises(InputError, match="file: is a file"):
        check_writable(tmp_path / "file" / "folder")


@pytest.mark.skipif(not Path("/proc/self").exists(), reason="there is no /proc here")
def test_a_folder_that_cannot_be_written_is_reported():
    begin = time.monotonic()
    with pytest.raises(InputError, match=r"/proc/report: cannot be written \("):
        check_writable(Path("/proc/report"))
    assert time.monotonic() - begin < 1.0
    assert os.path.exists("/proc")
