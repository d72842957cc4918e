"""AeroID's output error and filter error beside our fit and our search.

The flights are lifelike ones of an independent simulator, without flight-to-flight
variation; all but our search are given the right formulas. The physics is ours on both
sides, compiled. AeroID takes one log and fits no launch: all flights are one state
vector, and output error flies our compiled rollouts through AeroID's interface for
simulators, with the launch states among its parameters. Filter error is given the true
noise, and the gusts as states with their true spectrum; it estimates launches by its
first covariance.
"""

import bisect
import time
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from scipy.special import stdtrit
from threadpoolctl import threadpool_limits

from glider.campaign.logs import Campaign
from glider.compiled import replay
from glider.compiled.kernel import Family
from glider.physics.chain import derivatives, theta_of
from glider.physics.effects import NO_GAUSSIANS
from glider.sysid.likelihood.linear_flight import STILL_AIR, path_of
from glider.sysid.likelihood.model_fit import fit_model
from glider.sysid.likelihood.task import FitResult, Task
from glider.sysid.likelihood.uncertainty import uncertainty_of
from glider.sysid.pipeline import close_the_loop
from glider.sysid.replay.replayed import signals, true_nodes
from tests.helpers.known_truth import begin, task_of
from tests.helpers.lifelike import Truth, draw_campaign

FLIGHTS, CAMPAIGNS, LEVEL = 8, 10, 0.95
KINDS = "attached_lift", "profile_drag", "pitch_damping"
USUAL = 2.5, 0.265, 0.05, 0.06, 0.0165
"""Where AeroID starts: the middles of the ranges that true coefficients are drawn from.
From farther away, as our fit starts, its filter error ends in other minima."""

OPTIONS = {"ftol": 1e-6, "xtol": 1e-6}
"""Tolerances of AeroID's optimizer: with its own, a hundred times less, it takes longer
to change them by much less than their errors."""

MOTION = "x", "z", "pitch", "elevator", "xdot", "zdot", "pitchdot"
STATES = *MOTION, "gust_x", "gust_z"
"""The elevator is its constant offset from its replayed path."""

OUTPUTS = MOTION[:4]

LAUNCH = np.array([0.003, 0.003, 0.01, 0.001, 0.05, 0.05, 0.3])
"""Typical errors of smoothed launch states: units of AeroID's parameters of them."""


def flight_slopes(states, elevator, rate, numbers, gaussians, x, slopes):
    """Writes d/dt of STATES (9, F), but of the gusts; x (n,) is scratch, 0 from 7."""
    theta = theta_of(numbers, gaussians)
    for i in range(states.shape[1]):
        for j in range(7):
            x[j] = states[j, i]
        x[3] += elevator[i]
        d = derivatives(0.0, x, rate[i], states[7, i], states[8, i], theta)
        for j in range(7):
            slopes[j, i] = d[j]
        slopes[3, i] = 0.0


SLOPES = Family((flight_slopes,), (flight_slopes,))


class Estimates(NamedTuple):
    """What a program found of a campaign."""

    values: dict[str, float]  #: "kind.coefficient" to its value; absent if not found.
    stds: dict[str, float]
    freedom: float  #: Degrees of freedom of its intervals.
    seconds: float  #: Processor time.


