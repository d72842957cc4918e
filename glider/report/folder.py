"""The folder of a report: its figures, its page, its model and its numbers."""

import datetime
import importlib.metadata
import math
import platform
from collections.abc import Callable
from pathlib import Path

from glider.files.schema import json_text
from glider.files.writing import replace_files
from glider.physics.covariance import Covariance
from glider.physics.effects import ANGLE_SIGN
from glider.physics.model import GliderModel, Origin, model_text
from glider.report import error_table, flight_figures, model_figures, numbers, wording
from glider.report.as_page import render_page
from glider.report.plots.figure import Figure
from glider.sysid.result import Result

FIGURES: dict[str, Callable[[Result], Figure | None]] = {
    "free_functions": model_figures.free_functions_figure,
    "coefficients": model_figures.coefficients_figure,
    "held_out": flight_figures.held_out_figure,
    "residual": model_figures.residual_figure,
}
"""Function that makes each figure, by its name in the page."""


def write_report(result: Result, folder: Path | str) -> None:
    """Writes report.json, report.html and model.yaml.

    Models that are nearly as likely are rivals/rival_1.yaml and so on, the likeliest
    first. All is made before anything is written, and what cannot be written in full
    leaves the folder as it was. Where report.json is, the rest is too. Other files of
    the folder stay as they are.

    Raises:
        InputError: if the folder is a file.
        OSError: if it cannot be written.
    """
    files: dict[str, bytes | None] = {"report.html": to_html(result).encode()}
    notes = wording.notes_of(result)
    text = _model_text(result, result.model, result.covariance, notes)
    files["model.yaml"] = text.encode()
    for path in Path(folder).glob("rivals/rival_*.yaml"):
        if path.stem.removeprefix("rival_").isdigit():  # Of an earlier run.
            files[f"rivals/{path.name}"] = None
    for number, rival in enumerate(result.rivals, 1):
        note = (
            "a rival of model.yaml: of the explanations that are nearly as likely, its "
            f"probability is {rival.probability:.2g}, that of model.yaml "
            f"{result.alternatives[0].probability:.2g}"
        )
        text = _model_text(result, rival.model, rival.covariance, [note])
        files[f"rivals/rival_{number}.yaml"] = text.encode()
    files["report.json"] = f"{json_text(result.report)}\n".encode()
    replace_files(Path(folder), files, last="report.json")


def to_html(result: Result) -> str:
    """The page of a result, one file; figures with nothing to show are omitted."""
    figures = {name: make(result) for name, make in FIGURES.items()}
    versions = {"drake-glider": result.version, "Python": platform.python_version()}
    for package in ("drake", "numpy", "numba"):
        versions[package] = importlib.metadata.version(package)
    return render_page(
        "report.html",
        {name: figure for name, figure in figures.items() if figure is not None},
        result=result,
        versions=versions,
        error_table=error_table,
        numbers=numbers,
        wording=wording,
        in_page=len(flight_figures.flights_in_page(result)),
        has_signs=any(e.kind == ANGLE_SIGN.kind for e in result.effects),
        total=sum(s for s in result.seconds.values() if math.isfinite(s)),
    )


def _model_text(
    result: Result, model: GliderModel, known: Covariance | None, notes: list[str]
) -> str:
    """A model's file: what it is, how well it is known, where it comes from."""
    errors = {}
    if known:
        errors = dict(zip(known.names, known.std.tolist(), strict=True))
    now = datetime.datetime.now().astimezone()
    origin = Origin(
        source=result.path.name,
        date=now.isoformat(timespec="seconds"),
        version=f"drake-glider {result.version}",
        standard_errors=errors,
        notes=notes,
        warnings=wording.say("model_warnings", result),
    )
    return model_text(model, origin, known)
