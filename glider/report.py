"""Writes what closing the loop found: for programs, for people, as a model.

`report.json` is SI throughout, and NaN or infinity become null. The page and
the terminal show degrees and millimetres where those read better. A number that
is missing reads "–"; a rollout that left all bounds reads "diverges".
"""

import base64
import dataclasses
import functools
import importlib.metadata
import io
import json
import math
import os
import platform
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import jinja2
import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from rich import box
from rich.console import Console
from rich.padding import Padding
from rich.table import Table
from rich.text import Text

from glider import plots
from glider.effects import KINDS
from glider.errors import InputError
from glider.model_file import save_model
from glider.sysid.result import (
    MODELS,
    Errors,
    Estimate,
    FoundEffect,
    ResidualTable,
    Result,
)

NOTHING_LEFT = 4.0
"""What a model leaves is noise below this many standard deviations of noise."""

_MOST_COEFFICIENTS = 8
"""An effect with more of them shows the first; all are in the files."""

_MISSING = "–"

_DIVERGED = 1e5
"""An error above this [SI] only says that the model left all bounds."""

_MOST_FLIGHTS = 4
_WIDTH = 10.0  # Of a figure [inch].
_DPI = 160
_PAGE_DPI = 100  # A figure's dots an inch on a screen.


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
    files["report.html"] = to_html(result, figures).encode()
    text = json.dumps(to_json(result), indent=2, ensure_ascii=False, allow_nan=False)

    for target in (folder, folder / "figures"):
        try:
            target.mkdir(parents=True, exist_ok=True)
        except (FileExistsError, NotADirectoryError):
            raise InputError(f"{target}: is a file; a folder is needed.") from None
    _replace(folder / "model.yaml", lambda path: save_model(path, result.model))
    for name, content in files.items():
        _replace(folder / name, functools.partial(Path.write_bytes, data=content))
    for name in _FIGURES.keys() - figures.keys():  # Of an earlier run.
        (folder / "figures" / f"{name}.png").unlink(missing_ok=True)
    _replace(
        folder / "report.json",
        lambda path: path.write_text(text + "\n", encoding="utf-8"),
    )


def to_json(result: Result) -> dict[str, Any]:
    """Returns report.json: lists, dicts, strings, finite floats and None."""
    return {
        "campaign": result.campaign,
        "flights": {
            "fit": list(result.fit_flights),
            "held_out": list(result.held_out_flights),
        },
        "verdict": result.verdict,
        "effects": [
            {
                "kind": e.kind,
                "coefficients": {
                    name: {
                        "value": _finite(c.value),
                        "std": _finite(c.std),
                        "unit": c.unit,
                    }
                    for name, c in e.coefficients.items()
                },
                "evidence": _finite(e.evidence),
                "share_of_residual": _finite(e.share),
                "indistinguishable_from": list(e.indistinguishable_from),
                "depends_on": list(e.depends_on),
            }
            for e in result.effects
        ],
        "errors": {model: _errors_json(result.errors.get(model)) for model in MODELS},
        "noise": {
            "position_m": _finite(result.noise_position_m),
            "pitch_rad": _finite(result.noise_pitch_rad),
        },
        "seconds": {stage: _finite(s) for stage, s in result.seconds.items()},
        "version": result.version,
    }


