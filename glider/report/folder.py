"""Writes the folder of a report, all of it or nothing."""

import datetime
import math
from pathlib import Path

from glider.files.schema import json_text
from glider.files.writing import replace_files
from glider.physics.model import Origin, model_text
from glider.report.figures_of_result import FIGURES, make_figures
from glider.report.page import to_html
from glider.report.plots.as_file import to_png
from glider.report.wording import notes_of
from glider.sysid.result import Result


def write_report(result: Result, folder: Path | str) -> None:
    """Writes report.json, report.html, model.yaml and figures/*.png.

    All is made before anything is written, and what cannot be written in full leaves
    the folder as it was. Where report.json is, the rest is too. Other files of the
    folder stay as they are.

    Raises:
        InputError: if the folder is a file.
        OSError: if it cannot be written.
    """
    figures = make_figures(result)
    # None: a figure of an earlier run.
    files: dict[str, bytes | None] = {f"figures/{name}.png": None for name in FIGURES}
    for name, figure in figures.items():
        files[f"figures/{name}.png"] = to_png(figure)
    files["report.html"] = to_html(result, figures).encode()
    text_of_model = model_text(result.model, origin_of(result), result.covariance)
    files["model.yaml"] = text_of_model.encode()
    files["report.json"] = f"{json_text(result.report)}\n".encode()
    replace_files(Path(folder), files, last="report.json")


def origin_of(result: Result) -> Origin:
    """Returns where the corrected model comes from, and how well it is known."""
    errors = {
        f"{effect.kind}.{name}": estimate.std
        for effect in result.effects
        for name, estimate in effect.coefficients.items()
    }
    errors |= {name: estimate.std for name, estimate in result.vehicle.items()}
    return Origin(
        source=str(result.path),
        date=datetime.datetime.now().astimezone().isoformat(timespec="seconds"),
        version=f"drake-glider {result.version}",
        standard_errors={n: float(s) for n, s in errors.items() if math.isfinite(s)},
        notes=notes_of(result),
    )
