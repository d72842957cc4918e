"""Compiled flights are Drake's flights, and a sweep is the same on any worker."""

import pickle
import warnings

import joblib
import numpy as np
import pytest

from diagrams.loops import closed_loop
from diagrams.simulate import simulate_flights
from glider.compiled.runge_kutta import BLOCK
from glider.control.tvlqr import tracking_policy
from glider.errors import InputError
from glider.physics.effects import DYNAMIC_STALL, WIND
from glider.physics.model import GliderModel
from glider.planning.problem import PerchingProblem
from glider.simulation.flown_flights import closest_pass
from glider.simulation.fly import _CHUNK, fly, full_starts, sweep
from glider.systems.regulator import tracking_regulator
from tests.helpers.flights import (
    LAGGING,
    NO_HOOK,
    NOMINAL,
    PROBLEM,
    drake_policy,
    plan_of,
    policy,
)

FAR = {"height": 0.3, "speed": 0.5, "pitch": 0.15}


def launches(count, spread=FAR, seed=0):
    return PROBLEM.draw_launches(count, np.random.default_rng(seed), **spread)


# ------------------------------------------------------ the compiled closed loop


@pytest.mark.parametrize(
    ("truth", "rate"),
    [(NOMINAL, None), (NOMINAL, 50.0), (LAGGING, 50.0)],
    ids=["at once", "held", "another truth"],
)
def test_flight_by_flight_it_is_drakes_diagram(truth, rate):
    """End states and misses to 1e-5, with the nominal model's servo at its limits."""
    starts = launches(2, FAR if truth is NOMINAL else {}, seed=4)
    ours = fly(truth, drake_policy(), starts, command_rate=rate, step=0.0005)
    regulator = tracking_regulator(GliderModel(), plan_of())
    diagram = closed_loop(truth, regulator, command_rate=rate)
    drakes = simulate_flights(
        diagram, starts, ours.times[-1], problem=NO_HOOK, accuracy=1e-8
    )
    ends = np.array([flight.states[-1] for flight in drakes])
    np.testing.assert_allclose(ours.ends, ends, atol=1e-5)
    misses = np.array([flight.miss for flight in drakes])
    np.testing.assert_allclose(ours.miss, misses, atol=1e-5)
    arrivals = np.array([flight.arrival for flight in drakes])
    np.testing.assert_allclose(ours.arrivals, arrivals, atol=2e-3)
    assert np.ptp(misses) > 1e-4
    if truth is NOMINAL:  # A limit was at work.
        turned = [
            np.abs(np.diff(flight.states[:, 3]) / np.diff(flight.times)).max()
            for flight in drakes
        ]
        assert max(turned) > 12.999


def test_a_batch_is_its_flights_one_by_one():
    starts = launches(BLOCK + 3)
    many = fly(NOMINAL, policy(), starts, command_rate=50.0, keep_paths=True)
    for k in (0, BLOCK - 1, BLOCK, BLOCK + 2):
        one = fly(NOMINAL, policy(), starts[[k]], command_rate=50.0)
        np.testing.assert_allclose(many.ends[k], one.ends[0], rtol=1e-12, atol=1e-12)
        np.testing.assert_allclose(many.miss[k], one.miss[0], rtol=1e-9)
        assert one.paths is None
    np.testing.assert_array_equal(many.paths[:, 0], starts)
    np.testing.assert_array_equal(many.paths[:, -1], many.ends)
    assert many.paths.shape[1] == len(many.times)


@pytest.mark.parametrize("wire", [(0.0, 0.0), (-0.3, 0.2)])
def test_the_miss_is_the_distance_of_the_path(wire):
    problem = PerchingProblem(wire=list(wire))
    flights = fly(NOMINAL, policy(), launches(5), problem=problem, keep_paths=True)
    for path, miss, state in zip(
        flights.paths, flights.miss, flights.arrivals, strict=True
    ):
        passed = closest_pass(flights.times, path, np.array(wire))
        assert miss == pytest.approx(passed.miss, abs=1e-5)
        assert state == pytest.approx(passed.arrival, abs=2e-3)


def test_finer_steps_change_little():
    coarse = fly(NOMINAL, policy(), launches(50))
    fine = fly(NOMINAL, policy(), launches(50), step=0.0005)
    np.testing.assert_allclose(coarse.miss, fine.miss, atol=1e-4)


def test_feedback_is_what_perches():
    """The article's launches perch; farther ones do not always."""
    near = fly(NOMINAL, policy(), launches(500, {}))
    far = fly(NOMINAL, policy(), launches(500))
    assert np.mean(near.perched) > 0.99
    assert 0.5 < np.mean(far.perched) < 0.99
    hook = PROBLEM.hook
    np.testing.assert_array_equal(far.perched, hook.takes(far.miss, far.arrivals))
    assert np.any(far.perched != (far.miss < hook.reach))  # Not by distance alone.


def test_effects_with_states_start_at_rest():
    """All at once as one by one."""
    model = GliderModel(
        effects=(WIND(x=-1.0), DYNAMIC_STALL(strength=0.5), *LAGGING.effects)
    )
    starts = launches(3)
    full = full_starts(model, starts)
    np.testing.assert_array_equal(full, [model.initial_state(s) for s in starts])
    assert np.all(np.any(full[:, 7:] != 0.0, axis=1))
    np.testing.assert_array_equal(full_starts(model, full), full)


def test_a_short_flight_does_not_reach_the_wire():
    flights = fly(NOMINAL, policy(), launches(1, {}), after=0.0)
    assert flights.times[-1] == pytest.approx(plan_of().duration)