def to_html(result: Result, figures: Mapping[str, bytes]) -> str:
    """Returns the page: one file that needs nothing else.

    Args:
        result: what was found.
        figures: name to PNG, as `make_figures` returns them.
    """
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("glider"),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    baseline = _baseline(result)
    return environment.get_template("report.html").render(
        result=result,
        headline=headline(result),
        remarks=remarks(result),
        models=[m for m in MODELS if result.errors.get(m) is not None],
        labels=plots.LABELS,
        colors=plots.COLORS,
        baseline=baseline,
        rows=error_rows(result),
        effects=[_effect_view(e) for e in result.effects],
        figures={n: base64.b64encode(p).decode() for n, p in figures.items()},
        widths={n: _png_width(p) * _PAGE_DPI // _DPI for n, p in figures.items()},
        shown=min(_MOST_FLIGHTS, len(result.held_out)),
        notes=_notes(result),
        left=_left_words(result),
        noise_position=_length(result.noise_position_m),
        noise_pitch=_angle(result.noise_pitch_rad),
        versions=_versions(result),
        total=sum(s for s in result.seconds.values() if math.isfinite(s)),
    )


def print_summary(result: Result, console: Console) -> None:
    """Prints the verdict, the errors before and after and the effects."""

    def say(text: str = "", style: str = "", indent: int = 0) -> None:
        console.print(Padding(Text(_plain(text, console), style), (0, 0, 0, indent)))

    say(headline(result), "bold")
    for remark in remarks(result):
        say(remark)
    say()
    models = [m for m in MODELS if result.errors.get(m) is not None]
    table = Table(
        box=box.SIMPLE_HEAD,
        title=f"Errors on {_count(result.held_out_flights, 'held-out flight')}",
        title_justify="left",
        title_style="bold",
        pad_edge=False,
    )
    table.add_column("")
    for model in models:
        table.add_column(plots.LABELS[model], justify="right", no_wrap=True)
    table.add_column("gain", justify="right", no_wrap=True)
    group = ""
    for row in error_rows(result):
        if row.group != group:
            group = row.group
            table.add_row(Text(group, "bold"))
        cells = [Text(_plain(row.cells[m], console)) for m in models]
        gain = Text(_plain(row.gain, console))
        table.add_row(Text("  " + row.name), *cells, gain)
    console.print(table)

    for effect in map(_effect_view, result.effects):
        say(f"{effect['words']} ({effect['kind']})", "bold")
        for name, value in effect["coefficients"]:
            say(f"{name} = {value}", indent=2)
        if effect["more"]:
            say(f"and {effect['more']} more in model.yaml", indent=2)
        say(
            f"evidence {effect['evidence']} nats; explains {effect['share']} of "
            "the error",
            indent=2,
        )
        if effect["confused"]:
            say(f"could be confused with: {'; '.join(effect['confused'])}", indent=2)
        elif not effect["is_unexplained"]:
            say("could be confused with: nothing in the library", indent=2)
        if effect["depends_on"]:
            say(f"varies with: {', '.join(effect['depends_on'])}", indent=2)
        say()
    noise = f"{_length(result.noise_position_m)}, {_angle(result.noise_pitch_rad)}"
    left = _left_words(result)
    say(f"Noise: {noise}. {'' if left in remarks(result) else left}".rstrip())
    for note in _notes(result):
        say(f"Note: {note}")


def headline(result: Result) -> str:
    """Returns the verdict in one sentence."""
    named = [e for e in result.effects if e.kind != "unexplained"]
    unnamed = [e for e in result.effects if e.kind == "unexplained"]
    is_unexplained = bool(unnamed) or result.verdict == "unexplained"
    if result.verdict == "no_effect":
        before = _baseline(result)
        model = "drawing" if before == "as_drawn" else "refitted flat plate"
        errors = result.errors.get(before)
        text = f"The flights show no effect that the {model} lacks"
        if result.left_z >= NOTHING_LEFT:
            text = (
                f"The {model} is not all that the flights show, but no effect "
                "of the library earns its place"
            )
        if errors is None or not math.isfinite(errors.position_rms_m):
            return text + "."
        return (
            f"{text}; it flies held-out flights to {_length(errors.position_rms_m)} "
            "in position (RMS)."
        )
    found = [_in_line(e) for e in named]
    if is_unexplained:
        on = [name for e in unnamed for name in e.depends_on]
        varying = f" that varies with {_and(on)}" if on else ""
        error = f"an error{varying} and that no effect of the library explains"
        found.append(error if varying else error.replace(" and that", " that"))
    text = "The flights show " + _and(found, "; and ", "; ")
    change = _change(result)
    return f"{text}; {change}." if change else f"{text}."


def remarks(result: Result) -> list[str]:
    """Returns what a reader of the headline must know too, as sentences."""
    said = []
    for e in result.effects:
        if e.indistinguishable_from:
            others = _and([_words(k) for k in e.indistinguishable_from], " or ")
            said.append(f"From these flights, {e.words} could also be {others}.")
    if result.left_z >= NOTHING_LEFT:
        said.append(_left_words(result))
    return said


@dataclasses.dataclass(frozen=True, kw_only=True)
class ErrorRow:
    """A row of the table of errors, as text."""

    group: str
    name: str
    cells: dict[str, str]
    gain: str


def error_rows(result: Result) -> list[ErrorRow]:
    """Returns the errors of each model with units, and how much smaller they got."""
    rows = []
    for group, name, field, show in (
        ("Acceleration, RMS", "tangential", "tangential", _plain_unit("m/s²")),
        ("Acceleration, RMS", "normal", "normal", _plain_unit("m/s²")),
        ("Acceleration, RMS", "pitch", "pitch", _plain_unit("rad/s²")),
        ("Free rollout", "position, RMS", "position_rms_m", _length),
        ("Free rollout", "position, at the end", "position_end_m", _length),
        ("Free rollout", "pitch, RMS", "pitch_rms_rad", _angle),
        (
            "Along the measured pitch",
            "position, RMS",
            "measured_pitch_position_rms_m",
            _length,
        ),
    ):
        errors = {m: result.errors.get(m) for m in MODELS}
        values = {m: getattr(e, field) for m, e in errors.items() if e is not None}
        rows.append(
            ErrorRow(
                group=group,
                name=name,
                cells={m: show(v) for m, v in values.items()},
                gain=_gain(
                    values.get(_baseline(result), math.nan),
                    values.get("corrected", math.nan),
                ),
            )
        )
    return rows


def make_figures(result: Result) -> dict[str, bytes]:
    """Returns figure name to PNG; what there is nothing to show of is left out."""
    figures = {}
    with matplotlib.rc_context(plots.STYLE):
        for name, draw in _FIGURES.items():
            figure = draw(result)
            if figure is not None:
                FigureCanvasAgg(figure)
                layout = figure.get_layout_engine()
                if layout is not None:  # Once is enough, and saves a draw.
                    layout.execute(figure)
                    figure.set_layout_engine("none")
                buffer = io.BytesIO()
                figure.savefig(buffer, format="png", dpi=_DPI)
                figures[name] = buffer.getvalue()
    return figures


def _draw_residual(result: Result) -> Figure | None:
    before, after = result.residual_before, result.residual_after
    variables = _pick_variables(result)
    if not variables:
        return None
    figure = Figure(figsize=(_WIDTH, 7.0), layout="constrained")
    grid = figure.subplots(3, len(variables), sharex="col", squeeze=False)
    labels = ("along the wing [m/s²]", "normal to it [m/s²]", "in pitch [rad/s²]")
    for row, label in enumerate(labels):
        for ax, name in zip(grid[row], variables, strict=True):
            plots.plot_residual(
                ax,
                name,
                [before.variables[name], after.variables[name]],
                [before.residual[:, row], after.residual[:, row]],
                [_baseline(result), "corrected"],
            )
            if row < 2:
                ax.set_xlabel("")
        grid[row][0].set_ylabel(label)
    figure.align_ylabels(grid[:, 0])
    _legend(figure, grid[0][0])
    return figure


def _draw_evidence(result: Result) -> Figure | None:
    if not result.candidates:
        return None
    figure = Figure(
        figsize=(_WIDTH, 1.0 + 0.23 * len(result.candidates)), layout="constrained"
    )
    plots.plot_evidence(
        figure.subplots(),
        result.candidates,
        picked=[e.kind for e in result.effects],
        confused=[k for e in result.effects for k in e.indistinguishable_from],
    )
    return figure


def _draw_held_out(result: Result) -> Figure | None:
    flights = _pick_flights(result)
    if not flights:
        return None
    width = min(_WIDTH, 1.0 + 3.5 * len(flights))
    figure = Figure(figsize=(width, 7.4), layout="constrained")
    grid = figure.subplots(3, len(flights), squeeze=False)
    for column, flight in zip(grid.T, flights, strict=True):
        flown = {m: _bounded(flight.flown[m]) for m in MODELS if m in flight.flown}
        plots.plot_paths(
            column[0], flight.measured, flown, flight.time <= flight.fitted_until
        )
        column[0].set_title(flight.name.removesuffix(".csv"))
        column[0].set_xlabel("x [m]")
        column[1].sharex(column[2])
        column[1].tick_params(labelbottom=False)
        plots.plot_pitch(
            column[1],
            flight.time,
            flight.measured[:, 2],
            {m: pose[:, 2] for m, pose in flown.items()},
            flight.fitted_until,
        )
        plots.plot_distance(
            column[2],
            flight.time,
            {m: _distance(pose, flight.measured) for m, pose in flown.items()},
            flight.fitted_until,
            result.noise_position_m,
        )
        column[2].set_xlabel("time [s]")
    grid[0][0].set_ylabel("z [m]")
    grid[1][0].set_ylabel("pitch, nose down > 0 [°]")
    grid[2][0].set_ylabel("distance from the flight [m]")
    figure.align_ylabels(grid[:, 0])
    _legend(figure, grid[0][0])
    return figure


def _draw_coefficients(result: Result) -> Figure | None:
    tables = {
        _baseline(result): result.residual_before,
        "corrected": result.residual_after,
    }
    names = {"c_lift": "$C_L$", "c_drag": "$C_D$", "c_moment": "$C_M$ [m]"}
    if not all(
        "alpha" in t.variables and names.keys() <= t.coefficients.keys()
        for t in tables.values()
    ):
        return None
    figure = Figure(figsize=(_WIDTH, 6.0), layout="constrained")
    grid = figure.subplots(2, 3, sharex=True, sharey="col")
    for axes, (model, table) in zip(grid, tables.items(), strict=True):
        for ax, (name, label) in zip(axes, names.items(), strict=True):
            plots.plot_coefficient(
                ax,
                table.variables["alpha"],
                table.coefficients[name],
                table.modelled[name],
                model,
            )
            ax.set_title(f"{label}, {plots.LABELS[model]}")
    for ax, name in zip(grid[0], names, strict=True):
        everything = [
            c[name] for t in tables.values() for c in (t.coefficients, t.modelled)
        ]
        plots.limit(ax.set_ylim, np.concatenate(everything))
    for ax in grid[1]:
        ax.set_xlabel(plots.VARIABLES["alpha"][0])
    _legend(figure, *grid[:, 0])
    return figure


def _draw_errors(result: Result) -> Figure | None:
    errors = {m: e for m in MODELS if (e := result.errors.get(m)) is not None}
    if not errors:
        return None
    figure = Figure(figsize=(_WIDTH, 3.6), layout="constrained")
    panels = (
        ("acceleration [m/s²]", {"tangential": "along wing", "normal": "normal"}, 1.0),
        ("acceleration [rad/s²]", {"pitch": "in pitch"}, 1.0),
        (
            "position [mm]",
            {
                "position_rms_m": "RMS",
                "position_end_m": "at the end",
                "measured_pitch_position_rms_m": "measured\npitch, RMS",
            },
            1e3,
        ),
        ("pitch [°]", {"pitch_rms_rad": "RMS"}, math.degrees(1.0)),
    )
    noise = (
        math.nan,
        math.nan,
        1e3 * result.noise_position_m,
        math.degrees(result.noise_pitch_rad),
    )
    axes = figure.subplots(
        1, 4, width_ratios=[len(fields) + 0.25 for _, fields, _ in panels]
    )
    for ax, (label, fields, factor), level in zip(axes, panels, noise, strict=True):
        plots.plot_errors(
            ax,
            list(fields.values()),
            {
                m: [factor * _bounded(getattr(e, f)) for f in fields]
                for m, e in errors.items()
            },
            level,
        )
        ax.set_title(label)
    _legend(figure, axes[0])
    return figure


_FIGURES: dict[str, Callable[[Result], Figure | None]] = {
    "errors": _draw_errors,
    "residual": _draw_residual,
    "evidence": _draw_evidence,
    "held_out": _draw_held_out,
    "coefficients": _draw_coefficients,
}
"""By file name."""


def _legend(figure: Figure, *axes: Axes) -> None:
    """Adds one legend above all axes, each label once."""
    shown: dict[str, Any] = {}
    for ax in axes:
        for handle, label in zip(*ax.get_legend_handles_labels(), strict=True):
            shown.setdefault(label, handle)
    figure.legend(
        shown.values(), shown.keys(), loc="outside upper center", ncols=len(shown)
    )


def _pick_variables(result):
    """Returns up to three variables, those of the strongest effects first."""
    wanted = [name for e in result.effects for name in e.depends_on]
    if len(set(wanted)) < 2:
        wanted += ["alpha", "V"]
    tables = (result.residual_before, result.residual_after)
    there = [n for n in dict.fromkeys(wanted) if all(_varies(t, n) for t in tables)]
    return there[: max(2, min(3, len(there)))]


def _varies(table: ResidualTable, name: str) -> bool:
    values = table.variables.get(name, np.zeros(0))
    values = values[np.isfinite(values)]
    return values.size > 0 and float(np.ptp(values)) > 0.0


def _pick_flights(result):
    """Returns up to four held-out flights, from the best corrected to the worst."""

    def error(flight):
        flown = flight.flown.get("corrected")
        if flown is None:
            return math.inf
        rms = np.sqrt(np.mean(_distance(_bounded(flown), flight.measured) ** 2))
        return rms if math.isfinite(rms) else math.inf  # NaN where it diverged.

    ranked = sorted(result.held_out, key=error)
    count = min(_MOST_FLIGHTS, len(ranked))
    ranks = np.linspace(0, len(ranked) - 1, count).round().astype(int)
    return [ranked[i] for i in ranks]


def _distance(pose, measured):
    return np.linalg.norm(pose[:, :2] - measured[:, :2], axis=1)


def _bounded(values):
    """Returns the values, NaN where they left all bounds."""
    return np.where(np.abs(values) < _DIVERGED, values, math.nan)


def _baseline(result: Result) -> str:
    """Returns the model that the correction is compared with."""
    return "as_drawn" if result.errors.get("as_drawn") is not None else "refitted"


def _change(result: Result) -> str:
    before, after = (result.errors.get(m) for m in (_baseline(result), "corrected"))
    if before is None or after is None:
        return ""
    old, new = before.position_rms_m, after.position_rms_m
    if not new < _DIVERGED:
        return "held-out rollouts of the corrected model diverge"
    if not old < _DIVERGED:
        return f"held-out rollouts, which diverged, now err by {_length(new)} (RMS)"
    verb = "falls" if new < old else "goes"
    return f"held-out position error {verb} from {_length(old)} to {_length(new)} (RMS)"


def _left_words(result):
    z = result.left_z
    model = "model" if result.verdict == "no_effect" else "corrected model"
    if not math.isfinite(z):
        return ""
    if z < NOTHING_LEFT:
        return f"The {model} leaves nothing but noise ({z:.1f} σ)."
    size = f"{z:.1f}" if z < 100.0 else f"{z:,.0f}"
    return (
        f"The {model} still leaves more than noise ({size} σ; "
        f"below {NOTHING_LEFT:g} is noise)."
    )


def _effect_view(effect: FoundEffect) -> dict[str, Any]:
    """Returns an effect as text."""
    items = list(effect.coefficients.items())
    return {
        "kind": effect.kind,
        "is_unexplained": effect.kind == "unexplained",
        "words": effect.words,
        "coefficients": [
            (name.replace("_", " "), _with_std(c) + _in_degrees(c))
            for name, c in items[:_MOST_COEFFICIENTS]
        ],
        "more": max(len(items) - _MOST_COEFFICIENTS, 0),
        "evidence": f"{effect.evidence:+,.0f}"
        if math.isfinite(effect.evidence)
        else _MISSING,
        "share": f"{100.0 * effect.share:.0f} %"
        if math.isfinite(effect.share)
        else _MISSING,
        "confused": [f"{_words(k)} ({k})" for k in effect.indistinguishable_from],
        "depends_on": list(effect.depends_on),
    }


def _in_line(effect):
    """Returns "a steady wind: x = -0.600 ± 0.001 m/s, z = ..."."""
    texts = [
        f"{name.replace('_', ' ')} = {_with_std(c)}"
        for name, c in list(effect.coefficients.items())[:3]
    ]
    colon = ", with " if ":" in effect.words else ": "
    return effect.words + (colon if texts else "") + ", ".join(texts)


def _with_std(c: Estimate) -> str:
    """Returns "-0.600 ± 0.001 m/s": as many digits as the standard error allows."""
    unit = "" if c.unit in ("", "-") else f" {c.unit}"
    if not math.isfinite(c.value):
        return _MISSING
    if not (math.isfinite(c.std) and c.std > 0.0):
        return f"{c.value:.4g}{unit}"
    digits = -math.floor(math.log10(c.std))
    if f"{c.std:e}"[0] == "1":  # 0.0014, not 0.001.
        digits += 1
    if digits > 6:
        power = math.floor(math.log10(max(abs(c.value), c.std)))
        scale, digits = 10.0**power, max(digits + power, 0)
        number = f"({c.value / scale:.{digits}f} ± {c.std / scale:.{digits}f})"
        return f"{number}e{power}{unit}"
    value, std = round(c.value, digits), round(c.std, digits)
    digits = max(digits, 0)
    return f"{value:.{digits}f} ± {std:.{digits}f}{unit}"


def _in_degrees(c: Estimate) -> str:
    if c.unit != "rad" or not math.isfinite(c.value):
        return ""
    return f" ({math.degrees(c.value):.1f}°)"


def _length(value: float) -> str:
    for scale, unit in ((1.0, "m"), (1e-2, "cm"), (1e-3, "mm")):
        if abs(value) >= 0.0995 * scale if unit == "m" else abs(value) >= 0.995 * scale:
            return _number(value / scale, unit)
    return _number(value * 1e3, "mm")


def _angle(value: float) -> str:
    return _number(math.degrees(value), "°")


def _plain_unit(unit: str) -> Callable[[float], str]:
    return lambda value: _number(value, unit)


def _number(value, unit):
    if math.isnan(value):
        return _MISSING
    if abs(value) >= _DIVERGED:
        return "diverges"
    if abs(value) >= 100.0:
        text = f"{value:,.0f}"
    elif value == 0.0 or abs(value) < 1e-4:
        text = f"{value:.2g}"
    else:  # Three digits.
        text = f"{value:.{max(2 - math.floor(math.log10(abs(value))), 0)}f}"
    return text + unit if unit == "°" else f"{text} {unit}"


def _gain(before, after):
    if before >= _DIVERGED > after:
        return "∞"
    if not (0.0 < before < _DIVERGED and 0.0 < after < _DIVERGED):
        return _MISSING
    factor = before / after
    if factor >= 10.0:
        return f"{factor:,.0f}×"
    return f"{factor:.1f}×" if factor >= 0.95 else f"{factor:.2f}×"


def _words(kind):
    return KINDS[kind].words if kind in KINDS else kind.replace("_", " ")


def _and(items, last=" and ", between=", "):
    items = list(dict.fromkeys(items))
    return last.join(filter(None, [between.join(items[:-1]), *items[-1:]]))


def _count(items, noun):
    return f"{len(items)} {noun}{'' if len(items) == 1 else 's'}"


def _notes(result):
    """Returns what was assumed, as sentences."""
    notes = result.settings.get("notes", ())
    return list(notes) if isinstance(notes, (list, tuple)) else [str(notes)]


def _png_width(png):
    return int.from_bytes(png[16:20], "big")


def _versions(result):
    versions = {"drake-glider": result.version, "Python": platform.python_version()}
    for package in ("drake", "numpy", "numba"):
        versions[package] = importlib.metadata.version(package)
    return versions


def _plain(text: str, console: Console) -> str:
    """Returns the text in ASCII where the console can show no more."""
    if not console.options.ascii_only:
        return text
    table = str.maketrans(
        {"±": "+/-", "×": "x", "²": "^2", "³": "^3", "°": " deg", "σ": "sigma"}
        | {_MISSING: "-", "∞": "inf"}
    )
    return text.translate(table).encode("ascii", "replace").decode()


def _finite(value: float) -> float | None:
    number = float(value)
    return number if math.isfinite(number) else None


def _errors_json(errors: Errors | None) -> dict[str, Any] | None:
    if errors is None:
        return None
    return {
        "equation": {
            "tangential": _finite(errors.tangential),
            "normal": _finite(errors.normal),
            "pitch": _finite(errors.pitch),
        },
        "rollout": {
            "position_rms_m": _finite(errors.position_rms_m),
            "position_end_m": _finite(errors.position_end_m),
            "pitch_rms_rad": _finite(errors.pitch_rms_rad),
        },
        "rollout_measured_pitch": {
            "position_rms_m": _finite(errors.measured_pitch_position_rms_m)
        },
    }


def _replace(path: Path, write: Callable[[Path], object]) -> None:
    """Writes a file beside its place, then moves it there."""
    temporary = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        write(temporary)
        temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)
