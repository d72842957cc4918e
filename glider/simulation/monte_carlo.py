"""Monte-Carlo over launches: how often does a glider perch?

A sweep runs through joblib: the caller chooses the workers, up to a cluster. With Dask
(the extra `cluster`):

    with Client(address), joblib.parallel_config(backend="dask"):
        results = sweep(cases, flights=100_000, seed=0)
"""

import dataclasses
import math
from collections.abc import Sequence

import joblib
import numpy as np

from glider.errors import expect
from glider.physics.model import GliderModel
from glider.physics.state import NUM_STATES, STATE_NAMES, VELOCITY
from glider.planning.problem import PerchingProblem
from glider.simulation.flown_flights import Flights
from glider.simulation.fly import AFTER, STEP, Policy, fly, make_clock

CHUNK = 2500
"""Number of flights in one task of a sweep. Another number means other random draws."""

_Z, _PITCH = STATE_NAMES.index("z"), STATE_NAMES.index("pitch")


@dataclasses.dataclass(frozen=True, kw_only=True)
class LaunchSpread:
    """Standard deviations of normally distributed launch errors."""

    height: float = 0.04
    """Deviation of the height [m]."""

    speed: float = 0.1
    """Deviation of the speed along the launch velocity [m/s]."""

    pitch: float = 0.02
    """Deviation of the pitch [rad]."""

    def __post_init__(self):
        """Raises InputError where a deviation is negative or not finite."""
        for name, value in dataclasses.asdict(self).items():
            good = math.isfinite(value) and value >= 0.0
            expect(good, f"LaunchSpread: '{name}'", value, "a number not negative")

    def scaled(self, times: float) -> "LaunchSpread":
        """Launch errors so many times as large."""
        return LaunchSpread(
            height=times * self.height,
            speed=times * self.speed,
            pitch=times * self.pitch,
        )

    def draw(
        self, problem: PerchingProblem, count: int, rng: np.random.Generator
    ) -> np.ndarray:
        """Draws perturbed launch states of a problem, (count, 7)."""
        expect(count >= 1, "LaunchSpread.draw: 'count'", count, "at least 1")
        errors = rng.normal(size=(count, 3)) * [self.height, self.speed, self.pitch]
        starts = np.tile(np.array(problem.launch, dtype=float), (count, 1))
        velocity = starts[:, VELOCITY]
        along = velocity / np.linalg.norm(velocity[0])
        starts[:, _Z] += errors[:, 0]
        starts[:, VELOCITY] += errors[:, 1:2] * along
        starts[:, _PITCH] += errors[:, 2]
        return starts


@dataclasses.dataclass(frozen=True, kw_only=True)
class Case:
    """One row of a sweep: a glider, its feedback and how it is launched."""

    name: str
    """Name, different from the other cases'."""

    model: GliderModel
    """The glider that is flown."""

    policy: Policy
    """The feedback."""

    problem: PerchingProblem
    """Launch, wire and hook."""

    spread: LaunchSpread = LaunchSpread()
    """Spread of the launches."""

    command_rate: float | None = None
    """Rate of held commands as in `fly` [Hz]."""

    feedback_noise: tuple[float, ...] = (0.0,) * NUM_STATES
    """Standard deviation of the measured STATE_NAMES; needs a command rate."""

    step: float = STEP
    """Longest step as in `fly` [s]."""

    after: float = AFTER
    """Time flown after the plan as in `fly` [s]."""


def fly_case(case: Case, flights: int, rng: np.random.Generator) -> Flights:
    """Draws and flies launches of a case."""
    starts = case.spread.draw(case.problem, flights, rng)
    noise = None
    if any(case.feedback_noise):
        clock = make_clock(case.policy, case.command_rate, case.step, case.after)
        states = len(case.policy.state_names)
        noise = np.zeros((flights, clock.commands, states))
        drawn = rng.normal(size=(flights, clock.commands, NUM_STATES))
        noise[:, :, :NUM_STATES] = drawn * case.feedback_noise
        what = f"case '{case.name}': the command rate"
        expect(clock.hold, what, None, "a number, as there is feedback noise")
    return fly(
        case.model,
        case.policy,
        starts,
        problem=case.problem,
        command_rate=case.command_rate,
        noise=noise,
        step=case.step,
        after=case.after,
    )


def sweep(cases: Sequence[Case], flights: int, seed: int) -> list[Flights]:
    """Flies many launches of each case, in chunks that workers share.

    The result depends on the seed alone, not on the workers. All cases get the
    same launches, so that chance does not add to their differences.

    Args:
        cases: what to fly.
        flights: launches of each.
        seed: of the launches and the noise.

    Returns:
        The flights of each case, without paths.
    """
    expect(flights >= 1, "sweep: 'flights'", flights, "at least 1")
    counts = [min(CHUNK, flights - first) for first in range(0, flights, CHUNK)]
    seeds = np.random.SeedSequence(seed).spawn(len(counts))
    tasks = [
        joblib.delayed(_fly_chunk)(case, count, seed)
        for case in cases
        for count, seed in zip(counts, seeds, strict=True)
    ]
    done = joblib.Parallel()(tasks)
    return [
        _joined(done[k * len(counts) : (k + 1) * len(counts)])
        for k in range(len(cases))
    ]


def _fly_chunk(case: Case, flights: int, seed: np.random.SeedSequence) -> Flights:
    return fly_case(case, flights, np.random.default_rng(seed))


def _joined(chunks: list[Flights]) -> Flights:
    return Flights(
        times=chunks[0].times,
        miss=np.concatenate([chunk.miss for chunk in chunks]),
        arrivals=np.concatenate([chunk.arrivals for chunk in chunks]),
        problem=chunks[0].problem,
        ends=np.concatenate([chunk.ends for chunk in chunks]),
    )
