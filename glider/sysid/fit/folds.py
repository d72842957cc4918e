"""Flights held out in folds: effects searched and all models refitted without them."""

import dataclasses
from collections.abc import Collection

import numpy as np
from scipy.special import ndtri, stdtrit

from glider.physics.confidence import LEVEL
from glider.sysid.constants import FOLDS, WORSE
from glider.sysid.fit.prediction import compare, flown_by, mean_squares, near_median
from glider.sysid.likelihood import model_fit
from glider.sysid.likelihood.candidates import gather_in_parts
from glider.sysid.likelihood.information import counted_from, solve_scaled
from glider.sysid.likelihood.scales import Scales
from glider.sysid.likelihood.task import FitResult, Task
from glider.sysid.result import Fold
from glider.sysid.search.support import Nearby
from glider.sysid.search.tracing import without_late

WAYS = "freely", "along the measured pitch"
"""How flights are flown again, as `HeldOut.paths` has them."""

_LARGEST_LOG = 9.0  # Of a ratio of errors: a model that diverges is one loss.


@dataclasses.dataclass(frozen=True, kw_only=True)
class Gains:
    """Log-likelihood that a correction gains on flights that played no part in it."""

    values: np.ndarray  #: (flights,) of each [nats].

    @property
    def t(self) -> float:
        """Student's t of the mean over all flights, each held near the median."""
        held = np.nan_to_num(self.values)  # Of no model where it is NaN.
        if len(held) < 2:
            return 0.0
        held = near_median(held)
        error = np.std(held, ddof=1) / np.sqrt(len(held))
        return float(np.mean(held) / max(error, 1e-12))

    @property
    def least_t(self) -> float:
        """Student's t within which so many gains of nothing are, with LEVEL."""
        count = len(self.values)
        level = 0.5 * (1.0 + LEVEL)
        return float(stdtrit(count - 1, level)) if count > 1 else np.inf

    @property
    def are_significant(self) -> bool:
        """Whether the correction gains beyond chance."""
        return self.t >= self.least_t

    @property
    def would_suffice(self) -> bool:
        """Whether gains so large beside their scatter would show on many flights."""
        return self.t >= float(ndtri(0.5 * (1.0 + LEVEL)))


@dataclasses.dataclass(frozen=True)
class HeldOut:
    """Two models on flights that they were made without."""

    folds: tuple[Fold, ...]  #: Their errors.
    gain: Gains  #: Of the corrected model over the baseline.
    #: Name of a flight to the position RMS (2,) of each model, of free rollouts and
    #: along the measured pitch [m].
    paths: dict[str, dict[str, np.ndarray]]
    over_nominal: Gains | None = None  #: Over the nominal model, where it is known.
    apart: tuple[str, ...] = ()  #: Names of flights that no fold was fitted to.

    def lost(self, way: str, model: str = "refitted") -> Gains:
        """Logarithms of corrected over another model's errors, flown in a way.

        A few flights, such as one on which a model diverges, decide nothing.
        """
        place = WAYS.index(way)
        names = (model, "corrected")
        both = np.array([[p[n][place] for n in names] for p in self.paths.values()])
        flown = both[np.isfinite(both).any(axis=1)]
        lost = np.log([ratio_of(*own) + 1e-12 for own in flown])
        return Gains(values=np.clip(lost, -_LARGEST_LOG, _LARGEST_LOG))

    def over_median(self, model: str) -> float:
        """Median ratio of the corrected to another model's errors of free rollouts."""
        return float(np.exp(np.median(self.lost(WAYS[0], model).values)))

    def is_worse(self, way: str) -> bool:
        """Whether the correction loses on flights flown in a way, more than a tie."""
        lost = self.lost(way)
        return lost.are_significant and float(np.median(lost.values)) > np.log(WORSE)


def ratio_of(before: float, after: float) -> float:
    """Returns after over before; infinite where the later model diverges."""
    if not np.isfinite(after):
        return np.inf
    return float(after / before) if np.isfinite(before) else 0.0


