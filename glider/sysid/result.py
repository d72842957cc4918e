"""The result of closing the loop: inert data, as the report and the caller read it."""

import dataclasses
from pathlib import Path

import numpy as np

from glider.campaign.checks.masks import ExcludedRows
from glider.errors import InputError, show
from glider.physics.covariance import Covariance
from glider.physics.effects import EffectKind
from glider.physics.model import GliderModel

VERDICTS = (
    "no_effect",
    "effect_found",
    "partly_explained",
    "unexplained",
    "not_trusted",
)
"""Nothing is wrong; all that is wrong has a name; some of it has; none of it has; what
was found does not hold on flights that were held out."""

MODELS = ("nominal", "refitted", "corrected")
"""Nominal model; flat plate with its own parameters refitted; with the effects."""

CALIBRATED = "calibrated"
"""A further model: the refitted plate with a constant error of the pitch reading taken
out. Calibration is not physics, so it has a line of its own."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Estimate:
    """A coefficient: value, standard error and unit."""

    value: float
    std: float
    unit: str


@dataclasses.dataclass(frozen=True, kw_only=True)
class FoundEffect:
    """An effect that the flights show.

    Attributes:
        kind: in the library, of the caller's own, or "unexplained".
        words: a short phrase for people.
        coefficients: by name.
        evidence: log-likelihood lost without it, all else refitted [nats]; NaN where
            only a difference from flight to flight was found.
        share: of all the evidence, 0 to 1.
        indistinguishable_from: kinds that the data cannot tell from it.
        depends_on: variables that it varies with.
        inclusion: share of resampled sets of flights in which it is chosen, 0 to 1.
        spread: coefficient to how much it differs from flight to flight, one standard
            deviation; only those that do.
        shape_fits: whether the library's formula has the right shape; else the model
            carries a curve beside it.
    """

    kind: str
    words: str
    coefficients: dict[str, Estimate]
    evidence: float
    share: float
    indistinguishable_from: tuple[str, ...]
    depends_on: tuple[str, ...]
    inclusion: float = 1.0
    spread: dict[str, float] = dataclasses.field(default_factory=dict)
    shape_fits: bool = True


@dataclasses.dataclass(frozen=True, kw_only=True)
class Spread:
    """Something that differs from flight to flight, about the model's own value.

    Attributes:
        std: standard deviation over flights.
        unit: of it.
        values: name of each fitted flight to its own value.
    """

    std: float
    unit: str
    values: dict[str, float]


CURVE_TERMS = ("c_normal", "c_axial", "c_moment", "elevator_factor")
"""Terms of a curve; the third in metres."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Curve:
    """What a plate lacks in one term, over the angle of attack, with a band.

    Attributes:
        term: one of CURVE_TERMS.
        alpha: (n,) [rad].
        lack: (n,) all that the plate lacks there: named effects and what is carried.
        std: (n,) standard error of it.
        named: (n,) the part that has a name.
    """

    term: str
    alpha: np.ndarray
    lack: np.ndarray
    std: np.ndarray
    named: np.ndarray

    def __post_init__(self) -> None:
        if self.term not in CURVE_TERMS:
            raise InputError(
                f"field 'term' is {show(self.term)}; expected one of "
                f"{', '.join(CURVE_TERMS)}."
            )


@dataclasses.dataclass(frozen=True, kw_only=True)
class Air:
    """How the air moves: its velocity in x and in z, one standard deviation.

    A model's own error looks like moving air too.
    """

    std_m_s: float
    correlation_s: float


@dataclasses.dataclass(frozen=True, kw_only=True)
class Residual:
    """What the corrected model leaves of held-out flights.

    Attributes:
        ratio_to_noise: RMS of the position's error over the measurement's noise.
        position_m: that RMS [m].
        depends_on: variables that what is left varies with, most first.
    """

    ratio_to_noise: float
    position_m: float
    depends_on: tuple[str, ...]


@dataclasses.dataclass(frozen=True, kw_only=True)
class Fold:
    """Some flights held out, the models refitted to the others.

    Attributes:
        held_out: names of the flights.
        refitted: errors of the refitted plate on them.
        corrected: errors of the plate with the effects.
    """

    held_out: tuple[str, ...]
    refitted: "Errors"
    corrected: "Errors"


@dataclasses.dataclass(frozen=True, kw_only=True)
class Combination:
    """A set of effects that was fitted in full.

    Attributes:
        kinds: of its effects.
        evidence: log-likelihood gained over the plate alone, less the price of the
            effects [nats].
    """

    kinds: tuple[str, ...]
    evidence: float


