"""A report of the estimation error that a funnel bears: numbers, words, a picture."""

from collections.abc import Sequence
from itertools import groupby
from pathlib import Path

import numpy as np
from matplotlib import rc_context
from matplotlib.figure import Figure

from glider.report.plots.axes import legend_beside
from glider.report.plots.style import BLUE, GREEN, ORANGE, RED, STYLE
from glider.verification.trials.estimated import EstimatedFlights

_COLORS = (BLUE, GREEN, ORANGE, RED)


def estimate_figures(found: Sequence[EstimatedFlights]) -> dict:
    """Returns the key figures of `study_estimates`.

    Shares are of the flights. In "bears", one for each unknown share, "noise_m" is the
    largest noise below the first with an escape, and "first_escape_m" that one; null
    where no level is.
    """
    return {
        "flights": len(found[0].miss),
        "levels": [
            {
                "unknown": level.unknown,
                "noise_m": level.noise,
                "escaped": float(level.escaped.mean()),
                "believed_escaped": float(level.believed_escaped.mean()),
                "perched": float(level.perched.mean()),
                "largest_level": float(level.levels.max()),
                "largest_error": float(level.errors.max()),
                "rms_error": float(np.sqrt(np.mean(level.errors**2))),
            }
            for level in found
        ],
        "bears": [_borne(share, levels) for share, levels in _by_share(found)],
    }


def describe_estimates(found: Sequence[EstimatedFlights]) -> str:
    """Returns a sentence for each unknown share."""
    lines = []
    for share, levels in _by_share(found):
        borne, last = _borne(share, levels), levels[-1]
        most, first = borne["noise_m"], borne["first_escape_m"]
        words = "no noise of these" if most is None else f"{1e3 * most:g} mm of noise"
        when = "no escape" if first is None else f"escapes from {1e3 * first:g} mm on"
        lines.append(
            f"With {100 * share:.0f} % of a launch's deviation unknown to the filter, "
            f"the funnel bears {words} ({when});\n"
            f"  at {1e3 * last.noise:g} mm {100 * last.escaped.mean():.0f} % of "
            f"{len(last.miss)} flights leave it and {100 * last.perched.mean():.0f} % "
            "perch."
        )
    return "\n".join(lines)


def save_estimate_figure(path: Path, found: Sequence[EstimatedFlights]) -> None:
    """Saves the share of escapes, and the estimate's error, against the noise."""
    with rc_context(STYLE):
        figure = Figure(figsize=(9.0, 3.6), layout="constrained")
        left, right = figure.subplots(1, 2)
        for (share, levels), color in zip(_by_share(found), _COLORS, strict=False):
            noises = [1e3 * level.noise for level in levels]
            label = f"{100 * share:.0f} % of the launch unknown"
            escapes = [100.0 * level.escaped.mean() for level in levels]
            left.plot(noises, escapes, "o-", color=color, ms=4, label=label)
            errors = [level.errors.max() for level in levels]
            right.plot(noises, errors, "o-", color=color, ms=4, label=label)
        left.set_ylabel(f"flights that leave the funnel, of {len(found[0].miss)} [%]")
        right.set_ylabel("largest error of the estimate, √(eᵀ S e)")
        right.axhline(1.0, color="k", lw=1.0, ls=(0, (4, 2)), label="the boundary")
        for ax in (left, right):
            ax.set_xscale("log")
            ax.xaxis.set_major_formatter(lambda value, _: f"{value:g}")
            ax.set_xlabel("noise of a measured position [mm]")
            ax.set_ylim(bottom=0.0)
        legend_beside(right)
        figure.savefig(path, dpi=120)


def _by_share(
    found: Sequence[EstimatedFlights],
) -> list[tuple[float, list[EstimatedFlights]]]:
    """Groups levels, of which the noises of a share stand in a row."""
    return [(s, list(levels)) for s, levels in groupby(found, lambda f: f.unknown)]


def _borne(share: float, levels: Sequence[EstimatedFlights]) -> dict:
    """Returns the largest noise before an escape, and the first with one."""
    noises = [level.noise for level in levels]
    escapes = [k for k, level in enumerate(levels) if level.escaped.any()]
    first = escapes[0] if escapes else len(levels)
    return {
        "unknown": share,
        "noise_m": noises[first - 1] if first else None,
        "first_escape_m": noises[first] if escapes else None,
    }