class Identification:
    """A campaign as AeroID takes it."""

    def __init__(self, task: Task, start: FitResult, truth: Truth) -> None:
        self.task, self.truth, self.theta = task, truth, start.theta
        space = task.space
        self.slots = {
            space.names[slot]: slot for kind in KINDS for slot in space.slots_of(kind)
        }
        self.guess = dict(zip(self.slots, USUAL, strict=True))
        self.paths = [path_of(r, start.theta, STILL_AIR)[0] for r in task.records]
        self.elevator = np.stack([path.elevator for path in self.paths], axis=2)
        self.rate = np.stack([path.rate for path in self.paths], axis=1)
        nodes = [true_nodes(record, start.theta)[0] for record in task.records]
        self.launches = np.stack(nodes)
        sensors = truth.capture
        stds = [sensors.position, sensors.position, sensors.pitch, sensors.elevator]
        self.gust_rate = 1.0 / (truth.air_correlation or 1.0)
        self.noise = np.repeat(stds, FLIGHTS)
        self.time = task.records[0].time
        self.rows, self.last = self.time.tolist(), ((), np.zeros(0))
        assert all(np.allclose(r.time, self.time) for r in task.records)

    def numbers(self, parameters) -> np.ndarray:
        """Returns the numbers of the compiled dynamics at AeroID's parameters."""
        theta = self.theta.copy()
        for name, slot in self.slots.items():
            theta[slot] = parameters[name]
        return theta

    def names(self, states) -> list[str]:
        """Returns the names of some states of all flights.

        Outputs are the first of the states, as AeroID 0.5 takes them to be: without a
        function of the measurement, output j is state j, whatever their names.
        """
        return [f"{name}_{i}" for name in states for i in range(FLIGHTS)]

    def data(self):
        """Returns the measured poses as AeroID's log."""
        from aeroid import FlightData

        columns = [
            [*r.pose.T, r.elevator - signals(r, self.theta).logged]
            for r in self.task.records
        ]
        measured = np.concatenate(np.swapaxes(columns, 0, 1))
        return FlightData(
            self.time, dict(zip(self.names(OUTPUTS), measured, strict=True))
        )

    def output_error(self):
        """Returns what AeroID finds by rollouts, launches among its parameters."""
        from aeroid import identify

        model = _Rollouts(self)
        weights = dict(zip(model.outputs, 1.0 / self.noise, strict=True))
        return identify(
            model,
            self.data(),
            list(model.parameters),
            weights=weights,
            optimizer_options=OPTIONS,
        )

    def filter_error(self):
        """Returns what AeroID finds by the innovations of its Kalman filter."""
        from aeroid import Model, identify

        air, rate = max(self.truth.air_std, 1e-4), self.gust_rate
        launches = np.zeros((len(STATES), FLIGHTS))
        launches[:7] = self.launches.T[:7]
        spectrum = [*[0.0] * 7, *[2.0 * rate * air**2] * 2]
        first = [*(25.0 * LAUNCH**2), *[air**2] * 2]
        model = Model(
            states=self.names(STATES),
            controls=(),
            parameters=dict(self.guess),
            dynamics=lambda t, x, u, p: self.rates(
                t, x.reshape(launches.shape), p
            ).ravel(),
            outputs=self.names(OUTPUTS),
        )
        return identify(
            model,
            self.data(),
            list(self.guess),
            method="filter_error",
            x0=launches.ravel(),
            process_noise=np.diag(np.repeat(spectrum, FLIGHTS)),
            measurement_noise=np.diag(self.noise**2),
            optimizer_options=OPTIONS,
            filter_options={"P0": np.diag(np.repeat(first, FLIGHTS))},
        )

    def rates(self, t: float, states: np.ndarray, parameters) -> np.ndarray:
        """Returns d/dt of STATES (9, FLIGHTS); gusts only shift the velocities."""
        k = max(bisect.bisect_left(self.rows, t + 1e-9) - 1, 0)
        k = min(k, len(self.elevator) - 1)
        node = round(2.0 * (t - self.rows[k]) / (self.rows[k + 1] - self.rows[k]))
        values = tuple(parameters.values())
        if values != self.last[0]:
            self.last = values, self.numbers(parameters)
        slopes = np.empty_like(states)
        fly = SLOPES.over(self.task.space.flown).flight_slopes
        path = self.elevator[k, node], self.rate[k]
        fly(states, *path, self.last[1], NO_GAUSSIANS, self.launches[0].copy(), slopes)
        slopes[7:] = -self.gust_rate * states[7:]
        return slopes


class _Rollouts:
    """Our compiled rollouts as a simulator of AeroID's."""

    states, controls, name = (), (), "rollouts"

    def __init__(self, own: Identification) -> None:
        self.own, self.outputs = own, tuple(own.names(OUTPUTS))
        launches = own.names([f"launch_{name}" for name in MOTION])
        self.parameters = own.guess | dict.fromkeys(launches, 1.0)

    def simulate(self, time, controls, x0, parameters=None, **options):
        """Flies all flights."""
        from aeroid import SimulationResult

        given, own = self.parameters | dict(parameters or {}), self.own
        size, numbers = len(own.guess), own.numbers(given)
        shifts = np.array(list(given.values()))[size:].reshape(-1, FLIGHTS).T - 1.0
        flown = []
        for path, launch, shift in zip(own.paths, own.launches, shifts, strict=True):
            start = launch.copy()
            start[:7] += LAUNCH * shift
            kinds = own.task.space.flown
            states = replay.roll_out(kinds, path, start, numbers, NO_GAUSSIANS)
            flown.append(states[:, :4])
        outputs = np.concatenate(np.moveaxis(flown, 2, 0)).T
        return SimulationResult(own.time, outputs[:, :0], outputs, (), self.outputs)

    def simulate_data(self, data, parameters=None, x0=None, **options):
        """Flies all flights."""
        return self.simulate(data.time, None, x0, parameters)