MOST_COMBINATIONS = 12
"""Sets of effects that a result lists."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class EvidenceThreshold:
    """Evidence below which an effect is not taken [nats].

    Attributes:
        effect: of one coefficient, at least.
        coefficient: more for each further coefficient.
        uncommon: more for an effect that not every glider has; zero where the nominal
            forces are known.
    """

    effect: float
    coefficient: float
    uncommon: float = 0.0


@dataclasses.dataclass(frozen=True, kw_only=True)
class Errors:
    """Errors of one model on held-out flights.

    Attributes:
        tangential: RMS of measured minus modelled acceleration along the wing
            [m/s²].
        normal: normal to the wing [m/s²].
        pitch: in pitch [rad/s²].
        position_rms_m: of free rollouts, over whole flights.
        position_end_m: mean distance at the end.
        pitch_rms_rad: of free rollouts.
        measured_pitch_position_rms_m: of the forces integrated along the measured
            pitch.
    """

    tangential: float
    normal: float
    pitch: float
    position_rms_m: float
    position_end_m: float
    pitch_rms_rad: float
    measured_pitch_position_rms_m: float


@dataclasses.dataclass(frozen=True, kw_only=True)
class OutlyingFlights:
    """Held-out flights that no model explains with the others, scored apart.

    Attributes:
        names: of their files.
        errors: model name to its errors on them.
    """

    names: tuple[str, ...]
    errors: dict[str, Errors | None]


@dataclasses.dataclass(frozen=True, kw_only=True)
class HeldOutFlight:
    """A held-out flight measured and flown by each model.

    Attributes:
        name: of its file.
        time: (n,) from the first row [s].
        measured: (n, 3) x [m], z [m], pitch [rad].
        flown: model name (of MODELS) to (n, 3) the same from its free rollout.
        fitted_until: the launch state was fitted on the rows up to here [s].
    """

    name: str
    time: np.ndarray
    measured: np.ndarray
    flown: dict[str, np.ndarray]
    fitted_until: float


@dataclasses.dataclass(frozen=True, kw_only=True)
class ResidualTable:
    """The article's residual data set of one model, all flights stacked.

    Attributes:
        variables: name (of FIELD_VARIABLES and "alphadot") to (N,) values.
        residual: (N, 3) measured minus modelled acceleration: along the wing, normal
            to it [m/s²], pitch [rad/s²].
        coefficients: name ("c_lift", "c_drag", "c_moment") to (N,) measured, referred
            to ½ρV²S_w.
        modelled: the same of the model.
        flight: (N,) number of the flight that each row is of, an index of `names`.
        names: of the flights.
        noise: (N, 3) standard deviation of `residual` that the measurement's noise
            alone gives it, as the smoothing lets it through.
        unit: (N, 2) accelerations that coefficients of one stand for: ½ρV²S_w over
            the mass [m/s²] and over the moment of inertia [rad/s²/m].
    """

    variables: dict[str, np.ndarray]
    residual: np.ndarray
    coefficients: dict[str, np.ndarray]
    modelled: dict[str, np.ndarray]
    flight: np.ndarray
    names: tuple[str, ...]
    noise: np.ndarray
    unit: np.ndarray


@dataclasses.dataclass(frozen=True, kw_only=True)
class Result:
    """Result of `close_the_loop`.

    Attributes:
        campaign: its name.
        path: of its folder.
        fit_flights: names of the flights used to fit.
        held_out_flights: names of the flights that errors are measured on.
        verdict: one of VERDICTS.
        reason: a sentence that says why.
        effects: strongest first.
        errors: model name (of MODELS, and CALIBRATED) to its errors; nominal is None
            where the vehicle is not known.
        outlying: held-out flights that stand out from all others, whose errors are not
            in `errors`; None where there are none.
        folds: errors over all flights, each held out once.
        left: what the corrected model leaves.
        candidates: evidence of each kind when tried alone [nats].
        combinations: sets of effects that were fitted, best first.
        evidence_threshold: below which an effect is not taken.
        correlations: "kind.coefficient" to the same to the correlation of their errors.
        spreads: name to what differs from flight to flight, only what does.
        air: how it moves.
        curves: what the plate lacks, over the angle of attack.
        vehicle: name of a parameter that was not told to its estimate.
        knows_forces: whether mass and areas are told: sets of effects are then judged
            by the fitted flights, else by what they foretell of flights left out.
        warnings: sentences about the campaign and the result.
        set_aside: rows that were not used.
        planarity: name of a flight to a sentence, where the log has roll and yaw.
        noise_position_m: standard deviation of the measured x and z.
        noise_pitch_rad: of the measured pitch.
        model: the corrected glider.
        covariance: of the errors of its coefficients and of the vehicle's numbers that
            nobody told, those that were fitted; None where none was.
        held_out: held-out flights, measured and flown.
        residual_before: of the nominal model (of the refitted plate where the vehicle
            is not known).
        residual_after: of the corrected model.
        seconds: stage to wall-clock time.
        version: of this package.
        settings: seed, fraction and what else would repeat this run.
        own_effects: kinds of the caller's that were tried beside the library.
    """

    campaign: str
    path: Path
    fit_flights: tuple[str, ...]
    held_out_flights: tuple[str, ...]
    verdict: str
    reason: str
    effects: tuple[FoundEffect, ...]
    errors: dict[str, Errors | None]
    folds: tuple[Fold, ...]
    left: Residual
    candidates: dict[str, float]
    combinations: tuple[Combination, ...]
    evidence_threshold: EvidenceThreshold
    correlations: dict[str, dict[str, float]]
    spreads: dict[str, Spread]
    air: Air
    curves: tuple[Curve, ...]
    vehicle: dict[str, Estimate]
    knows_forces: bool
    warnings: tuple[str, ...]
    set_aside: tuple[ExcludedRows, ...]
    planarity: dict[str, str]
    noise_position_m: float
    noise_pitch_rad: float
    model: GliderModel
    held_out: tuple[HeldOutFlight, ...]
    residual_before: ResidualTable
    residual_after: ResidualTable
    seconds: dict[str, float]
    version: str
    settings: dict[str, object]
    own_effects: tuple[EffectKind, ...] = ()
    covariance: Covariance | None = None
    outlying: OutlyingFlights | None = None
