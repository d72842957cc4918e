"""Candidate effects as columns of all flights, linear about one model."""

import dataclasses
from collections.abc import Sequence

import numpy as np

from glider.sysid.likelihood import model_fit
from glider.sysid.likelihood.directions import Direction, slopes, starts_of
from glider.sysid.likelihood.information import Evidence, eliminate, solve
from glider.sysid.likelihood.linear_flight import LinearFlight
from glider.sysid.likelihood.scales import Scales, fit_scales
from glider.sysid.likelihood.task import Task

Variant = tuple[int, ...]
"""Columns of an effect with one choice of its starting shapes."""

Member = tuple[str, Variant]
"""An effect of a set: its kind and the columns it acts by."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Candidates:
    """Columns of the flights about a model, and the effects they belong to."""

    task: Task  # Of the flights.
    model: model_fit.FitResult  # About which the flights are linear.
    directions: tuple[Direction, ...]  # Of the columns; the curves' columns follow.
    # Kind to its variants; a kind that acts already has one.
    variants: dict[str, tuple[Variant, ...]]
    flights: Sequence[LinearFlight]  # Linear in all columns.

    @property
    def always(self) -> list[int]:
        """Columns that act in every set: unknown parameters and the curves."""
        own = set(self.task.vehicle.nuisance)
        count = len(self.directions)
        vehicle = [j for j, d in enumerate(self.directions) if d.slot in own]
        return [*vehicle, *range(count, count + len(self.model.coordinates))]

    def grams(self, scales: Scales) -> np.ndarray:
        """Returns the flights' information on all columns, (flights, m + 1, m + 1)."""
        return np.stack(model_fit.grams_of(self.flights, scales))

    def from_nothing(
        self, grams: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Returns the information about effects that count from zero.

        The share of those that act is returned to the error.

        Returns:
            the same with the error of the model without effects; and (m,) the columns'
            values there, their prior means and precisions.
        """
        task, model = self.task, self.model
        slots = [d.slot for d in self.directions]
        value, mean, precision = model_fit.prior_of(task, model, slots)
        restored = np.zeros(grams.shape[-1])
        restored[-1] = 1.0
        for j, slot in enumerate(slots):
            acts = task.layout.slots[slot][0] in model.kinds
            if acts and not task.is_shape(slot) and j not in set(self.always):
                restored[j] = model.theta[slot] - mean[j]
                value[j] = mean[j]
            elif not acts:
                value[j] = mean[j]
        whole = grams.copy()
        whole[..., :, -1] = grams @ restored
        whole[..., -1, -1] = whole[..., :, -1] @ restored
        whole[..., -1, :-1] = whole[..., :-1, -1]
        return whole, value, mean, precision

    def evidence(self, gram: np.ndarray) -> tuple[Evidence, dict[str, list[Variant]]]:
        """Returns the evidence of sets of effects, and the variants in its columns."""
        whole, value, mean, precision = self.from_nothing(gram)
        slots = [d.slot for d in self.directions]
        always = self.always
        reduced = eliminate(whole, always, precision[always], (mean - value)[always])
        keep = [j for j in range(len(slots)) if j not in set(always)]
        layout = self.task.layout
        kept_slots = [slots[j] for j in keep]
        found = Evidence(
            gram=reduced,
            precision=precision[keep],
            lower=layout.lower[kept_slots] - value[keep],
            upper=layout.upper[kept_slots] - value[keep],
        )
        return found, self.columns_of_kinds()

    def columns_of_kinds(self) -> dict[str, list[Variant]]:
        """Returns the variants of each kind, in the columns that are not always on."""
        always = set(self.always)
        keep = [j for j in range(len(self.directions)) if j not in always]
        place = {j: k for k, j in enumerate(keep)}
        return {
            kind: [tuple(place[j] for j in v) for v in own]
            for kind, own in self.variants.items()
        }


def gather(task: Task, model: model_fit.FitResult) -> Candidates:
    """Linearizes all flights about a model, in all candidate effects."""
    layout = task.layout
    directions = slopes(layout, model.theta, model.free)
    own = set(task.vehicle.nuisance)
    variants: dict[str, tuple[Variant, ...]] = {}
    for kind in model.kinds:
        variants[kind] = (
            tuple(
                j
                for j, d in enumerate(directions)
                if d.kind == kind and d.slot not in own
            ),
        )
    for kind in task.kinds:
        if kind in model.kinds:
            continue
        allowed = set(task.free((kind,))) - own
        found = []
        for columns in starts_of(layout, layout.kinds[kind], model.theta):
            mine = [d for d in columns if d.slot in allowed]
            if mine:
                first = len(directions)
                found.append(tuple(range(first, first + len(mine))))
                directions += mine
        if found:
            variants[kind] = tuple(found)
    flights, wild = tamed(
        task, directions, model_fit.linear_flights(task, model, directions)
    )
    for kind in set(variants) - set(model.kinds):
        variants[kind] = tuple(v for v in variants[kind] if not wild & set(v))
    return Candidates(
        task=task,
        model=model,
        directions=tuple(directions),
        variants={k: v for k, v in variants.items() if v and v[0]},
        flights=flights,
    )


_LARGEST_PUSH = 1e3
"""Change of a state in one interval, by a coefficient of its usual scale, that no
flight has: the formula is then far outside its range."""


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


def saturated_scales(
    candidates: Candidates, scales: Scales, rounds: int
) -> tuple[Scales, np.ndarray]:
    """Fits the scales with all candidates acting at once, shrunken.

    Otherwise a missing effect would be taken for noise before it is searched for.

    Returns:
        the scales, and the change of all columns there (m,).
    """
    slots = [d.slot for d in candidates.directions]
    own, mean, precision = model_fit.prior_of(candidates.task, candidates.model, slots)
    for _ in range(rounds):
        gram = candidates.grams(scales).sum(axis=0)
        total = model_fit.with_prior(gram, own, mean, precision)
        change = solve(total)
        flights = [f.combined(change) for f in candidates.flights]
        scales, _ = fit_scales(flights, scales, iterations=3)
    return scales, change
