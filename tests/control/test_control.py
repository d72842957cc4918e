"""The feedback is LQR: Drake's, the compiled one, and what both promise."""

import dataclasses
import pickle

import numpy as np
import pytest
from pydrake.autodiffutils import ExtractGradient, InitializeAutoDiff
from scipy.linalg import solve_continuous_are

from examples.cruise import find_trim
from glider.control.tvlqr import (
    TrackingWeights,
    aligned_count,
    sample_plan,
    tracking_policy,
    weight_matrix,
)
from glider.errors import InputError
from glider.physics.model import GliderModel
from glider.planning import dircol
from glider.planning.plan import Plan
from glider.simulation.fly import fly
from glider.systems.plant import GliderPlant
from glider.systems.regulator import tracking_regulator
from tests.helpers.drake_gains import TABLE_STEP, policy_of, tracking_gains
from tests.helpers.flights import (
    LAGGING,
    NOMINAL,
    PROBLEM,
    QUICK,
    drake_gains,
    drake_policy,
    plan_of,
    policy,
)

# -------------------------------------------------------------------- tracking


def test_the_regulator_is_the_law_of_the_gains():
    gains, plan = drake_gains(), plan_of()
    regulator = tracking_regulator(GliderModel(), plan)
    assert regulator.get_name() == "regulator"
    context = regulator.CreateDefaultContext()
    state = plan.state_trajectory.value(0.4)[:, 0] + 0.01 * np.arange(7)
    context.SetTime(0.4)
    regulator.GetInputPort("plant_state").FixValue(context, state)
    [command] = regulator.GetOutputPort("command").Eval(context)
    error = state[:, None] - gains.x0.value(0.4)
    expected = gains.u0.value(0.4) - gains.K.value(0.4) @ error - gains.k0.value(0.4)
    assert command == pytest.approx(expected[0, 0], rel=1e-12)
    assert gains.u0.value(0.4)[0, 0] == plan.input_trajectory.value(0.4)[0, 0]


def test_the_cost_to_go_is_a_cost_and_ends_in_its_final_weight():
    gains, weights = drake_gains(), TrackingWeights()
    end = gains.S.value(plan_of().duration)
    np.testing.assert_allclose(end, weight_matrix(weights.final, 7), atol=1e-9)
    for S in policy().cost[::20]:
        np.testing.assert_array_equal(S, S.T)
        assert np.linalg.eigvalsh(S).min() > 0.0


