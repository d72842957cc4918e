"""The result of closing the loop, as inert data.

`Report` is what report.json holds, key by key, NaN being null; docs/file_formats.md has
all of it. `Result` adds what the program needs: the model, and arrays of figures.
"""

import dataclasses
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from glider.campaign.changes import Change
from glider.campaign.checks.masks import ExcludedRows
from glider.errors import InputError, expect
from glider.files.schema import Number, convert, parse_json, read_text
from glider.physics.covariance import Covariance
from glider.physics.effects import EffectKind
from glider.physics.model import GliderModel
from glider.sysid.constants import MOST_LEFT, NO_CHANCE, UNLIKELY

#: Nothing is wrong; all that is wrong has a name; some of it has; none of it has; what
#: was found does not hold on held-out flights.
VERDICTS = "no_effect", "effect_found", "partly_explained", "unexplained", "not_trusted"
#: Nominal model; flat plate with refitted parameters; model with the effects.
MODELS = "nominal", "refitted", "corrected"
#: What a perfect model would leave.
PERFECT = "floor"
#: Whether an effect's formula has the shape that the flights show.
UNEXPLAINED = "unexplained"  # Kind of a free function that no formula explains.
LIBRARY_SHAPE = "library"
OTHER_SHAPE = "not the library's"


@dataclasses.dataclass(frozen=True)
class Estimate:
    """A coefficient: value, standard error and unit."""

    value: Number
    std: Number
    unit: str


@dataclasses.dataclass(frozen=True, kw_only=True)
class FoundEffect:
    """An effect that the flights show."""

    kind: str  #: Of the library, a user effect, or "unexplained".
    words: str  #: A short phrase for people.
    coefficients: dict[str, Estimate]  #: By name.
    evidence: Number = math.nan  #: Log-likelihood lost without it, if any [nats].
    share_of_residual: Number = math.nan  #: Of all the evidence, 0 to 1.
    inclusion: Number = 1.0  #: Share of the folds that find it again, 0 to 1.
    shape: str = LIBRARY_SHAPE  #: OTHER_SHAPE: the model has a free function.
    indistinguishable_from: tuple[str, ...] = ()  #: Do as well, alone or together.
    link: str = ""  #: Of the force chain, where a free function acts; of a formula "".
    depends_on: tuple[str, ...]  #: Variables that it varies with.


@dataclasses.dataclass(frozen=True, kw_only=True)
class Spread:
    """Flight-to-flight variation: standard deviation and flights' values."""

    std: Number
    unit: str
    values: dict[str, Number]

    @property
    def std_error(self) -> float:
        """Standard error of the standard deviation, s / √(2 (n - 1)) of n flights."""
        count = sum(math.isfinite(value) for value in self.values.values())
        return self.std / math.sqrt(2.0 * (count - 1)) if count > 1 else math.nan


@dataclasses.dataclass(frozen=True)
class Air:
    """Turbulence in x and in z; an error of the model looks like moving air too."""

    std_m_s: Number
    correlation_s: Number


@dataclasses.dataclass(frozen=True, kw_only=True)
class Residual:
    """Error of the corrected model on held-out flights."""

    position_m: Number  #: RMS of the position [m].
    ratio_to_floor: Number  #: That over the RMS which a perfect model would leave.
    ratio_along_pitch: Number = math.nan  #: The same along the measured pitch.
    chance: Number = math.nan  #: Probability that a perfect model leaves as much.
    depends_on: tuple[str, ...]  #: Variables that it varies with, most first.

    @property
    def exceeds_chance(self) -> bool:
        """Whether there is more than noise and moving air: an effect, found or not.

        A perfect model would leave as much on all flights with a probability below
        UNLIKELY, where a ratio on the held-out ones is above one. Or these, which are
        few, show NO_CHANCE times as much.
        """
        is_more = self.ratio_to_floor > 1.0 or self.ratio_along_pitch > 1.0
        is_improbable = is_more and self.chance < UNLIKELY
        return is_improbable or self.ratio_to_floor > NO_CHANCE

    @property
    def is_below_floor(self) -> bool:
        """Whether noise and air were overestimated: so much less is never chance."""
        return self.ratio_to_floor < 1.0 / NO_CHANCE

    @property
    def may_be_chance(self) -> bool:
        """Whether a perfect model may leave as much: never more than MOST_LEFT."""
        return not (self.exceeds_chance or self.ratio_to_floor > MOST_LEFT)


