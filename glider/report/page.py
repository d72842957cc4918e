"""report.html: one file that needs nothing else."""

import importlib.metadata
import math
import platform

from glider.physics.effects import ANGLE_SIGN
from glider.report.as_page import render_page
from glider.report.error_table import baseline, columns_of, error_rows
from glider.report.figures_of_result import make_figures
from glider.report.flight_errors import STANDS_OUT, worst_flights
from glider.report.flight_figures import flights_in_page
from glider.report.numbers import format_angle, format_length
from glider.report.plots.figure import Figure
from glider.report.plots.style import LABELS
from glider.report.tables import (
    combination_rows,
    correlation_rows,
    spread_rows,
    spread_values,
    vehicle_rows,
)
from glider.report.wording import effect_view, headline, notes_of, remarks, say
from glider.sysid.result import Result


def to_html(result: Result, figures: dict[str, Figure] | None = None) -> str:
    """The page of a result: one file that needs nothing else.

    Args:
        result: of closing the loop.
        figures: of the result; made from it if None.
    """
    return render_page(
        "report.html",
        make_figures(result) if figures is None else figures,
        result=result,
        headline=headline(result),
        remarks=remarks(result),
        models=columns_of(result),
        labels=LABELS,
        baseline=baseline(result),
        rows=error_rows(result),
        effects=[effect_view(e, result) for e in result.effects],
        in_page=len(flights_in_page(result)),
        has_signs=any(e.kind == ANGLE_SIGN.kind for e in result.effects),
        notes=notes_of(result),
        air=" ".join(say("air", result)),
        combinations=combination_rows(result),
        correlations=correlation_rows(result),
        folds=" ".join(say("folds", result)),
        worst=worst_flights(result),
        stands_out=STANDS_OUT,
        spreads=spread_rows(result),
        spread_values=spread_values(result),
        vehicle=vehicle_rows(result),
        noise_position=format_length(result.noise.position_m),
        noise_pitch=format_angle(result.noise.pitch_rad),
        versions=_versions(result),
        total=sum(s for s in result.seconds.values() if math.isfinite(s)),
    )


def _versions(result):
    versions = {"drake-glider": result.version, "Python": platform.python_version()}
    for package in ("drake", "numpy", "numba"):
        versions[package] = importlib.metadata.version(package)
    return versions
