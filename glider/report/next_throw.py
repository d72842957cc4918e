"""Proposed throws: sentences, terminal, next_throw.json, commands and picture."""

import dataclasses
import io
import itertools
import math
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.figure import Figure
from rich.console import Console

from glider.compiled.actuators import elevator_path
from glider.experiments.proposal import Proposal
from glider.files.schema import json_text, to_builtins
from glider.files.writing import replace_files
from glider.report.numbers import format_length
from glider.report.plots.style import BLUE, GREEN, ORANGE, PURPLE, RED, STYLE
from glider.report.wording import TEMPLATES, join
from glider.systems.command_tape import tape_text

_SURE = 0.99
"""Probability of the best explanation among the listed ones above which it is alone."""

_SMALL = 1.0 / 3.0
"""Scatter by the coefficients over that by chance, or over the noise of a position,
below which that dominates: they then add less than 6 % to it."""

_LEAST_GAIN = 0.02
"""Least gain of probability by throws that are worth flying."""

_NAMED = 0.01
"""Probability above which an explanation is named."""

_INSEPARABLE = 3.0
"""Expected log-evidence below which explanations stay indistinguishable [nats]."""

_COLORS = (BLUE, RED, GREEN, ORANGE, PURPLE)  # Of the proposed throws in turn.
_LINES = ("-", "--", ":", "-.", (0, (5, 1, 1, 1, 1, 1)))  # Of the explanations in turn.


def is_one_left(proposal: Proposal) -> bool:
    """Checks whether the flights leave one explanation alone."""
    return proposal.chance_now > _SURE * (1.0 - proposal.missing)


def is_done(proposal: Proposal) -> bool:
    """Checks whether more flights would show nothing more."""
    least = max(proposal.ending_air, proposal.noise)
    is_known = proposal.ending_now < _SMALL * least
    is_explained = not proposal.explanations[0].model.functions
    return is_one_left(proposal) and is_known and is_explained


def sentences(proposal: Proposal) -> list[str]:
    """What the flights leave open, and what to expect of the throws."""
    p = proposal
    likely = [i for i, e in enumerate(p.explanations) if e.probability >= _NAMED]
    evidence = np.minimum(p.distances, p.distances.T)
    text = TEMPLATES.get_template("next_throw.txt").render(
        p=p,
        likely=likely,
        other=1.0 - sum(p.explanations[i].probability for i in likely),
        is_one_left=is_one_left(p),
        is_better=p.chance_then >= p.chance_now + _LEAST_GAIN,
        is_done=is_done(p),
        inseparable=[
            (i, j)
            for i, j in itertools.combinations(likely, 2)
            if evidence[i, j] < _INSEPARABLE
        ],
        beyond=[f"throw {k} ({own})" for k, own in enumerate(p.beyond, 1) if own],
        join=join,
        chance=_chance,
        length=format_length,
    )
    return [line for line in text.splitlines() if line]


def throw_words(proposal: Proposal, number: int) -> str:
    """Returns a launch as people set it."""
    throw = proposal.throws[number - 1]
    pitch = float(throw.launch[2])
    return (
        f"release at {throw.launch[1]:.2f} m, {throw.speed:.2f} m/s, flight path "
        f"{_up_or_down(throw.climb)}, nose {_up_or_down(-pitch)}"
    )


def _up_or_down(angle: float) -> str:
    """An angle as people set it."""
    size = abs(math.degrees(angle))
    side = "up" if angle >= 0.0 else "down"
    return f"{size:.1f}° {side}"


def _chance(value: float) -> str:
    """A probability of two digits."""
    if value < 0.01:
        return "under 0.01"
    return "over 0.99" if value > 0.99 else f"{value:.2f}"


def commands_name(number: int) -> str:
    """Name of a throw's file of commands; they count from 1."""
    return f"commands_{number}.csv"