@dataclasses.dataclass(frozen=True)
class EquationErrors:
    """RMS of measured minus modelled acceleration [m/s², m/s², rad/s²]."""

    tangential: Number
    normal: Number
    pitch: Number


@dataclasses.dataclass(frozen=True)
class RolloutErrors:
    """Errors of free rollouts, over whole flights; the mean distance at the end."""

    position_rms_m: Number
    position_end_m: Number
    pitch_rms_rad: Number


@dataclasses.dataclass(frozen=True)
class PathErrors:
    """Errors of the forces integrated along the measured pitch."""

    position_rms_m: Number


@dataclasses.dataclass(frozen=True)
class Errors:
    """Errors of one model on held-out flights."""

    equation: EquationErrors
    rollout: RolloutErrors
    rollout_measured_pitch: PathErrors

    @property
    def position_rms_m(self) -> float:
        """RMS of the position of free rollouts [m]."""
        return self.rollout.position_rms_m


@dataclasses.dataclass(frozen=True)
class FlightNames:
    """Names of flights."""

    fit: tuple[str, ...]  #: Used to fit.
    held_out: tuple[str, ...]  #: That errors are measured on.
    #: Those of the held-out ones on which every model diverges: they are in no error.
    diverged: tuple[str, ...] = ()

    @property
    def predicted(self) -> tuple[str, ...]:
        """The held-out ones that errors are of."""
        return tuple(name for name in self.held_out if name not in self.diverged)

    @property
    def count(self) -> int:
        """Number of all."""
        return len(self.fit) + len(self.held_out)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Difference:
    """In what some flights differ most from the others."""

    what: str  #: A feature of a variable, as "largest alpha".
    unit: str
    value: Number  #: Its median over them.
    others: Number  #: That over the others.


@dataclasses.dataclass(frozen=True, kw_only=True)
class UnlikeFlights:
    """The flights most unlike the others, predicted by models refitted without them."""

    flights: tuple[str, ...]
    difference: Difference
    errors: dict[str, Errors | None]  #: As those of `Report`, without accelerations.
    left: Residual  #: By the corrected model.
    diverged: tuple[str, ...] = ()  #: More of them, on which every model diverges.

    @property
    def warning(self) -> str:
        """What to say where a perfect model would leave less."""
        free, along = self.left.ratio_to_floor, self.left.ratio_along_pitch
        times = max(free, along)
        what = f"leaves {times:.3g} times the error of a perfect model"
        if along > free:
            what += " along the measured pitch"
        return (
            f"on the flights most unlike the others, refitted without them, the model "
            f"{what if math.isfinite(times) else 'diverges'}: it may be used within "
            "the flown range only."
        )


@dataclasses.dataclass(frozen=True)
class MeasurementNoise:
    """Standard deviations of the measured x and z, and of the measured pitch."""

    position_m: Number
    pitch_rad: Number


@dataclasses.dataclass(frozen=True, kw_only=True)
class Report:
    """The part of a result that report.json holds."""

    campaign: str
    flights: FlightNames
    verdict: str
    reason: str
    effects: Sequence[FoundEffect]
    errors: dict[str, Errors | None]  #: By model; None of one that there is not.
    evidence_threshold: Number  #: Evidence of an effect beside others, at least [nats].
    left: Residual
    unlike: UnlikeFlights | None = None  #: None of too few flights.
    #: Position errors (RMS) on held-out flights that models fly by commands alone, with
    #: their own servo [m]; of the models for which that differs from `errors`.
    by_commands_m: dict[str, Number] = dataclasses.field(default_factory=dict)
    changes: tuple[Change, ...] = ()  #: During the session, found one after the other.
    bank_rad: Number | None = None  #: At the end of flights that seem to roll, RMS.
    air: Air
    spreads: dict[str, Spread]  #: Flight-to-flight variations, by name.
    vehicle: dict[str, Estimate]  #: Parameters that were not specified, by name.
    warnings: tuple[str, ...]
    set_aside: tuple[ExcludedRows, ...]
    settings: dict[str, Any]  #: Seed, fraction and what else would repeat this run.
    noise: MeasurementNoise
    #: Offsets of clocks and biases of sensors, estimated with the flights, by name.
    clocks: dict[str, Estimate] = dataclasses.field(default_factory=dict)
    #: Faults of the logs that were found, and what was done about them.
    log_findings: tuple[str, ...] = ()
    seconds: dict[str, Number]
    version: str

    def __post_init__(self) -> None:
        models = *MODELS, PERFECT
        known = f"one of {', '.join(models)}"
        for name in self.errors:
            expect(name in models, "a model of 'errors'", name, known)


