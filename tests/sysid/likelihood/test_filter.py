"""The filter's likelihood is that of one big Gaussian, written out."""

import dataclasses

import numba
import numpy as np
import pytest

from glider.compiled.filter_error import _filter_columns, no_flight
from glider.physics.effects import NO_GAUSSIANS
from glider.sysid.likelihood import filtering
from glider.sysid.likelihood.directions import slopes
from glider.sysid.likelihood.filtering import (
    negative_log_likelihood,
    score,
    smooth,
    start_variances,
    whiten,
)
from glider.sysid.likelihood.linear_flight import linearize
from glider.sysid.likelihood.scales import MOMENT_TIME, Scales
from tests.helpers.tasks import fly, task_of

ROWS = 14
SCALES = Scales(air=0.2, air_time=0.1, moment=5.0, wind=0.1, trim=0.02, pitch_zero=0.01)


def first_rows(record):
    """The beginning of a flight."""
    ends = dict.fromkeys(("pitch", "bank", "side_wind"), ROWS - 1)
    for name in ("time", "pose", "elevator", "seen", "nodes", "departure"):
        ends[name] = ROWS
    cut = {name: getattr(record, name)[:end] for name, end in ends.items()}
    return dataclasses.replace(record, **cut)


@pytest.fixture(scope="module")
def flight():
    """A short flight with columns of a force, a sensor, the servo and a state."""
    campaign = fly(flights=2, duration=0.3)
    task, _ = task_of(campaign)
    space, record = task.space, first_rows(task.records[0])
    kinds = ("profile_drag", "marker_offset", "servo_lag", "dynamic_stall")
    free = [i for kind in kinds for i in space.slots_of(kind)]
    theta = task.vehicle.theta.copy()
    theta[list(space.slots_of("servo_lag"))] = 0.02
    theta[space.slots_of("dynamic_stall")[0]] = 0.3
    return linearize(record, theta, NO_GAUSSIANS, slopes(space, free))


def unseen(flight, *entries):
    """The flight with some rows of some channels not measured."""
    seen = flight.record.seen.copy()
    for rows, channel in entries:
        seen[rows, channel] = False
    record = dataclasses.replace(flight.record, seen=seen)
    return dataclasses.replace(flight, record=record)


class Written:
    """The linear system of a flight, from its definition."""

    def __init__(self, flight, scales):
        self.flight, self.scales = flight, scales
        self.n = len(flight.states)
        self.times = np.array(
            [scales.air_time, scales.air_time, MOMENT_TIME, MOMENT_TIME]
        )

    def ahead(self, k, state):
        """Motion, then gust (2), moment, servo, wind (2), trim, pitch zero."""
        flight, n = self.flight, self.n
        motion, (gx, gz, moment, servo, wx, wz, trim, zero) = state[:n], state[n:]
        step = flight.record.time[k + 1] - flight.record.time[k]
        by_x = flight.moves[k, :, :n]
        new = by_x @ motion
        new += flight.moves[k, :, n : n + 2] @ np.array([gx + wx, gz + wz])
        by_elevator = by_x[:, 3].copy()
        by_elevator[3] = 0.0  # The offset itself stays.
        new += by_elevator * (trim + servo)
        new[2] += 0.5 * step**2 * moment
        new[6] += step * moment
        keep = np.exp(-step / self.times)
        return np.concatenate(
            [new, keep * np.array([gx, gz, moment, servo]), [wx, wz, trim, zero]]
        )

    def seen(self, k, state):
        n = self.n
        shows = self.flight.shows[k % len(self.flight.shows)]
        pose = shows[:3, :n] @ state[:n]
        pose[2] += state[n + 7]
        shown = [*pose, state[3] + state[n + 3], state[6]]
        return np.array(shown[: self.flight.record.seen.shape[1]])

    def states(self, start, pushes):
        """Returns the states (K + 1, n + 8) from a start, pushed in each interval."""
        states = [start]
        for k, push in enumerate(pushes):
            states.append(self.ahead(k, states[-1]) + push)
        return np.array(states)

    def respond(self, start, pushes):
        """Returns what is seen (K + 1, C) of a start, pushed in each interval."""
        states = self.states(start, pushes)
        return np.array([self.seen(k, state) for k, state in enumerate(states)])

    def factors(self):
        """Returns starts and pushes, each as far as its standard deviation."""
        flight, s, n = self.flight, self.scales, self.n
        rows, total = len(flight.record.time), n + 8
        still = np.zeros((rows - 1, total))
        found = [(d, still) for d in np.diag(np.sqrt(start_variances(flight, s)))]
        steady = np.array([s.air, s.air, s.moment, s.servo])
        for k in range(rows - 1):
            step = flight.record.time[k + 1] - flight.record.time[k]
            for p in range(4):
                push = still.copy()
                left = 1.0 - np.exp(-2.0 * step / self.times[p])
                push[k, n + p] = steady[p] * np.sqrt(left)
                found.append((np.zeros(total), push))
        return found

    def gaussian(self):
        """Returns errors (N, m) less their expectation, and covariance (N, N)."""
        flight, s, n = self.flight, self.scales, self.n
        rows, total, mask = len(flight.record.time), n + 8, flight.record.seen
        table = np.array([self.respond(*f)[mask] for f in self.factors()]).T
        own = [s.position, s.position, s.pitch, s.elevator]
        own = np.tile(own[: mask.shape[1]], (rows, 1))
        covariance = table @ table.T + np.diag(own[mask] ** 2)
        errors = []
        for j in range(flight.inputs.shape[2]):
            pushes = np.zeros((rows - 1, total))
            pushes[:, :n] = flight.inputs[:, :, j]
            expected = self.respond(flight.start[:, j], pushes)
            errors.append((flight.outputs[:, :, j] - expected)[mask])
        return np.array(errors).T, covariance


