"""report.html: one file that needs nothing else."""

import importlib.metadata
import math
import platform

from glider.physics.effects import ANGLE_SIGN
from glider.report import error_table, flight_errors, numbers, tables, wording
from glider.report.as_page import render_page
from glider.report.figures_of_result import make_figures
from glider.report.flight_figures import flights_in_page
from glider.report.plots.figure import Figure
from glider.report.plots.style import LABELS
from glider.sysid.result import Result


def to_html(result: Result, figures: dict[str, Figure] | None = None) -> str:
    """The page of a result: one file that needs nothing else.

    Args:
        result: of closing the loop.
        figures: of the result; made from it if None.
    """
    versions = {"drake-glider": result.version, "Python": platform.python_version()}
    for package in ("drake", "numpy", "numba"):
        versions[package] = importlib.metadata.version(package)
    return render_page(
        "report.html",
        make_figures(result) if figures is None else figures,
        result=result,
        versions=versions,
        labels=LABELS,
        error_table=error_table,
        flight_errors=flight_errors,
        numbers=numbers,
        tables=tables,
        wording=wording,
        in_page=len(flights_in_page(result)),
        has_signs=any(e.kind == ANGLE_SIGN.kind for e in result.effects),
        total=sum(s for s in result.seconds.values() if math.isfinite(s)),
    )