def test_a_policy_with_states_of_its_own_needs_the_observer():
    lagging = tracking_policy(LAGGING, plan_of(lagging=True))
    with pytest.raises(InputError, match=r"diagrams.closed_loop's observer"):
        fly(NOMINAL, lagging, launches(2))
    assert fly(LAGGING, lagging, launches(2, {})).perched.all()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"command_rate": 0.0}, "command rate is 0.0"),
        ({"step": 0.0}, "step is 0.0"),
        ({"after": -1.0}, "'after' is -1.0"),
        ({"starts": np.zeros(7)}, r"expected \(B, 7\)"),
        ({"starts": np.full((1, 7), np.nan)}, "finite"),
        ({"starts": np.zeros((1, 6))}, "is 6; expected 7"),
    ],
)
def test_what_does_not_fit_is_refused(options, message):
    starts = options.pop("starts", launches(2))
    with pytest.raises(InputError, match=message):
        fly(NOMINAL, policy(), starts, **options)


# --------------------------------------------------------------------- the miss


def straight(times, points, velocity):
    """States on a path of one velocity (2,)."""
    states = np.zeros((len(points), 7))
    states[:, :2], states[:, 4:6] = points, velocity
    return np.array(times), states


def test_a_path_that_jumps_over_the_wire_still_meets_it():
    times, states = straight([0.0, 2.0], [[-1.0, 0.03], [1.0, 0.03]], [1.0, 0.0])
    states[:, 2] = [0.0, -1.0]
    for wire, miss, time in (((0.0, 0.0), 0.03, 1.0), ((1.3, 0.43), 0.5, 2.0)):
        passed = closest_pass(times, states, np.array(wire))
        assert passed.miss == pytest.approx(miss)  # Not of the line beyond the end.
        assert passed.time == pytest.approx(time)
        assert passed.arrival[2] == pytest.approx(-0.5 * time)
        assert passed.arrival[:2] == pytest.approx([time - 1.0, 0.03])
    passed = closest_pass(times[:1], states[:1], np.array([-1.0, 0.0]))
    assert (passed.miss, passed.time) == pytest.approx((0.03, 0.0))


def test_between_long_steps_the_path_is_curved():
    """Half a circle of radius 1 in 6 steps; chords would say 0.034 less."""
    angle = np.linspace(0.0, np.pi, 7)
    states = np.zeros((7, 7))
    states[:, :2] = np.column_stack([np.cos(angle), np.sin(angle)])
    states[:, 4:6] = np.column_stack([-np.sin(angle), np.cos(angle)])
    assert closest_pass(angle, states, np.zeros(2)).miss == pytest.approx(1.0, abs=5e-4)
    twice = np.repeat(np.arange(7), 2)  # A log holds the time of an event twice.
    assert closest_pass(angle[twice], states[twice], np.zeros(2)).miss == pytest.approx(
        1.0, abs=5e-4
    )


# -------------------------------------------------------------------- launches


def test_launches_spread_as_they_should():
    spread = {"height": 0.1, "speed": 0.3, "pitch": 0.02}
    starts = launches(20_000, spread) - PROBLEM.launch
    np.testing.assert_allclose(starts.mean(axis=0), 0.0, atol=0.01)
    expected = [0.0, 0.1, 0.02, 0.0, 0.3, 0.0, 0.0]
    np.testing.assert_allclose(starts.std(axis=0), expected, rtol=0.03)
    np.testing.assert_array_equal(launches(5, seed=3), launches(5, seed=3))
    nothing = launches(2, FAR | {"scale": 0.0})
    np.testing.assert_array_equal(nothing, [PROBLEM.launch] * 2)


@pytest.mark.parametrize("count", [0, -1])
def test_no_launches_are_refused(count):
    with pytest.raises(InputError, match=f"'count' is {count}; expected at least 1"):
        launches(count)


@pytest.mark.parametrize("value", [-0.1, np.nan, np.inf])
def test_a_spread_that_cannot_be_is_refused(value):
    with pytest.raises(InputError, match="'height'"):
        launches(1, {"height": value})


# ----------------------------------------------------------------------- sweeps


def fly_near(count, rng):
    return fly(NOMINAL, policy(), PROBLEM.draw_launches(count, rng))


def assert_same(one, other):
    np.testing.assert_array_equal(one.miss, other.miss)
    np.testing.assert_array_equal(one.arrivals, other.arrivals)
    np.testing.assert_array_equal(one.ends, other.ends)


def test_a_sweep_does_not_depend_on_its_workers():
    flights = _CHUNK + 100
    alone = sweep(fly_near, flights, seed=1)
    assert len(alone) == len(alone.perched) == flights
    with joblib.parallel_config(backend="threading", n_jobs=2):
        assert_same(alone, sweep(fly_near, flights, seed=1))
    assert len(np.unique(alone.miss)) == flights
    assert not np.any(sweep(fly_near, flights, seed=2).miss == alone.miss)


def test_a_sweep_runs_on_dask():
    """A local cluster; any other differs in its address."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # Dask's own, at import and at closing.
        from dask.distributed import Client

        client = Client(
            processes=False, n_workers=1, threads_per_worker=2, dashboard_address=None
        )
        with client, joblib.parallel_config(backend="dask"):
            found = sweep(fly_near, 200, seed=1)
    assert_same(found, sweep(fly_near, 200, seed=1))


def test_a_policy_can_go_to_another_process():
    plan_of().state_trajectory  # noqa: B018  Cached, and on Drake 1.51 no traveller.
    again = pickle.loads(pickle.dumps((NOMINAL, policy(), PROBLEM)))
    starts = launches(10)
    first = fly(NOMINAL, policy(), starts, problem=PROBLEM)
    assert_same(first, fly(again[0], again[1], starts, problem=again[2]))


def test_a_sweep_without_flights_is_refused():
    with pytest.raises(InputError, match="'flights' is 0"):
        sweep(fly_near, 0, seed=0)