def read_report(path: Path) -> tuple[Report, Path]:
    """Reads a report: its folder, or its report.json; also returns the file."""
    file = path / "report.json" if path.is_dir() else path
    data = parse_json(
        read_text(file, "a report.json of close-the-loop, to be run first"), str(file)
    )
    try:
        return convert(data, Report, str(file)), file
    except InputError as error:
        again = "run close-the-loop again if another version wrote it"
        raise InputError(f"{str(error).rstrip('.')} ({again}).") from None


@dataclasses.dataclass(frozen=True, kw_only=True)
class HeldOutFlight:
    """A held-out flight measured and flown by each model."""

    name: str  #: Of its file.
    time: np.ndarray  #: (n,) from the first row [s].
    measured: np.ndarray  #: (n, 3) x [m], z [m], pitch [rad].
    flown: dict[str, np.ndarray]  #: The same from rollouts of MODELS.
    fitted_until: float  #: The launch state was fitted on the rows up to here [s].


@dataclasses.dataclass(frozen=True, kw_only=True)
class ResidualTable:
    """The article's residual data set of one model, all flights stacked."""

    variables: dict[str, np.ndarray]  #: Of FLOW_VARIABLES and "alphadot", (N,) each.
    #: (N, 3) measured minus modelled: along the wing, normal [m/s²], pitch [rad/s²].
    residual: np.ndarray
    coefficients: dict[str, np.ndarray]  #: Measured COEFFICIENTS, over ½ρV²S_w, (N,).
    modelled: dict[str, np.ndarray]  #: The same of the model.
    flight: np.ndarray  #: (N,) index of `names` of each row.
    names: tuple[str, ...]  #: Of the flights.
    noise: np.ndarray  #: (N, 3) deviation of `residual` by smoothed noise alone.


@dataclasses.dataclass(frozen=True, kw_only=True)
class Alternative:
    """A glider that may be the right one, of another set of effects than others."""

    probability: float  #: Of those that are nearly as likely.
    model: GliderModel
    covariance: Covariance | None  #: Given that the set is right; None where all is.


@dataclasses.dataclass(frozen=True, kw_only=True)
class Result(Report):
    """Result of `close_the_loop`."""

    path: Path  #: Of the campaign's folder.
    knows_forces: bool  #: Whether mass and areas are specified.
    model: GliderModel  #: The corrected glider.
    held_out: tuple[HeldOutFlight, ...]  #: Held-out flights, measured and flown.
    residual_before: ResidualTable  #: Of the nominal model, else of the baseline.
    residual_after: ResidualTable  #: Of the corrected model.
    own_effects: tuple[EffectKind, ...] = ()  #: User effects that were tried.
    covariance: Covariance | None = None  #: Of all fitted parameters, if any.
    #: The corrected glider and those of sets that are nearly as likely.
    alternatives: tuple[Alternative, ...] = ()

    def __repr__(self) -> str:
        """Returns one line, as a notebook shows it."""
        names = ", ".join(effect.kind for effect in self.effects) or "nothing"
        return f"Result('{self.campaign}', {self.verdict}: {names})"

    @property
    def rivals(self) -> list[Alternative]:
        """Those of the other sets, the likeliest first."""
        return sorted(self.alternatives[1:], key=lambda own: -own.probability)

    @property
    def report(self) -> Report:
        """The part that report.json holds."""
        fields = dataclasses.fields(Report)
        return Report(**{field.name: getattr(self, field.name) for field in fields})
