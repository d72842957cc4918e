"""Rehearsal of a campaign: which effects its flights would show, and at what size.

The campaign is taken as it was flown: launches, commands, clocks, gaps, noise, moving
air. An effect that its model does not have is planted, and the tracer searches for it;
without one, what it names is a false alarm.

Most of this is done to first order. Let G be the information of all flights on the
columns of the candidates, linear about the model that was found. Where an effect acts
by changes δ of its coefficients, another campaign like this one has the errors

    b = G δ + L z,   L L' = G,   z ~ N(0, 1),

from which the tracer's own search decides (`glider.sysid.search.subsets`). The tracer
estimates the strengths of the noise as well, and part of an effect passes for noise: δ
is reduced to the change that, of known strengths, loses as much likelihood, less what
fits do not realize of it. Last, each effect is planted once in the equations of motion,
all flights are flown again, and the campaign is traced as a whole.
"""

import dataclasses
import itertools
import math
import time
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from threadpoolctl import threadpool_limits

from glider.campaign.checks.masks import Masks, masks_of
from glider.campaign.logs import Campaign, Flight, split_flights
from glider.campaign.reader import load_campaign
from glider.compiled.parallel import in_parallel
from glider.compiled.replay import OFFSET, roll_out
from glider.errors import InputError
from glider.experiments.explanations import Findings, explain, findings_of
from glider.experiments.proposal import Reading, read_task
from glider.physics.effects.effect import Coefficient
from glider.physics.state import NUM_STATES
from glider.progress import Progress, Step, silent
from glider.sysid.constants import MANY_FLIGHTS, PRIOR_SCALES
from glider.sysid.fit.prediction import RolloutModel, find_launch, flown_by
from glider.sysid.likelihood.candidates import gather, gather_in_parts
from glider.sysid.likelihood.filtering import negative_log_likelihood
from glider.sysid.likelihood.information import counted_from
from glider.sysid.likelihood.linear_flight import LinearFlight, Surroundings, path_of
from glider.sysid.likelihood.model_fit import grams_of
from glider.sysid.likelihood.scale_fit import fit_scales
from glider.sysid.likelihood.scales import Scales
from glider.sysid.likelihood.task import FitResult
from glider.sysid.outcome import BAND
from glider.sysid.pipeline import HELD_OUT, close_the_loop
from glider.sysid.replay.log_space import sensed
from glider.sysid.replay.record import Record
from glider.sysid.replay.replayed import signals, states_at_rest
from glider.sysid.result import UNEXPLAINED, Result
from glider.sysid.search.subsets import Members, Scorer, climb, near_sets, scorer_of

VISIBLE = 0.95
"""Power at which an effect is visible."""

