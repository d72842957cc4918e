"""Flights of the full dynamics that try to falsify a funnel; they prove nothing.

Full means: the physics, not its Taylor polynomial, and the servo with its limits.
Flights start from random points of the boundary and with random gliders on the edge of
a confidence set, if one is given; from the worst of them, start and glider climb. For a
funnel of a set, V of each glider is about its own center. Flights that escape are
counted, never dropped.

The feedback of the theorem acts at all times. Or the loop is flown as it is: commands
come from a clock, each computed from the state one latency ago and held, at any phase
between clock and launch, in moving air. Then flights start at the launch, and phase and
wind climb, too. Half of them meet a steady wind and error of the command, and half what
at each moment makes V rise fastest. A funnel that was made for held commands has its
own clock: its first command acts from the launch on, and an error stays while its
command is held.
"""

import dataclasses
import math
from collections.abc import Sequence

import numpy as np

from glider.compiled.flight import Steps, fly_batch, make_tape
from glider.control.predictor import STEP, Hold, held_command, policy_command
from glider.errors import InputError, expect
from glider.physics.confidence import ALONE, ConfidenceSet, numbers_at, physical
from glider.physics.model import GliderModel
from glider.progress import Shares, silent
from glider.simulation.fly import check_states, full_starts
from glider.verification.dynamics.nominal import fly_plan
from glider.verification.funnel.funnel import Funnel, funnel_policy
from glider.verification.sos.forms import to_ball
from glider.verification.sos.sphere import normalized

ESCAPE_LEVEL = 1.005
"""Level V that only flights which have left the funnel exceed: from 1, rounding and
integration take others to 1 + 1e-6."""

_START_SHARES = (0.0, 0.12, 0.25, 0.37, 0.5, 0.62, 0.75, 0.87)
"""Times when flights start, as shares of the funnel's duration."""

_CLIMB_ROUNDS = 6
"""Rounds of ascent along the boundary, each with a fifth as many flights."""

_CLIMB_WIDTH = 0.3
"""Length by which the first round strays from the worst points, on the unit sphere."""

_CLIMB_NARROWING = 0.6
"""Factor on this length from a round to the next."""

_MOST_WIND = 20.0
"""Strongest wind that is flown [m/s]."""

_MOST_ERROR = 100.0
"""Largest error of the command that is flown [rad/s]."""

_FRESH = 1e-3
"""Push by which the direction where V rises fastest is found [m/s, rad/s]."""

_BATCH = 4000
"""Held flights at once: more do not fit the cache."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class FlownLoop:
    """The loop that flies: by default, the theorem's of a feedback at all times."""

    hold: Hold | None = None  #: How commands reach the servo, if from a clock.
    wind: float = 0.0  #: Largest speed of the wind beyond the model's own [m/s].
    command_error: float = 0.0  #: Largest other error of the command [rad/s].
    gliders: ConfidenceSet | None = None  #: Those that fly, if not one.
    #: The glider that flies, if not the funnel's own; states that the funnel lacks
    #: start at rest.
    model: GliderModel | None = None

    def __post_init__(self):
        """Raises InputError where the wind or the error is out of range."""
        wind = self.wind
        words = f"a speed from 0 to {_MOST_WIND:g} m/s"
        expect(0.0 <= wind <= _MOST_WIND, "the wind", wind, words)
        error = self.command_error
        words = f"from 0 to {_MOST_ERROR:g} rad/s"
        expect(0.0 <= error <= _MOST_ERROR, "the command error", error, words)
        if self.hold is None and (wind or error):
            raise InputError("Wind and command errors are flown with a hold only.")
        if self.model and (self.hold or self.gliders):
            raise InputError("Another model is flown alone, and without a hold.")


@dataclasses.dataclass(frozen=True, kw_only=True)
class Trial:
    """The outcome of flights from a funnel's boundary."""

    loop: FlownLoop  #: What was flown.
    times: np.ndarray  #: Times (B,) when they started [s].
    states: np.ndarray  #: States (B, n) where they started.
    deviations: np.ndarray  #: δ (B, m) of the gliders; m is 0 where all flew the same.
    phases: np.ndarray  #: Times (B,) from the launch to the clock's first sample [s].
    levels: np.ndarray  #: Largest V (B,) of each; 1 is the boundary, where it starts.
    later: np.ndarray  #: Largest V (B,) after the start, or once a command has acted.
    ends: np.ndarray  #: V (B,) at the end, in the last set if at most 1.
    climbed: np.ndarray  #: Whether it is of the ascent, (B,).

    @property
    def samples(self) -> int:
        """Number of flights."""
        return len(self.levels)

    @property
    def escapes(self) -> int:
        """Number of flights that left the funnel."""
        return int((~(self.levels <= ESCAPE_LEVEL)).sum())  # NaN is an escape.

    @property
    def astray(self) -> int:
        """Number of flights that end outside the last set."""
        return int((~(self.ends <= ESCAPE_LEVEL)).sum())


