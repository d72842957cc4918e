"""Flights of a funnel of held commands by its clock, in winds that push outward."""

import dataclasses
import math

import numpy as np

from glider.control.predictor import STEP, Hold, held_command, policy_command
from glider.physics.confidence import theta_at
from glider.verification.dynamics.nominal import hermite_path
from glider.verification.funnel.funnel import Funnel, funnel_policy
from glider.verification.sos.sphere import normalized
from glider.verification.trials import ESCAPE_LEVEL, boundary_states
from tests.helpers.second_flight import advance, rates_of

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
            states=boundary_states(funnel, 0, directions),
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
        self._theta = theta_at(model, names, launches.deviations.T)
        gliders = funnel.gliders
        self._centers = hermite_path(gliders.times, gliders.shifts, gliders.slopes)
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
        V = self._funnel.level(time, self.states - self._moved())
        return np.where(np.isfinite(V), V, np.inf)

    def _moved(self):
        """Returns how far the centers of the gliders are from the nominal flight."""
        end = self._funnel.nominal.times[-1]
        X = self._centers(min(self.time, end))
        return np.einsum("nm,bm->bn", X, self._given.deviations)

    def _step(self, duration, command, wind, order=4):
        """Returns states (B, n) one step [s] later."""
        model = self._funnel.nominal.model

        def rates(states, since):
            return rates_of(model, states, command, wind, self._theta)

        if order == 1:
            return self.states + duration * rates(self.states, 0.0)
        return advance(rates, self.states, duration)

    def _pushes(self, command):
        """Returns error (B,) and wind (B, 2): steady, or where V rises fastest."""
        given = self._given
        funnel = self._funnel
        center = funnel.center(self.time) + self._moved()
        deviation = self.states - center
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
