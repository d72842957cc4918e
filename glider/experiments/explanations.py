"""Explanations of a campaign: its report's model and rivals, fitted and weighed."""

import dataclasses
import warnings
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from scipy.special import softmax

from glider.campaign.checks.masks import ALL
from glider.physics.effects import EffectKind
from glider.physics.model import GliderModel
from glider.sysid.likelihood.fitted_functions import functions_of
from glider.sysid.likelihood.information import solve_scaled
from glider.sysid.likelihood.model_fit import (
    fit_model,
    grams_of,
    linear_flights,
    prior_of,
)
from glider.sysid.likelihood.task import FitResult, Task, start_of
from glider.sysid.likelihood.uncertainty import jackknife, larger_of
from glider.sysid.replay.log_space import vector_of
from glider.sysid.replay.record import Noise
from glider.sysid.result import Report, Result, read_report

_LEAST = 1e-4
"""Probability below which an explanation is omitted."""

UNKNOWN = 0.02
"""Prior probability that none of the explanations is the right one."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Findings:
    """What an analysis found, and the flights that it used."""

    models: tuple[GliderModel, ...]  #: The corrected glider, then its rivals.
    flights: tuple[str, ...] | None = None  #: Names that were read; None for all.
    excluded: tuple[str, ...] = ()  #: Names of those that were not used then.
    own: tuple[EffectKind, ...] = ()  #: User effects.
    #: Name of the campaign that was analysed; None where unspecified.
    campaign: str | None = None


def load_findings(folder: Path, own_effects: Sequence[EffectKind] = ()) -> Findings:
    """Reads what close-the-loop wrote: report.json, model.yaml and rivals/.

    Raises:
        InputError: they are not there, or of another version.
    """
    report, path = read_report(folder)
    models = [GliderModel.load(path.with_name("model.yaml"), own_effects)]
    with warnings.catch_warnings(action="ignore"):  # They say the same.
        for rival in sorted(path.parent.glob("rivals/rival_?.yaml")):
            models.append(GliderModel.load(rival, own_effects))
    return _findings(report, models, own_effects)


def findings_of(result: Result) -> Findings:
    """Findings of a result of `close_the_loop`."""
    rivals = [rival.model for rival in result.rivals]
    return _findings(result, [result.model, *rivals], result.own_effects)


def _findings(
    report: Report, models: Sequence[GliderModel], own_effects: Sequence[EffectKind]
) -> Findings:
    """Findings of a report and its models."""
    flights = report.settings.get("flights")
    return Findings(
        models=tuple(models),
        flights=None if flights is None else tuple(flights),
        excluded=tuple(rows.file for rows in report.set_aside if rows.rows == ALL),
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
        return " + ".join([*self.model.kinds, *carried]) or "flat plate"


def explain(task: Task, noise: Noise, findings: Findings) -> tuple[Explanation, ...]:
    """Fits the models of an analysis to all flights and weighs them, best first.

    All have the noise of the first. Air and sensors do not depend on which explanation
    is right, and scales fitted to a few flights each would distinguish them by more
    than the flights do. Rivals with other free functions are left out: the evidence of
    a function that was fitted to these flights is not known.
    """
    starts = [_start(task, noise, model) for model in findings.models]
    scales = fit_model(task, starts[0], iterations=4).scales
    carried = starts[0].by_name.keys()
    weighed = []
    for start in starts:
        if start.by_name.keys() != carried:
            continue
        own = dataclasses.replace(start, scales=scales)
        fitted = fit_model(task, own, iterations=4, free_scales=())
        weighed.append(_weigh(task, fitted))
    return _with_probabilities(weighed)


def _start(task: Task, noise: Noise, model: GliderModel) -> FitResult:
    """A model of the analysis, not fitted yet; its free functions keep their shapes."""
    carried = {effect.kind.kind for effect in model.effects}
    kinds = tuple(kind for kind in task.kinds if kind in carried)
    return dataclasses.replace(
        start_of(task, noise),
        kinds=kinds,
        theta=vector_of(model),
        free=task.free(kinds),
        functions=functions_of(model.free_functions),
    )


def _weigh(task: Task, model: FitResult) -> Explanation:
    """A model with its evidence: -cost + ½ log |Λ| - ½ log |A|, and its prior.

    A priori each kind of the library is as probable as the next.
    """
    grams = grams_of(linear_flights(task, model), model.scales)
    prior = prior_of(task, model).precision
    information = grams.sum(axis=0)[:-1, :-1] + np.diag(prior)
    _, volume = np.linalg.slogdet(information)
    evidence = -model.cost + 0.5 * float(np.sum(np.log(prior)) - volume)
    evidence -= np.log(len(task.kinds)) * len(model.kinds)
    covariance, _ = larger_of(*jackknife(grams, prior))
    return Explanation(
        model=model,
        log_evidence=evidence,
        probability=np.nan,
        precision=solve_scaled(covariance, np.eye(len(prior))),
    )


def _with_probabilities(weighed: Sequence[Explanation]) -> tuple[Explanation, ...]:
    """Explanations with probabilities, best first, without hopeless ones."""
    ranked = sorted(weighed, key=lambda own: -own.log_evidence)
    least = ranked[0].log_evidence + np.log(_LEAST)
    likely = [own for own in ranked if own.log_evidence > least]
    shares = (1.0 - UNKNOWN) * softmax([own.log_evidence for own in likely])
    return tuple(
        dataclasses.replace(own, probability=float(share))
        for own, share in zip(likely, shares, strict=True)
    )