def falsify_funnel(
    funnel: Funnel,
    samples: int,
    rng: np.random.Generator,
    loop: FlownLoop | None = None,
    *,
    shares: Sequence[float] = _START_SHARES,
    climb: bool = True,
    progress: Shares = silent,
) -> Trial:
    """Flies from random points of the boundary, then climbs from the worst of them.

    Args:
        samples: flights from random points, divided among start times; at least one at
            each. The climb adds as many and a fifth more.
        loop: what flies; the theorem's if None.
        shares: of the duration: when flights start. Held commands start at the launch.
        climb: whether to look for worse flights near the worst.
        progress: called with the share that is done.

    Raises:
        InputError: the funnel's clock is another one, or it is of gliders that deviate
            in other numbers.
    """
    loop = loop or FlownLoop()
    check_clock(funnel, loop.hold)
    _check_gliders(funnel, loop.gliders)
    shares = (0.0,) if loop.hold else shares
    last = len(funnel.nominal.times) - 1
    rounds = _CLIMB_ROUNDS if climb else 0
    parts = []
    for number, share in enumerate(shares):
        k = min(round(share * last), last - 1)
        more = number < samples % len(shares)
        count = max(1, samples // len(shares) + more)
        genes = _draw_genes(funnel, loop, count, rng)
        found = _fly(funnel, loop, k, genes)
        parts.append(found)
        for turn in range(rounds):
            done = number + (turn + 1) / (rounds + 1)
            progress(done / len(shares))
            genes = _stray(funnel, _worst(found, count), turn, rng)
            found = _fly(funnel, loop, k, genes, climbed=True)
            parts.append(found)
        progress((number + 1) / len(shares))
    columns = {}
    for field in dataclasses.fields(Trial):
        if field.name != "loop":
            each = [part[field.name] for part in parts]
            columns[field.name] = np.concatenate(each)
    return Trial(loop=loop, **columns)


def check_clock(funnel: Funnel, hold: Hold | None) -> None:
    """Raises InputError where the funnel's clock is not that of the commands."""
    period = funnel.settings.period
    if not (period and hold):
        return  # A feedback of held commands refuses to act at all times.
    own = hold.period == period
    expect(own, "the period of commands", hold.period, "the funnel's")
    good = hold.latency < period and (hold.predicts or hold.latency == 0.0)
    words = "less than the period, with a predictor"
    expect(good, "the latency", hold.latency, words)


def _check_gliders(funnel, allowed):
    """Raises InputError where a funnel is of gliders that deviate in other numbers."""
    made_for = funnel.allowed.names
    if allowed and made_for not in ((), allowed.names):
        raise InputError(
            f"The funnel is of gliders that deviate in {', '.join(made_for)}; those to "
            f"fly deviate in {', '.join(allowed.names) or 'nothing'}."
        )


# ------------------------------------------------------------------------- the ascent
# Genes of a flight: directions of its start (n) and of the wind (2), the phase of the
# clock, whether the wind is steady, and the direction of the glider (r).


def _draw_genes(funnel, loop, count, rng):
    """Returns random genes (count, n + 4 + r)."""
    allowed = loop.gliders or ALONE

    def directions(dimension):
        return normalized(rng.normal(size=(count, dimension)))

    start = directions(funnel.num_states)
    wind = directions(2)
    glider = directions(allowed.dimension)
    phase = rng.uniform(size=(count, 1))
    steady = np.arange(count)[:, None] % 2
    return np.hstack([start, wind, phase, steady, glider])


def _worst(found, samples):
    """Returns the genes of the worst flights, a twenty-fifth of the random ones."""
    levels = found["levels"]
    # A flight starts at 1: what counts is how close it comes again, or goes beyond.
    values = np.where(levels > ESCAPE_LEVEL, levels, found["later"])
    kept = max(1, samples // 25)
    worst = np.argsort(-values)[:kept]
    return found["genes"][worst]


def _stray(funnel, worst, turn, rng):
    """Returns genes near each of the worst, five of each, closer from turn to turn."""
    n = funnel.num_states
    near = np.repeat(worst, 5, axis=0)
    width = _CLIMB_WIDTH * _CLIMB_NARROWING**turn
    noise = width * rng.normal(size=near.shape)
    noise[:, :n] /= math.sqrt(n)
    noise[:, n + 3] = 0.0  # A wind stays steady or not.
    moved = near + noise
    start = normalized(moved[:, :n])
    wind = normalized(moved[:, n : n + 2])
    phase = moved[:, n + 2 : n + 3] % 1.0
    steady = moved[:, n + 3 : n + 4]
    glider = normalized(moved[:, n + 4 :])
    return np.hstack([start, wind, phase, steady, glider])


def _fly(funnel, loop, k, genes, climbed=False):
    """Returns what came of the genes' flights from one of the funnel's times."""
    n = funnel.num_states
    allowed = loop.gliders or ALONE
    at_edge = allowed.on_boundary(genes[:, n + 4 :])
    deviations = physical(funnel.nominal.model, allowed.names, at_edge)
    own = deviations if loop.gliders else None
    states = boundary_states(funnel, k, genes[:, :n], own)
    phases = np.zeros(len(genes))
    if loop.hold:
        phases = _phases(funnel, loop.hold, genes)
        found = _fly_held(funnel, loop, genes, states, deviations)
    else:
        V, _ = fly_from(funnel, k, states, loop.model, allowed.names, own)
        later = V[:, 1:].max(axis=1)
        found = V.max(axis=1), later, V[:, -1]
    # What diverges has no level: it is the worst.
    levels, later, ends = (np.where(np.isfinite(V), V, np.inf) for V in found)
    return {
        "genes": genes,
        "climbed": np.full(len(genes), climbed),
        "times": np.full(len(genes), funnel.nominal.times[k]),
        "states": states,
        "deviations": deviations,
        "phases": phases,
        "levels": levels,
        "later": later,
        "ends": ends,
    }


def boundary_states(
    funnel: Funnel, k: int, directions: np.ndarray, deviation: np.ndarray | None = None
) -> np.ndarray:
    """Returns states (B, n) on the boundary at a time, given unit vectors (B, n).

    Those of gliders of the funnel's set, (m,) or (B, m), are about their own centers.
    """
    states = funnel.nominal.states[k] + directions @ to_ball(funnel.S[k])[1].T
    if deviation is not None and funnel.is_of_set:
        states = states + deviation @ funnel.gliders.shifts[k].T
    return states


# -------------------------------------------------- a feedback that acts at all times


def fly_from(
    funnel: Funnel,
    first: int,
    states: np.ndarray,
    model: GliderModel | None = None,
    names: tuple[str, ...] = (),
    deviations: np.ndarray | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Flies states (B, n) from one of the funnel's times to its end.

    The funnel's own glider flies if no other does, or gliders that deviate from it in
    some numbers by (B, m). V is about the center of each if the funnel is of a set.

    Returns:
        V of each at the funnel's times from `first` on, (B, T - first), and the
        paths (B, T - first, n'), n' the states of the glider that flies.
    """
    model = model or funnel.nominal.model
    policy = funnel_policy(funnel, first)
    check_states(model, policy)
    times = funnel.nominal.times[first:]
    numbers = None
    center = None
    if deviations is not None:
        numbers = numbers_at(model, names, deviations)
        center = deviations[:, None]
    starts = full_starts(model, states)
    step = 0.5 * (times[1] - times[0])
    paths = fly_plan(model, policy, starts, len(times) - 1, step, numbers)
    return funnel.level(times, paths[..., : funnel.num_states], center), paths


def draw_inside(funnel: Funnel, count: int, rng: np.random.Generator) -> np.ndarray:
    """Draws launches (count, n) that are uniform in the inlet."""
    n = funnel.num_states
    points = normalized(rng.normal(size=(count, n)))
    points *= rng.uniform(size=(count, 1)) ** (1 / n)
    return boundary_states(funnel, 0, points)


def fly_inside(funnel: Funnel, count: int, rng: np.random.Generator) -> np.ndarray:
    """Flies launches that are uniform in the inlet; returns paths (count, T, n)."""
    return fly_from(funnel, 0, draw_inside(funnel, count, rng))[1]


# ---------------------------------------------------------------------- held commands


def _phases(funnel, hold, genes):
    """Returns times (B,) from the launch to the clock's first sample after it [s]."""
    period = funnel.settings.period
    if period:  # Its second command was computed then.
        return np.full(len(genes), period - hold.latency)
    return genes[:, funnel.num_states + 2] * hold.period


def _fly_held(funnel, loop, genes, states, deviations):
    """Returns the largest V, the largest later and that at the end, (B,), of genes."""
    found = []
    for first in range(0, len(genes), _BATCH):
        here = slice(first, first + _BATCH)
        flight = _HeldFlight(funnel, loop, genes[here], states[here], deviations[here])
        found.append(flight.levels())
    return [np.concatenate(column) for column in zip(*found, strict=True)]


class _HeldFlight:
    """Flights of a batch, each at its own time: their clocks are."""

    def __init__(self, funnel, loop, genes, states, deviations):
        """Launches gliders that deviate by (B, m) from states (B, n)."""
        n = funnel.num_states
        self._funnel = funnel
        self._loop = loop
        self._model = funnel.nominal.model
        names = (loop.gliders or ALONE).names
        self._numbers = numbers_at(self._model, names, deviations)
        self._glider = deviations if loop.gliders else None
        self._policy = funnel_policy(funnel, held=True)
        self._wind = loop.wind * genes[:, n : n + 2]
        self._error = loop.command_error * np.sign(genes[:, n])
        self._steady = genes[:, n + 3] > 0.5
        self._first = _phases(funnel, loop.hold, genes)
        self._states = states
        self._times, self._largest, self._later = np.zeros((3, len(genes)))

    def levels(self):
        """Flies to the funnel's end; returns levels, later and ends, (B,)."""
        hold = self._loop.hold
        model = self._model
        policy = self._policy
        # Until the clock's first command acts, that of the launch does.
        before = policy_command(policy, self._times, self._states)
        waiting = [before] * (hold.waiting + 1)
        self.fly(before, self._first, begins=True)
        with np.errstate(over="ignore", invalid="ignore"):  # A flight may diverge.
            while np.any(self._times < policy.duration):
                now = self._times, self._states
                new = held_command(model, policy, *now, waiting, hold)
                self.fly(waiting.pop(0), hold.rest)
                waiting.append(new)
                self.fly(waiting[0], hold.period - hold.rest, begins=True)
        ends = self._funnel.level(self._times, self._states, self._glider)
        return self._largest, self._later, ends

    def fly(self, command, duration, begins=False):
        """Flies under a command (B,) for some time, (B,) or one for all [s].

        The command begins to act, or it has acted before.
        """
        count = max(math.ceil(np.max(duration) / STEP - 1e-9), 1)
        step = duration / count * np.ones(len(self._times))
        end = self._policy.duration
        is_held = self._funnel.settings.period > 0.0
        acting = self._first + self._loop.hold.latency
        for number in range(count):
            left = np.clip(end - self._times, 0.0, step)
            chooses = not is_held or (begins and number == 0)
            error, wind = self._pushes_now(command, chooses)
            self._states = self._step(left, command + error, wind)
            ended = left < step - 1e-15
            self._times = np.where(ended, end, self._times + left)
            level = self._funnel.level(self._times, self._states, self._glider)
            self._largest = np.maximum(self._largest, level)
            later = np.maximum(self._later, level)
            self._later = np.where(self._times > acting, later, self._later)

    def _step(self, duration, command, wind, order=4):
        """Returns states (B, n) one step of durations (B,) [s] later."""
        flown = fly_batch(
            self._model,
            self._states,
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
        loop = self._loop
        error = self._funnel.error(self._times, self._states, self._glider)
        S = self._funnel.shape(self._times)
        pull = np.einsum("bij,bj->bi", S, error)
        slopes = []
        second = np.ones(len(self._times))
        for push in _FRESH * np.eye(3):
            wind = np.tile(push[1:], (len(second), 1))
            # Euler's step of a second ends a derivative away.
            ahead = self._step(second, command + push[0], wind, order=1)
            behind = self._step(second, command - push[0], -wind, order=1)
            change = ahead - behind
            slopes.append(np.sum(pull * change, axis=1))
        by_error, *by_wind = slopes
        toward = np.array(by_wind).T
        size = np.linalg.norm(toward, axis=1, keepdims=True)
        worst = loop.wind * toward / np.maximum(size, 1e-300)
        wind = np.where(self._steady[:, None], self._wind, worst)
        if chooses:
            highest = loop.command_error * np.sign(by_error)
            self._error = np.where(self._steady, self._error, highest)
        return self._error, wind
