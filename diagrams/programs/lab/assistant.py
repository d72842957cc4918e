"""The import assistant: takes that are dropped on the page, and a map for them."""

import contextlib
import dataclasses
import re
import secrets
import shutil
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Any

from diagrams.programs.lab.folder import MAP, Watched, read_some
from diagrams.programs.lab.state import Draft
from glider.campaign.importing.formats import SUFFIXES
from glider.campaign.importing.guess import quoted
from glider.campaign.logs import Campaign
from glider.errors import InputError, expect, show
from glider.files import schema
from glider.files.writing import replace_file, write_text
from glider.report.wording import counted

_MOST_BYTES = 200_000_000
"""Size of a take that is dropped; a Motive export of ten minutes has 100 MB."""

_MOST_TAKES = 500

_NAME = re.compile(r"\w[\w .()+-]{0,118}")


@dataclasses.dataclass(frozen=True, kw_only=True)
class MapJob:
    """A map to propose for takes, or to check."""

    folder: Path  #: Of the takes.
    out: Path  #: Folder of the picture.
    takes: tuple[str, ...]
    text: str = ""  #: Of the map; "" to propose one.

    @property
    def words(self) -> str:
        """What is done."""
        what = "checking the map" if self.text else "proposing axes, units and signs"
        return f"{what} ({counted(self.takes, 'take')})"

    @property
    def failure(self) -> str:
        """The beginning of a sentence about why it was not done."""
        return "The map could not be checked" if self.text else "No map was proposed"

    def run(self) -> Draft:
        """Does it; what cannot be is in the answer."""
        from glider.campaign.importing.guess import guess_columns, guess_mapping
        from glider.campaign.importing.readers import read_recordings

        text = self.text
        try:
            if not text:
                guess, _ = read_some(self._files, guess_mapping)
                text = guess.text
            draft = self._check(text)
        except InputError as error:
            if not text:
                with contextlib.suppress(InputError):  # What is known of it stays.
                    columns, _ = read_some(self._files, guess_columns)
                    text = schema.yaml_text({"columns": columns}) if columns else ""
            draft = self.refused(self._short(error), text)
        names: dict[str, None] = {}  # Of columns, in their order.
        for file in self._files:  # Those of one take are enough.
            with contextlib.suppress(InputError):
                for recording in read_recordings(file):
                    names.update(dict.fromkeys(recording.names()))
                break
        return dataclasses.replace(
            draft, is_proposed=not self.text, columns=tuple(names)
        )

    def refused(self, why: str, text: str = "", *, is_fault: bool = False) -> Draft:
        """The answer where there is none."""
        return Draft(text=text or self.text, takes=self.takes, refusal=why)

    @property
    def _files(self) -> list[Path]:
        return [self.folder / name for name in self.takes]

    def _short(self, error: InputError) -> str:
        """A refusal without the folder: people see the page of it."""
        return str(error).replace(f"{self.out}/", "").replace(f"{self.folder}/", "")

    def _check(self, text: str) -> Draft:
        """Draws the flights as a map reads them, then checks them against it."""
        from glider.campaign.importing import campaign_import, joining
        from glider.campaign.settings import read_settings
        from glider.progress import silent
        from glider.report.import_figure import save_import_figure

        self.out.mkdir(exist_ok=True)
        file = self.out / MAP
        picture = self.out / "MAP.png"
        write_text(file, text)
        settings, claim = read_settings(file)
        if claim is None:
            raise InputError("The map has no 'columns:'; expected those of the takes.")

        def cut(files: list[Path]) -> tuple[list[Path], Campaign]:
            recordings = joining.read_logs(files, claim, silent)
            found = campaign_import.cut_recordings(recordings, claim, settings)
            return files, found.campaign

        (files, campaign), skipped = read_some(self._files, cut)
        flights = len(campaign.flights)
        draft = Draft(text=text, takes=self.takes, flights=flights, skipped=skipped)
        if flights:
            replace_file(picture, lambda path: save_import_figure(campaign, path))
        try:
            read = campaign_import.read_flights(files, file)
        except InputError as error:
            return dataclasses.replace(draft, refusal=self._short(error))
        return dataclasses.replace(draft, warnings=tuple(read.warnings))


