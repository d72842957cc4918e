"""The strengths of noise, air and trims are those that were simulated."""

import dataclasses

import numpy as np
import pytest

from glider.physics.state import NUM_STATES
from glider.sysid.likelihood.filtering import negative_log_likelihood
from glider.sysid.likelihood.model_fit import fit_model, linear_flights
from glider.sysid.likelihood.scale_fit import fit_scales
from glider.sysid.likelihood.scales import CEILING, FLOOR, NAMES, Scales
from tests.helpers.lifelike import turbulence_campaign
from tests.helpers.tasks import begin, fly, task_of, typical


@pytest.fixture(scope="module")
def turbulent():
    campaign, truth = turbulence_campaign(2, flights=16)
    task, noise = task_of(campaign)
    return task, fit_model(task, begin(task, noise)), truth


def test_sensors_air_and_trims_have_their_strengths(turbulent):
    _, model, truth = turbulent
    scales = model.scales
    assert scales.position == pytest.approx(truth.capture.position, rel=0.15)
    assert scales.pitch == pytest.approx(truth.capture.pitch, rel=0.15)
    assert scales.elevator == pytest.approx(truth.capture.elevator, rel=0.15)
    assert scales.air == pytest.approx(truth.air_std, rel=0.3)
    assert scales.air_time == pytest.approx(truth.air_correlation, rel=0.6)
    drawn = np.std(truth.per_flight["elevator_trim"])
    assert scales.trim == pytest.approx(drawn, rel=0.25)


def test_what_is_not_there_is_weak(turbulent):
    _, model, _ = turbulent
    assert model.scales.wind < 0.05
    assert model.scales.pitch_zero < 3e-3
    assert model.scales.servo < 5e-3


def test_no_other_scales_are_more_likely(turbulent):
    """Each scale moved by a tenth, alone."""
    task, model, _ = turbulent
    flights = [f.error_only() for f in linear_flights(task, model, ())]
    best, _ = fit_scales(flights, model.scales, iterations=20, tolerance=1e-3)
    cost = negative_log_likelihood(flights, best).sum()
    for k, name in enumerate(NAMES):
        for change in (-0.1, 0.1):
            logs = best.logs
            logs[k] += change
            moved = Scales.from_logs(logs)
            low, high = getattr(FLOOR, name), getattr(CEILING, name)
            if not low <= getattr(moved, name) <= high:
                continue
            worse = negative_log_likelihood(flights, moved).sum() - cost
            assert worse > -0.2, name


@pytest.mark.parametrize("seed", [0, 3, 16])
def test_scales_are_found_from_anywhere_between_their_bounds(turbulent, seed):
    """Where steps of several scales end on bounds, which shifts the others."""
    task, model, _ = turbulent
    flights = [f.error_only() for f in linear_flights(task, model, ())]
    _, best = fit_scales(flights, model.scales, iterations=20, tolerance=1e-3)
    share = np.random.default_rng(seed).uniform(size=len(NAMES))
    start = Scales.from_logs(FLOOR.logs + share * (CEILING.logs - FLOOR.logs))
    assert fit_scales(flights, start, iterations=20)[1] < best + 1.0  # [nats]


def test_a_scale_that_is_not_free_stays(turbulent):
    task, model, _ = turbulent
    flights = [f.error_only() for f in linear_flights(task, model, ())]
    start = Scales(air=0.4)
    found, _ = fit_scales(flights, start, ("air",), iterations=3)
    assert found.air < 0.35
    expected = dataclasses.replace(start, air=found.air)
    np.testing.assert_allclose(found.logs, expected.logs)


def test_still_air_is_still():
    task, noise = task_of(fly(flights=4))
    scales = fit_model(task, begin(task, noise)).scales
    assert scales.air < 0.01
    assert scales.moment < 1.0
    assert scales.position == pytest.approx(noise.position, rel=0.2)


@pytest.mark.parametrize("spread", [0.0, 0.03])
def test_elevators_rest_at_zero_but_for_their_spread(spread):
    campaign, rng = fly(flights=8), np.random.default_rng(0)
    flights = [
        dataclasses.replace(f, elevator=f.elevator + spread * rng.normal())
        for f in campaign.flights
    ]
    task, noise = task_of(dataclasses.replace(campaign, flights=tuple(flights)))
    model = begin(task, noise)
    flights = [f.error_only() for f in linear_flights(task, model, ())]
    found, _ = fit_scales(flights, model.scales, ("rest",), iterations=20)
    low, high = (0.5 * spread, 2.0 * spread) if spread else (0.0, 0.1 * noise.elevator)
    assert low < found.rest < high


@pytest.mark.parametrize("spread", [0.0, 0.2])
def test_memory_begins_steady_but_for_its_spread(spread):
    effect, rng = typical("lagged_downwash", 2.0), np.random.default_rng(0)
    task, noise = task_of(fly(effect, flights=12))
    model = begin(task, noise, [effect.kind.kind])
    model.theta[list(task.space.slots_of(effect.kind.kind))] = effect.values
    flights = [f.error_only() for f in linear_flights(task, model, ())]
    for flight in flights:  # As if the true flights had begun there.
        flight.start[NUM_STATES, -1] += spread * rng.normal()
    free = ("memory", "position", "pitch")
    found, _ = fit_scales(flights, model.scales, free, iterations=20)
    low, high = (0.5 * spread, 2.0 * spread) if spread else (0.0, 0.03)
    assert low < found.memory < high


def test_logarithms_there_and_back():
    np.testing.assert_allclose(Scales.from_logs(CEILING.logs).logs, CEILING.logs)
