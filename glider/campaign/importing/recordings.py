"""Files made recordings: one each, or those that a mapping joins."""

import dataclasses
import fnmatch
from collections.abc import Sequence
from pathlib import Path

from glider.campaign.importing.mapping import Mapping
from glider.campaign.importing.raw import RawTable
from glider.campaign.importing.readers import read_raw
from glider.errors import InputError


def read_recordings(files: Sequence[Path], mapping: Mapping) -> list[RawTable]:
    """Returns the recordings in files, in the order of their names.

    With `join: [poses_*.csv, servo_*.csv]` the files with the same text for * are one,
    its groups are named by the patterns, and each file has a clock of its own.

    Raises:
        InputError: a file cannot be read, fits no pattern or lacks its companions.
    """
    if not mapping.join:
        return [read_raw(file) for file in sorted(files)]
    parts: dict[str, dict[str, Path]] = {}
    for file in sorted(files):
        pattern = next((p for p in mapping.join if fnmatch.fnmatch(file.name, p)), None)
        if pattern is None:
            raise InputError(
                f"{file}: its name fits none of {', '.join(mapping.join)}, the "
                f"patterns of 'join' in {mapping.source}."
            )
        before, _, after = pattern.partition("*")
        key = file.name.removeprefix(before).removesuffix(after)
        parts.setdefault(key, {})[pattern] = file
    for key, found in parts.items():
        lacking = [p.replace("*", key) for p in mapping.join if p not in found]
        if lacking:
            raise InputError(
                f"{next(iter(found.values()))}: there is no {lacking[0]} to join it "
                f"with, as {mapping.source} says."
            )
    return [_join(found, mapping.join) for _, found in sorted(parts.items())]


def _join(files: dict[str, Path], patterns: Sequence[str]) -> RawTable:
    tables = {pattern: read_raw(files[pattern]) for pattern in patterns}
    groups = tuple(
        dataclasses.replace(
            group,
            name=f"{pattern}:{group.name}" if group.name else pattern,
            clock=pattern,
        )
        for pattern, table in tables.items()
        for group in table.groups
    )
    rotations = [t.rotation for t in tables.values() if t.rotation]
    return RawTable(
        path=files[patterns[0]],
        groups=groups,
        rotation=rotations[0] if rotations else None,
    )
