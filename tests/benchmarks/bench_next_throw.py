"""Do designed throws tell rivals apart sooner? Prints a table; asserts nothing.

    python -m tests.benchmarks.bench_next_throw [--truths 4] [--first 0]
        [--pairs lag,pressure,incidence] [--most 16] [--jobs 1]

Each hidden truth is a glider of the simulator of `tests.helpers.lifelike`, which shares
no physics with the library, with one small effect of a pair; the air moves, and each
flight has its trim. Two flights of the random kind are given. Then one throw at a time
is flown, designed or random, until the right one of the pair has probability 0.95.
Launches miss what was asked for as `ThrowLimits` says. Only the pair is weighed: an
oracle that knows which two effects it may be.

A line a truth: flights that designed and random throws took, `>` where that was not
enough; and of the first designed throw the chance that was promised, and whether it
came true.
"""

import argparse
import dataclasses
from collections.abc import Sequence

import joblib
import numpy as np

from glider.campaign.logs import Campaign, Flight, campaign_of
from glider.design.explanations import Explanation, explain
from glider.design.findings import Findings
from glider.design.limits import ThrowLimits
from glider.design.proposal import propose, read_task
from glider.design.throws import Throw
from glider.physics.effects import KINDS
from glider.physics.model import GliderModel
from glider.physics.parameters import GliderParameters
from tests.helpers.lifelike import (
    COMMAND_RATE,
    Capture,
    draw_commands,
    draw_starts,
    log_flights,
)
from tests.helpers.lifelike_flight import STEP, Glider, elevator_paths, fly, gusts

PAIRS = {
    "lag": ("servo_lag", "command_delay"),
    "pressure": ("center_of_pressure", "pitch_moment"),
    "incidence": ("wing_incidence", "camber"),
}
"""Rivals by a short name."""

ENOUGH = 0.95
"""Probability of the right explanation that ends a campaign."""

GIVEN = 2
"""Flights of the random kind at the start."""

ROWS = round(0.85 * Capture().rate) + 1

AIR = (0.1, 0.25)
"""Standard deviation [m/s] and correlation time [s] of the gusts."""

TRIM = 0.01
"""Standard deviation of the flights' own trims [rad]."""


def plant(glider: Glider, kind: str, rng: np.random.Generator) -> None:
    """Gives a glider a small effect, so that its rival is close."""
    sign = rng.choice([-1.0, 1.0])
    if kind == "servo_lag":
        glider.servo.lag = rng.uniform(0.001, 0.002)
    elif kind == "command_delay":
        glider.servo.delay = rng.uniform(0.001, 0.002)
    elif kind == "center_of_pressure":
        shift = sign * rng.uniform(0.0015, 0.003)
        glider.wing_shift.append(lambda f: shift)
    elif kind == "pitch_moment":
        moment = sign * rng.uniform(0.0005, 0.001)
        glider.moment.append(lambda f: moment)
    elif kind == "wing_incidence":
        glider.wing_incidence = sign * rng.uniform(0.006, 0.012)
    elif kind == "camber":
        angle = sign * rng.uniform(0.006, 0.012)
        glider.normal.append(
            lambda f: 2.0 * (np.sin(f.alpha - angle) - np.sin(f.alpha))
        )


class Thrower:
    """Flies throws of a hidden glider, each in air and with a trim of its own."""

    def __init__(self, kind: str, seed: int):
        """Makes the glider with an effect."""
        self.rng = np.random.default_rng([seed, 7])
        self.glider = Glider()
        plant(self.glider, kind, self.rng)

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
        """Flies throws of the random kind."""
        rng = self.rng
        return self.fly(draw_starts(rng, count), draw_commands(rng, count), first)

    def designed(self, throw: Throw, first: int) -> list[Flight]:
        """Flies a throw that was proposed, its launch a little missed."""
        limits, noise = ThrowLimits(), self.rng.normal(size=3) / 2.0
        x, z, pitch, _, xdot, zdot, _ = throw.launch
        faster = 1.0 + limits.missed_speed * noise[0] / throw.speed
        start = np.zeros((4, 1), complex)
        start[0] = x + 1j * (z + limits.missed_height * noise[1])
        start[1] = (xdot + 1j * zdot) * faster
        start[2] = pitch + limits.missed_pitch * noise[2]
        return self.fly(start, throw.commands[:, None], first)


