"""Runs an example's main on a result that is known, and looks at what it writes."""

import contextlib
import dataclasses
import io
import json
import types
from pathlib import Path
from unittest import mock

import matplotlib.image
import numpy as np


@dataclasses.dataclass(frozen=True, kw_only=True)
class Output:
    """What a main reported of a result."""

    figures: dict
    """What --json holds."""

    words: str
    """What was printed."""

    picture: np.ndarray | None
    """(rows, columns, 4) what --figure holds, from 0 to 1."""

    page: str | None
    """What --html holds."""

    asked: mock.Mock
    """The story function, which knows how it was called."""

    @property
    def size(self) -> tuple[int, int]:
        """Columns and rows of the picture."""
        rows, columns, _ = self.picture.shape
        return columns, rows

    @property
    def ink(self) -> float:
        """Share of the picture's pixels that are not white."""
        return float(np.mean(np.min(self.picture[..., :3], axis=-1) < 0.95))


def story_name(example: types.ModuleType) -> str:
    """Returns the name of an example's story function."""
    [name] = {"fly", "run"} & vars(example).keys()
    return name


@contextlib.contextmanager
def known_story(example: types.ModuleType, result: object):
    """Puts a result in the place of an example's story; yields what replaces it.

    It takes what the story takes, and nothing else.
    """
    story = story_name(example)
    with mock.patch.object(example, story, autospec=True, return_value=result) as asked:
        yield asked


NAMES = {"--json": "output.json", "--figure": "output.png", "--html": "output.html"}


def run_main(
    example: types.ModuleType,
    result: object,
    folder: Path,
    *arguments: str,
    writes: tuple[str, ...] = tuple(NAMES),
) -> Output:
    """Runs a main, with a result in the place of its story.

    Args:
        example: the module.
        result: of its story.
        folder: for what it writes.
        *arguments: of the command line, beside its files and --headless.
        writes: options of the files that it can write.
    """
    files = {option: folder / NAMES[option] for option in writes}
    given = [*arguments, *(f"{option}={file}" for option, file in files.items())]
    given += ["--headless"] if "--html" in files else []
    printed = io.StringIO()
    with known_story(example, result) as asked, contextlib.redirect_stdout(printed):
        example.main(given)
    picture, page = (files.get(option) for option in ("--figure", "--html"))
    return Output(
        figures=json.loads(files["--json"].read_text(encoding="utf-8")),
        words=printed.getvalue(),
        picture=matplotlib.image.imread(picture) if picture else None,
        page=page.read_text(encoding="utf-8") if page else None,
        asked=asked,
    )
