"""Lessons 5, 6 and 8: the plan without feedback, with it, and within a funnel."""

import numpy as np
import pytest

import funnel
import tracking_lqr
from collocation import GLIDER, LAUNCH, miss_of, plan_perch, replay
from diagrams.tube import tube_of
from glider import funnels
from glider.paths import models_path
from tests.helpers.flights import drake_gains, plan_of


@pytest.fixture(scope="module")
def found():
    return plan_perch()


def test_the_plan_costs_what_it_must(found):
    (states, inputs), costs = found
    assert costs == pytest.approx((194.815, 194.0462), abs=1e-3)
    assert states.end_time() == pytest.approx(0.8795, abs=1e-4)
    np.testing.assert_allclose(states.value(0.0)[:, 0], LAUNCH, atol=1e-9)
    times = np.linspace(0.0, states.end_time(), 200)
    fastest = GLIDER.parameters.elevator_rate_limit
    assert np.max(np.abs(inputs.vector_values(times))) <= fastest + 1e-6


def test_a_replay_drifts_only_where_something_is_not_as_planned(found):
    planned, _ = found
    assert miss_of(replay(planned)) < 1e-4
    assert miss_of(replay(planned, euler=0.01)) > 0.02
    faster = LAUNCH + np.array([0.0, 0.0, 0.0, 0.0, 0.1, 0.0, 0.0])
    assert miss_of(replay(planned, start=faster)) > 0.01
    assert miss_of(replay(planned, wind=(-0.6, 0.0))) > 0.1


def test_the_feedback_is_that_of_the_library():
    """Integrated by other means: the gains agree."""
    arguments = tracking_lqr.riccati_arguments(GLIDER, plan_of())
    gains = tracking_lqr.FiniteHorizonLinearQuadraticRegulator(**arguments).K
    for t in (0.0, 0.4, 0.8):
        ours = drake_gains().K.value(t)
        np.testing.assert_allclose(
            gains.value(t), ours, atol=1e-2 * np.max(np.abs(ours))
        )


@pytest.mark.nightly
def test_flights_with_feedback_perch():
    found = tracking_lqr.main([])
    guided, blind = found["Launches that perch with feedback, and without"].split(
        " and "
    )
    assert guided == "20"
    assert blind == "20 of 20"
    words = "Worse launches that perch with feedback, and without"
    guided, blind = found[words].split(" and ")
    assert int(guided) == 20 and int(blind.split()[0]) < 10
    with_feedback, without = found["Median miss in it"].split(" and ")
    assert float(with_feedback) < float(without.split()[0])


def test_the_tube_holds_the_flights_inside():
    """Each flight within the funnel stays between the edges of its tube."""
    given = funnels.load_funnel(models_path("funnels", "drawn.npz"))
    center, beside = tube_of(given, given.nominal.times)
    upper, lower = center + beside, center - beside
    reach = np.linalg.norm(upper - center, axis=1)
    np.testing.assert_allclose(np.linalg.norm(lower - center, axis=1), reach)
    flights = funnels.fly_inside(given, 20, np.random.default_rng(0))
    across = (upper - center) / reach[:, None]
    apart = np.sum((flights[:, :, :2] - center) * across, axis=2)
    assert np.all(np.abs(apart) <= reach + 1e-6)
    assert np.max(np.abs(apart[:, 0])) > 0.2 * reach[0]


@pytest.mark.nightly
def test_no_flight_leaves_the_funnel():
    found = funnel.main([])
    assert found["Certificate of the polynomials, in exact arithmetic"] == "holds"
    assert found["Flights from the boundary that leave"].startswith("0 of ")
