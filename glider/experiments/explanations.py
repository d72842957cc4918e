"""Explanations of a campaign, by what an analysis found, each fitted and weighed."""

import dataclasses
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from scipy.special import softmax

from glider.physics.effects import COMMAND_DELAY, POSE_LATENCY, EffectKind
from glider.physics.model import GliderModel
from glider.sysid.likelihood.candidates import gather, tamed
from glider.sysid.likelihood.directions import nearest_start, slopes, starts_of
from glider.sysid.likelihood.fitted_functions import functions_of
from glider.sysid.likelihood.information import (
    Evidence,
    counted_from,
    eliminate,
    solve_scaled,
)
from glider.sysid.likelihood.model_fit import (
    fit_model,
    grams_of,
    linear_flights,
    prior_of,
)
from glider.sysid.likelihood.scales import Scales
from glider.sysid.likelihood.task import FitResult, Task, start_of
from glider.sysid.likelihood.uncertainty import jackknife, larger_of
from glider.sysid.replay.log_space import SERVO_LOG, vector_of
from glider.sysid.replay.record import Noise
from glider.sysid.result import Report, Result, read_report
from glider.sysid.search.subsets import Members, Scorer

_MOST = 5
"""Largest number of explanations."""

_LEAST = 1e-4
"""Probability below which an explanation is omitted."""

UNKNOWN = 0.02
"""Prior probability that the flights show an effect that the library lacks."""

