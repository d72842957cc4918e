"""Is a servo that differs from its file named as what it is? Prints a table.

    python -m benchmarks.bench_servo [KIND ...] [--seeds 2] [--flights 16]

An independent simulator (tests/helpers/lifelike) flies gliders whose servo has one
fault, with the elevator's angle logged beside its commands; each is traced by
`close_the_loop`. The mass and inertia of the glider, the noise of the angle (2, 5 and
10 mrad), a drag (of odd seeds) and moving air (of every third seed) change with the
seed. A row a campaign: the verdict, whether the fault is named, by an effect or in the
findings of the log, effects that are named wrongly, and what the log's findings say.
"""

import argparse
import dataclasses
import math
import time
from typing import NamedTuple

import numpy as np

from glider.campaign.logs import Campaign
from glider.errors import InputError
from glider.sysid.pipeline import close_the_loop
from tests.helpers.lifelike import (
    COMMAND_RATE,
    ELEVATOR_RATE_LIMIT,
    Capture,
    draw_commands,
    draw_starts,
    log_flights,
)
from tests.helpers.lifelike_flight import STEP, Glider, Motion, fly, gusts

ROWS = 103
NOISES = (0.002, 0.005, 0.01)  # Of the measured angle [rad].
DRAG = 0.05  # C_D of odd seeds.
GUSTS = (0.1, 0.3)  # [m/s] and [s], of every third seed.
TOUR = 3  # Flights along the load that the last one had: it then changes no more.


@dataclasses.dataclass(frozen=True, kw_only=True)
class Fault:
    """A servo, as it is, and by what it is named rightly."""

    says: str  # Part of a finding of the log, or the effect.
    low: float = -0.4463  # Stops [rad].
    high: float = 0.9473
    rate: float = ELEVATOR_RATE_LIMIT  # [rad/s]
    rate_per_load: float = 0.0  # Share of the rate that is lost [1/N].
    up: float = 0.0  # Lags of turning up and down [s].
    down: float = 0.0
    lag_per_load: float = 0.0  # [s/N]
    play: float = 0.0  # [rad]
    slew: float = math.inf  # Of the elevator behind its servo [rad/s].
    delay: float = 0.0  # [s]
    trim: float = 0.0  # True minus read angle [rad].
    lost: float = 0.0  # Share of the commands; that before is held.
    step: float = 0.0  # In which commands reach it [rad/s].
    logged_step: float = 0.0  # In which they are logged [rad/s].


FAULTS = {
    "none": Fault(says=""),
    "stop up": Fault(says="stops at", high=0.5),
    "both stops": Fault(says="stops at", low=-0.1, high=0.55),
    "rate limit": Fault(says="rad/s at most", rate=7.0),
    "lag": Fault(says="servo_lag", up=0.04, down=0.04),
    "lag up": Fault(says="turning up", up=0.05, down=0.006),
    "lag down": Fault(says="turning down", up=0.006, down=0.04),
    "lag by load": Fault(
        says="lag that grows with", up=0.01, down=0.01, lag_per_load=0.12
    ),
    "rate by load": Fault(says="rate limit that falls", rate_per_load=2.0),
    "slew": Fault(says="catches up", up=0.02, down=0.02, slew=5.0),
    "play 0.015": Fault(says="free play", play=0.015),
    "play 0.04": Fault(says="free play", play=0.04),
    "lost": Fault(says="loses", lost=0.1),
    "rounded 0.5": Fault(says="rounds its commands", step=0.5),
    "rounded 1": Fault(says="rounds its commands", step=1.0),
    "log rounded 1": Fault(says="a log that rounds", logged_step=1.0),
    "late": Fault(says="command_delay", delay=0.015),
    "zero": Fault(says="elevator_trim", trim=0.04),
}


class Flown(NamedTuple):
    """A campaign of a servo with a fault, and what is true of it."""

    campaign: Campaign
    names: frozenset[str]  # Effects that are there beside the servo.


def turn(
    fault: Fault, commands: np.ndarray, load: np.ndarray, rng: np.random.Generator
) -> np.ndarray:
    """Returns the elevator's angles (2 K + 1, F) at every half STEP [rad].

    Args:
        fault: of the servo.
        commands: (H, F) rates [rad/s], each held for a period.
        load: (2 K + 1, F) size of the force on the tail [N].
        rng: of what is lost.
    """
    given = commands.copy()
    gone = rng.random(commands.shape) < fault.lost
    for k in range(1, len(given)):
        given[k] = np.where(gone[k], given[k - 1], given[k])
    if fault.step:
        given = fault.step * np.round(given / fault.step)
    h = 0.5 * STEP
    demanded = np.zeros(commands.shape[1])
    behind = demanded.copy()
    angle = demanded.copy()
    angles = np.zeros_like(load)
    for k in range(len(load) - 1):
        held = int(np.floor((k * h - fault.delay) * COMMAND_RATE + 1e-6))
        asked = given[min(held, len(given) - 1)] if held >= 0 else 0.0 * demanded
        most = fault.rate * np.maximum(1.0 - fault.rate_per_load * load[k], 0.1)
        demanded = demanded + h * np.clip(asked, -most, most)
        demanded = np.clip(demanded, fault.low, fault.high)
        lag = np.where(demanded > behind, fault.up, fault.down)
        lag = lag + fault.lag_per_load * load[k]
        share = -np.expm1(-h / np.maximum(lag, 1e-6))
        most = h * fault.slew
        behind = behind + np.clip(share * (demanded - behind), -most, most)
        half = 0.5 * fault.play
        angle = np.clip(angle, behind - half, behind + half)
        angles[k + 1] = angle
    return angles


