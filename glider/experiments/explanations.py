"""Explanations of a campaign, each fitted, and how probable each is."""

import dataclasses
from collections.abc import Sequence

import numpy as np

from glider.experiments.findings import Findings
from glider.experiments.shapes import choice_of_shapes
from glider.sysid.likelihood.candidates import gather
from glider.sysid.likelihood.directions import slopes
from glider.sysid.likelihood.model_fit import (
    FitResult,
    beforehand,
    fit_model,
    grams_of,
    linear_flights,
    start_of,
)
from glider.sysid.likelihood.scales import Scales
from glider.sysid.likelihood.task import Task
from glider.sysid.replay.noise import Noise
from glider.sysid.replay.theta import theta_of
from glider.sysid.search.sets_in_models import begin
from glider.sysid.search.subsets import Members, Scorer

MOST = 5
"""Explanations that are weighed at most."""

LEAST = 1e-4
"""Probability below which an explanation is left out."""

UNKNOWN = 0.02
"""Probability beforehand that what the flights show is nothing of the library's."""

_NEAR = 8.0
"""Loss of evidence, to first order, up to which a set is fitted in full [nats]."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Explanation:
    """A set of effects that may be the right one.

    Attributes:
        model: fitted to all flights.
        log_evidence: log marginal likelihood by Laplace's method, with what the
            effects are worth beforehand, up to a constant of the campaign [nats].
        probability: that it is the right one; all together are less than 1, for none
            of them may be.
        precision: (m, m) inverse covariance of its free numbers, after the flights.
    """

    model: FitResult
    log_evidence: float
    probability: float
    precision: np.ndarray

    @property
    def name(self) -> str:
        """Its effects in a word."""
        return " + ".join(self.model.kinds) or "plate alone"


def explain(task: Task, noise: Noise, findings: Findings) -> tuple[Explanation, ...]:
    """Fits the sets of effects that the flights may be explained by, best first.

    The chosen set; what differs from it by one effect and is nearly as good, as the
    flights that are linear about it say in closed form; and what the analysis fitted
    or named a rival. Beforehand each kind of the library is as probable as the next.

    Args:
        task: all the flights.
        noise: of the sensors.
        findings: of the analysis.
    """
    price = float(np.log(len(task.kinds)))
    chosen = _chosen(task, noise, findings)
    candidates = gather(task, chosen)
    evidence, variants = candidates.evidence(
        candidates.grams(chosen.scales).sum(axis=0)
    )
    score = Scorer(evidence, variants, lambda kind: price)
    own = score.by_first(chosen.kinds)
    base = score(own)
    near: dict[frozenset[str], tuple[float, Members]] = {}
    named = {*findings.swapped, *_clocks_swapped(task, chosen)}
    others = [*score.larger(own), *score.smaller(own), *score.swapped(own)]
    others += _best_variants(score, [*findings.sets, *named])
    for members in others:
        kinds, value = frozenset(k for k, _ in members), score(members)
        best = near.get(kinds, (-np.inf, ()))[0]
        least = -np.inf if kinds in named else base - _NEAR
        if value > max(least, best) and kinds != frozenset(chosen.kinds):
            near[kinds] = value, members
    ranked = sorted(near.items(), key=lambda item: (item[0] not in named, -item[1][0]))[
        : MOST - 1
    ]
    models = [chosen]
    for _, (_, members) in ranked:
        start = begin(candidates, score.evidence, members, chosen.scales)
        models.append(fit_model(task, start, iterations=4))
    acting = [model for model in models if not _is_idle(task, model)]
    weighed = [_weigh(task, m, price) for m in acting or [chosen]]
    # What was not fitted counts by its closed form, against the chosen set's.
    fitted = {kinds for kinds, _ in ranked}
    left = [value for kinds, (value, _) in near.items() if kinds not in fitted]
    every = np.array(
        [e.log_evidence for e in weighed]
        + [weighed[0].log_evidence + value - base for value in left]
    )
    shares = np.exp(every - every.max())
    listed = float(shares[: len(weighed)].sum() / shares.sum())
    missing = 1.0 - (1.0 - UNKNOWN) * listed
    return with_probabilities(_in_one_air(task, weighed, price), missing)


def with_probabilities(
    weighed: Sequence[Explanation], missing: float = 0.0
) -> tuple[Explanation, ...]:
    """Returns explanations with their probabilities, best first, hopeless ones out.

    Args:
        weighed: by their evidence.
        missing: probability that none of them is right.
    """
    top = max(e.log_evidence for e in weighed)
    likely = [e for e in weighed if e.log_evidence - top > np.log(LEAST)]
    total = sum(np.exp(e.log_evidence - top) for e in likely) / (1.0 - missing)
    return tuple(
        dataclasses.replace(e, probability=float(np.exp(e.log_evidence - top) / total))
        for e in sorted(likely, key=lambda e: -e.log_evidence)
    )


def _in_one_air(
    task: Task, weighed: Sequence[Explanation], price: float
) -> list[Explanation]:
    """Returns explanations fitted and weighed again with the same scales for all.

    The air and the sensors are what they are, whichever explanation is right. Scales
    that each fits to a few flights tell them apart by more than the flights do.
    """
    logs = np.array([e.model.scales.logs for e in weighed])
    shares = np.array([e.log_evidence for e in weighed])
    shares = np.exp(shares - shares.max())
    scales = Scales.from_logs(shares @ logs / shares.sum())
    found = []
    for explanation in weighed:
        model = dataclasses.replace(explanation.model, scales=scales)
        fitted = fit_model(task, model, iterations=3, free_scales=())
        found.append(_weigh(task, fitted, price))
    return found


def _chosen(task: Task, noise: Noise, findings: Findings) -> FitResult:
    """Returns the analysis' own model, fitted to all flights."""
    start = start_of(task, noise, with_curves=False)
    theta = theta_of(findings.model)
    kinds = tuple(k for k in findings.kinds if k in task.kinds)
    start = dataclasses.replace(
        start,
        kinds=kinds,
        theta=theta,
        free=task.free(kinds),
        extra=findings.model.field,
    )
    return fit_model(task, start, iterations=4)


