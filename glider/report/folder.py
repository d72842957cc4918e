"""Writes the folder of a report, all of it or nothing."""

import functools
import json
import os
from collections.abc import Callable
from pathlib import Path

from glider.errors import InputError
from glider.physics.model import save_model
from glider.report.figures import (
    FIGURES,
    make_figures,
)
from glider.report.json_report import to_json
from glider.report.page import to_html
from glider.sysid.result import Result


def write_report(result: Result, folder: Path) -> None:
    """Writes report.json, report.html, model.yaml and figures/*.png.

    All is made before anything is written, each file replaces its predecessor at
    once, and report.json comes last: where it is, the rest is too. Other files
    of the folder stay as they are.

    Raises:
        InputError: if the folder is a file.
    """
    figures = make_figures(result)
    files = {f"figures/{name}.png": png for name, png in figures.items()}
    files["report.html"] = to_html(result).encode()
    text = json.dumps(to_json(result), indent=2, ensure_ascii=False, allow_nan=False)

    make_folder(folder / "figures")
    replace_file(folder / "model.yaml", lambda path: save_model(path, result.model))
    for name, content in files.items():
        replace_file(folder / name, functools.partial(Path.write_bytes, data=content))
    for name in FIGURES.keys() - figures.keys():  # Of an earlier run.
        (folder / "figures" / f"{name}.png").unlink(missing_ok=True)
    write_text(folder / "report.json", text + "\n")


def make_folder(folder: Path) -> None:
    """Makes a folder with its parents; raises InputError if a file is in its way."""
    for target in (*reversed(folder.parents), folder):
        if target.exists() and not target.is_dir():
            raise InputError(f"{target}: is a file; a folder is needed.")
    folder.mkdir(parents=True, exist_ok=True)


def write_text(path: Path, text: str) -> None:
    """Writes a text file, all of it or nothing."""
    replace_file(path, functools.partial(Path.write_text, data=text, encoding="utf-8"))


def replace_file(path: Path, write: Callable[[Path], object]) -> None:
    """Writes a file beside its place, then moves it there: all of it or nothing."""
    temporary = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        write(temporary)
        temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)