MISSING = [
    (),
    ((slice(4, 8), slice(0, 3)), (slice(4, 6), 3), (0, 2), (ROWS - 1, 0)),
    ((slice(None), 3),),
]


@pytest.mark.parametrize("entries", MISSING, ids=["all", "gaps", "no elevator"])
def test_squares_and_volume_are_those_of_the_gaussian(flight, entries):
    flight = unseen(flight, *entries)
    found = whiten(flight, SCALES)
    errors, covariance = Written(flight, SCALES).gaussian()
    expected = errors.T @ np.linalg.solve(covariance, errors)
    size = np.sqrt(np.diag(expected))
    np.testing.assert_allclose(
        found.gram / np.outer(size, size), expected / np.outer(size, size), atol=1e-6
    )
    _, log_volume = np.linalg.slogdet(covariance)
    assert found.log_variances.sum() == pytest.approx(log_volume, rel=1e-6)
    nats = 0.5 * (expected[-1, -1] + log_volume)
    value = negative_log_likelihood([flight.error_only()], SCALES)
    np.testing.assert_allclose(value, nats, rtol=1e-6)


@pytest.mark.parametrize("entries", MISSING, ids=["all", "gaps", "no elevator"])
def test_the_smoothed_start_and_gusts_are_the_posterior_means(flight, entries):
    flight = unseen(flight, *entries).error_only()
    written = Written(flight, SCALES)
    errors, covariance = written.gaussian()
    factors, mask, n = written.factors(), flight.record.seen, written.n
    states = np.array([written.states(*f) for f in factors])
    table = np.array([written.respond(*f)[mask] for f in factors])
    likeliest = table @ np.linalg.solve(covariance, errors[:, -1])
    expected = np.tensordot(likeliest, states, 1)
    found = smooth(flight, SCALES)
    spreads = np.sqrt(start_variances(flight, SCALES))
    np.testing.assert_allclose(found.start / spreads, expected[0] / spreads, atol=1e-5)
    gusts = expected[:, n : n + 2]
    assert np.abs(gusts).max() > 1e-3
    np.testing.assert_allclose(found.gusts, 0.5 * (gusts[1:] + gusts[:-1]), atol=1e-6)


