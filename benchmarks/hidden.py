"""Hidden gliders with one small effect, of which a close rival is another: who is it?

They fly in the simulator of `lifelike_flight`, which shares no physics with the
library: in moving air, each flight with a trim of its own.
"""

import dataclasses
import functools
from collections.abc import Mapping, Sequence

import numpy as np

from benchmarks.one_effect import ONE_SIGN, plant
from glider.campaign.logs import Campaign, Flight, campaign_of
from glider.control.tvlqr import sample_plan
from glider.experiments.explanations import Explanation, Findings, explain
from glider.experiments.proposal import read_task
from glider.experiments.throw_limits import ThrowLimits
from glider.experiments.throws import Throw
from glider.physics.effects import KINDS
from glider.physics.model import GliderModel
from glider.physics.parameters import GliderParameters
from glider.physics.state import ELEVATOR
from glider.planning.dircol import plan
from glider.planning.problem import PerchingProblem
from glider.sysid.likelihood.task import Task
from glider.sysid.replay.record import Noise
from tests.helpers.lifelike import (
    COMMAND_RATE,
    Capture,
    draw_commands,
    draw_starts,
    log_flights,
)
from tests.helpers.lifelike_flight import STEP, Glider, elevator_paths, fly, gusts

RIVALS = {
    "late": ("servo_lag", "command_delay"),
    "pressure": ("center_of_pressure", "pitch_moment"),
    "angle": ("wing_incidence", "camber", "pitch_offset"),
    "mass": ("mass", "airspeed_dependence"),
    "tail": ("elevator_area", "tail_wake"),
    "wash": ("downwash", "pitch_damping"),
}
"""Close rivals by a short name."""

SIZES = {
    "servo_lag": (0.001, 0.002),
    "command_delay": (0.001, 0.002),
    "center_of_pressure": (0.0005, 0.001),
    "pitch_moment": (0.00015, 0.0003),
    "wing_incidence": (0.006, 0.012),
    "camber": (0.006, 0.012),
    "pitch_offset": (0.006, 0.012),
    "mass": (0.01, 0.02),
    "airspeed_dependence": (0.03, 0.06),
    "elevator_area": (0.006, 0.012),
    "tail_wake": (0.015, 0.03),
    "downwash": (0.008, 0.016),
    "pitch_damping": (0.0002, 0.0004),
}
"""Least and largest size of an effect, so small that two flights hardly name it."""

ROWS = round(0.85 * Capture().rate) + 1

AIR = (0.1, 0.25)
"""Standard deviation [m/s] and correlation time [s] of the gusts."""

TRIM = 0.01
"""Standard deviation of the flights' own trims [rad]."""


def draw_size(kind: str, rng: np.random.Generator) -> float:
    """Draws the size of a small effect."""
    sign = 1.0 if kind in ONE_SIGN else rng.choice([-1.0, 1.0])
    return float(sign * rng.uniform(*SIZES[kind]))


def draw_shapes(kind: str, rng: np.random.Generator) -> dict[str, float]:
    """Draws the shapes of an effect of SIZES."""
    if kind == "tail_wake":
        return {"angle": rng.uniform(0.3, 0.7), "width": rng.uniform(0.12, 0.25)}
    return {"reference_speed": 7.0}


class Thrower:
    """Flies throws of a hidden glider, each in air and with a trim of its own."""

    def __init__(
        self,
        kind: str | None,
        seed: int,
        size: float | None = None,
        shapes: Mapping[str, float] | None = None,
    ):
        """Makes the glider with an effect; what is not given of it is drawn."""
        self.rng = np.random.default_rng([seed, 7])
        self.glider = Glider()
        if kind is not None:
            size = draw_size(kind, self.rng) if size is None else size
            shapes = draw_shapes(kind, self.rng) if shapes is None else shapes
            plant(self.glider, kind, size, shapes)

    def fly(self, starts: np.ndarray, commands: np.ndarray, first: int) -> list[Flight]:
        """Flies starts (4, F) under commands (H, F); names count from `first`."""
        glider, rng, count = self.glider, self.rng, commands.shape[1]
        trims = glider.elevator_trim + TRIM * rng.normal(size=count)
        thrown = dataclasses.replace(glider, elevator_trim=trims)
        steps = round((ROWS - 1) / Capture().rate / STEP)
        elevator = elevator_paths(
            glider.servo,
            commands,
            1.0 / COMMAND_RATE,
            2 * steps,
            glider.elevator_limits,
        )
        air = gusts(rng, *AIR, elevator.shape)
        motion = fly(thrown, starts, elevator, air)
        logged = log_flights(rng, thrown, motion, Capture(), commands)
        return [
            dataclasses.replace(f, name=f"flight_{first + i:03d}.csv")
            for i, f in enumerate(logged)
        ]

    def random(self, count: int, first: int) -> list[Flight]:
        """Flies throws of the kind that campaigns are made of."""
        rng = self.rng
        return self.fly(draw_starts(rng, count), draw_commands(rng, count), first)

    def throw(self, throw: Throw, first: int) -> list[Flight]:
        """Flies a throw, its launch a little missed."""
        limits, noise = ThrowLimits(), self.rng.normal(size=3) / 2.0
        x, z, pitch, _, xdot, zdot, _ = throw.launch
        faster = 1.0 + limits.missed_speed * noise[0] / throw.speed
        start = np.zeros((4, 1), complex)
        start[0] = x + 1j * (z + limits.missed_height * noise[1])
        start[1] = (xdot + 1j * zdot) * faster
        start[2] = pitch + limits.missed_pitch * noise[2]
        return self.fly(start, throw.commands[:, None], first)


def campaign(flights: Sequence[Flight]) -> Campaign:
    """Returns flights as a campaign of the nominal glider."""
    return campaign_of(
        "hidden", GliderParameters(), flights, Capture().rate, COMMAND_RATE
    )


def weigh(
    flights: Sequence[Flight], rivals: Sequence[str]
) -> tuple[Campaign, Task, Noise, tuple[Explanation, ...]]:
    """Returns campaign, task, noise and the explanations by some rivals, fitted.

    An oracle's, who knows which effects it may be.
    """
    models = []
    for kind in rivals:
        size = KINDS[kind].coefficients[0]
        effect = KINDS[kind](**{size.name: 0.05 * size.scale})
        models.append(GliderModel(effects=(effect,)))
    findings = Findings(models=tuple(models))
    known, _, task, noise = read_task(campaign(flights), findings)
    task = dataclasses.replace(task, kinds=tuple(rivals))
    return known, task, noise, explain(task, noise, findings)


def probability(explanations: Sequence[Explanation], kind: str) -> float:
    """Returns the probability of one effect alone."""
    return sum(e.probability for e in explanations if e.model.kinds == (kind,))


@functools.cache
def perch_throw() -> Throw:
    """Returns the plain perch of the nominal glider, as long as the logs are."""
    planned = plan(GliderModel(), PerchingProblem())
    duration = (ROWS - 1) / Capture().rate
    times = np.arange(int(duration * COMMAND_RATE) + 1) / COMMAND_RATE
    edges = np.append(times, times[-1] + 1.0 / COMMAND_RATE)
    elevator = sample_plan(planned, edges)[0][:, ELEVATOR]
    return Throw(
        launch=planned.states[0],
        times=times,
        commands=np.diff(elevator) * COMMAND_RATE,
        duration=duration,
    )