_DRAWS = 200  # Campaigns of each size: a power of 95 % is then known to 1.5 %.
_ALIKE = 60  # Of which no more are drawn if all have one answer: others are below 5 %.
_STEP = 4.0  # Ratio of two sizes that are tried first.
_HALVINGS = 3  # Of their ratio's logarithm, about where an effect is visible.
_SMALLEST = 2.0**-12  # Of the typical size.
_ITERATIONS = 20  # Of a fit of the scales.
_ROUNDS = 3  # Of scales and coefficients that depend on each other.
_FEW = 3  # Answers that are reported.
_REALIZED = 0.8  # Of a gain to first order (m: bench_rehearsal, seeds 0 and 1).
_LEAST_SHARE = 0.01  # Of an effect that does not pass for noise.
_NOTHING = frozenset[str]()
_SURE = math.log(BAND**2 - 1.0)
"""Gain of an effect over none [nats] above which the band of its size excludes zero.

The variance of a size x, averaged over both, is at least p x² for a probability p of
none, and p < 1 / BAND².
"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Rehearsed:
    """What a campaign shows of one effect."""

    kind: str
    coefficient: Coefficient  #: That was planted: its first that sets the size.
    size: float  #: That was planted [its unit].
    #: Share of campaigns that name the effect, or one that is indistinguishable.
    power: float
    #: Share of campaigns that name something else instead, by those names.
    instead: dict[str, float]
    #: (n, 2) sizes that were tried and the power at each, ascending.
    curve: np.ndarray
    visible: float  #: Smallest size with a power of VISIBLE; infinite where none has.
    flown: Result | None = None  #: Of a campaign that was flown again and traced.


@dataclasses.dataclass(frozen=True, kw_only=True)
class Rehearsal:
    """What a campaign can show."""

    campaign: str  #: Its name.
    flights: int  #: Their number.
    known: tuple[str, ...]  #: Effects of the model, which act in all flights.
    effects: tuple[Rehearsed, ...]
    false_alarms: float  #: Share of campaigns without a further effect that name one.
    flown: Result | None = None  #: Of the campaign flown again without one.
    seed: int
    seconds: float


def rehearse(
    campaign: Path | str | Campaign,
    findings: Findings | None = None,
    *,
    effects: Sequence[str] | None = None,
    size: float = 1.0,
    flies: bool = True,
    seed: int = 0,
    progress: Progress = silent,
) -> Rehearsal:
    """Rehearses a campaign: which effects would its flights show?

    Args:
        campaign: the folder of its flights, or the campaign in memory.
        findings: of an analysis of it; by default it is analysed.
        effects: to plant; by default those that gliders often have beside the model's.
        size: to plant them in, in typical sizes of the library.
        flies: whether each is also flown and traced once.
        seed: of what is drawn.
        progress: called with a line of text as the work goes on.

    Raises:
        InputError: the campaign or an argument cannot be used.
    """
    begin = time.perf_counter()
    if not isinstance(campaign, Campaign):
        flights = None if findings is None else findings.flights
        campaign = load_campaign(Path(campaign), flights=flights)
    if findings is None:
        progress(Step("tracing the campaign", 0.0))
        findings = findings_of(close_the_loop(campaign, seed=seed))

    with threadpool_limits(limits=1, user_api="blas"):  # We thread over flights.
        progress(Step("fitting its model", 0.1))
        reading = read_task(campaign, findings)
        model = explain(reading.task, reading.noise, findings)[0].model
        again = Rehearser(reading, model, seed)
        kinds = again.chosen(effects)
        found = []
        for i, kind in enumerate(kinds):
            share = 0.15 + 0.25 * i / len(kinds)
            progress(Step(f"drawing campaigns with {kind}", share))
            found.append(again.rehearsed(kind, size))
        alarms = again.outcomes(np.zeros(again.noise.shape[1]))
        result = Rehearsal(
            campaign=campaign.name,
            flights=len(reading.task.records),
            known=model.kinds,
            effects=tuple(found),
            false_alarms=1.0 - alarms[_NOTHING] / _DRAWS,
            seed=seed,
            seconds=0.0,
        )

    if flies:
        progress(Step("flying and tracing it without another effect", 0.4))
        bare = again.traced(None, seed)
        traced = []
        for i, own in enumerate(found):
            share = 0.4 + 0.6 * (i + 1) / (len(kinds) + 1)
            progress(Step(f"flying and tracing it with {own.kind}", share))
            traced.append(dataclasses.replace(own, flown=again.traced(own, seed)))
        result = dataclasses.replace(result, effects=tuple(traced), flown=bare)
    return dataclasses.replace(result, seconds=time.perf_counter() - begin)


class Rehearser:
    """A campaign that is drawn, or flown, again."""

    def __init__(self, reading: Reading, model: FitResult, seed: int):
        """Takes the campaign and the model of its glider."""
        self.reading = reading
        task = reading.task
        scales = model.scales.without("moment", "servo")  # As a perfect model has them.
        self.model = dataclasses.replace(model, scales=scales)
        self.flown = flown_by(task, model, model.scales)
        fitted, _ = split_flights(reading.campaign, HELD_OUT, seed)
        names = [flight.name for flight in fitted]
        records = [record for record in task.records if record.name in names]
        own = task.offering(task.kinds).on(records)
        self.candidates, grams = gather_in_parts(own, self.model, scales)
        self.gram = grams.sum(axis=0)
        few = gather(own.thinned(MANY_FLIGHTS), self.model)
        self.share, prior = self.candidates.nothing()
        acting = self.acting
        self.strengths = Strengths(few.flights, scales, acting, prior.precision[acting])
        self.reach = len(records) / len(few.flights)
        rng = np.random.default_rng(seed)
        drawn = rng.normal(size=(_DRAWS, len(self.gram) - 1))
        self.noise = drawn @ _root_of(self.gram[:-1, :-1]).T

    def chosen(self, effects: Sequence[str] | None) -> list[str]:
        """Effects to plant.

        Raises:
            InputError: one cannot be planted.
        """
        known = self.model.kinds
        offered = [kind for kind in self.candidates.variants if kind not in known]
        if effects is None:
            kinds = self.reading.task.space.kinds
            return [kind for kind in offered if kinds[kind].is_likely]
        for kind in effects:
            if kind not in offered:
                has = f" (its model has {', '.join(known)})" if known else ""
                raise InputError(
                    f"{self.reading.campaign.path}: '{kind}' cannot be planted{has}; "
                    f"expected one of {', '.join(offered)}."
                )
        return list(effects)

    def column_of(self, kind: str) -> int:
        """Column of the coefficient that sets the size of an effect.

        Of those that were made linear, it is the first, with the shapes nearest to the
        usual ones, and of the smallest step.
        """
        space = self.reading.task.space
        usual = self.reading.task.vehicle.theta

        def unusual(column: int) -> tuple[float, int, float]:
            _, slot, step, shapes = self.candidates.directions[column]
            apart = [abs(v - usual[i]) / space.scale[i] for i, v in shapes]
            return sum(apart), slot, abs(step)

        return min(itertools.chain(*self.candidates.variants[kind]), key=unusual)

    def rehearsed(self, kind: str, size: float) -> Rehearsed:
        """Draws campaigns with an effect of typical sizes times `size`, and others."""
        column = self.column_of(kind)
        coefficient = self.reading.task.space.entries[self.candidates.slots[column]]
        scale = coefficient.scale
        most = min(PRIOR_SCALES, coefficient.upper / scale)
        outcomes = {size: self.outcomes(self.change_of(column, size * scale))}

        def power(times: float) -> float:
            if times not in outcomes:
                outcomes[times] = self.outcomes(self.change_of(column, times * scale))
            named = [n for names, n in outcomes[times].items() if kind in names]
            return sum(named) / outcomes[times].total()

        low = high = size
        while power(high) < VISIBLE and high < most:
            low, high = high, min(_STEP * high, most)
        while power(low) >= VISIBLE and low > _SMALLEST:
            low, high = low / _STEP, low
        for _ in range(_HALVINGS if power(high) >= VISIBLE else 0):
            middle = (low * high) ** 0.5
            low, high = (middle, high) if power(middle) < VISIBLE else (low, middle)
        curve = np.array([(own * scale, power(own)) for own in sorted(outcomes)])
        others = Counter(
            {
                ", ".join(sorted(names)): n / outcomes[size].total()
                for names, n in outcomes[size].items()
                if names and kind not in names
            }
        )
        return Rehearsed(
            kind=kind,
            coefficient=coefficient,
            size=size * scale,
            power=power(size),
            instead=dict(others.most_common(_FEW)),
            curve=curve,
            visible=_first_above(curve, VISIBLE),
        )

    def change_of(self, column: int, size: float) -> np.ndarray:
        """Change of all columns (m,) by an effect, less what passes for noise."""
        change = np.zeros(self.noise.shape[1])
        change[column] = size
        known = 0.5 * size**2 * self._information(column)
        lost = _REALIZED * self.reach * self.strengths.lost_without(change)
        share = lost / known
        return change * float(np.clip(share, _LEAST_SHARE, 1.0)) ** 0.5

    def _information(self, column: int) -> float:
        """Information on a coefficient where the strengths of the noise are known."""
        fitted = self.acting
        precision = self.strengths.precision
        inner = self.gram[np.ix_(fitted, fitted)] + np.diag(precision)
        side = self.gram[fitted, column]
        return float(self.gram[column, column] - side @ np.linalg.solve(inner, side))

    @property
    def acting(self) -> list[int]:
        """Columns of the coefficients that are fitted in the model."""
        effects = (self.candidates.variants[kind][0] for kind in self.model.kinds)
        return [*self.candidates.always, *itertools.chain(*effects)]

    def outcomes(self, change: np.ndarray) -> Counter[frozenset[str]]:
        """Draws campaigns with a change of the columns (m,), and counts the answers.

        An answer is the effects that are named beside those of the model, and those
        that are said to be indistinguishable from them.
        """
        found = Counter[frozenset[str]]()
        for error in self.gram[:-1, :-1] @ change + self.noise:
            drawn = self.gram.copy()
            drawn[-1, :-1] = drawn[:-1, -1] = error
            counted = counted_from(drawn, self.share)
            score = scorer_of(self.candidates, counted[None])
            members = climb(score, score.by_first(self.model.kinds))
            found[self._answer(score, members)] += 1
            if change.any() and found.total() == _ALIKE and len(found) == 1:
                break
        return found

    def _answer(self, score: Scorer, members: Members) -> frozenset[str]:
        """What is reported of a set of effects, beside those of the model.

        An effect without which the set is nearly as probable has no name.
        """
        known = set(self.model.kinds)
        named = set[str]()
        for (kind, _), others in zip(members, score.smaller(members), strict=True):
            if kind not in known:
                sure = score(members) - score(others) > _SURE
                named.add(kind if sure else UNEXPLAINED)
        if not named - {UNEXPLAINED}:
            return frozenset(named)
        _, alike = near_sets(score, members)
        return frozenset(named.union(*(alike.get(kind, ()) for kind in named)))

    def traced(self, effect: Rehearsed | None, seed: int) -> Result:
        """Flies the campaign again, with an effect or none, and traces it."""
        theta = self.model.theta.copy()
        if effect is not None:
            direction = self.candidates.directions[self.column_of(effect.kind)]
            theta = direction.base(theta)
            theta[direction.slot] += effect.size
        scales = self.model.scales.without_floors
        again = self.flown_again(theta, scales, seed)
        return close_the_loop(again, seed=seed)

    def flown_again(self, theta: np.ndarray, scales: Scales, seed: int) -> Campaign:
        """Flies the campaign again with a glider, and noise and air of such scales."""
        campaign, masks, task, _ = self.reading
        flights = {flight.name: flight for flight in campaign.flights}
        rngs = np.random.default_rng(seed).spawn(len(task.records))

        def fly(pair: tuple[Record, np.random.Generator]) -> Flight:
            record, rng = pair
            flight = flights[record.name]
            mask = masks_of(flight, masks)
            return _fly_again(self.flown, theta, record, flight, mask, scales, rng)

        flown = in_parallel(fly, zip(task.records, rngs, strict=True))
        return dataclasses.replace(campaign, flights=tuple(flown))


class Strengths:
    """What is lost of an effect where the strengths of all noise are fitted, too.

    Args:
        flights: linear in all columns.
        scales: of the noise, which are known.
        fitted: columns of what is fitted beside the strengths.
        precision: of the prior of their coefficients.
    """

    def __init__(
        self,
        flights: Sequence[LinearFlight],
        scales: Scales,
        fitted: Sequence[int],
        precision: np.ndarray,
    ):
        """Fits the strengths to the flights as they are."""
        self.flights = [flight.expanded() for flight in flights]  # For all steps.
        self.scales = scales
        self.fitted = list(fitted)
        self.precision = precision
        self.least = self._cost(np.zeros(self.flights[0].inputs.shape[2] - 1))

    def lost_without(self, step: np.ndarray) -> float:
        """Returns the log-likelihood that is lost without a step (m,) [nats].

        The mean of both signs: the noise that the flights have falls out.
        """
        return 0.5 * (self._cost(step) + self._cost(-step)) - self.least

    def _cost(self, step: np.ndarray) -> float:
        """Returns the cost of the flights moved by a step, all else fitted [nats]."""
        fitted = self.fitted
        moved = step.copy()
        scales = self.scales
        for _ in range(_ROUNDS if fitted else 1):
            flights = [flight.combined(moved) for flight in self.flights]
            scales, _ = fit_scales(flights, scales, iterations=_ITERATIONS)
            if fitted:
                gram = grams_of(self.flights, scales).sum(axis=0)
                inner = gram[np.ix_(fitted, fitted)] + np.diag(self.precision)
                missed = gram[fitted, -1] - gram[fitted, :-1] @ step
                moved = step.copy()
                moved[fitted] += np.linalg.solve(inner, missed)
        change = moved[fitted] - step[fitted]
        flights = [flight.combined(moved) for flight in self.flights]
        cost = float(negative_log_likelihood(flights, scales).sum())
        return cost + 0.5 * float(change @ (self.precision * change))


def _root_of(gram: np.ndarray) -> np.ndarray:
    """Returns L (m, m) of L L' = G, which may be singular and of any units."""
    scale = np.sqrt(np.maximum(gram.diagonal(), 1e-300))
    values, vectors = np.linalg.eigh(gram / scale[:, None] / scale)
    root: np.ndarray = scale[:, None] * vectors * np.sqrt(np.maximum(values, 0.0))
    return root