def _parse_map(text: str) -> dict[str, Any]:
    """The fields of a map; axes by one name are a field of 'frame', too."""
    known = schema.parse_yaml(text, MAP) or {}
    if not isinstance(known, dict):
        raise InputError(f"{MAP}: is no map; expected fields such as 'columns:'.")
    if isinstance(known.get("frame"), str):
        known["frame"] = {"axes": known["frame"]}
    return known


def map_fields(text: str) -> dict[str, dict[str, str]]:
    """Fields of a map by section, "" for those outside of one; {} for what is no map.

    Fields that are lists or have fields of their own are left out.
    """
    try:
        known = _parse_map(text)
    except InputError:
        return {}
    found: dict[str, dict[str, str]] = {}
    for section, fields in {"": known, **known}.items():
        if isinstance(fields, dict):
            plain = {k: v for k, v in fields.items() if isinstance(v, str | float)}
            found[section] = {name: str(value) for name, value in plain.items()}
    return found


def with_map_field(text: str, section: str, name: str, value: str) -> str:
    """The text of a map with another value of a field, "" for none.

    Where only the value of a line changes, the comments of the others stay; otherwise
    the map is rewritten without comments.
    """
    known = _parse_map(text)
    fields = known.setdefault(section, {}) if section else known
    if not isinstance(fields, dict):
        raise InputError(f"{MAP}: '{section}' has no fields; expected such as {name}.")
    fields.pop(name, None)
    if value:
        fields[name] = value
    if section and not fields:
        del known[section]
    indent = "  " if section else ""
    line = f"{indent}{name}: {quoted(value)}"
    written = re.compile(rf"^{indent}{re.escape(name)}:.*$", re.MULTILINE)
    head = re.search(rf"^{re.escape(section)}:", text, re.MULTILINE)
    begin = head.end() if section and head else 0
    edited = text[:begin] + written.sub(lambda _: line, text[begin:], count=1)
    with contextlib.suppress(InputError):
        if schema.parse_yaml(edited, MAP) == known:
            return edited
    return schema.yaml_text(known)


def next_map_job(
    watched: Watched, draft: Draft | None, asked: str | None
) -> MapJob | None:
    """The map to propose or to check now: the one asked for, or for new takes.

    `asked` is the text of a map, "" for a proposal, None for neither.
    """
    takes = tuple(file.name for file in watched.takes)
    if not takes:
        return None
    if asked is None:
        is_known = draft is not None and draft.takes == takes
        if is_known or not watched.is_open:
            return None
        asked = ""
        if draft and not draft.is_proposed:  # What a person has corrected stays.
            asked = draft.text
    return MapJob(
        folder=watched.path, out=watched.kept / "draft", takes=takes, text=asked
    )


def save_map(watched: Watched, draft: Draft | None, text: str) -> None:
    """Writes a map that was checked: from here on takes are imported with it.

    Raises:
        InputError: it was not checked, or takes contradict it.
    """
    if draft is None or draft.text != text or draft.refusal:
        raise InputError("The map was not checked, or is refused; expected a good one.")
    write_text(watched.path / MAP, text)


async def save_take(watched: Watched, name: str, parts: AsyncIterator[bytes]) -> None:
    """Saves a take that was dropped: all of it or nothing, and over no other file.

    Raises:
        InputError: its name or size cannot be, or it is there already.
    """
    expected = f"letters, digits, spaces and .()+-_, ending in {', '.join(SUFFIXES)}"
    known = _NAME.fullmatch(name) and name.lower().endswith(SUFFIXES)
    expect(known, "the name of a take", name[:120], expected)
    taken = watched.takes
    path = watched.path / name
    if not (watched.is_open or watched.has_takes):
        raise InputError("This session's throws are its own; expected no takes.")
    if path.exists() or len(taken) >= _MOST_TAKES:
        why = "exists" if path.exists() else f"is one more than {_MOST_TAKES}"
        raise InputError(f"{show(name)}: {why}; expected a new take.")
    part = watched.kept / f"upload-{secrets.token_hex(8)}"
    size = 0
    try:
        with part.open("wb") as file:
            async for data in parts:
                size += len(data)
                if size > min(_MOST_BYTES, shutil.disk_usage(watched.kept).free // 2):
                    raise InputError(
                        f"{show(name)}: is too large; expected at most "
                        f"{_MOST_BYTES // 1_000_000} MB, and room for it on the disk."
                    )
                file.write(data)
        expect(size > 0, "a take", "nothing", "a file with rows")
        part.rename(path)
    finally:
        part.unlink(missing_ok=True)
