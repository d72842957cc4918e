"""The joint fit: exact on its own rollouts, honest about its errors."""

import dataclasses

import numpy as np
import pytest

from glider.physics.effects import KINDS
from glider.physics.model import GliderModel
from glider.sysid.likelihood.information import (
    bounded_step,
    cost,
    held_out_costs,
    moved,
    solve,
)
from glider.sysid.fit.output_error import fit, fit_covariance, gather
from glider.sysid.fit.simulate import (
    CampaignPlan,
    simulate_campaign,
    theta_of,
)
from glider.sysid.replay.noise import measure_noise
from glider.sysid.replay.problem import Problem
from glider.sysid.replay.record import prepare
from glider.sysid.replay.sensitivity import linearize
from glider.sysid.replay.shooting import (
    fit_start,
    fly_record,
)
from glider.sysid.replay.theta import LIBRARY_LAYOUT

INDEX, slots_of = LIBRARY_LAYOUT.index, LIBRARY_LAYOUT.slots_of
default_theta = LIBRARY_LAYOUT.default_theta


def make_problem(model, seed=0, **plan):
    campaign = simulate_campaign(
        model, CampaignPlan(**plan), np.random.default_rng(seed)
    )
    noise = measure_noise(campaign)
    return Problem(records=prepare(campaign.flights, campaign, noise), noise=noise)


@pytest.fixture(scope="module")
def windy():
    model = GliderModel(effects=(KINDS["wind"](x=-0.4, z=0.1),))
    return model, make_problem(model, flights=8)


def test_truth_leaves_only_noise(windy):
    model, problem = windy
    found = fit(problem, theta_of(model), ())
    assert found.dispersion == pytest.approx(1.0, abs=0.1)


def test_wind_is_found_within_its_standard_error(windy):
    model, problem = windy
    found = fit(problem, default_theta(model.parameters), slots_of("wind"))
    error = found.theta[list(slots_of("wind"))] - [-0.4, 0.1]
    std = np.sqrt(np.diag(fit_covariance(found)))
    assert np.all(np.abs(error) < 4.0 * std)
    assert np.all(std < 0.01)


def test_standard_errors_cover_over_campaigns():
    """Over campaigns the error in standard errors has a spread near one."""
    model = GliderModel(effects=(KINDS["profile_drag"](cd0=0.05),))
    scores = []
    for seed in range(12):
        problem = make_problem(model, seed=seed, flights=5)
        found = fit(
            problem,
            default_theta(model.parameters),
            slots_of("profile_drag"),
        )
        error = found.theta[INDEX["profile_drag", "cd0"]] - 0.05
        scores.append(error / np.sqrt(fit_covariance(found)[0, 0]))
    assert 0.4 < np.sqrt(np.mean(np.square(scores))) < 1.8


def test_signatures_are_derivatives_of_the_errors(windy):
    """A column is what the errors of free rollouts do when a coefficient moves."""
    model, problem = windy
    record = problem.records[0]
    theta = theta_of(model)
    free = (*slots_of("wind"), *slots_of("marker_offset"), *slots_of("servo_lag"))
    free = tuple(sorted(free))
    theta[list(slots_of("servo_lag"))] = 0.02
    start = fit_start(problem, record, theta)
    nodes = fly_record(problem, record, theta, start)
    here = linearize(problem, record, theta, free, nodes=nodes)
    for j, i in enumerate(free):
        moved = theta.copy()
        moved[i] += 1e-5
        flown = fly_record(problem, record, moved, start)
        there = linearize(problem, record, moved, nodes=flown)
        numeric = (here.residual - there.residual)[:-5] / 1e-5
        scale = np.abs(numeric).max()
        np.testing.assert_allclose(here.by_theta[:-5, j], numeric, atol=2e-3 * scale)


def test_launch_state_is_fitted(windy):
    model, problem = windy
    record, theta = problem.records[1], theta_of(model)
    start = fit_start(problem, record, theta)
    flown = fly_record(problem, record, theta, start)
    error = record.flight.pose - flown[:, :3]
    assert np.sqrt(np.mean(error[:, :2] ** 2)) < 1.3 * problem.noise.position
    assert np.sqrt(np.mean(error[:, 2] ** 2)) < 1.3 * problem.noise.pitch


def test_bounds_hold_and_the_others_adjust():
    rng = np.random.default_rng(0)
    table = rng.normal(size=(50, 4))
    information = table.T @ table
    free = solve(information)
    limit = free[0] - 0.1
    upper = np.array([limit, np.inf, np.inf])
    step = bounded_step(information, np.zeros(3), 0.0, np.full(3, -np.inf), upper)
    assert step[0] == pytest.approx(limit)
    rest = np.linalg.lstsq(table[:, 1:3], table[:, 3] - limit * table[:, 0], rcond=None)
    np.testing.assert_allclose(step[1:], rest[0], rtol=1e-6)


def test_information_moves_with_the_coefficients():
    rng = np.random.default_rng(0)
    table = rng.normal(size=(50, 4))
    information, step, further = table.T @ table, rng.normal(size=3), rng.normal(size=3)
    there = moved(information, step)
    assert cost(there, further) == pytest.approx(cost(information, step + further))


def test_left_out_flights_are_left_out():
    """A flight's held-out cost does not know the flight itself."""
    rng = np.random.default_rng(0)
    tables = rng.normal(size=(4, 30, 3))
    information = np.einsum("fni,fnj->fij", tables, tables)
    held_out = held_out_costs(information)
    others = information[1:].sum(axis=0)
    assert held_out[0] == pytest.approx(cost(information[0], solve(others)))
    assert np.all(held_out >= [cost(own, solve(own)) for own in information])


def test_a_model_that_blows_up_costs_infinitely(windy):
    model, problem = windy
    theta = theta_of(model)
    theta[list(slots_of("profile_drag"))] = -1e6
    assert gather(problem, theta, ()).sum() == np.inf


def test_a_prior_pulls(windy):
    model, problem = windy
    theta = default_theta(model.parameters)
    spread = np.full(len(theta), np.inf)
    spread[list(slots_of("wind"))] = 1e-7
    held = dataclasses.replace(problem, prior=(theta.copy(), spread))
    found = fit(held, theta, slots_of("wind"))
    np.testing.assert_allclose(found.theta[list(slots_of("wind"))], 0.0, atol=1e-3)
