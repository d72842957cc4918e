"""report.html: one file that needs nothing else."""

import base64
import importlib.metadata
import math
import platform
from collections.abc import Mapping

import jinja2

from glider.report.error_table import (
    baseline,
    columns_of,
    error_rows,
)
from glider.report.figures import (
    DPI,
    MOST_FLIGHTS,
)
from glider.report.flight_errors import STANDS_OUT, worst_flights
from glider.report.numbers import (
    format_angle,
    format_length,
)
from glider.report.plots.style import (
    COLORS,
    LABELS,
)
from glider.report.tables import (
    combination_rows,
    correlation_rows,
    spread_rows,
    spread_values,
    vehicle_rows,
)
from glider.report.wording import (
    air_words,
    effect_view,
    fold_words,
    headline,
    notes_of,
    remarks,
)
from glider.sysid.result import Result

_PAGE_DPI = 100  # A figure's dots an inch on a screen.


def to_html(result: Result, figures: Mapping[str, bytes]) -> str:
    """Returns the page: one file that needs nothing else.

    Args:
        result: what was found.
        figures: name to PNG, as `make_figures` returns them.
    """
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("glider.report"),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    return environment.get_template("report.html").render(
        result=result,
        headline=headline(result),
        remarks=remarks(result),
        models=columns_of(result),
        labels=LABELS,
        colors=COLORS,
        baseline=baseline(result),
        rows=error_rows(result),
        effects=[effect_view(e, result) for e in result.effects],
        figures={n: base64.b64encode(p).decode() for n, p in figures.items()},
        widths={n: _png_width(p) * _PAGE_DPI // DPI for n, p in figures.items()},
        shown=min(MOST_FLIGHTS, len(result.held_out)),
        notes=notes_of(result),
        air=air_words(result),
        combinations=combination_rows(result),
        correlations=correlation_rows(result),
        folds=fold_words(result),
        worst=worst_flights(result),
        stands_out=STANDS_OUT,
        spreads=spread_rows(result),
        spread_values=spread_values(result),
        vehicle=vehicle_rows(result),
        noise_position=format_length(result.noise_position_m),
        noise_pitch=format_angle(result.noise_pitch_rad),
        versions=_versions(result),
        total=sum(s for s in result.seconds.values() if math.isfinite(s)),
    )


def _png_width(png):
    return int.from_bytes(png[16:20], "big")


def _versions(result):
    versions = {"drake-glider": result.version, "Python": platform.python_version()}
    for package in ("drake", "numpy", "numba"):
        versions[package] = importlib.metadata.version(package)
    return versions
