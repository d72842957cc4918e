"""How well are elevators followed that no servo explains?

Elevators of commands that lost or rounded some of them, of a servo that lags one way,
and of one with play are measured with noise. For each order of the smoothing and each
noise: the error of the smoothed departure, and its ratio to the standard error that a
Gaussian process of this order has. `servo_forms` takes the order of the least errors,
and `servo_fit` the largest of its ratios.

    python -m benchmarks.bench_departures
"""

from collections.abc import Callable

import numpy as np

from glider.campaign.checks.masks import masks_of
from glider.campaign.checks.servo import command_tape
from glider.campaign.logs import Campaign
from glider.campaign.smoothing import estimate_noise, smoothing_maps
from glider.compiled.actuators import elevator_path
from glider.physics.model import GliderModel
from glider.simulation.campaigns import CampaignPlan

SEED = 0
ORDERS = (1, 2, 3)
NOISES = (0.001, 0.005)  # Of the measured angle [rad].
PLAY = 0.04  # Of the elevator behind its servo [rad].
LAGS = (0.05, 0.006)  # Of turning up and down [s].
STEP = 2.5e-4  # Of an integration [s].

Path = Callable[[np.ndarray, np.ndarray, np.ndarray, np.random.Generator], np.ndarray]


def lose(switches, commands, time, rng):
    """Follows commands of which one in fifty is another than the log has."""
    others = rng.normal(0.0, 4.0, len(commands)) * (rng.random(len(commands)) < 0.02)
    return elevator_path(switches, commands + others, time)


def quantize(switches, commands, time, rng):
    """Follows commands that the log has in steps of 0.2 rad/s."""
    rounded = rng.uniform(-0.1, 0.1, len(commands))
    return elevator_path(switches, commands + rounded, time)


def lag_upward(switches, commands, time, rng):
    """Lags longer where it turns faster upward."""
    fine = np.arange(time[0], time[-1] + STEP, STEP)
    held = np.searchsorted(switches, fine, side="right") - 1
    angle = np.zeros(len(fine))
    rate = 0.0
    for k, command in enumerate(commands[np.clip(held, 0, None)][:-1]):
        rate += (command - rate) * STEP / LAGS[int(command <= rate)]
        angle[k + 1] = angle[k] + rate * STEP
    return np.interp(time, fine, angle)


def play(switches, commands, time, rng):
    """Follows its servo with a play."""
    angle = 0.0
    angles = []
    for asked in elevator_path(switches, commands, time):
        angle = min(max(angle, asked - 0.5 * PLAY), asked + 0.5 * PLAY)
        angles.append(angle)
    return np.array(angles)


def compare(campaign: Campaign, path: Path, noise: float) -> list[str]:
    """Returns error [mrad] and ratio of each order, as text."""
    rng = np.random.default_rng(SEED)
    times = []
    departures = []
    measured = []
    for flight in campaign.flights:
        tape = command_tape(flight, masks_of(flight, {}), campaign.switch_rate)
        expected = elevator_path(tape.switches, tape.commands, flight.time)
        true = path(tape.switches, tape.commands, flight.time, rng) - expected
        times.append(flight.time)
        departures.append(true)
        measured.append(true + noise * rng.standard_normal(len(true)))
    columns = []
    for order in ORDERS:
        values = [own[:, None] for own in measured]
        [found] = estimate_noise(times, values, order)
        squares = []
        variances = []
        for time, true, own in zip(times, departures, measured, strict=True):
            smoothed = smoothing_maps(time, time, found.ratio, order)[0]
            squares.append(np.mean((smoothed @ own - true) ** 2))
            variances.append(found.noise**2 * np.mean(smoothed.diagonal()))
        error = np.sqrt(np.mean(squares))
        expected = np.sqrt(np.mean(variances))
        columns.append(f"{1e3 * error:5.2f} {error / max(expected, 1e-9):6.2f}")
    return columns


def main() -> None:
    """Prints a row for each departure and noise."""
    plan = CampaignPlan(flights=20)
    campaign = plan.simulate(GliderModel(), np.random.default_rng(SEED))
    head = "   ".join(f"order {order} [mrad, -]" for order in ORDERS)
    print(f"{'departure':12s} noise [mrad]   {head}")
    for path in (lose, quantize, lag_upward, play):
        for noise in NOISES:
            columns = "           ".join(compare(campaign, path, noise))
            print(f"{path.__name__:12s} {1e3 * noise:8.1f}       {columns}")


if __name__ == "__main__":
    main()