def _clocks_swapped(task: Task, model: FitResult) -> list[frozenset[str]]:
    """Returns the set with lags and delays in the place of one another.

    Their columns are secants to where they are tried, five milliseconds and more: what
    the flights say in closed form of a smaller one is far off.
    """
    clocks = [
        name
        for name in task.kinds
        if all(c.is_shape for c in task.layout.kinds[name].coefficients)
    ]
    return [
        frozenset({*model.kinds} - {kind} | {other})
        for kind in model.kinds
        if kind in clocks
        for other in clocks
        if other not in model.kinds
    ]


def _is_idle(task: Task, model: FitResult) -> bool:
    """Whether an effect came out as nothing: the set without it says the same."""
    for kind in model.kinds:
        slots = list(task.layout.slots_of(kind))
        moved = np.abs(model.theta - task.vehicle.theta)[slots]
        if np.all(moved <= 1e-9 * task.layout.scale[slots]):
            return True
    return False


def _best_variants(score: Scorer, sets: Sequence[frozenset[str]]) -> list[Members]:
    """Returns the sets by the best variant of each member, the others kept."""
    found = []
    for kinds in sets:
        if not kinds <= set(score.variants):
            continue
        members = score.by_first(sorted(kinds))
        for i, (kind, _) in enumerate(members):
            options = [
                (*members[:i], (kind, v), *members[i + 1 :])
                for v in score.variants[kind]
            ]
            members = max(options, key=score)
        found.append(members)
    return found


def _weigh(task: Task, model: FitResult, price: float) -> Explanation:
    """Returns a model with its evidence: -cost + ½ log |Λ| - ½ log |A|, and shapes."""
    directions = slopes(task.layout, model.theta, model.free)
    grams = grams_of(linear_flights(task, model, directions), model.scales)
    _, _, prior = beforehand(task, model, model.free)
    precision = np.sum(grams, axis=0)[:-1, :-1] + np.diag(prior)
    size = np.linalg.slogdet(precision)[1] if len(prior) else 0.0
    evidence = -model.cost + 0.5 * float(np.sum(np.log(prior)) - size)
    evidence += choice_of_shapes(task, model)
    return Explanation(
        model=model,
        log_evidence=evidence - price * len(model.kinds),
        probability=np.nan,
        precision=precision,
    )