def write_proposal(proposal: Proposal, folder: Path) -> None:
    """Writes commands_N.csv, next_throw.png and, last, next_throw.json.

    Files of commands of an earlier proposal are removed: they must not be flown.

    Raises:
        InputError: if the folder is a file.
    """
    old = [path.name for path in folder.glob("commands_*.csv")]
    files: dict[str, bytes | None] = dict.fromkeys(old)
    for number, throw in enumerate(proposal.throws, start=1):
        tape = tape_text(throw.times, throw.commands, throw.end)
        files[commands_name(number)] = tape.encode()
    files["next_throw.png"] = draw_proposal(proposal)
    files["next_throw.json"] = f"{json_text(to_json(proposal))}\n".encode()
    replace_files(folder, files, last="next_throw.json")


def to_json(proposal: Proposal) -> dict[str, Any]:
    """next_throw.json: lists, dicts, strings, numbers, booleans and None."""
    p = proposal
    found: dict[str, Any] = to_builtins(
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
                    "beyond_flown": p.beyond[k - 1],
                }
                for k, t in enumerate(p.throws, start=1)
            ],
            "chance": {"now": p.chance_now, "then": p.chance_then},
            "expected_log_evidence": p.distances,
            "end_of_flight_m": {
                "air": p.ending_air,
                "coefficients_now": p.ending_now,
                "coefficients_then": p.ending_then,
            },
            "limits": dataclasses.asdict(p.place.limits),
            "seconds": p.seconds,
        }
    )
    return found


def print_proposal(proposal: Proposal, folder: Path, console: Console) -> None:
    """Prints what is expected, the launches and where their commands are."""
    for sentence in sentences(proposal):
        console.print(sentence, highlight=False)
    console.print()
    for number in range(1, len(proposal.throws) + 1):
        console.print(
            f"Throw {number}: {throw_words(proposal, number)}; "
            f"{folder / commands_name(number)}",
            highlight=False,
            soft_wrap=True,
        )


def draw_proposal(proposal: Proposal, form: str = "png") -> bytes:
    """Draws the proposed throws beside the flown flights, in a form of Matplotlib's."""
    p = proposal
    with matplotlib.rc_context(STYLE):
        # Of one explanation there is no difference.
        rows = 2 if len(p.paths[0]) == 1 else 3
        figure = Figure(figsize=(9.0, 2.7 * rows), layout="constrained")
        path_axes, tape_axes, *apart_axes = figure.subplots(rows)
        for path in p.flown:
            path_axes.plot(*path[:, :2].T, color="#C4C4C4", lw=0.9)
        for k, (throw, paths) in enumerate(zip(p.throws, p.paths, strict=True)):
            color = _COLORS[k % len(_COLORS)]
            time = np.arange(paths.shape[1]) / p.place.pose_rate
            for e, path in enumerate(paths[:, :, :2]):
                style: Any = {"color": color, "ls": _LINES[e % len(_LINES)], "lw": 1.7}
                apart = np.linalg.norm(path - paths[0, :, :2], axis=1)
                path_axes.plot(*path.T, **style)
                for axes in apart_axes:
                    axes.plot(time, 1e3 * apart, **style)
            times = np.append(throw.times, throw.end)
            angles = np.degrees(
                elevator_path(
                    throw.times,
                    throw.commands,
                    times,
                    p.place.servo,
                    start=p.place.rest,
                )
            )
            tape_axes.plot(times, angles, color=color, lw=1.6, label=f"throw {k + 1}")
        path_axes.axhline(p.place.limits.z[0], color="k", lw=0.9, ls=":", label="floor")
        path_axes.set(xlabel="x, along the throw [m]", ylabel="z, up [m]")
        tape_axes.set(ylabel="commanded elevator,\nup > 0 [°]")
        for axes in apart_axes:
            axes.set(ylabel="difference of explanations,\nas fitted now [mm]")
        for axes in (tape_axes, *apart_axes):
            axes.set_xlabel("time since release [s]")
        figure.legend(loc="outside upper center", ncols=len(p.throws) + 1)
        buffer = io.BytesIO()
        figure.savefig(buffer, format=form, dpi=160)
    return buffer.getvalue()