def hold_out(
    task: Task,
    baseline: FitResult,
    corrected: FitResult,
    scales: Scales,
    rng: np.random.Generator,
    apart: Collection[str] = (),
    nominal: FitResult | None = None,
) -> HeldOut:
    """Holds out each flight once, the effects of the corrected model searched again.

    Those whose names are apart are scored and never fitted.
    """
    count = len(task.records)
    is_fitted = np.array([record.name not in apart for record in task.records])
    order = rng.permutation(count)
    parts = [np.sort(order[k::FOLDS]) for k in range(min(FOLDS, count))]
    models = {"refitted": baseline, "corrected": corrected}
    if nominal is not None:
        models["nominal"] = nominal
    refits = {n: _Refits(task, m, m is corrected) for n, m in models.items()}
    rollouts = {name: flown_by(task, own, scales) for name, own in models.items()}
    costs = {name: np.zeros(count) for name in models}
    paths = dict[str, dict[str, np.ndarray]]()
    folds = []
    for part in parts:
        unseen = [task.records[i] for i in part]
        rest = is_fitted.astype(float)
        rest[part] = 0.0
        flown = {}
        for name, refit in refits.items():
            model, costs[name][part] = refit.on(rest, part)
            flown[name] = rollouts[name].with_numbers_of(model), unseen

        found = compare(flown)
        names = tuple(record.name for record in unseen)
        errors = {name: found.errors[name] for name in ("refitted", "corrected")}
        folds.append(Fold(held_out=names, **errors))
        for k, record in enumerate(unseen):
            paths[record.name] = {
                name: np.sqrt(mean_squares(record, own[k])[:2])
                for name, own in found.predictions.items()
            }

    gains = {n: Gains(values=cost - costs["corrected"]) for n, cost in costs.items()}
    over_nominal = gains.get("nominal")
    gain = gains["refitted"]
    return HeldOut(tuple(folds), gain, paths, over_nominal, tuple(sorted(apart)))


class _Refits:
    """A model, made again from some flights."""

    def __init__(self, task: Task, model: FitResult, is_searched: bool):
        self.task = task
        self.is_searched = is_searched
        self.model = model = model_fit.in_surroundings(
            task, model, model_fit.error_flights(task, model)
        )
        offered = without_late(task, model.kinds) if is_searched else task.offering(())
        found = gather_in_parts(offered, model, model.scales)
        self.candidates, self.grams, now = found
        if is_searched:
            self.near = Nearby(self.candidates, self.grams)
            self.given, self.prior = self.candidates.nothing()
        else:
            self.prior = model_fit.prior_of(task, model)
            self.given = np.zeros(len(self.prior.mean))

        # The likelihood is a square of changes and what depends on the scales alone.
        self.constant = now - 0.5 * self.grams[:, -1, -1]

    def on(
        self, counts: np.ndarray, unseen: np.ndarray
    ) -> tuple[FitResult, np.ndarray]:
        """Returns the model of flights that count so often, and others' costs [nats].

        The costs are those of the predictive distribution: what the flights leave
        unknown of the coefficients counts with the noise, so that a flight beyond the
        range of the others is not held against a model that does not know it.
        """
        model = self.model
        columns = list(range(len(self.prior.mean)))
        if self.is_searched:
            score, members = self.near.best(counts)
            model = score.begin(members)
            found = [column for _, variant in members for column in variant]
            columns = [*self.candidates.always, *found]

        keep = [*columns, len(self.prior.mean)]
        step = np.zeros(len(self.prior.mean))
        total = counted_from(np.tensordot(counts, self.grams, 1), self.given)
        prior = self.prior.among(columns)
        change = prior.best_step(total[np.ix_(keep, keep)])
        step[columns] = change
        is_open = (prior.lower < change) & (change < prior.upper)
        own = np.array(columns, dtype=int)[is_open]
        known = total[np.ix_(own, own)] + np.diag(prior.precision[is_open])
        others = counted_from(self.grams[unseen], self.given - step)
        added = others[:, own[:, None], own]
        error = others[:, own, -1]
        more = np.sum(solve_scaled(known + added, error, 0.0) * error, axis=1)
        volume = np.linalg.slogdet(np.eye(len(own)) + np.linalg.solve(known, added))[1]
        costs = self.constant[unseen] + 0.5 * (others[:, -1, -1] - more + volume)
        if not self.is_searched:  # Few parameters, and nearly linear.
            return model_fit.moved(self.task, model, step), costs
        if counts.any():
            pairs = zip(self.task.records, counts, strict=True)
            fitted = self.task.on([record for record, count in pairs if count])
            fixed = {*self.task.vehicle.nuisance}.difference(self.model.free)
            free = tuple(slot for slot in model.free if slot not in fixed)
            start = dataclasses.replace(model, free=free)
            if {*model.kinds} == {*self.model.kinds}:
                start = self.model
            model = model_fit.fit_model(fitted, start, free_scales=())

        return model, costs
