"""What is written and printed of proposed throws."""

import dataclasses
import io
import json
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from rich import box
from rich.console import Console
from rich.table import Table

from glider.experiments.proposal import Proposal
from glider.experiments.throws import Throw
from glider.files.writing import replace_files
from glider.report.json_report import plain
from glider.report.next_throw_words import (
    is_done,
    keeping_words,
    launch_words,
    sentences,
)
from glider.report.numbers import format_estimate
from glider.report.plots.axes import legend
from glider.report.plots.style import STYLE
from glider.report.plots.throws import plot_differences, plot_tapes, plot_throws
from glider.sysid.result import Estimate
from glider.systems.command_tape import tape_text
from glider.verification.funnel.funnel import tube_outline


def commands_name(number: int) -> str:
    """Returns the name of a throw's file of commands; they count from 1."""
    return f"commands_{number}.csv"


def write_proposal(proposal: Proposal, folder: Path) -> None:
    """Writes commands_N.csv, next_throw.png and, last, next_throw.json.

    Files of commands of an earlier proposal go: nobody must fly them by mistake.

    Raises:
        InputError: if the folder is a file.
    """
    text = json.dumps(to_json(proposal), indent=2, ensure_ascii=False, allow_nan=False)
    old = [path.name for path in folder.glob("commands_*.csv")]
    files: dict[str, bytes | None] = dict.fromkeys(old)
    for number, throw in enumerate(proposal.throws, start=1):
        tape = tape_text(throw.times, throw.commands, _end(throw))
        files[commands_name(number)] = tape.encode()
    files["next_throw.png"] = draw_proposal(proposal)
    files["next_throw.json"] = f"{text}\n".encode()
    replace_files(folder, files, last="next_throw.json")


def _end(throw: Throw) -> float:
    period = float(throw.times[1] - throw.times[0])
    return float(throw.times[-1]) + period


def to_json(proposal: Proposal) -> dict[str, Any]:
    """Returns next_throw.json: lists, dicts, strings, numbers, booleans and None."""
    p, known = proposal, proposal.place.funnel
    found: dict[str, Any] = plain(
        {
            "campaign": p.campaign,
            "says": sentences(p),
            "nothing_more_to_learn": is_done(p),
            "explanations": [
                {"effects": e.model.kinds, "probability": e.probability}
                for e in p.explanations
            ],
            "none_of_them": p.missing,
            "throws": [
                {
                    "commands": commands_name(k),
                    "x_m": t.launch[0],
                    "height_m": t.launch[1],
                    "speed_m_s": t.speed,
                    "climb_rad": t.climb,
                    "pitch_rad": t.launch[2],
                    "feedback_from_s": t.duration if known else None,
                    "funnel_level": p.levels[k - 1] if known else None,
                }
                for k, t in enumerate(p.throws, start=1)
            ],
            "funnel": known
            and {
                "file": known.file,
                "sha256": known.funnel.sha256,
                "certificate_checked": known.is_checked,
                "proof_by": known.proof,
            },
            "chance": {
                "now": p.chance_now,
                "then": p.chance_then,
                "as_many_of_the_present_kind": p.chance_alike,
            },
            "throws_of_the_present_kind_for_the_same": p.alike,
            "expected_log_evidence": p.distances,
            "end_of_flight_m": {
                "air": p.ending_air,
                "coefficients_now": p.ending_now,
                "coefficients_then": p.ending_then,
                "coefficients_by_the_present_kind": p.ending_alike,
            },
            "coefficients": {
                name: {"std_now": now, "std_then": then, "unit": unit}
                for name, (now, then, unit) in p.stds.items()
            },
            "limits": dataclasses.asdict(p.place.limits),
            "seconds": p.seconds,
        }
    )
    return found


def draw_proposal(proposal: Proposal, form: str = "png") -> bytes:
    """Returns a picture of the proposed throws beside the flown flights, as a file.

    Args:
        proposal: its throws.
        form: of the file, one that Matplotlib writes.
    """
    p = proposal
    several = len(p.explanations) > 1
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(9.0, 8.0 if several else 6.0), layout="constrained")
        FigureCanvasAgg(figure)
        axes = figure.subplots(3 if several else 2, 1)
        side, tapes = axes[0], axes[1]
        low, high = p.place.limits.elevator
        known = p.place.funnel
        tube = tube_outline(known.funnel) if known else None
        plot_throws(side, p.flown, p.paths, p.place.limits.z[0], tube)
        side.set_xlabel("x, along the throw [m]")
        side.set_ylabel("z, up [m]")
        times = [np.append(t.times, _end(t)) for t in p.throws]
        angles = [
            np.clip(
                p.place.rest + np.append(0.0, np.cumsum(t.commands * np.diff(time))),
                low,
                high,
            )
            for t, time in zip(p.throws, times, strict=True)
        ]
        plot_tapes(tapes, times, angles, (low, high))
        tapes.set_ylabel("elevator asked for,\nup > 0 [°]")
        tapes.set_xlabel("time since release [s]")
        if several:
            rows = [np.arange(q.shape[1]) / p.place.pose_rate for q in p.paths]
            plot_differences(axes[2], rows, p.paths)
            axes[2].set_ylabel("explanations apart,\nas fitted now [mm]")
            axes[2].set_xlabel("time since release [s]")
        legend(figure, side)
        buffer = io.BytesIO()
        figure.savefig(buffer, format=form, dpi=160)
    return buffer.getvalue()


def print_proposal(proposal: Proposal, folder: Path, console: Console) -> None:
    """Prints what is expected, the launches and where their commands are."""
    for sentence in sentences(proposal):
        console.print(sentence, highlight=False)
    console.print()
    for k, throw in enumerate(proposal.throws, start=1):
        console.print(
            f"Throw {k}: {launch_words(throw)}{keeping_words(proposal, k - 1)}; "
            f"{folder / commands_name(k)}",
            highlight=False,
            soft_wrap=True,
        )
    if not proposal.stds:
        return
    console.print()
    table = Table(box=box.SIMPLE_HEAD)
    for title in (proposal.explanations[0].name, "now ±", "then ±"):
        table.add_column(title)
    for name, (now, then, unit) in proposal.stds.items():
        table.add_row(name, *(_std(value, unit) for value in (now, then)))
    console.print(table)


def _std(value: float, unit: str) -> str:
    return format_estimate(Estimate(value=value, std=0.0, unit=unit))
