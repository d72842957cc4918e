"""Candidate effects as columns of all flights, linear about one model."""

import dataclasses
from collections.abc import Sequence

import numpy as np

from glider.sysid.likelihood import model_fit
from glider.sysid.likelihood.information import Evidence, counted_from, eliminate, solve
from glider.sysid.likelihood.linear_flight import (
    Direction,
    LinearFlight,
    slopes,
    starts_of,
)
from glider.sysid.likelihood.scales import Scales, fit_scales
from glider.sysid.likelihood.task import Task

Variant = tuple[int, ...]  # Columns of an effect with one choice of starting shapes.
Member = tuple[str, Variant]  # An effect of a set: kind and the columns it acts by.

# Change of a state in an interval that no flight has: a formula is outside its range.
_LARGEST_PUSH = 1e3


@dataclasses.dataclass(frozen=True, kw_only=True)
class Candidates:
    """Columns of the flights about a model, and the effects they belong to."""

    task: Task  #: Of the flights.
    model: model_fit.FitResult  #: About which the flights are linear.
    directions: tuple[Direction, ...]  #: Of the columns; the curves' columns follow.
    variants: dict[str, tuple[Variant, ...]]  #: By kind; one of a kind that acts.
    flights: Sequence[LinearFlight]  #: Linear in all columns.

    @property
    def slots(self) -> list[int]:
        """Slots of theta that the directions move."""
        return [d.slot for d in self.directions]

    @property
    def always(self) -> list[int]:
        """Columns that act in every set: unknown parameters and the curves."""
        own = set(self.task.vehicle.nuisance)
        count = len(self.directions)
        vehicle = [j for j, slot in enumerate(self.slots) if slot in own]
        return [*vehicle, *range(count, count + len(self.model.coordinates))]

    def grams(self, scales: Scales) -> np.ndarray:
        """Returns the flights' information on all columns, (flights, m + 1, m + 1)."""
        return model_fit.grams_of(self.flights, scales)

    def from_nothing(self, grams: np.ndarray) -> tuple[np.ndarray, model_fit.Prior]:
        """Returns the information and the prior about the model without effects."""
        prior = model_fit.prior_of(self.task, self.model, self.slots)
        always, share = set(self.always), np.zeros(len(prior.mean))
        for j, slot in enumerate(self.slots):
            if j not in always and not self.task.is_shape(slot):
                share[j] = -prior.mean[j]
        mean = prior.mean.copy()
        mean[: len(self.slots)] = 0.0  # Unknown parameters count from where they are.
        lower, upper = prior.lower + share, prior.upper + share
        prior = dataclasses.replace(prior, mean=mean, lower=lower, upper=upper)
        return counted_from(grams, share), prior

    def evidence(self, gram: np.ndarray) -> Evidence:
        """Returns the evidence of sets of columns beside those that always act."""
        (whole, prior), always = self.from_nothing(gram), self.always
        keep = np.delete(np.arange(len(whole)), always)
        reduced = np.zeros_like(whole)
        reduced[np.ix_(keep, keep)] = eliminate(
            whole, always, prior.precision[always], prior.mean[always]
        )
        return Evidence(
            gram=reduced,
            precision=prior.precision,
            lower=prior.lower,
            upper=prior.upper,
        )


def gather(task: Task, model: model_fit.FitResult) -> Candidates:
    """Linearizes all flights about a model, in all candidate effects."""
    layout = task.layout
    directions = slopes(layout, model.theta, model.free)
    own = set(task.vehicle.nuisance)
    variants: dict[str, list[Variant]] = {}
    for kind in model.kinds:
        acting = enumerate(directions)
        mine = [j for j, d in acting if d.kind == kind and d.slot not in own]
        variants[kind] = [tuple(mine)]
    for kind in task.kinds:
        if kind in model.kinds:
            continue
        allowed = set(task.free((kind,))) - own
        variants[kind] = []
        for columns in starts_of(layout, layout.kinds[kind], model.theta):
            first = len(directions)
            directions += [d for d in columns if d.slot in allowed]
            variants[kind].append(tuple(range(first, len(directions))))
    flights, wild = tamed(
        task, directions, model_fit.linear_flights(task, model, directions)
    )
    for kind in set(variants) - set(model.kinds):
        variants[kind] = [v for v in variants[kind] if v and not wild & set(v)]
    return Candidates(
        task=task,
        model=model,
        directions=tuple(directions),
        variants={k: tuple(v) for k, v in variants.items() if v and v[0]},
        flights=flights,
    )


def tamed(
    task: Task, directions: Sequence[Direction], flights: Sequence[LinearFlight]
) -> tuple[list[LinearFlight], set[int]]:
    """Returns the flights with diverging columns set to zero, and which those are."""
    scale = task.layout.scale[[d.slot for d in directions]]
    columns = slice(0, len(directions))
    wild = np.zeros(len(directions), dtype=bool)
    for flight in flights:
        largest = np.abs(flight.inputs[:, :, columns]).max(axis=(0, 1), initial=0.0)
        wild |= ~(largest * scale < _LARGEST_PUSH)  # So is what is not a number.
    found = set(np.flatnonzero(wild).tolist())
    if not found:
        return list(flights), found
    tame = []
    for flight in flights:
        inputs = flight.inputs.copy()
        inputs[:, :, sorted(found)] = 0.0
        tame.append(dataclasses.replace(flight, inputs=inputs))
    return tame, found


def saturated_scales(candidates: Candidates, scales: Scales, rounds: int) -> Scales:
    """Fits the scales with all candidates acting at once, shrunken.

    Otherwise a missing effect would be taken for noise before it is searched for.
    """
    prior = model_fit.prior_of(candidates.task, candidates.model, candidates.slots)
    for _ in range(rounds):
        gram = candidates.grams(scales).sum(axis=0)
        change = solve(prior.added_to(gram))
        flights = [f.combined(change) for f in candidates.flights]
        scales, _ = fit_scales(flights, scales, iterations=3)
    return scales
