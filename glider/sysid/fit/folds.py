"""Does a correction hold? Flights held out in folds, both models refitted."""

import dataclasses
from collections.abc import Callable

import numpy as np

from glider.compiled.parallel import in_parallel
from glider.sysid.fit.prediction import (
    Prediction,
    RolloutModel,
    errors_of,
    flight_errors,
    predict,
    rollout_scales,
)
from glider.sysid.likelihood.directions import slopes
from glider.sysid.likelihood.information import bounded_step
from glider.sysid.likelihood.model_fit import (
    FitResult,
    beforehand,
    field_of,
    grams_of,
    linear_flights,
    with_constants,
    with_prior,
)
from glider.sysid.likelihood.scales import Scales, negative_log_likelihood
from glider.sysid.likelihood.task import Task
from glider.sysid.replay.record import Record
from glider.sysid.result import Fold

FOLDS = 5

CLIP = 3.0
"""Gains of single flights are held within this many median deviations of the
median: one flight may not decide."""

LEAST_T = 2.0
"""Mean gain over its standard error from which on it holds: by chance one campaign in
forty has it."""

WORSE = 1.001, 1.02
"""Ratios of errors from which on a correction makes flights worse, free and along the
measured pitch. A glider that flies freely shows all that is wrong with it, and a claim
has to tell where it goes better than the plate does; a thousandth is a tie. Along the
measured pitch what turns the glider changes nothing but by chance."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class HeldOut:
    """What two models make of flights that they were fitted without.

    Attributes:
        folds: their errors.
        gain: (flights,) log-likelihood that the corrected model gains [nats].
        over_nominal: the same over the nominal model; None where it was not asked.
        free: (flights, 2) position RMS of free rollouts, plate and corrected [m].
        along: (flights, 2) the same along the measured pitch.
    """

    folds: tuple[Fold, ...]
    gain: np.ndarray
    free: np.ndarray
    along: np.ndarray
    over_nominal: np.ndarray | None = None

    @property
    def t(self) -> float:
        """Student's t of the flights' gains."""
        return robust_t(self.gain)

    @property
    def t_over_nominal(self) -> float | None:
        """The same of their gains over the nominal model."""
        return None if self.over_nominal is None else robust_t(self.over_nominal)

    @property
    def ratios(self) -> tuple[float, float]:
        """Corrected over plate errors, free and along the measured pitch."""
        return ratio_of(*_rms(self.free)), ratio_of(*_rms(self.along))


def _rms(errors: np.ndarray) -> tuple[float, float]:
    before, after = np.sqrt(np.mean(errors**2, axis=0))
    return float(before), float(after)


def ratio_of(before: float, after: float) -> float:
    """Returns after over before; a model that blows up has an infinite error."""
    if not np.isfinite(after):
        return np.inf
    return after / before if np.isfinite(before) else 0.0


def robust_t(gains: np.ndarray) -> float:
    """Returns the mean over its standard error, each gain held near the median."""
    middle = np.median(gains)
    spread = 1.4826 * np.median(np.abs(gains - middle)) + 1e-12
    held = np.clip(gains, middle - CLIP * spread, middle + CLIP * spread)
    error = np.std(held, ddof=1) / np.sqrt(len(held)) if len(held) > 1 else np.inf
    return float(np.mean(held) / max(error, 1e-12))


def flown_by(task: Task, model: FitResult, scales: Scales) -> RolloutModel:
    """Returns a fitted model as one that flies logs again.

    Args:
        task: on the flights that it was fitted to.
        model: fitted.
        scales: of sensors, and of what differs from flight to flight, as the best model
            has them: a wrong model would make much of them.
    """
    flown = RolloutModel(
        theta=model.theta,
        field=field_of(task, model),
        scales=scales,
        own_trims=task.own_trims,
    )
    scales = rollout_scales(flown, task.records, scales)
    return dataclasses.replace(flown, scales=scales)


def hold_out(
    task: Task,
    plate: FitResult,
    corrected: FitResult,
    scales: Scales,
    rng: np.random.Generator,
    drawn: FitResult | None = None,
) -> HeldOut:
    """Holds out each flight once.

    Args:
        task: on all flights.
        plate: the model before.
        corrected: the model after.
        scales: of sensors, and of what differs from flight to flight, of rollouts.
        rng: that deals the flights to folds.
        drawn: the nominal model, where the gain over it is asked too.
    """
    count = len(task.records)
    order = rng.permutation(count)
    parts = [np.sort(order[k::FOLDS]) for k in range(min(FOLDS, count))]
    refits = [_Refits(task, model) for model in (plate, corrected)]
    gain, free, along = np.zeros(count), np.zeros((count, 2)), np.zeros((count, 2))
    nominal = None if drawn is None else _Refits(task, drawn)
    over_nominal = None if drawn is None else np.zeros(count)
    folds = []
    for part in parts:
        unseen = [task.records[i] for i in part]
        errors, costs = [], np.zeros((2, len(part)))
        for j, refit in enumerate(refits):
            model, costs[j] = refit.without(part)
            flown = flown_by(task, model, scales)
            predictions = in_parallel(_predictor(flown), unseen)
            errors.append(errors_of(flown, unseen, predictions))
            for i, record, predicted in zip(part, unseen, predictions, strict=True):
                free[i, j], along[i, j] = flight_errors(record, predicted)
        gain[part] = costs[0] - costs[1]
        if nominal is not None and over_nominal is not None:
            over_nominal[part] = nominal.without(part)[1] - costs[1]
        folds.append(
            Fold(
                held_out=tuple(record.name for record in unseen),
                refitted=errors[0],
                corrected=errors[1],
            )
        )
    return HeldOut(
        folds=tuple(folds), gain=gain, free=free, along=along, over_nominal=over_nominal
    )


def _predictor(flown: RolloutModel) -> Callable[[Record], Prediction]:
    def one(record: Record) -> Prediction:
        return predict(flown, record)

    return one


class _Refits:
    """A model, refitted to all flights but some by one step from the fit to all."""

    def __init__(self, task: Task, model: FitResult):
        model = with_constants(task, model)
        self.task, self.model = task, model
        directions = slopes(task.layout, model.theta, model.free)
        self.flights = linear_flights(task, model, directions)
        scales = model.scales
        self.grams = np.stack(grams_of(self.flights, scales))

    def without(self, part: np.ndarray) -> tuple[FitResult, np.ndarray]:
        """Returns the model without some flights, and their costs under it [nats]."""
        model, index = self.model, list(self.model.free)
        rest = self.grams.sum(axis=0) - self.grams[part].sum(axis=0)
        own, mean, precision = beforehand(self.task, model, index)
        count, free = len(model.coordinates), len(index)
        wide = np.full(count, np.inf)
        step = bounded_step(
            with_prior(rest, own, mean, precision),
            np.full(free + count, 1e-9),
            0.0,
            np.append(self.task.layout.lower[index], -wide) - own,
            np.append(self.task.layout.upper[index], wide) - own,
        )
        theta = model.theta.copy()
        theta[index] += step[:free]
        moved = dataclasses.replace(
            model, theta=theta, coordinates=model.coordinates + step[free:]
        )
        unseen = [self.flights[i].combined(step) for i in part]
        return moved, negative_log_likelihood(unseen, model.scales)