def theirs(found, names, seconds: float) -> Estimates:
    """Returns AeroID's estimates of some parameters."""
    values = {name: found.parameters[name] for name in names}
    stds = {name: found.stderr[name] for name in names}
    return Estimates(values, stds, float(found.dof), seconds)


def fitted(campaign: Campaign) -> Estimates:
    """Returns our fit of the right effects, from the logs on."""
    began = time.process_time()
    task, noise = task_of(campaign)
    model = fit_model(task, begin(task, noise, KINDS), iterations=20)
    known = uncertainty_of(task, model)
    names = {i: task.space.names[i] for i in known.named}
    return Estimates(
        {name: float(model.theta[i]) for i, name in names.items()},
        {name: known.std(i) for i, name in names.items()},
        known.covariance[1],
        time.process_time() - began,
    )


def searched(campaign: Campaign) -> Estimates:
    """Returns what close-the-loop finds, which is given no effect."""
    began = time.process_time()
    result = close_the_loop(campaign)
    found = {
        f"{effect.kind}.{name}": estimate
        for effect in result.effects
        for name, estimate in effect.coefficients.items()
    }
    freedom = result.covariance and result.covariance.degrees_of_freedom
    return Estimates(
        {name: own.value for name, own in found.items()},
        {name: own.std for name, own in found.items()},
        freedom or np.inf,
        time.process_time() - began,
    )


def identify_all(seed: int, moving_air: bool) -> tuple[Truth, dict[str, Estimates]]:
    """Returns a campaign's truth and what each program finds."""
    planted = [(kind, "library") for kind in KINDS]
    campaign, truth = draw_campaign(
        seed, FLIGHTS, planted, moving_air=moving_air, spreads=False, broken=False
    )
    task, noise = task_of(campaign)
    own = Identification(task, begin(task, noise, KINDS), truth)
    found = {}
    for words, run in (
        ("AeroID, output error", own.output_error),
        ("AeroID, filter error", own.filter_error),
    ):
        began = time.process_time()
        try:
            answer = run()
        except Exception as error:  # Of any kind, as theirs are.
            print(f"{words} fails on seed {seed}: {error}")
            found[words] = Estimates({}, {}, 1.0, time.process_time() - began)
            continue
        found[words] = theirs(answer, own.guess, time.process_time() - began)
    found["ours, the same effects given"] = fitted(campaign)
    found["ours, close-the-loop"] = searched(campaign)
    return truth, found


def rows(campaigns: int = CAMPAIGNS) -> list[str]:
    """Returns the table of so many campaigns, half of them in still air."""
    import aeroid  # noqa: F401  It is not installed, or it is, before any work.

    with threadpool_limits(1):
        drawn = [identify_all(seed, bool(seed % 2)) for seed in range(campaigns)]
    return [
        "| air | program | processor time | median error | largest | 95 % intervals |",
        "|---|---|---|---|---|---|",
        *(line for air in (0, 1) for line in rows_of(drawn[air::2])),
    ]


def rows_of(drawn: Sequence[tuple[Truth, dict[str, Estimates]]]) -> Iterator[str]:
    """Yields the rows of campaigns in the same air."""
    air = "gusts" if drawn[0][0].air_std else "still"
    for words in drawn[0][1]:
        errors, holds, asked = [], [], 0
        for truth, found in drawn:
            own, right = found[words], truth.coefficients
            asked += len(right)
            most = stdtrit(own.freedom, 0.5 * (1.0 + LEVEL))
            for name in right.keys() & own.values.keys():
                error = abs(own.values[name] - right[name])
                errors.append(error / abs(right[name]))
                holds.append(error <= most * own.stds[name])
        seconds = np.median([found[words].seconds for _, found in drawn])
        errors = errors or [np.nan]
        yield (
            f"| {air} | {words} | {seconds:.3g} s | {np.median(errors):.2%} | "
            f"{max(errors):.1%} | {sum(holds)} of {len(holds)} ({asked} asked) |"
        )
