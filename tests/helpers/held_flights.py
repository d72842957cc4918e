"""Flights of a funnel of held commands by its clock, in winds that push outward."""

import dataclasses
import math

import numpy as np

from glider.compiled.flight import Steps, fly_batch, make_tape
from glider.control.predictor import STEP, Hold, held_command, policy_command
from glider.physics.confidence import numbers_at
from glider.verification.funnel.funnel import Funnel, funnel_policy
from glider.verification.sos.sphere import normalized
from glider.verification.trials import ESCAPE_LEVEL, _boundary_states

_FRESH = 1e-3
"""Push by which the direction where V rises fastest is found [m/s, rad/s]."""


@dataclasses.dataclass
class Launches:
    """Launches from the boundary of a funnel, and what pushes each of them."""

    states: np.ndarray  #: (B, n).
    deviations: np.ndarray  #: (B, m) of the gliders.
    wind: np.ndarray  #: (B, 2) a steady one [m/s].
    error: np.ndarray  #: (B,) of the command, steady [rad/s].
    steady: np.ndarray  #: (B,) whether both are; else they choose where V rises.

    @classmethod
    def draw(cls, funnel: Funnel, count: int, rng: np.random.Generator, **pushes):
        """Draws gliders of the funnel's set, and pushes of the given sizes."""
        allowed = funnel.allowed
        directions = normalized(rng.normal(size=(count, funnel.num_states)))
        turns = normalized(rng.normal(size=(count, allowed.dimension)))
        deviations = allowed.on_boundary(turns)
        wind = normalized(rng.normal(size=(count, 2)))
        return cls(
            states=_boundary_states(funnel, 0, directions, deviations),
            deviations=deviations,
            wind=pushes.get("wind", 0.0) * wind,
            error=pushes.get("error", 0.0) * np.sign(wind[:, 0]),
            steady=np.arange(count) % 2 > 0,
        )


class HeldFlights:
    """Flights of a batch; the launch's command acts first, then those of the clock."""

    def __init__(self, funnel: Funnel, launches: Launches, latency=0.0, late=0.0):
        """Takes the predictor's latency, and by how much commands act later [s]."""
        self._funnel = funnel
        self._given = launches
        self._hold = Hold(period=funnel.settings.period, latency=latency)
        self._late = late
        self._policy = funnel_policy(funnel, held=True)
        names = funnel.allowed.names
        model = funnel.nominal.model
        self._numbers = numbers_at(model, names, launches.deviations)
        self.states = launches.states
        self.time = 0.0
        self.largest = np.zeros(len(self.states))

    def levels(self) -> tuple[np.ndarray, np.ndarray]:
        """Flies to the funnel's end; returns the largest V and that at the end."""
        hold = self._hold
        model = self._funnel.nominal.model
        count = len(self.states)
        command = policy_command(self._policy, np.zeros(count), self.states)
        self.fly(command, hold.period - hold.latency)
        with np.errstate(over="ignore", invalid="ignore"):  # A flight may diverge.
            while self.time < self._policy.duration - 1e-9:
                times = np.full(count, self.time)
                now = times, self.states, [command]
                new = held_command(model, self._policy, *now, hold)
                self.fly(command, hold.latency + self._late)
                command = new
                self.fly(command, hold.period - hold.latency - self._late)
        ends = self._level()
        return self.largest, ends

    def fly(self, command: np.ndarray, duration: float) -> None:
        """Flies under a command (B,) for some time [s], or to the funnel's end."""
        duration = min(duration, self._policy.duration - self.time)
        if duration <= 1e-12:
            return
        count = math.ceil(duration / STEP - 1e-9)
        for _ in range(count):
            error, wind = self._pushes(command)
            self.states = self._step(duration / count, command + error, wind)
            self.time += duration / count
            self.largest = np.maximum(self.largest, self._level())

    def _level(self):
        time = np.full(len(self.states), self.time)
        V = self._funnel.level(time, self.states, self._given.deviations)
        return np.where(np.isfinite(V), V, np.inf)

    def _step(self, duration, command, wind, order=4):
        """Returns states (B, n) one step [s] later."""
        flown = fly_batch(
            self._funnel.nominal.model,
            self.states,
            Steps(1, duration, order),
            make_tape(command[:, None]),
            numbers=self._numbers,
            wind=wind,
        )
        return flown.states[:, 1]

    def _pushes(self, command):
        """Returns error (B,) and wind (B, 2): steady, or where V rises fastest."""
        given = self._given
        funnel = self._funnel
        deviation = funnel.error(self.time, self.states, given.deviations)
        pull = deviation @ funnel.shape(self.time)
        slopes = []
        for push in _FRESH * np.eye(3):
            wind = np.tile(push[1:], (len(pull), 1))
            # Euler's step of a second ends a derivative away.
            ahead = self._step(1.0, command + push[0], wind, order=1)
            behind = self._step(1.0, command - push[0], -wind, order=1)
            slopes.append(np.sum(pull * (ahead - behind), axis=1))
        toward = np.array(slopes[1:]).T
        size = np.linalg.norm(toward, axis=1, keepdims=True)
        strength = np.linalg.norm(given.wind, axis=1, keepdims=True)
        worst = strength * toward / np.maximum(size, 1e-300)
        wind = np.where(given.steady[:, None], given.wind, worst)
        highest = np.abs(given.error) * np.sign(slopes[0])
        return np.where(given.steady, given.error, highest), wind


def count_escapes(levels: np.ndarray) -> int:
    """Returns how many flights left, given the largest V (B,) of each."""
    return int(np.sum(~(levels <= ESCAPE_LEVEL)))
