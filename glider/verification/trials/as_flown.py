"""Flights of the loop as it is flown: held commands, latency, moving air.

Commands come from a clock, each computed from the state one latency ago and held, at
any phase between clock and launch. Flights start on the boundary of the inlet; from the
worst of them, start, phase and wind climb. Half of them meet a steady wind and error of
the command, and half what at each moment makes V rise fastest.

A funnel that was made for held commands has its own clock: its first command acts from
the launch on, and an error stays while its command is held. From a launch funnel
(`proof.phases`) the flight goes on in the funnel in which the predicted state has the
least V.
"""

import dataclasses
import functools
import math
from collections.abc import Sequence

import numpy as np

from glider.compiled.flight import Steps, fly_batch, make_tape
from glider.control.predictor import (
    STEP,
    Hold,
    flown_under,
    held_command,
    policy_command,
)
from glider.errors import expect
from glider.physics.confidence import ALONE, ConfidenceSet, numbers_at, physical
from glider.progress import Shares, silent
from glider.verification.funnel.funnel import Funnel, funnel_policy
from glider.verification.proof.phases import GRID_ROOM, choose, first_commands
from glider.verification.sos.sphere import normalized
from glider.verification.trials.falsify import (
    CLIMB_NARROWING,
    CLIMB_ROUNDS,
    CLIMB_WIDTH,
    ESCAPE_LEVEL,
    boundary_states,
    check_gliders,
)

_MOST_WIND = 20.0
"""Strongest wind that is flown [m/s]."""

_MOST_ERROR = 100.0
"""Largest error of the command that is flown [rad/s]."""

_FRESH = 1e-3
"""Push by which the direction where V rises fastest is found [m/s, rad/s]."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class FlownLoop:
    """What a loop has that the theorem does not."""

    hold: Hold  #: How commands reach the servo.
    wind: float = 0.0  #: Largest speed of the wind beyond the model's own [m/s].
    command_error: float = 0.0  #: Largest other error of the command [rad/s].
    gliders: ConfidenceSet | None = None  #: Those that fly; None for the model's own.

    def __post_init__(self):
        """Raises InputError where the wind or the error is out of range."""
        wind = self.wind
        words = f"a speed from 0 to {_MOST_WIND:g} m/s"
        expect(0.0 <= wind <= _MOST_WIND, "the wind", wind, words)
        error = self.command_error
        words = f"from 0 to {_MOST_ERROR:g} rad/s"
        expect(0.0 <= error <= _MOST_ERROR, "the command error", error, words)


@dataclasses.dataclass(frozen=True, kw_only=True)
class FlownTrial:
    """The outcome of flights of a loop as it is flown, from the inlet's boundary."""

    loop: FlownLoop  #: What was flown.
    levels: np.ndarray  #: Largest V (B,) of each; 1 is the boundary, where it starts.
    later: np.ndarray  #: Largest V (B,) once a command of the clock has acted.
    ends: np.ndarray  #: V (B,) at the end, in the last set if at most 1.
    climbed: np.ndarray  #: Whether it is of the ascent, (B,).
    starts: np.ndarray  #: States (B, n) at the launch.
    phases: np.ndarray  #: Times (B,) from the launch to the clock's first sample [s].

    @property
    def escapes(self) -> int:
        """Number of flights that left the funnel."""
        return int((~(self.levels <= ESCAPE_LEVEL)).sum())  # NaN is an escape.

    @property
    def astray(self) -> int:
        """Number of flights that end outside the last set."""
        return int((~(self.ends <= ESCAPE_LEVEL)).sum())


