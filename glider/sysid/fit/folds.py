"""Flights held out in folds, baseline and corrected model refitted to the others."""

import dataclasses
from collections.abc import Collection, Sequence

import numpy as np
from scipy.special import stdtrit

from glider.campaign.checks.motion import robust_std
from glider.sysid.constants import FOLDS, GAIN_CHANCE, GAIN_CLIP, LEAST_UNSEEN_GAIN
from glider.sysid.fit import prediction
from glider.sysid.likelihood import model_fit
from glider.sysid.likelihood.scales import Scales, negative_log_likelihood
from glider.sysid.likelihood.task import Task
from glider.sysid.result import Fold


@dataclasses.dataclass(frozen=True, kw_only=True)
class Gains:
    """Log-likelihood that a correction gains on flights that it was not fitted to."""

    values: np.ndarray  #: (flights,) of each [nats].
    unseen: np.ndarray  #: (flights,) which of them the search has not seen either.

    @property
    def t(self) -> float:
        """Student's t of the mean over all flights."""
        return robust_t(self.values)

    @property
    def least_t(self) -> float:
        """Student's t that so many gains exceed with a probability of GAIN_CHANCE."""
        count = len(self.values)
        return float(stdtrit(count - 1, 1.0 - GAIN_CHANCE)) if count > 1 else np.inf

    @property
    def of_unseen(self) -> float:
        """Sum over the flights that the search has not seen either [nats]."""
        return float(np.sum(clipped(self.values[self.unseen])))

    @property
    def are_significant(self) -> bool:
        """Whether the correction gains beyond chance, on unseen flights too."""
        return self.t >= self.least_t and self.of_unseen >= LEAST_UNSEEN_GAIN


@dataclasses.dataclass(frozen=True, kw_only=True)
class HeldOut:
    """Two models on flights that they were fitted without."""

    folds: tuple[Fold, ...]  #: Their errors.
    gain: Gains  #: Of the corrected model over the baseline.
    #: (flights, 2, 2) position RMS of baseline and corrected model, of free rollouts
    #: and along the measured pitch [m].
    paths: np.ndarray
    over_nominal: Gains | None = None  #: Over the nominal model, where computed.

    @property
    def ratios(self) -> tuple[float, float]:
        """Corrected over baseline errors, free and along the measured pitch."""
        return _ratio_over(self.paths[..., 0]), _ratio_over(self.paths[..., 1])


def _ratio_over(errors: np.ndarray) -> float:
    """Returns the ratio of RMS over flights (flights, 2) that either model flies."""
    flown = errors[np.isfinite(errors).any(axis=1)]
    return ratio_of(*np.sqrt(np.mean(flown**2, axis=0))) if len(flown) else np.inf


def ratio_of(before: float, after: float) -> float:
    """Returns after over before; infinite where the later model diverges."""
    if not np.isfinite(after):
        return np.inf
    return float(after / before) if np.isfinite(before) else 0.0


def robust_t(gains: np.ndarray) -> float:
    """Returns the mean over its standard error, each gain held near the median."""
    held = clipped(gains)
    error = np.std(held, ddof=1) / np.sqrt(len(held)) if len(held) > 1 else np.inf
    return float(np.mean(held) / max(error, 1e-12))


def clipped(gains: np.ndarray) -> np.ndarray:
    """Returns gains held near their median; those of no model (NaN) are zero."""
    gains = np.nan_to_num(gains)
    if not len(gains):
        return gains
    middle = np.median(gains)
    spread = robust_std(gains - middle) + 1e-12
    return np.clip(gains, middle - GAIN_CLIP * spread, middle + GAIN_CLIP * spread)


def flown_by(
    task: Task, model: model_fit.FitResult, scales: Scales
) -> prediction.RolloutModel:
    """Returns a fitted model as one that flies logs again."""
    flown = prediction.RolloutModel(
        theta=model.theta,
        field=model_fit.field_of(model),
        scales=scales,
        per_flight_trims=task.per_flight_trims,
    )
    scales = prediction.rollout_scales(flown, task.records, scales)
    return dataclasses.replace(flown, scales=scales)


def hold_out(
    task: Task,
    baseline: model_fit.FitResult,
    corrected: model_fit.FitResult,
    scales: Scales,
    rng: np.random.Generator,
    searched: Collection[str] = (),
    nominal: model_fit.FitResult | None = None,
) -> HeldOut:
    """Holds out each flight once."""
    count = len(task.records)
    is_new = np.array([record.name not in searched for record in task.records])
    order = rng.permutation(count)
    parts = [np.sort(order[k::FOLDS]) for k in range(min(FOLDS, count))]
    models = [baseline, corrected] + ([] if nominal is None else [nominal])
    refits = [_Refits(task, model) for model in models]
    costs, paths, folds = np.zeros((len(models), count)), np.zeros((count, 2, 2)), []
    for part in parts:
        unseen = [task.records[i] for i in part]
        fitted = [refit.without(part) for refit in refits]
        costs[:, part] = [cost for _, cost in fitted]
        flown = [flown_by(task, model, scales) for model, _ in fitted[:2]]
        predictions = [prediction.predict_all(model, unseen) for model in flown]
        for j, own in enumerate(predictions):
            pairs = zip(unseen, own, strict=True)
            paths[part, j] = [prediction.flight_errors(*pair) for pair in pairs]
        keep = predictable(predictions) or range(len(part))
        kept = [unseen[k] for k in keep]
        errors = [
            prediction.errors_of(model, kept, [own[k] for k in keep])
            for model, own in zip(flown, predictions, strict=True)
        ]
        names = tuple(record.name for record in unseen)
        folds.append(Fold(held_out=names, refitted=errors[0], corrected=errors[1]))
    over_nominal = None
    if nominal is not None:
        over_nominal = Gains(values=costs[2] - costs[1], unseen=is_new)
    return HeldOut(
        folds=tuple(folds),
        gain=Gains(values=costs[0] - costs[1], unseen=is_new),
        paths=paths,
        over_nominal=over_nominal,
    )


def predictable(predictions: Sequence[Sequence[prediction.Prediction]]) -> list[int]:
    """Finds the flights that at least one model flies to the end."""
    by_flight = zip(*predictions, strict=True)
    return [i for i, own in enumerate(by_flight) if any(p.is_finite for p in own)]


class _Refits:
    """A model, refitted to all flights but some by one step from the fit to all."""

    def __init__(self, task: Task, model: model_fit.FitResult):
        self.task, self.model = task, model_fit.with_constants(task, model)
        self.flights = model_fit.linear_flights(task, self.model)
        self.grams = model_fit.grams_of(self.flights, model.scales)

    def without(self, part: np.ndarray) -> tuple[model_fit.FitResult, np.ndarray]:
        """Returns the model without some flights, and their costs under it [nats]."""
        rest = self.grams.sum(axis=0) - self.grams[part].sum(axis=0)
        step = model_fit.prior_of(self.task, self.model).best_step(rest)
        unseen = [self.flights[i].combined(step) for i in part]
        costs = negative_log_likelihood(unseen, self.model.scales)
        return model_fit.moved(self.task, self.model, step), costs