def load_of(glider: Glider, motion: Motion) -> np.ndarray:
    """Returns the size of the force on the tail (2 K + 1, F) at every half STEP [N]."""
    axis = np.exp(-1j * motion.pitch)
    normal = 1j * axis * np.exp(-1j * motion.elevator)
    arm = -(glider.hinge_offset + glider.elevator_offset) * axis
    through = motion.velocity - 1j * motion.pitchdot * arm
    across = (np.conj(normal) * through).real
    force = glider.air_density * glider.elevator_area * across * np.abs(through)
    fine = 0.5 * np.arange(2 * len(force) - 1)
    whole = np.arange(len(force))
    columns = [np.interp(fine, whole, column) for column in np.abs(force).T]
    return np.stack(columns, axis=1)


def simulate(fault: Fault, seed: int, flights: int) -> Flown:
    """Flies and logs a campaign of a servo with a fault."""
    rng = np.random.default_rng(seed)
    mass = rng.uniform(0.06, 0.11)
    inertia = mass * rng.uniform(0.015, 0.024)
    glider = Glider(mass=mass, pitch_inertia=inertia, elevator_trim=fault.trim)
    names = set[str]()
    if seed % 2:
        glider.drag.append(lambda flow: DRAG)
        names.add("profile_drag")
    rate = Capture().rate
    capture = Capture(elevator=NOISES[seed % len(NOISES)])
    steps = round((ROWS - 1) / rate / STEP)
    commands = draw_commands(rng, flights)
    start = draw_starts(rng, flights)
    shape = (2 * steps + 1, flights)
    air = gusts(rng, *GUSTS, shape) if seed % 3 == 2 else None
    load = np.zeros(shape)
    chance = rng.integers(2**32)
    for _ in range(TOUR if fault.lag_per_load or fault.rate_per_load else 1):
        elevator = turn(fault, commands, load, np.random.default_rng(chance))
        motion = fly(glider, start, elevator, air)
        load = load_of(glider, motion)
    told = commands
    if fault.logged_step:
        told = fault.logged_step * np.round(commands / fault.logged_step)
    names_of = ("mass", "pitch_inertia", "wing_area", "elevator_area", "wing_offset")
    more = ("hinge_offset", "elevator_offset", "air_density", "gravity")
    return Flown(
        Campaign.from_arrays(
            [
                {
                    "time": f.time,
                    "x": f.pose[:, 0],
                    "z": f.pose[:, 1],
                    "pitch": f.pose[:, 2],
                    "elevator": f.elevator,
                    "elevator_rate_command": f.command,
                }
                for f in log_flights(rng, glider, motion, capture, told)
            ],
            {name: float(getattr(glider, name)) for name in (*names_of, *more)}
            | {
                "elevator_limits": list(glider.elevator_limits),
                "elevator_rate_limit": ELEVATOR_RATE_LIMIT,
            },
            pose_rate=rate,
            command_rate=COMMAND_RATE,
        ),
        frozenset(names),
    )


def main() -> None:
    """Prints a row for each campaign."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("kinds", nargs="*", metavar="KIND", help=", ".join(FAULTS))
    parser.add_argument("--seeds", type=int, default=2, help="campaigns a kind")
    parser.add_argument("--flights", type=int, default=16, help="flights of each")
    args = parser.parse_args()
    right = false = count = 0
    print("| servo | seed | verdict | named | false effects | s | the log |")
    print("|---|---|---|---|---|---|---|")
    for kind in args.kinds or FAULTS:
        fault = FAULTS[kind]
        for seed in range(args.seeds):
            campaign, names = simulate(fault, seed, args.flights)
            begin = time.perf_counter()
            try:
                result = close_the_loop(campaign)
                verdict = result.verdict
                kinds = {effect.kind for effect in result.effects}
                says = " ".join(result.log_findings)
            except InputError as error:
                verdict, kinds, says = "refused", set(), str(error)
            taken = time.perf_counter() - begin
            own = fault.says
            is_named = own in kinds or own in says if own else not says
            right_names = {own, "unexplained", *names}
            if fault.up or fault.down:
                right_names.add("servo_lag")
            wrong = sorted(kinds - right_names)
            count += 1
            right += is_named
            false += len(wrong)
            print(
                f"| {kind} | {seed} | {verdict} | {'yes' if is_named else 'NO'} | "
                f"{', '.join(wrong) or '-'} | {taken:.0f} | {says or '-'} |",
                flush=True,
            )
    print(f"\n{right} of {count} named, {false} effects named wrongly.")


if __name__ == "__main__":
    main()