def campaign(flights: Sequence[Flight]) -> Campaign:
    """Returns flights as a campaign of the glider as drawn."""
    return campaign_of(
        "hidden", GliderParameters(), flights, Capture().rate, COMMAND_RATE
    )


def weigh(flights: Sequence[Flight], pair: tuple[str, str]):
    """Returns campaign, task, noise and the explanations of a pair, fitted."""
    start = GliderModel(effects=(KINDS[pair[0]](**_small(pair[0])),))
    findings = Findings(
        model=start, kinds=pair[:1], rivals={pair[0]: pair[1:]}, combinations=()
    )
    known, task, noise = read_task(campaign(flights), findings)
    task = dataclasses.replace(task, kinds=pair)
    return known, task, noise, explain(task, noise, findings)


def _small(kind: str) -> dict[str, float]:
    coefficients = KINDS[kind].coefficients
    return {c.name: 0.05 * c.scale for c in coefficients[:1]}


def probability(explanations: Sequence[Explanation], kind: str) -> float:
    """Returns the probability of one effect alone."""
    return sum(e.probability for e in explanations if e.model.kinds == (kind,))


@dataclasses.dataclass(frozen=True, kw_only=True)
class Line:
    """How one truth was found: flights, and what was promised of the first design."""

    kind: str
    seed: int
    designed: float
    random: float
    promised: float
    kept: bool
    seconds: float


def run(pair: tuple[str, str], seed: int, most: int) -> Line:
    """Finds one hidden truth twice."""
    kind = pair[seed % 2]
    promised, kept, seconds, taken = np.nan, False, [], {}
    for way in ("designed", "random"):
        thrower = Thrower(kind, seed)
        flights = thrower.random(GIVEN, 0)
        taken[way] = np.inf
        for count in range(most + 1):
            known, task, noise, explanations = weigh(flights, pair)
            if way == "designed" and count == 1:
                kept = explanations[0].model.kinds == (kind,)
            if probability(explanations, kind) >= ENOUGH:
                taken[way] = count
                break
            if way == "random":
                flights += thrower.random(1, len(flights))
                continue
            proposal = propose(
                known, task, noise, explanations, launches=1, seed=seed + count
            )
            seconds.append(proposal.seconds)
            if count == 0:
                promised = proposal.chance_then
            flights += thrower.designed(proposal.throws[0], len(flights))
    return Line(
        kind=kind,
        seed=seed,
        designed=taken["designed"],
        random=taken["random"],
        promised=promised,
        kept=kept,
        seconds=float(np.mean(seconds)) if seconds else np.nan,
    )


def main() -> None:
    """Runs the chosen truths."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--truths", type=int, default=4, help="of each pair")
    parser.add_argument("--first", type=int, default=0, help="first seed")
    parser.add_argument("--pairs", default=",".join(PAIRS))
    parser.add_argument("--most", type=int, default=16, help="flights at most")
    parser.add_argument("--jobs", type=int, default=1, help="truths at a time")
    args = parser.parse_args()
    tasks = [
        joblib.delayed(run)(PAIRS[name], args.first + seed, args.most)
        for name in args.pairs.split(",")
        for seed in range(args.truths)
    ]
    print("truth              seed designed random promised kept  time")
    lines: list[Line] = []
    for line in joblib.Parallel(n_jobs=args.jobs, return_as="generator")(tasks):
        lines.append(line)
        counts = [
            f">{args.most}" if n == np.inf else f"{n:.0f}"
            for n in (line.designed, line.random)
        ]
        print(
            f"{line.kind:18s} {line.seed:4d} {counts[0]:>8s} {counts[1]:>6s} "
            f"{line.promised:8.2f} {'yes' if line.kept else 'no':4s} "
            f"{line.seconds:5.1f} s",
            flush=True,
        )
    open_ = [x for x in lines if x.designed > 0 or x.random > 0]
    if open_:
        designed, random = (
            np.median([getattr(x, way) for x in open_])
            for way in ("designed", "random")
        )
        print(f"median flights: designed {designed:g}, random {random:g}")
    sure = [x for x in lines if x.promised >= 0.85]
    if sure:
        print(
            f"promised 0.85 or more: {len(sure)}, mean "
            f"{np.mean([x.promised for x in sure]):.2f}; came true: "
            f"{np.mean([x.kept for x in sure]):.2f}"
        )


if __name__ == "__main__":
    main()
