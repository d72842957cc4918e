"""The reading step: the recordings in the files that an import is given.

With `join: [poses_*.csv, servo_*.csv]` in the mapping several files make a recording,
those with the same text for *: one by a motion capture system, and one by a servo.
"""

import dataclasses
import fnmatch
from collections.abc import Iterable, Sequence
from pathlib import Path

from glider.campaign.importing.readers import read_recording, read_recordings
from glider.campaign.importing.recording import Group, Recording
from glider.campaign.settings import ColumnMapping
from glider.errors import InputError, expect
from glider.progress import Progress, announced

_Files = dict[str, Path]  # Of one recording, by the patterns of `join`.


def as_files(files: Iterable[Path | str]) -> list[Path]:
    """Returns paths of logs; InputError where there are none."""
    expect(
        isinstance(files, Iterable) and not isinstance(files, (str, Path)),
        "files",
        files,
        "a list of paths of logs",
    )
    listed = list(files)
    if not listed:
        raise InputError("no files were given; expected one log or more.")
    for file in listed:
        expect(isinstance(file, (str, Path)), "files", file, "paths of logs")
    return [Path(file) for file in listed]


def read_logs(
    files: Sequence[Path], mapping: ColumnMapping, progress: Progress
) -> list[Recording]:
    """Reads the recordings in files, in the order of their names.

    Of joined files the groups are named by the patterns, and each file has a clock of
    its own.

    Args:
        files: logs of any known format.
        mapping: has the patterns by which they are joined, if they are.
        progress: called with each file, or text in place of *, before it is read.

    Raises:
        InputError: a file cannot be read, or one that it is joined with is missing.
    """
    if not mapping.join:
        recordings = []
        for file in announced(sorted(set(files)), "reading", progress):
            recordings += read_recordings(file)
        return recordings
    takes = _find_takes(files, mapping.join)
    joined = {file for take in takes.values() for file in take.values()}
    for file in sorted(set(files) - joined):
        raise InputError(
            f"{file}: it makes no recording by 'join' in {mapping.source}; expected a "
            f"file for each of {', '.join(mapping.join)} with the same text for *."
        )
    texts = announced(sorted(takes), "reading", progress)
    return [_join(takes[text]) for text in texts]


def _find_takes(files: Sequence[Path], patterns: Sequence[str]) -> dict[str, _Files]:
    """The files of each recording, by their text for *.

    Texts for which a pattern has no file are left out.
    """
    takes: dict[str, _Files] = {}
    for pattern in patterns:
        before, _, after = pattern.partition("*")
        for file in sorted(files):
            if fnmatch.fnmatch(file.name, pattern):
                text = file.name.removeprefix(before).removesuffix(after)
                takes.setdefault(text, {})[pattern] = file
    return {text: own for text, own in takes.items() if len(own) == len(patterns)}


def _join(files: _Files) -> Recording:
    """One recording of several files, with the rotation and axis of the poses' format.

    Times of a calendar are counted from the earliest day in any of the files on.
    """
    parts = {pattern: read_recording(file) for pattern, file in files.items()}
    groups = [(pattern, own) for pattern, part in parts.items() for own in part.groups]
    epochs = [
        column.epoch
        for _, group in groups
        for column in group.columns.values()
        if column.epoch is not None
    ]
    start = min(epochs, default=0.0)

    joined = []
    for pattern, group in groups:
        shifted = {}
        for name, column in group.columns.items():
            since = 0.0 if column.epoch is None else column.epoch - start
            shifted[name] = dataclasses.replace(column, values=column.values + since)
        full_name = f"{pattern}:{group.name}" if group.name else pattern
        joined.append(Group(full_name, shifted, group.time, clock=pattern))
    posed = max(parts.values(), key=lambda part: (bool(part.rotation), part.up))
    path = next(iter(files.values()))
    return Recording(path, tuple(joined), posed.rotation, up=posed.up)
