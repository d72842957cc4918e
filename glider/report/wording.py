"""Sentences, phrases and rows of tables about a result, for the page and the terminal.

Sentences are in templates/sentences.txt, errors in `error_table`.
"""

import math
from collections.abc import Iterable, Sized

import jinja2

from glider.paths import cache_folder
from glider.physics.effects import KINDS
from glider.physics.effects.free_functions import FLOW_UNITS
from glider.report import numbers
from glider.report.error_table import FREE, baseline, error_of
from glider.sysid.result import Estimate, Result

_MOST_COEFFICIENTS = 8
"""An effect with more of them shows the first; all are in the files."""


def headline(result: Result) -> str:
    """The verdict in one sentence."""
    return " ".join(say("headline", result))


def say(name: str, *values: object) -> list[str]:
    """Sentences of a macro of sentences.txt, one a line there."""
    text = getattr(_SENTENCES.module, name)(*values)
    return [" ".join(line.split()) for line in text.splitlines() if line.strip()]


def join(items: Iterable[str], last: str = " and ", between: str = ", ") -> str:
    """Returns "a, b and c", each item once."""
    once = list(dict.fromkeys(items))
    return last.join(filter(None, [between.join(once[:-1]), *once[-1:]]))


def counted(items: Sized, noun: str) -> str:
    """Returns "1 flight" or "3 flights"."""
    return f"{len(items)} {noun}{'' if len(items) == 1 else 's'}"


def words_of(result: Result, kinds: Iterable[str]) -> list[str]:
    """Short phrases for kinds of effects."""
    known = {**KINDS, **{e.kind: e for e in result.own_effects}}
    return [known[k].words if k in known else name_of(k) for k in kinds]


def name_of(text: str) -> str:
    """A name of the program as people write it."""
    return text.replace("_", " ")


def notes_of(result: Result) -> list[str]:
    """Assumptions, as sentences."""
    return list(result.settings.get("notes", ()))


_CLOCKS = {
    "poses": "offset of the poses' clock from that of the servo",
    "commands": "offset of the commands' clock from that of the elevator",
    "drift": "drift between the clocks of poses and servo over the session",
}


def spread_rows(result: Result) -> list[tuple[str, str, str]]:
    """Flight-to-flight variations: name, standard deviation, the largest value."""
    rows = []
    for name, spread in result.spreads.items():
        known = {f: v for f, v in spread.values.items() if math.isfinite(v)}
        most = max(known, key=lambda f: abs(known[f]), default=None)
        largest = numbers.MISSING
        if most is not None:
            largest = f"{most}: {_spread(known[most], spread.unit)}"
        std = _spread(spread.std, spread.unit, spread.std_error)
        rows.append((name_of(name), std, largest))
    return rows


def _spread(std: float, unit: str, error: float = math.nan) -> str:
    return numbers.format_value(Estimate(std, error, unit))


def _model_of(result: Result) -> str:
    is_given = baseline(result) == "nominal"
    return "nominal model" if is_given else "refitted flat plate"


TEMPLATES = jinja2.Environment(
    loader=jinja2.PackageLoader("glider.report"),
    autoescape=jinja2.select_autoescape(["html"]),
    undefined=jinja2.StrictUndefined,
    trim_blocks=True,
    lstrip_blocks=True,
    bytecode_cache=jinja2.FileSystemBytecodeCache(str(cache_folder())),
)
"""Templates of pages and of sentences; their code is kept, as it takes long to make."""

TEMPLATES.globals |= {
    "DIVERGED": numbers.DIVERGED,
    "angle": numbers.format_angle,
    "baseline": baseline,
    "both": lambda r: all(r.errors.get(m) for m in (baseline(r), "corrected")),
    "cache_folder": cache_folder,
    "counted": counted,
    "error": lambda r, model: error_of(r, model, FREE),
    "estimate": numbers.format_estimate,
    "evidence": numbers.format_evidence,
    "inf": math.inf,
    "join": join,
    "notes_of": notes_of,
    "clock_name": lambda name: _CLOCKS.get(name, name),
    "units": FLOW_UNITS,
    "length": numbers.format_length,
    "may_be_chance": lambda r: r.left.ratio_to_floor > 1.0 and r.left.may_be_chance,
    "model_of": _model_of,
    "most_coefficients": _MOST_COEFFICIENTS,
    "name_of": name_of,
    "share": numbers.format_share,
    "spread": _spread,
    "value": numbers.format_value,
    "vars": vars,
    "words_of": words_of,
}
_SENTENCES = TEMPLATES.get_template("sentences.txt")
