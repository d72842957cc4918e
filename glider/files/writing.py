"""Writes files so that a half-written one never stands in the place of a whole one.

New files are written beside their place first; then they are renamed, which takes
neither disk space nor time to speak of.
"""

import contextlib
import functools
import os
import shutil
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path

from glider.errors import InputError

_PREFIX = ".half-written-"

_DAY = 86_400.0
"""Age at which half-written files are of a run that was killed, not of another [s]."""


def _nearest_folder(folder: Path) -> Path:
    """The folder, or the first of its parents that exists; InputError for a file."""
    place = next(p for p in (folder, *folder.absolute().parents) if p.exists())
    if not place.is_dir():
        raise InputError(f"{place}: is a file; expected a folder.")
    return place


def check_writable(folder: Path) -> None:
    """Raises InputError where a folder cannot be made or written: before the work."""
    place = _nearest_folder(folder)
    try:
        with tempfile.TemporaryDirectory(prefix=_PREFIX, dir=place):
            pass
    except OSError as error:
        raise InputError(
            f"{folder}: cannot be written ({error.strerror}); "
            "expected a folder that you may write."
        ) from None


def write_text(path: Path, text: str) -> None:
    """Writes a text file, all of it or nothing."""
    replace_file(path, functools.partial(Path.write_text, data=text, encoding="utf-8"))


def replace_file(path: Path, write: Callable[[Path], object]) -> None:
    """Writes a file beside its place, then moves it there: all of it or nothing."""
    # The suffix stays: some writers take the format from it.
    temporary = path.with_name(f"{_PREFIX}{os.getpid()}-{path.name}")
    try:
        with _errors_about(path):
            write(temporary)
            temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)


def replace_files(
    folder: Path, files: Mapping[str, bytes | None], *, last: str
) -> None:
    """Writes files of a folder, None for one to remove: all, or it stays as it was.

    Everything is written into a temporary folder within it and then moved. The file
    `last` is removed first and comes last: where it is, the others are too. Other files
    stay. InputError if the folder is a file.
    """
    was_there = folder.is_dir()
    _nearest_folder(folder)
    folder.mkdir(parents=True, exist_ok=True)
    _remove_old_leftovers(folder)
    try:
        with (
            _errors_about(folder),
            tempfile.TemporaryDirectory(prefix=_PREFIX, dir=folder) as part,
        ):
            for name, content in files.items():
                if content is not None:
                    new = Path(part, name)
                    new.parent.mkdir(parents=True, exist_ok=True)
                    new.write_bytes(content)
                    (folder / name).parent.mkdir(parents=True, exist_ok=True)
            (folder / last).unlink(missing_ok=True)
            for name in sorted(files, key=lambda name: name == last):
                if files[name] is None:
                    (folder / name).unlink(missing_ok=True)
                else:
                    Path(part, name).replace(folder / name)
    except OSError:
        if not was_there:
            with contextlib.suppress(OSError):
                folder.rmdir()
        raise


def _remove_old_leftovers(folder: Path) -> None:
    """Removes what killed runs left; a run that is writing now keeps its files."""
    for left in folder.glob(f"{_PREFIX}*"):
        with contextlib.suppress(OSError):
            if time.time() - left.stat().st_mtime > _DAY:
                shutil.rmtree(left) if left.is_dir() else left.unlink()


@contextlib.contextmanager
def _errors_about(path: Path) -> Iterator[None]:
    """Lets OSErrors name what was to be written, not the temporary file."""
    try:
        yield
    except OSError as error:
        reason = error.strerror or str(error)
        raise OSError(error.errno, reason, str(path)) from None
