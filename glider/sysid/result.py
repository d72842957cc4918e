"""The result of closing the loop: inert data, as the report and the caller read it."""

import dataclasses
from pathlib import Path

import numpy as np

from glider.physics.effects import EffectKind
from glider.physics.model import GliderModel

Z_SIGNIFICANT = 4.0
"""Lack of fit in standard deviations of pure noise (`LackOfFit.z`) from which on
something is left. Set by hand: with it, `bench_tracing alarms` finds no effect in
twenty campaigns that have none."""

MODELS = ("as_drawn", "refitted", "corrected")
"""Nominal model; flat plate with its own parameters refitted; with the effects."""


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
        evidence: log-likelihood gained on flights left out of the fit [nats].
        share: of the nominal model's error that it explains, 0 to 1.
        indistinguishable_from: kinds that the data cannot tell from it.
        depends_on: variables that it varies with.
    """

    kind: str
    words: str
    coefficients: dict[str, Estimate]
    evidence: float
    share: float
    indistinguishable_from: tuple[str, ...]
    depends_on: tuple[str, ...]


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
    """

    variables: dict[str, np.ndarray]
    residual: np.ndarray
    coefficients: dict[str, np.ndarray]
    modelled: dict[str, np.ndarray]


@dataclasses.dataclass(frozen=True, kw_only=True)
class Result:
    """Result of `close_the_loop`.

    Attributes:
        campaign: its name.
        path: of its folder.
        fit_flights: names of the flights used to fit.
        held_out_flights: names of the flights that errors are measured on.
        verdict: "no_effect", "effect_found" or "unexplained".
        effects: strongest first.
        errors: model name (of MODELS) to its errors; as_drawn is None where the
            vehicle is not known.
        left_z: what the corrected model leaves on held-out flights, in standard
            deviations of pure noise (below Z_SIGNIFICANT: nothing).
        candidates: evidence of each kind when tried alone [nats].
        noise_position_m: standard deviation of the measured x and z.
        noise_pitch_rad: of the measured pitch.
        model: the corrected glider.
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
    effects: tuple[FoundEffect, ...]
    errors: dict[str, Errors | None]
    left_z: float
    candidates: dict[str, float]
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