_NEAR = 8.0
"""Loss of evidence, to first order, up to which a set is fitted in full [nats]."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Findings:
    """A model, and the flights and effects that it was found with."""

    model: GliderModel  #: The corrected glider.
    kinds: tuple[str, ...]  #: Of the effects that were identified.
    flights: tuple[str, ...] | None = None  #: Names that were used; None for all.
    grades: tuple[str, ...] | None = None  #: Grades that were used; None for all.
    own: tuple[EffectKind, ...] = ()  #: User effects.
    #: Name of the campaign that was analysed; None where unspecified.
    campaign: str | None = None


def load_findings(folder: Path, own_effects: Sequence[EffectKind] = ()) -> Findings:
    """Reads what close-the-loop wrote: report.json, and model.yaml beside it.

    Raises:
        InputError: they are not there, or of another version.
    """
    report, path = read_report(folder)
    model = GliderModel.load(path.with_name("model.yaml"), own_effects)
    return _findings(report, model, own_effects)


def findings_of(result: Result) -> Findings:
    """Findings of a result of `close_the_loop`."""
    return _findings(result, result.model, result.own_effects)


def _findings(
    report: Report, model: GliderModel, own_effects: Sequence[EffectKind]
) -> Findings:
    """Findings of a report and its model."""
    carried = {e.kind.kind for e in model.effects if e.kind.stage != "log"}
    flights = report.settings.get("flights")
    grades = report.settings.get("grades")
    return Findings(
        model=model,
        kinds=tuple(e.kind for e in report.effects if e.kind in carried),
        flights=None if flights is None else tuple(flights),
        grades=None if grades is None else tuple(grades),
        own=tuple(own_effects),
        campaign=report.campaign,
    )


@dataclasses.dataclass(frozen=True, kw_only=True)
class Explanation:
    """A set of effects that may be the right one."""

    model: FitResult  #: Fitted to all flights.
    #: Log marginal likelihood by Laplace's method, with the prior of its effects, up to
    #: a constant of the campaign [nats].
    log_evidence: float
    #: That it is the right one; their sum is below 1, as none of them may be.
    probability: float
    #: (m, m) inverse covariance of its free parameters, see `uncertainty.Uncertainty`.
    precision: np.ndarray

    @property
    def name(self) -> str:
        """Its effects and the free functions that it carries, joined."""
        carried = [own.name for own in self.model.functions]
        return " + ".join([*self.model.kinds, *carried]) or "plate alone"


def explain(task: Task, noise: Noise, findings: Findings) -> tuple[Explanation, ...]:
    """Fits the sets of effects that may explain the flights, best first.

    The chosen set and those near it: by closed forms for flights linear about it,
    nearly as good. A priori each kind of the library is as probable as the next.
    """
    penalty = float(np.log(len(task.kinds)))
    chosen = _chosen(task, noise, findings)
    candidates = gather(task, chosen)
    evidence = candidates.evidence(candidates.total(chosen.scales))
    score = Scorer(candidates, evidence, lambda kind, kinds: penalty)
    own = score.by_first(chosen.kinds)
    near = _near(score, own, _clocks_swapped(task, chosen))
    models = [chosen]
    for members in near[: _MOST - 1]:
        models.append(fit_model(task, score.begin(members), iterations=4))
    acting = [model for model in models if not _is_idle(task, model)]
    weighed = [_weigh(task, model, penalty) for model in acting or [chosen]]
    # Sets that were not fitted count by their closed form, against the chosen set's.
    first = weighed[0].log_evidence - score(own)
    every = [e.log_evidence for e in weighed]
    every += [first + score(members) for members in near[_MOST - 1 :]]
    listed = float(softmax(every)[: len(weighed)].sum())
    missing = 1.0 - (1.0 - UNKNOWN) * listed
    return with_probabilities(_in_one_air(task, weighed, penalty), missing)


def _near(score: Scorer, own: Members, named: set[frozenset[str]]) -> list[Members]:
    """Sets that differ from one by an effect, or two in the place of one, best first.

    Those that are nearly as good, each with its best variant, behind those named.
    """
    others = [*score.larger(own), *score.smaller(own)]
    others += [*score.swapped(own), *score.merged(own)]
    others.sort(key=score, reverse=True)
    least = score(own) - _NEAR
    first = []
    rest = []
    done = {frozenset(kind for kind, _ in own)}

    for members in others:
        kinds = frozenset(kind for kind, _ in members)

        if kinds in done:
            continue

        done.add(kinds)
        value = score(members)

        if kinds in named and np.isfinite(value):
            first.append(members)
        elif value > least:
            rest.append(members)

    return first + rest


def with_probabilities(
    weighed: Sequence[Explanation], missing: float = 0.0
) -> tuple[Explanation, ...]:
    """Explanations with probabilities, best first, without hopeless ones.

    `missing` is the probability that none of them is right.
    """
    ranked = sorted(weighed, key=lambda e: -e.log_evidence)
    least = ranked[0].log_evidence + np.log(_LEAST)
    likely = [e for e in ranked if e.log_evidence > least]
    shares = (1.0 - missing) * softmax([e.log_evidence for e in likely])
    return tuple(
        dataclasses.replace(e, probability=float(share))
        for e, share in zip(likely, shares, strict=True)
    )


def _in_one_air(
    task: Task, weighed: Sequence[Explanation], penalty: float
) -> list[Explanation]:
    """Fits and weighs explanations again with the same scales for all.

    Air and sensors do not depend on which explanation is right. Scales fitted to a few
    flights each would distinguish them by more than the flights do.
    """
    logs = np.array([e.model.scales.logs for e in weighed])
    shares = softmax([e.log_evidence for e in weighed])
    scales = Scales.from_logs(shares @ logs)
    found = []
    for explanation in weighed:
        model = dataclasses.replace(explanation.model, scales=scales)
        fitted = fit_model(task, model, iterations=3, free_scales=())
        found.append(_weigh(task, fitted, penalty))
    return found


def _chosen(task: Task, noise: Noise, findings: Findings) -> FitResult:
    """The model of the analysis, fitted to all flights."""
    start = start_of(task, noise)
    theta = vector_of(findings.model)
    kinds = tuple(k for k in findings.kinds if k in task.kinds)
    start = dataclasses.replace(
        start,
        kinds=kinds,
        theta=theta,
        free=task.free(kinds),
        functions=functions_of(findings.model.free_functions),
    )
    return fit_model(task, start, iterations=4)


def _clocks_swapped(task: Task, model: FitResult) -> set[frozenset[str]]:
    """The set with lags and delays in the place of one another.

    Their columns are secants to where they are tried, five milliseconds and more: the
    closed form is far off for a smaller one.
    """
    clocks = {name for name in task.kinds if _is_clock(task, name)}
    own = {*model.kinds}
    return {
        frozenset(own - {gone} | {new}) for gone in own & clocks for new in clocks - own
    }


def _is_clock(task: Task, kind: str) -> bool:
    """Whether every coefficient of an effect is a shape, as of a lag or a delay."""
    return all(c.is_shape for c in task.space.kinds[kind].coefficients)


def _is_idle(task: Task, model: FitResult) -> bool:
    """Checks whether an effect vanished, or is an offset that the clocks allow.

    The set without it predicts the same flights.
    """
    clocks = task.space.slots_of(SERVO_LOG.kind)
    of_log = dict(zip((POSE_LATENCY.kind, COMMAND_DELAY.kind), clocks, strict=False))
    for kind in model.kinds:
        slots = list(task.space.slots_of(kind))
        moved = np.abs(model.theta - task.vehicle.theta)[slots]
        spread = task.vehicle.of_log.get(of_log.get(kind, -1), 0.0)
        if np.all(moved <= np.maximum(1e-9 * task.space.scale[slots], 2.0 * spread)):
            return True
    return False


def _weigh(task: Task, model: FitResult, penalty: float) -> Explanation:
    """A model with its evidence: -cost + ½ log |Λ| - ½ log |A|, and shapes."""
    grams = grams_of(linear_flights(task, model), model.scales)
    prior = prior_of(task, model).precision
    information = grams.sum(axis=0)[:-1, :-1] + np.diag(prior)
    _, volume = np.linalg.slogdet(information)
    evidence = -model.cost + 0.5 * float(np.sum(np.log(prior)) - volume)
    evidence += _choice_of_shapes(task, model) - penalty * len(model.kinds)
    covariance, _ = larger_of(*jackknife(grams, prior))
    return Explanation(
        model=model,
        log_evidence=evidence,
        probability=np.nan,
        precision=solve_scaled(covariance, np.eye(len(prior))),
    )


def _choice_of_shapes(task: Task, model: FitResult) -> float:
    """Evidence that a model loses for the choice of its effects' shapes [nats].

    Where a shape is fitted, the best of many was chosen, and noise alone makes the best
    of many good. Each of the library's starting shapes s is as probable as the next
    a priori, and stands for those around it, so that an effect is worth
        log mean_s exp E_s
    of the evidence E_s with that shape, in closed form; around the fitted shape it is
    that of the fit. An effect that shows well pays log(number of shapes), one that
    barely does is worth the average of its shapes.
    """
    return sum(_choice(task, model, kind) for kind in model.kinds)


def _choice(task: Task, model: FitResult, kind: str) -> float:
    space = task.space
    own = space.slots_of(kind)
    shapes = [i for i in own if i in task.space.shapes]
    sizes = [i for i in own if i in model.free and i not in shapes]

    if not shapes or not sizes:
        return 0.0

    beside = [i for i in model.free if i not in own]
    starts = [
        [d for d in columns if d.slot in sizes]
        for columns in starts_of(space, space.kinds[kind], model.theta)
    ]

    directions = slopes(space, [*sizes, *beside])
    directions += [d for columns in starts for d in columns]
    flights, wild = tamed(task, directions, linear_flights(task, model, directions))

    # The error of the model without the effect, the others fitted to it.
    count = len(sizes)
    end = len(sizes) + len(beside)
    last = len(directions)
    prior = prior_of(task, model, [*sizes, *beside])  # And of carried functions.
    mean = model.theta[sizes] + prior.mean[:count]
    precision = prior.precision[:count]
    share = np.zeros(last + len(model.coordinates))
    share[:count] = -prior.mean[:count]
    gram = counted_from(grams_of(flights, model.scales).sum(axis=0), share)
    others = [*range(count, end), *range(last, len(share))]
    variants = 1 + len(starts)
    evidence = Evidence(
        gram=eliminate(gram, others, prior.precision[count:], prior.mean[count:]),
        at=np.delete(np.arange(last), np.arange(count, end)),
        precision=np.tile(precision, variants),
        lower=np.tile(space.lower[sizes] - mean, variants),
        upper=np.tile(space.upper[sizes] - mean, variants),
    )

    sets = np.arange(variants * count).reshape(variants, count).tolist()
    fitted, *others = evidence.extended((), sets)

    if not np.isfinite(fitted):
        return 0.0

    nearest = nearest_start(space, starts, model.theta)
    worth = np.exp(np.minimum(np.array(others) - fitted, 0.0))
    worth[nearest] = 1.0  # Around the fitted shape.
    columns = np.arange(end, end + len(worth) * count).reshape(-1, count)
    sound = [wild.isdisjoint(own) for own in columns.tolist()]
    sound[nearest] = True

    return float(np.log(np.mean(worth[sound])))
