"""Writes files so that a half-written one never stands in the place of a whole one.

What is new is written beside its place first; then names change, which takes no space
and no time to speak of.
"""

import functools
import os
import shutil
import tempfile
from collections.abc import Callable, Mapping
from pathlib import Path

from glider.errors import InputError

_PREFIX = ".half-written-"


def make_folder(folder: Path) -> None:
    """Makes a folder with its parents; raises InputError if a file is in its way."""
    for target in (*reversed(folder.parents), folder):
        if target.exists() and not target.is_dir():
            raise InputError(f"{target}: is a file; a folder is needed.")
    folder.mkdir(parents=True, exist_ok=True)


def check_writable(folder: Path) -> None:
    """Raises InputError where a folder cannot be made or written: before the work."""
    place = next(p for p in (folder, *folder.absolute().parents) if p.exists())
    if not place.is_dir():
        raise InputError(f"{place}: is a file; a folder is needed.")
    try:
        with tempfile.TemporaryDirectory(prefix=_PREFIX, dir=place):
            pass
    except OSError as error:
        raise InputError(
            f"{folder}: cannot be written ({error.strerror}); "
            "a folder that you may write is needed."
        ) from None


def write_text(path: Path, text: str) -> None:
    """Writes a text file, all of it or nothing."""
    replace_file(path, functools.partial(Path.write_text, data=text, encoding="utf-8"))


def replace_file(path: Path, write: Callable[[Path], object]) -> None:
    """Writes a file beside its place, then moves it there: all of it or nothing."""
    # Its suffix stays: some writers tell the format by it.
    temporary = path.with_name(f"{_PREFIX}{os.getpid()}-{path.name}")
    try:
        write(temporary)
        temporary.replace(path)
    except OSError as error:
        raise _about(error, path) from None
    finally:
        temporary.unlink(missing_ok=True)


def replace_files(
    folder: Path, files: Mapping[str, bytes | None], *, last: str
) -> None:
    """Writes files of a folder: all of them, or it stays as it was.

    They are written into a folder within it. Then the old ones move out and the new
    ones in; where that is cut short by an exception, the old ones move back. Where the
    process is killed meanwhile, the file `last` is not there. Other files stay.

    Args:
        folder: made where it is not there.
        files: path within the folder to content; None for a file that is to be gone.
        last: of these files: it goes first and comes last, so that where it is, the
            others are too.

    Raises:
        InputError: if the folder is a file.
        OSError: it cannot be written, or the disk is full.
    """
    was_there = folder.is_dir()
    make_folder(folder)
    for left in folder.glob(f"{_PREFIX}*"):  # By a run that was killed.
        shutil.rmtree(left, ignore_errors=True)
    order = sorted(files, key=lambda name: name != last)
    try:
        with tempfile.TemporaryDirectory(prefix=_PREFIX, dir=folder) as part:
            new, old = Path(part) / "new", Path(part) / "old"
            for name, content in files.items():
                if content is not None:
                    _put(new / name, content)
            before = {name for name in files if (folder / name).exists()}
            try:
                for name in order:
                    _move(folder / name, old / name)
                for name in reversed(order):
                    _move(new / name, folder / name)
            except BaseException:
                for name in order:
                    if (old / name).exists() or name not in before:
                        _move(folder / name, new / name)
                    _move(old / name, folder / name)
                raise
    except OSError as error:
        if not was_there:
            _remove_empty(folder)
        raise _about(error, folder) from None


def _put(path: Path, content: bytes) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(content)


def _move(source: Path, target: Path) -> None:
    """Moves a file to where none is; what is not there need not be moved."""
    if source.exists() and not target.exists():
        target.parent.mkdir(parents=True, exist_ok=True)
        source.replace(target)


def _remove_empty(folder: Path) -> None:
    """Removes a folder in which nothing is but empty folders."""
    for path in (*sorted(folder.rglob("*"), reverse=True), folder):
        if not path.is_dir() or any(path.iterdir()):
            return
        path.rmdir()


def _about(error: OSError, path: Path) -> OSError:
    """Returns an error that names what was to be written, not where it was begun."""
    strerror = error.strerror or str(error)
    return OSError(error.errno, strerror, str(path))
