"""A rehearsal as a table in a terminal, rehearsal.json and a picture."""

import importlib.metadata
import io
import math
from collections.abc import Collection
from pathlib import Path
from typing import Any

import matplotlib
from matplotlib.figure import Figure
from matplotlib.ticker import NullFormatter
from rich.console import Console

from glider.experiments.rehearsal import VISIBLE, Rehearsal, Rehearsed
from glider.files.schema import json_text, to_builtins
from glider.files.writing import replace_files
from glider.report.numbers import Unit
from glider.report.plots.style import BLUE, ORANGE, STYLE
from glider.report.terminal import make_table, writer
from glider.sysid.result import Result


def write_rehearsal(rehearsal: Rehearsal, folder: Path) -> None:
    """Writes rehearsal.png and, last, rehearsal.json.

    Raises:
        InputError: if the folder is a file.
    """
    files: dict[str, bytes | None] = {
        "rehearsal.png": draw_rehearsal(rehearsal),
        "rehearsal.json": f"{json_text(to_json(rehearsal))}\n".encode(),
    }
    replace_files(folder, files, last="rehearsal.json")


def to_json(rehearsal: Rehearsal) -> dict[str, Any]:
    """rehearsal.json: lists, dicts, strings, numbers, booleans and None."""
    r = rehearsal
    found: dict[str, Any] = to_builtins(
        {
            "version": importlib.metadata.version("drake-glider"),
            "campaign": r.campaign,
            "flights": r.flights,
            "known_effects": r.known,
            "seed": r.seed,
            "false_alarms": r.false_alarms,
            "flown": r.flown and _answer(r.flown, r.known),
            "effects": [
                {
                    "kind": own.kind,
                    "coefficient": own.coefficient.name,
                    "unit": own.coefficient.unit,
                    "size": own.size,
                    "power": own.power,
                    "instead": own.instead,
                    "visible": own.visible,
                    "curve": own.curve,
                    "flown": own.flown and _answer(own.flown, r.known),
                }
                for own in r.effects
            ],
            "seconds": r.seconds,
        }
    )
    return found


def print_rehearsal(rehearsal: Rehearsal, console: Console) -> None:
    """Prints a row for each effect, and the false alarms."""
    write = writer(console)
    known = rehearsal.known
    has = ", ".join(known) or "no effect"
    write(
        f"{rehearsal.flights} flights of {rehearsal.campaign}, whose model has {has}."
    )
    write()
    headings = ["effect", "size", "power", "visible from"]
    if rehearsal.flown:
        headings.append("flown and traced once")
    table = make_table(*headings)
    for own in rehearsal.effects:
        unit = Unit(name=own.coefficient.unit)
        visible = unit.text(own.visible) if math.isfinite(own.visible) else "no size"
        cells = [own.kind, unit.text(own.size), f"{own.power:.0%}", visible]
        if own.flown:
            cells.append(_in_words(own.flown, known))
        table.add_row(*cells)
    console.print(table)
    write()
    write(
        "Power: share of campaigns in which the effect is named; visible from: least "
        f"size with a power of {VISIBLE:.0%}."
    )
    for sentence in confusions(rehearsal):
        write(sentence)
    alarms = f"Without a further effect, {rehearsal.false_alarms:.1%} name one"
    if rehearsal.flown:
        alarms += f"; flown and traced once: {_in_words(rehearsal.flown, known)}"
    write(f"{alarms}.")


def confusions(rehearsal: Rehearsal) -> list[str]:
    """Sentences on what is named instead of an effect, where that is not rare."""
    found = []
    for own in rehearsal.effects:
        shares = own.instead.items()
        others = [f"{name} ({share:.0%})" for name, share in shares if share >= 0.01]
        if others:
            found.append(f"{own.kind} is reported as {' or '.join(others)}.")
    return found


def draw_rehearsal(rehearsal: Rehearsal, form: str = "png") -> bytes:
    """Draws the power over the size of each effect, in a form of Matplotlib's."""
    effects = rehearsal.effects
    with matplotlib.rc_context(STYLE):
        columns = min(len(effects), 5)
        rows = math.ceil(len(effects) / columns)
        size = 2.2 * columns, 1.1 + 1.9 * rows
        figure = Figure(figsize=size, layout="constrained")
        panels = figure.subplots(rows, columns, squeeze=False, sharey=True)
        for axes, own in zip(panels.flat, effects, strict=False):
            _draw_curve(axes, own)
        for axes in panels.flat[len(effects) :]:
            axes.remove()
        figure.supylabel("power [%]", fontsize=10)
        words = panels[0, 0].get_legend_handles_labels()
        figure.legend(*words, loc="outside upper center", ncols=columns, fontsize=9)
        buffer = io.BytesIO()
        figure.savefig(buffer, format=form, dpi=160)
    return buffer.getvalue()


def _draw_curve(axes: Any, own: Rehearsed) -> None:
    """Draws the power of one effect; the size that was planted is marked."""
    sizes, power = own.curve.T
    axes.semilogx(sizes, 100.0 * power, color=BLUE, marker=".")
    axes.axvline(own.size, color=ORANGE, ls="--", lw=1.2, label="planted size")
    label = f"power of {VISIBLE:.0%}"
    axes.axhline(100.0 * VISIBLE, color="#8A8A8A", lw=0.9, ls=":", label=label)
    ends = sizes[[0, -1]]
    axes.set_xticks(ends, map("{:.2g}".format, ends))
    axes.xaxis.set_minor_formatter(NullFormatter())
    axes.set(ylim=(-4.0, 104.0), title=own.kind)
    axes.set_xlabel(f"{own.coefficient.name} [{own.coefficient.unit}]")
    axes.title.set_fontsize(9)


def _answer(flown: Result, known: Collection[str]) -> dict[str, Any]:
    """The verdict on a flown campaign, and the names beside those of the model."""
    named = [own.kind for own in flown.effects if own.kind not in known]
    return {"verdict": flown.verdict, "named": named}


def _in_words(flown: Result, known: Collection[str]) -> str:
    """The same for people."""
    named = _answer(flown, known)["named"]
    return f"{flown.verdict}: {', '.join(named)}" if named else flown.verdict