@pytest.mark.parametrize("entries", MISSING, ids=["all", "gaps", "no elevator"])
def test_the_score_is_the_slope_of_the_cost(flight, entries):
    flight = unseen(flight, *entries).error_only()
    cost, slopes_there = score(flight, SCALES)
    assert cost == pytest.approx(whiten(flight, SCALES).cost, rel=1e-12)
    step = 1e-4
    for i, own in enumerate(step * np.eye(len(SCALES.logs))):
        ends = (Scales.from_logs(SCALES.logs + sign * own) for sign in (1.0, -1.0))
        higher, lower = (whiten(flight, scales).cost for scales in ends)
        expected = (higher - lower) / (2.0 * step)
        assert slopes_there[i] == pytest.approx(expected, rel=1e-5, abs=1e-5)


def test_what_was_not_seen_does_not_count(flight):
    flight = unseen(flight, *MISSING[1])
    wild = np.where(flight.record.seen[:, :, None], flight.outputs, 1e9)
    other = whiten(dataclasses.replace(flight, outputs=wild), SCALES)
    np.testing.assert_array_equal(other.gram, whiten(flight, SCALES).gram)


def test_a_flight_begins_with_the_air_and_the_constants_of_any_other(flight):
    spreads = np.sqrt(start_variances(flight, SCALES)[-8:])
    s = SCALES
    expected = [s.air, s.air, s.moment, s.servo, s.wind, s.wind, s.trim, s.pitch_zero]
    np.testing.assert_allclose(spreads, expected)


def test_changed_coefficients_are_one_column(flight):
    """The error at changes δ has the square [-δ; 1]' G [-δ; 1]."""
    change = np.random.default_rng(0).normal(size=flight.inputs.shape[2] - 1) * 1e-3
    mix = np.append(-change, 1.0)
    gram = whiten(flight, SCALES).gram
    moved = whiten(flight.combined(change), SCALES).gram
    np.testing.assert_allclose(moved, [[mix @ gram @ mix]], rtol=1e-8)


def test_every_flight_takes_the_filter_that_is_compiled_first(flight, monkeypatch):
    types = []
    filter_flight = filtering.filter_flight

    def spy(*arrays):
        types.append(tuple(map(numba.typeof, arrays)))
        filter_flight(*arrays)

    monkeypatch.setattr(filtering, "filter_flight", spy)
    for asked in (flight, flight.error_only()):
        whiten(asked, SCALES)
    assert set(types) == {tuple(map(numba.typeof, no_flight()))}


def test_states_of_effects_that_do_nothing_are_left_out():
    """With one that does next to nothing, they are in the filter, to no effect."""
    task, _ = task_of(fly(flights=1, duration=0.3))
    space, theta = task.space, task.vehicle.theta.copy()
    columns = slopes(space, space.slots_of("profile_drag"))
    found = []
    for strength in (0.0, 1e-12):
        theta[space.slots_of("dynamic_stall")[0]] = strength
        linear = linearize(task.records[0], theta, NO_GAUSSIANS, columns)
        found.append((len(linear.states), whiten(linear, SCALES).gram))
    (fewer, expected), (more, gram) = found
    assert (fewer, more) == (7, 8)
    np.testing.assert_allclose(gram, expected, rtol=1e-6)


def test_one_column_alone_is_filtered_as_among_others():
    """There is a copy of the filter for it, as for a glider without more states."""
    task, _ = task_of(fly(flights=1, duration=0.3))
    columns = slopes(task.space, task.space.slots_of("profile_drag"))
    wide = linearize(task.records[0], task.vehicle.theta, NO_GAUSSIANS, columns)
    assert len(wide.states) == 7
    alone = whiten(wide.error_only(), SCALES)
    expected = whiten(wide, SCALES)
    np.testing.assert_allclose(
        alone.innovations[..., 0], expected.innovations[..., -1], rtol=1e-10
    )
    np.testing.assert_allclose(alone.log_variances, expected.log_variances, rtol=1e-12)


def test_a_flight_without_rows_is_read_within_its_arrays():
    """Compiled code does not check; it is compiled with such a flight."""
    _filter_columns.py_func(0, 0, *no_flight())