def fly_loop(
    funnel: Funnel,
    loop: FlownLoop,
    samples: int,
    rng: np.random.Generator,
    progress: Shares = silent,
    *,
    rests: Sequence[Funnel] = (),
) -> FlownTrial:
    """Flies from random points of the inlet's boundary, then climbs from the worst.

    Args:
        funnel: of the whole flight, or a launch funnel.
        samples: flights from random points; the climb adds as many and a fifth more.
        rests: the funnels of held commands that go on from the launch funnel.
    """
    n = funnel.num_states
    fly = functools.partial(_flights, funnel, loop, rests=rests)
    check_clock(funnel, loop.hold, rests)
    check_gliders(funnel, loop.gliders)
    # Directions of start (n) and wind (2), the phase, whether the wind is steady, and
    # the direction of the glider (r).
    sizes = n, 2, loop.gliders.dimension if loop.gliders else 0
    *toward, glider = (normalized(rng.normal(size=(samples, of))) for of in sizes)
    steady = np.arange(samples)[:, None] % 2
    genes = np.hstack([*toward, rng.uniform(size=(samples, 1)), steady, glider])
    found = genes, *fly(genes)
    for turn in range(CLIMB_ROUNDS):
        progress((turn + 1) / (CLIMB_ROUNDS + 1))
        genes, levels, later, _ = found
        worst = np.where(levels > ESCAPE_LEVEL, levels, later)
        best = genes[np.argsort(-worst)[: max(1, samples // 25)]]
        moved = np.repeat(best, 5, axis=0)
        noise = rng.normal(size=(len(moved), moved.shape[1] - 1))
        noise *= CLIMB_WIDTH * CLIMB_NARROWING**turn
        noise[:, :n] /= math.sqrt(n)
        moved += np.insert(noise, n + 3, 0.0, axis=1)  # A wind stays steady or not.
        for axes in (np.s_[:, :n], np.s_[:, n : n + 2], np.s_[:, n + 4 :]):
            moved[axes] = normalized(moved[axes])
        moved[:, n + 2] %= 1.0
        more = moved, *fly(moved)
        found = tuple(map(np.concatenate, zip(found, more, strict=True)))
    genes, levels, later, ends = found
    return FlownTrial(
        loop=loop,
        levels=levels,
        later=later,
        ends=ends,
        climbed=np.arange(len(levels)) >= samples,
        starts=boundary_states(funnel, 0, genes[:, :n]),
        phases=_phases(funnel, loop.hold, genes, rests),
    )


def _phases(funnel, hold, genes, rests=()):
    """Returns times (B,) from the launch to the clock's first sample after it [s]."""
    period = funnel.settings.period
    if period:  # Its second command was computed then.
        return np.full(len(genes), period - hold.latency)
    first = first_commands(funnel, rests)[0] - hold.latency if rests else 0.0
    return first + genes[:, funnel.num_states + 2] * hold.period


def check_clock(funnel: Funnel, hold: Hold, rests: Sequence[Funnel] = ()) -> None:
    """Raises InputError where funnels' clock is not that of the commands."""
    latency = hold.latency
    found = hold.period
    for own in rests or (funnel,):
        period = own.settings.period
        if period:
            expect(found == period, "the period of commands", found, "the funnel's")
            good = latency < period and (hold.predicts or latency == 0.0)
            words = "less than the period, with a predictor"
            expect(good, "the latency", latency, words)
    if rests:
        first = first_commands(funnel, rests)[0]
        words = f"the launch funnel's, {first:.6g} s"
        expect(abs(latency - first) <= GRID_ROOM, "the latency", latency, words)


BATCH = 4000
"""Flights at once: more do not fit the cache."""


def _flights(funnel, loop, genes, rests=()):
    """Returns the largest V, the largest later and that at the end, (B,), of genes."""

    def fly(part):
        if rests:
            return _phase_levels(funnel, rests, loop, part)
        return _Flight(funnel, loop, part).levels()

    found = map(fly, np.array_split(genes, math.ceil(len(genes) / BATCH)))
    # What diverges has no level: it is the worst.
    columns = map(np.concatenate, zip(*found, strict=True))
    return tuple(np.where(np.isfinite(v), v, np.inf) for v in columns)


def _phase_levels(launch, rests, loop, genes):
    """Returns the same of flights from a launch funnel on in one of the others."""
    model = launch.nominal.model
    latency = loop.hold.latency
    flight = _Flight(launch, loop, genes)
    still = np.zeros(len(genes))
    flight.fly(still, _phases(launch, loop.hold, genes, rests), begins=True)
    predicted = flown_under(model, flight.states, latency, still)
    flight.fly(still, latency)
    chosen = choose(rests, predicted)
    levels = np.zeros((3, len(genes)))
    for j in np.unique(chosen):
        here = chosen == j
        states = flight.states[here]
        rest = _Flight(rests[j], loop, genes[here], states)
        later, _, ends = rest.levels(predicted[here])
        start = rests[j].level(0.0, states)
        levels[:, here] = np.maximum(later, start), later, ends
    levels[0] = np.maximum(levels[0], flight.largest)
    return tuple(levels)


class _Flight:
    """Flights of a batch, each at its own time: their clocks are."""

    def __init__(self, funnel, loop, genes, states=None):
        """Launches them, from the boundary if not from some states."""
        n = funnel.num_states
        self._funnel = funnel
        self._loop = loop
        self._model = funnel.nominal.model
        allowed = loop.gliders or ALONE
        on_boundary = allowed.on_boundary(genes[:, n + 4 :])
        deviations = physical(self._model, allowed.names, on_boundary)
        self._numbers = numbers_at(self._model, allowed.names, deviations)
        self._glider = deviations if loop.gliders else None
        self._policy = funnel_policy(funnel, held=True)
        self._wind = loop.wind * genes[:, n : n + 2]
        self._error = loop.command_error * np.sign(genes[:, n])
        self._steady = genes[:, n + 3] > 0.5
        self._first = _phases(funnel, loop.hold, genes)
        launched = boundary_states(funnel, 0, genes[:, :n])
        self.states = launched if states is None else states
        self._times, self.largest, self._later = np.zeros((3, len(genes)))

    def levels(self, seen=None):
        """Flies to the funnel's end; returns levels, later and ends, (B,).

        The first command is computed from the states, or from those that are seen.
        """
        hold = self._loop.hold
        model = self._model
        policy = self._policy
        # Until the clock's first command acts, that of the launch does.
        seen = self.states if seen is None else seen
        before = policy_command(policy, self._times, seen)
        waiting = [before] * (hold.waiting + 1)
        self.fly(before, self._first, begins=True)
        with np.errstate(over="ignore", invalid="ignore"):  # A flight may diverge.
            while np.any(self._times < policy.duration):
                now = self._times, self.states
                new = held_command(model, policy, *now, waiting, hold)
                self.fly(waiting.pop(0), hold.rest)
                waiting.append(new)
                self.fly(waiting[0], hold.period - hold.rest, begins=True)
        ends = self._funnel.level(self._times, self.states, self._glider)
        return self.largest, self._later, ends

    def fly(self, command, duration, begins=False):
        """Flies under a command (B,) for some time, (B,) or one for all [s].

        The command begins to act, or it has acted before.
        """
        count = max(math.ceil(np.max(duration) / STEP - 1e-9), 1)
        step = duration / count * np.ones(len(self._times))
        end = self._policy.duration
        for number in range(count):
            left = np.clip(end - self._times, 0.0, step)
            chooses = (begins and number == 0) or not self._funnel.settings.period
            error, wind = self._pushes_now(command, chooses)
            self.states = self._step(left, command + error, wind)
            self._times = np.where(left < step - 1e-15, end, self._times + left)
            level = self._funnel.level(self._times, self.states, self._glider)
            self.largest = np.maximum(self.largest, level)
            acts = self._times > self._first + self._loop.hold.latency
            self._later = np.where(acts, np.maximum(self._later, level), self._later)

    def _step(self, duration, command, wind, order=4):
        """Returns states (B, n) one step of durations (B,) [s] later."""
        flown = fly_batch(
            self._model,
            self.states,
            Steps(1, 1.0, order),
            make_tape(command[:, None]),
            numbers=self._numbers,
            wind=wind,
            pace=duration,
        )
        return flown.states[:, 1]

    def _pushes_now(self, command, chooses):
        """Returns error (B,) and wind (B, 2): steady, or where V rises fastest.

        The error is that of before where it may not choose another.
        """
        if not (self._loop.wind or self._loop.command_error):
            return 0.0, None
        error = self._funnel.error(self._times, self.states, self._glider)
        pull = np.einsum("bij,bj->bi", self._funnel.shape(self._times), error)
        slopes = []
        second = np.ones(len(self._times))
        for push in _FRESH * np.eye(3):
            wind = np.tile(push[1:], (len(second), 1))
            # Euler's step of a second ends a derivative away.
            ahead = self._step(second, command + push[0], wind, order=1)
            behind = self._step(second, command - push[0], -wind, order=1)
            slopes.append(np.sum(pull * (ahead - behind), axis=1))
        toward = np.array(slopes[1:]).T
        size = np.maximum(np.linalg.norm(toward, axis=1, keepdims=True), 1e-300)
        worst = self._loop.wind * toward / size
        wind = np.where(self._steady[:, None], self._wind, worst)
        if chooses:
            highest = self._loop.command_error * np.sign(slopes[0])
            self._error = np.where(self._steady, self._error, highest)
        return self._error, wind
