"""What a session knows, as FOLDER/lab/session.json has it."""

import dataclasses
import math
from pathlib import Path

from glider.campaign.checks.masks import ExcludedRows
from glider.files import schema
from glider.files.schema import Number
from glider.files.writing import write_text
from glider.sysid.result import Estimate, Report

NOMINAL = "nominal"
CORRECTED = "corrected"
PROPOSED = "proposed"


@dataclasses.dataclass(frozen=True, kw_only=True)
class Throw:
    """A flight of the session."""

    name: str  #: Of its file in the campaign.
    sha256: str  #: Of this file and campaign.yaml: another content is another throw.
    take: str = ""  #: File of other software that it was cut out of; "" for none.
    flown: str = ""  #: When, as the station recorded it (ISO 8601); "": not known.
    written: str = ""  #: When its file, or that of its take, was written.
    fault: str = ""  #: Why it cannot be read, or why the station stopped it.
    is_read: bool = True  #: Whether it is a flight of the campaign.
    #: By the station's record, where there is one: NOMINAL or CORRECTED, the model that
    #: was planned with, or PROPOSED, without a plan; whether it perched; how far from
    #: the wire it passed [m].
    planned: str = ""
    perched: bool | None = None
    miss: float | None = None
    is_drawn: bool = False  #: Whether it was flown again, by the models there were.
    #: RMS of the position error of each model's prediction [m].
    errors: dict[str, Number] = dataclasses.field(default_factory=dict)
    is_fitted: bool = False  #: Whether the corrected model was fitted to it, too.


@dataclasses.dataclass(frozen=True, kw_only=True)
class TracedEffect:
    """An effect, as one trace has it."""

    kind: str
    evidence: Number  #: [nats]
    coefficients: dict[str, Estimate]


@dataclasses.dataclass(frozen=True, kw_only=True)
class Trace:
    """The answer of `close_the_loop` on the throws that there were."""

    flights: tuple[str, ...]  #: That it was given.
    sha256: str  #: Of their contents.
    verdict: str = ""
    headline: str = ""
    effects: tuple[TracedEffect, ...] = ()
    errors: dict[str, Number] = dataclasses.field(default_factory=dict)  #: RMS [m].
    seconds: Number = math.nan  #: That it took.
    refusal: str = ""  #: Why there is no answer, e.g. too few flights.
    is_fault: bool = False  #: Whether a fault of the program, or a kill, is why.


@dataclasses.dataclass(frozen=True, kw_only=True)
class Proposal:
    """The next throw to make, and why."""

    flights: int  #: Number of the flights that it was found from.
    sentences: tuple[str, ...]  #: What to expect of it.
    throws: tuple[str, ...] = ()  #: Each launch in words.
    sha256: str = ""  #: Of the contents of the flights.
    is_refused: bool = False  #: Whether there is none; `sentences` has the reason.


@dataclasses.dataclass(frozen=True, kw_only=True)
class Draft:
    """A map for takes: proposed, or corrected and checked."""

    text: str  #: Of MAP.yaml.
    takes: tuple[str, ...]  #: That it was checked on.
    is_proposed: bool = False  #: Whether no person has corrected or checked it.
    flights: int = 0  #: That were found in them; their picture is there if any.
    refusal: str = ""  #: Why it cannot be.
    warnings: tuple[str, ...] = ()  #: What the flights do not show.
    columns: tuple[str, ...] = ()  #: Names of the takes' columns.
    #: Takes that cannot be read like this, and why.
    skipped: dict[str, str] = dataclasses.field(default_factory=dict)


@dataclasses.dataclass(frozen=True, kw_only=True)
class State:
    """All that a session has found."""

    throws: tuple[Throw, ...] = ()  #: In the order of their names.
    excluded: tuple[ExcludedRows, ...] = ()  #: By the checks of all throws so far.
    notes: tuple[str, ...] = ()  #: Warnings of import and checks, refusals.
    traces: tuple[Trace, ...] = ()  #: In the order of time.
    proposal: Proposal | None = None
    draft: Draft | None = None

    @property
    def flights(self) -> tuple[str, ...]:
        """Names of the flights that can be traced."""
        return tuple(throw.name for throw in self.throws if throw.is_read)

    @property
    def answer(self) -> Trace | None:
        """The last trace that has an answer."""
        return next((t for t in reversed(self.traces) if not t.refusal), None)

    def count_perches(self, planned: str) -> tuple[int, int]:
        """Number of perches, and of launches, with plans of one model."""
        flown = [t.perched for t in self.throws if t.planned == planned]
        return sum(map(bool, flown)), len(flown)


def load_state(file: Path) -> State:
    """Loads a state; an empty one where there is no file."""
    if not file.exists():
        return State()
    return schema.load_json(State, file, "the state of a session")


def save_state(state: State, file: Path) -> None:
    """Saves a state, all of it or nothing."""
    write_text(file, schema.json_text(state) + "\n")


def trace_of(report: Report, headline: str, sha256: str) -> Trace:
    """The part of a report that a session keeps."""
    effects = tuple(
        TracedEffect(
            kind=e.kind, evidence=e.evidence, coefficients=dict(e.coefficients)
        )
        for e in report.effects
    )
    errors = {
        name: errors.position_rms_m
        for name, errors in report.errors.items()
        if errors is not None
    }
    return Trace(
        flights=tuple(report.settings["flights"]),
        sha256=sha256,
        verdict=report.verdict,
        headline=headline,
        effects=effects,
        errors=errors,
        seconds=sum(s for s in report.seconds.values() if math.isfinite(s)),
    )