def _first_above(curve: np.ndarray, level: float) -> float:
    """Size from which a curve (n, 2) stays above a level; infinite if it does not."""
    sizes, powers = curve.T
    stays = np.minimum.accumulate(powers[::-1])[::-1]
    if stays[-1] < level:
        return np.inf
    return float(np.exp(np.interp(level, stays, np.log(sizes))))


def _fly_again(
    model: RolloutModel,
    theta: np.ndarray,
    record: Record,
    flight: Flight,
    mask: Masks,
    scales: Scales,
    rng: np.random.Generator,
) -> Flight:
    """Flies a logged flight again, and logs it as it was logged.

    Args:
        model: that explains the flight, for its launch.
        theta: the glider that flies; it stays in the plane of flight.
        record: of the flight.
        flight: whose rows are replaced; a row without a usable pose has none again.
        mask: of the flight.
        scales: of sensors, moving air, and constants of flights.
        rng: of these.
    """
    space = record.space
    time = record.time
    count = len(time) - 1
    launch = find_launch(model, record)[0].copy()
    record = dataclasses.replace(
        record,
        rest=record.rest + launch[OFFSET],
        bank=np.ones(count),
        side_wind=np.zeros((count, 2)),
    )
    launch[OFFSET] = 0.0
    launch[NUM_STATES:] = states_at_rest(record, theta, launch)
    constants = rng.normal(size=4) * scales.of_flights
    gusts = scales.air * rng.normal(size=(count, 2))
    kept = np.exp(-np.diff(time) / scales.air_time)
    for k in range(1, count):
        gusts[k] = kept[k] * gusts[k - 1] + np.sqrt(1.0 - kept[k] ** 2) * gusts[k]
    path, dynamics = path_of(record, theta, Surroundings(constants, gusts))
    states = roll_out(space.flown, path, launch, dynamics, model.gaussians)

    clock = flight.time - flight.time[np.argmax(mask.usable)]
    shown = sensed(space, states, theta, model.gaussians)
    shown[:, 2] += constants[3]
    noise = rng.normal(size=(len(clock), 4)) * scales.sensors
    pose = np.stack([np.interp(clock, time, own) for own in shown.T], axis=1)
    pose = np.where(mask.usable[:, None], pose + noise[:, :3], np.nan)
    elevator = flight.elevator
    if elevator is not None and record.seen[:, 3].any():
        logged = signals(record, theta).logged + states[:, OFFSET]
        flown = np.interp(clock, time, logged) + noise[:, 3]
        within = (clock >= 0.0) & (clock <= time[-1])
        elevator = np.where(within, flown, elevator)
    return dataclasses.replace(
        flight, pose=pose, elevator=elevator, attitude=None, departure=None
    )
