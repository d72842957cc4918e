"""The import assistant: takes that are dropped on the page, and a map for them."""

import dataclasses
import re
import secrets
import shutil
from collections.abc import AsyncIterator
from pathlib import Path

from diagrams.lab.folder import MAP, Watched
from diagrams.lab.state import Draft
from glider.campaign.importing.formats import SUFFIXES
from glider.errors import InputError, expect, show
from glider.files.writing import replace_file, write_text
from glider.report.wording import counted

MOST_BYTES = 200_000_000
"""Size of a take that is dropped; a Motive export of ten minutes has 100 MB."""

MOST_TAKES = 500

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

    def run(self) -> Draft:
        """Does it; what cannot be is in the answer."""
        text = self.text
        try:
            if not text:
                from glider.campaign.importing.guess import guess_mapping

                text = guess_mapping(self._files).text
            draft = self._check(text)
        except InputError as error:
            draft = self.refused(self._short(error), text)
        return dataclasses.replace(draft, is_proposed=not self.text)

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
        from glider.campaign.importing import campaign_import
        from glider.campaign.settings import read_settings
        from glider.progress import silent
        from glider.report.import_figure import save_import_figure

        self.out.mkdir(exist_ok=True)
        file, picture = self.out / MAP, self.out / "MAP.png"
        write_text(file, text)
        settings, claim = read_settings(file)
        if claim is None:
            raise InputError("The map has no 'columns:'; expected those of the takes.")
        recordings = campaign_import.read_logs(self._files, claim, silent)
        cuts = campaign_import.cut_recordings(recordings, claim, settings)
        flights = [flight for cut in cuts for flight in cut.flights]
        draft = Draft(text=text, takes=self.takes, flights=len(flights))
        if flights:
            campaign = campaign_import.campaign_of_cuts(settings, cuts)
            replace_file(picture, lambda path: save_import_figure(campaign, path))
        try:
            read = campaign_import.read_flights(self._files, file)
        except InputError as error:
            return dataclasses.replace(draft, refusal=self._short(error))
        return dataclasses.replace(draft, warnings=tuple(read.warnings))


def next_map_job(
    watched: Watched, draft: Draft | None, asked: str | None
) -> MapJob | None:
    """The map to propose or to check now: the one asked for, or for new takes.

    `asked` is the text of a map, "" for a proposal, None for neither.
    """
    takes = tuple(file.name for file in watched.takes)
    is_new = watched.is_open and (draft is None or draft.takes != takes)
    if not takes or (asked is None and not is_new):
        return None
    if asked is None:  # What a person has corrected stays.
        asked = draft.text if draft and not draft.is_proposed else ""
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
    taken, path = watched.takes, watched.path / name
    if not (watched.is_open or watched.has_takes):
        raise InputError("This session's throws are its own; expected no takes.")
    if path.exists() or len(taken) >= MOST_TAKES:
        why = "exists" if path.exists() else f"is one more than {MOST_TAKES}"
        raise InputError(f"{show(name)}: {why}; expected a new take.")
    part, size = watched.kept / f"upload-{secrets.token_hex(8)}", 0
    try:
        with part.open("wb") as file:
            async for data in parts:
                size += len(data)
                if size > min(MOST_BYTES, shutil.disk_usage(watched.kept).free // 2):
                    raise InputError(
                        f"{show(name)}: is too large; expected at most "
                        f"{MOST_BYTES // 1_000_000} MB, and room for it on the disk."
                    )
                file.write(data)
        expect(size > 0, "a take", "nothing", "a file with rows")
        part.rename(path)
    finally:
        part.unlink(missing_ok=True)
