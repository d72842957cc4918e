"""The basis exercise: its scores, and flights beside models of a few features."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from axes import few_ticks, legend_beside, limit
from basis_study import BasisStudy, scores_of
from glider.report.plots.style import COLORS, GREEN, ORANGE, RED, STYLE

_SHADES = (RED, ORANGE, COLORS["corrected"], GREEN)
_DASHES = ("-", (0, (5, 1.5)), "-", (0, (2, 1.2)))


def plot_scores(
    ax: Axes, names: Sequence[str], scores: Mapping[str, Sequence[float]]
) -> None:
    """Draws what configurations leave of the accelerations, as pairs of bars.

    Args:
        ax: to draw into; its score axis is logarithmic.
        names: of the configurations.
        scores: label to a score for each.
    """
    width = 0.8 / len(scores)
    place = np.arange(len(names))
    shades = (_SHADES[0], _SHADES[2])
    for k, (label, values) in enumerate(scores.items()):
        at = place + (k - 0.5 * (len(scores) - 1)) * width
        ax.bar(at, values, width, color=shades[k % 2], label=label)
    ax.set_yscale("log")
    ax.set_ylim(bottom=10.0 ** np.floor(np.log10(min(map(min, scores.values())))))
    ax.set_xticks(place, names)
    ax.set_xlabel("configuration")
    ax.set_ylabel("squared error of accelerations")
    ax.grid(visible=False, axis="x")
    legend_beside(ax)


def plot_held_out(
    path: Axes,
    pitch: Axes,
    time: np.ndarray,
    measured: np.ndarray,
    flown: Mapping[str, np.ndarray],
) -> None:
    """Draws a held-out flight and models' rollouts: where they go, how they pitch.

    Args:
        path: to draw x and z into, one scale on both axes.
        pitch: to draw the pitch into.
        time: (n,) [s].
        measured: (n, 3 or more) x, z [m], pitch [rad].
        flown: label to the same, at most four.
    """
    path.plot(*measured[:, :2].T, color="k", lw=4.0, alpha=0.3, label="the flight")
    pitch.plot(time, np.degrees(measured[:, 2]), color="k", lw=4.0, alpha=0.3)
    for (label, poses), shade, dash in zip(
        flown.items(), _SHADES, _DASHES, strict=False
    ):
        path.plot(*poses[:, :2].T, color=shade, lw=1.6, ls=dash, label=label)
        pitch.plot(time, np.degrees(poses[:, 2]), color=shade, lw=1.6, ls=dash)
    limit(path.set_xlim, measured[:, 0], margin=0.06, quantile=0.0)
    limit(path.set_ylim, measured[:, 1], margin=0.3, quantile=0.0)
    limit(pitch.set_ylim, np.degrees(measured[:, 2]), margin=0.3, quantile=0.0)
    path.set_xlabel("x [m]")
    path.set_ylabel("z [m]")
    legend_beside(path)
    pitch.set_xlabel("time [s]")
    pitch.set_ylabel("pitch θ, nose down > 0 [°]")
    few_ticks(path)
    few_ticks(pitch)


def save_exercise_figure(
    file: Path,
    scores: Mapping[str, Mapping[str, float]],
    time: np.ndarray,
    measured: np.ndarray,
    flown: Mapping[str, np.ndarray],
) -> None:
    """Saves the scores and the held-out flight as one figure.

    Args:
        file: to write, of a kind that matplotlib knows by its name.
        scores: label to configuration to score.
        time: as in `plot_held_out`.
        measured: as in `plot_held_out`.
        flown: as in `plot_held_out`.
    """
    names = list(next(iter(scores.values())))
    with rc_context(STYLE):
        figure = Figure(figsize=(9.5, 8.0), layout="constrained")
        top, middle, bottom = figure.subplots(3, 1, height_ratios=[3, 3, 3])
        bars = {k.replace("_", " "): [v[n] for n in names] for k, v in scores.items()}
        plot_scores(top, names, bars)
        plot_held_out(middle, bottom, time, measured, flown)
        figure.savefig(file, dpi=150)


def save_basis_figure(path: Path, study: BasisStudy) -> None:
    """Saves the scores and the held-out flight of the exercise."""
    held_out = study.exercise.held_out
    times, measured = held_out.times, held_out.states[0]
    save_exercise_figure(path, scores_of(study.fits), times, measured, study.flown)