@pytest.mark.parametrize("lagging", [False, True], ids=["nominal", "servo_lag"])
def test_the_compiled_pass_equals_drakes(lagging):
    """To 1e-5 of the largest; with a lag, the final weight is semidefinite."""
    plan = plan_of(lagging)
    model = LAGGING if lagging else NOMINAL
    gains = tracking_gains(model, plan) if lagging else drake_gains()
    compiled, drake = tracking_policy(model, plan), policy_of(gains, plan)
    for name in ("gains", "cost"):
        ours, theirs = getattr(compiled, name), getattr(drake, name)
        # Common rows: both divide each knot interval into equal parts.
        knots = len(plan.times) - 1
        ours = ours[:: (len(ours) - 1) // knots]
        theirs = theirs[:: (len(theirs) - 1) // knots]
        assert len(ours) == len(theirs) == knots + 1
        assert np.max(np.abs(ours - theirs)) < 1e-5 * np.max(np.abs(theirs))
    times = np.linspace(0.0, plan.duration, 300)
    ours, theirs = compiled.sample(times), drake.sample(times)
    assert np.max(np.abs(ours[1] - theirs[1])) < 1e-5 * np.max(np.abs(theirs[1]))
    nominal = sample_plan(plan, times)[0]
    commands = [o - np.sum(k * nominal, axis=1) for o, k in (ours, theirs)]
    np.testing.assert_allclose(*commands, atol=1e-4)  # u₀ - k₀ [rad/s].


def test_what_the_plan_lacks_is_corrected_as_drake_does():
    """A plan that is no flight: k₀ is large, and the two passes agree on it."""
    plan = dataclasses.replace(plan_of(), inputs=plan_of().inputs + 1.0)
    gains = tracking_gains(GliderModel(), plan)
    drake = policy_of(gains, plan)
    ours = tracking_policy(GliderModel(), plan, step=TABLE_STEP)
    assert np.max(np.abs(drake.corrections)) > 0.5
    np.testing.assert_allclose(ours.corrections, drake.corrections, atol=1e-4)
    np.testing.assert_allclose(ours.cost_slope, drake.cost_slope, atol=1e-4)
    [offset], [gain] = ours.sample(np.array([0.31]))
    law = gains.u0.value(0.31) - gains.k0.value(0.31)
    law = law + gains.K.value(0.31) @ gains.x0.value(0.31)
    assert offset == pytest.approx(law[0, 0], abs=1e-3)
    np.testing.assert_allclose(gain, gains.K.value(0.31)[0], rtol=1e-4, atol=1e-3)


def test_over_a_long_steady_flight_it_is_the_infinite_horizon_lqr():
    trim = find_trim(NOMINAL, 7.0)
    slope = np.zeros(7)
    slope[:2] = trim[4:6]
    times = np.array([0.0, 40.0])
    steady = Plan(
        times=times,
        states=trim + times[:, None] * slope,
        slopes=np.array([slope, slope]),
        inputs=np.zeros(2),
        state_names=NOMINAL.state_names,
        cost=0.0,
    )
    twin = GliderPlant(NOMINAL).ToAutoDiffXd()
    context = twin.CreateDefaultContext()
    ad = InitializeAutoDiff(np.append(trim, 0.0)).ravel()
    context.SetContinuousState(ad[:7])
    twin.GetInputPort("elevator_rate").FixValue(context, ad[7:])
    rates = twin.EvalTimeDerivatives(context).CopyToVector()
    slopes = ExtractGradient(rates)
    A, B = slopes[2:, 2:7], slopes[2:, 7:]
    # Without thrust nobody holds a place on the way down: x and z weigh nothing.
    weights = TrackingWeights(state=(0, 0, 10, 1, 1, 1, 1), final=(0,) * 7)
    S = solve_continuous_are(A, B, np.diag(weights.state[2:]), [[weights.rate]])
    found = tracking_policy(NOMINAL, steady, weights, step=0.01)
    np.testing.assert_allclose(found.cost[0, 2:, 2:], S, rtol=1e-5, atol=1e-5)
    gain = B[:, 0] @ S / weights.rate
    np.testing.assert_allclose(found.gains[0, 2:], gain, rtol=1e-5, atol=1e-5)
    assert not found.gains[0, :2].any()


def test_the_cost_to_go_is_what_a_flight_costs():
    plan, weights = plan_of(), TrackingWeights()
    start = plan.states[0] + 1e-3 * np.array([1.0, -2.0, 1.0, 1.0, 3.0, -2.0, 2.0])
    flights = fly(
        NOMINAL, policy(), start[None], after=0.0, step=0.0005, keep_paths=True
    )
    nominal, _, inputs = sample_plan(plan, flights.times)
    offset, gain = policy().sample(flights.times)
    error = flights.paths[0] - nominal
    push = offset - np.sum(gain * flights.paths[0], axis=1) - inputs
    running = np.sum(error**2 * weights.state, axis=1) + weights.rate * push**2
    paid = np.trapezoid(running, flights.times) + np.sum(error[-1] ** 2 * weights.final)
    promised = error[0] @ policy().cost[0] @ error[0]
    promised += 2.0 * error[0] @ policy().cost_slope[0]
    assert paid == pytest.approx(promised, rel=0.02)


def test_a_policy_survives_a_journey():
    plan_of().state_trajectory  # noqa: B018  Cached, and on Drake 1.51 no traveller.
    again = pickle.loads(pickle.dumps(drake_policy()))
    np.testing.assert_array_equal(again.gains, drake_policy().gains)
    np.testing.assert_array_equal(again.plan.states, plan_of().states)


def test_after_the_plan_its_last_values_stay():
    duration = plan_of().duration
    offset, gain = policy().sample(np.array([duration, duration + 1.0]))
    assert offset[0] == offset[1]
    np.testing.assert_array_equal(gain[0], gain[1])


def test_the_steps_meet_the_knots():
    plan = plan_of()
    count = aligned_count(plan, 0.002)
    assert count % (len(plan.times) - 1) == 0
    assert plan.duration / count <= 0.002 + 1e-12


@pytest.mark.parametrize(
    "weights",
    [
        {"rate": 0.0},
        {"rate": np.inf},
        {"state": (1.0,) * 6},
        {"final": (1.0,) * 6 + (-1.0,)},
        {"state": (np.nan,) * 7},
    ],
)
def test_weights_without_a_solution_are_refused(weights):
    with pytest.raises(InputError, match=next(iter(weights))):
        TrackingWeights(**weights)


@pytest.mark.parametrize("make", [tracking_gains, tracking_regulator, tracking_policy])
def test_a_plan_for_another_glider_is_refused(make):
    with pytest.raises(InputError, match=r"servo_lag\.servo_rate"):
        make(LAGGING, plan_of())


def test_a_quick_servo_is_fed_back_as_none():
    """The compiled pass against Drake's, whose steps are as short as it needs."""
    planned = dircol.plan(QUICK, PROBLEM)
    table = tracking_policy(QUICK, planned)
    drake = tracking_gains(QUICK, planned)
    for time in (0.0, 0.3, 0.6):
        k = int(np.argmin(np.abs(table.times - time)))
        gain = drake.K.value(table.times[k])[0]
        np.testing.assert_allclose(table.gains[k], gain, atol=1e-3 * np.max(abs(gain)))
