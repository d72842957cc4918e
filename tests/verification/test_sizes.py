"""What deviations matter alike along a flight: errors of the launch, as they become."""

import dataclasses

import numpy as np
import pytest

from glider.control.tvlqr import tracking_policy, weight_matrix
from glider.errors import InputError
from glider.paths import models_path
from glider.physics.model import GliderModel
from glider.physics.state import NUM_STATES
from glider.simulation.fly import fly
from glider.verification.dynamics.nominal import make_nominal
from glider.verification.funnel import shape_flow
from glider.verification.funnel.funnel import load_funnel
from glider.verification.funnel.settings import LAUNCH_SIZES, FunnelSettings
from glider.verification.funnel.shape_flow import SHARE, FunnelTask
from tests.verification.points import sphere_points

SETTINGS = FunnelSettings(step=0.011, hold=0.088, launch_sizes=LAUNCH_SIZES)


@pytest.fixture(scope="module")
def policy(article_plan):
    return tracking_policy(GliderModel(), article_plan)


@pytest.fixture(scope="module")
def nominal(policy):
    return make_nominal(GliderModel(), policy, SETTINGS.step)


def test_sizes_alone_are_the_same_at_all_times(nominal):
    settings = dataclasses.replace(SETTINGS, launch_sizes=None)
    found = FunnelTask(nominal, settings, sphere_points(1, 7)).sizes
    assert found.shape == (len(nominal.times), NUM_STATES, NUM_STATES)
    assert np.all(found == np.diag(np.square(settings.sizes)))


def test_errors_of_a_launch_become_what_flights_show(nominal, policy):
    small = 1e-3
    found = FunnelTask(nominal, SETTINGS, sphere_points(1, 7)).sizes
    starts = nominal.states[0] + small * np.diag([*LAUNCH_SIZES])
    starts = np.vstack([nominal.states[0], starts])
    step = (nominal.times[1] - nominal.times[0]) / 8.0
    flown = fly(
        GliderModel(), policy, starts, step=step, after=0.0, keep_paths=True
    ).paths[:, ::8]
    for k in (0, 30, len(nominal.times) - 1):
        errors = (flown[1:, k] - flown[0, k]).T / small
        expected = errors @ errors.T + np.diag(np.square(SETTINGS.sizes)) * SHARE**2
        units = 1.0 / np.sqrt(np.diag(expected))
        difference = (found[k] - expected) * np.outer(units, units)
        assert np.abs(difference).max() < 0.02, k


def test_what_is_least_later_is_least_at_the_launch(policy, monkeypatch):
    """tr(W) = tr(Σ S) is one number all along a set that nothing makes grow."""
    traces = []

    def no_growth(program, cubic, quartic, weight, fault):
        traces.append(np.trace(weight))
        return (np.zeros_like(weight),)

    monkeypatch.setattr(shape_flow, "first_success", no_growth)
    monkeypatch.setattr(shape_flow, "SHARE", 0.0)
    nominal = make_nominal(GliderModel(), policy, 0.002)
    nominal = nominal.part(slice(50))
    small = tuple(1e-3 * np.array(SETTINGS.goal))  # No limit of the servo cuts it.
    settings = dataclasses.replace(SETTINGS, goal=small, hold=SETTINGS.step)
    task = FunnelTask(nominal, settings, sphere_points(1, 7))
    flow = shape_flow.ShapeFlow(task)
    S = flow.run()
    traces.append(np.sum(np.square(LAUNCH_SIZES) * np.diag(S[0])))
    np.testing.assert_allclose(traces, traces[0], rtol=1e-4)
    assert len(traces) > 5


def test_the_inlet_of_a_funnel_that_ships_is_high():
    held = load_funnel(models_path("funnels", "drawn_hook.npz"))
    assert held.settings.launch_sizes == LAUNCH_SIZES
    assert held.half_widths()[1] > 0.17


def test_states_of_the_effects_start_at_rest():
    axes = np.diag(weight_matrix(LAUNCH_SIZES, NUM_STATES + 1))
    np.testing.assert_array_equal(axes, [*LAUNCH_SIZES, 0.0])


@pytest.mark.parametrize("given", [(0.1,), (0.0, 0.1, 0.05, 0.1, 0.1, 0.2, 0.6)])
def test_sizes_of_a_launch_are_seven_positive_numbers(given):
    with pytest.raises(InputError, match=r"'launch_sizes' is .*7 positive numbers"):
        FunnelSettings(launch_sizes=given)
