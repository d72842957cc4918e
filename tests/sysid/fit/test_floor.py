import dataclasses
import types

import numpy as np
import pytest

from glider.physics.effects import NO_GAUSSIANS
from glider.physics.model import GliderModel
from glider.physics.state import NUM_STATES
from glider.sysid.constants import UNLIKELY
from glider.sysid.evaluation import without_model_errors
from glider.sysid.fit import floor as floors
from glider.sysid.fit.floor import PerfectModel, find_floor
from glider.sysid.fit.prediction import flown_by, mean_squares, predict
from glider.sysid.likelihood.linear_flight import linearize
from glider.sysid.likelihood.scales import FLOOR
from glider.sysid.replay.log_space import vector_of
from glider.sysid.result import EquationErrors, Spread
from tests.helpers.known_truth import begin, task_of
from tests.helpers.lifelike import draw_campaign, turbulence_campaign
from tests.helpers.tasks import fly, typical


def scales_of(truth):
    """Standard deviations with which a campaign was drawn."""
    capture = truth.capture
    return dataclasses.replace(
        FLOOR,
        position=capture.position,
        pitch=capture.pitch,
        elevator=capture.elevator,
        air=max(truth.air_std, FLOOR.air),
        air_time=truth.air_correlation or 0.25,
        trim=max(truth.spreads.get("elevator_trim", 0.0), FLOOR.trim),
    )


def perfect_of(scales, noise):
    ratio = noise.smoothing[2].ratio
    return PerfectModel(truth=scales, pitch_ratio=ratio, rng=np.random.default_rng(0))


def floor_and_errors(campaign, truth, effect=None):
    """Predicts flights of the nominal glider by a model, perfect without an effect."""
    task, noise = task_of(campaign)
    scales = scales_of(truth)
    model = dataclasses.replace(begin(task, noise), scales=scales)
    if effect is not None:
        model.theta[task.space.index[".".join(effect[:2])]] = effect[2]
    flown = flown_by(task, model, scales)
    perfect = perfect_of(scales, noise)
    floor = find_floor(flown, task.records, perfect)
    own = [predict(flown, record) for record in task.records]
    return floor, np.sqrt(mean_squares(task.records, own)[:, :2])


NO_NOISE = EquationErrors(0.0, 0.0, 0.0)


def along(floor):
    return floor.errors(NO_NOISE, 16).rollout_measured_pitch.position_rms_m


@pytest.fixture(scope="module")
def still():
    return draw_campaign(1, 16, (), moving_air=False, spreads=False, broken=False)


@pytest.fixture(scope="module")
def turbulent():
    return turbulence_campaign(2, 16)


@pytest.mark.parametrize("name", ["still", "turbulent"])
def test_a_perfect_model_leaves_its_floor(name, request):
    """Seen on flights of another simulator, predicted without linearization."""
    floor, errors = floor_and_errors(*request.getfixturevalue(name))
    typical = 0.5 * np.log(floor.squares[:, :2]).mean(axis=2)
    ratios = np.exp(np.mean(np.log(errors) - typical, axis=0))
    np.testing.assert_allclose(ratios, 1.0, atol=0.25)
    assert floor.chance(errors) > 0.05


@pytest.mark.parametrize(
    "effect",
    [
        ("profile_drag", "cd0", 0.05),
        ("pitch_damping", "coefficient", 0.03),
        ("center_of_pressure", "shift", 0.003),
    ],
)
def test_a_model_that_lacks_an_effect_leaves_more(still, effect):
    floor, errors = floor_and_errors(*still, effect)
    assert floor.chance(errors) < UNLIKELY


def test_turbulence_raises_the_floor_and_one_flight_does_not_decide(turbulent):
    floor, errors = floor_and_errors(*turbulent)
    calm, _ = floor_and_errors(
        turbulent[0], dataclasses.replace(turbulent[1], air_std=0)
    )
    assert along(floor) > 3.0 * along(calm)
    assert calm.chance(errors) < UNLIKELY
    for lost in (20.0 * errors[0], np.nan):
        errors[0] = lost
        assert floor.chance(errors) > UNLIKELY
    errors[:8] = np.nan
    assert floor.chance(errors) < UNLIKELY
    floor.squares[0] = np.nan
    assert floor.chance(errors) < UNLIKELY
    floor.squares[:] = np.nan
    assert np.isnan(floor.chance(errors))


def test_a_floor_of_a_hundred_replicas_is_known_to_a_twentieth(still):
    floor, _ = floor_and_errors(*still)
    assert floor.squares.shape[2] == 100
    assert pytest.approx(0.05) == floors._ACCURACY


def test_errors_of_the_first_flights_count_each_row_once(still):
    floor, _ = floor_and_errors(*still)
    squares = floor.squares[:2, 0].mean(axis=1) * floor.rows[:2]
    rms = np.sqrt(squares.sum() / floor.rows[:2].sum())
    assert floor.errors(NO_NOISE, 2).position_rms_m == pytest.approx(rms)


def test_only_reported_variations_are_in_the_floor():
    """Errors of a formula look like small trims: a perfect model has none of them."""
    scales = dataclasses.replace(FLOOR, air=0.1, trim=0.002, wind=0.1, servo=0.01)
    traced = types.SimpleNamespace(
        forces=None,
        model=types.SimpleNamespace(scales=scales, kinds=("wind",), functions=()),
    )
    wind = Spread(std=0.08, unit="m/s", values={})
    truth = without_model_errors(traced, {"wind": wind})
    assert truth == dataclasses.replace(FLOOR, air=0.1, wind=0.08).without_floors


def test_where_nothing_was_found_all_variations_are_in_the_floor():
    """No formula is there to err: small winds of each flight are not reported."""
    scales = dataclasses.replace(FLOOR, trim=0.002, wind=0.04, servo=0.01)
    traced = types.SimpleNamespace(
        forces=None, model=types.SimpleNamespace(scales=scales, kinds=(), functions=())
    )
    truth = without_model_errors(traced, {})
    assert truth == dataclasses.replace(FLOOR, trim=0.002, wind=0.04).without_floors


def test_memory_that_begins_elsewhere_is_predicted_along_the_pitch_too():
    """As replicas are, which begin there."""
    effect, rng = typical("lagged_downwash", 2.0), np.random.default_rng(0)
    campaign = fly(effect, flights=6)
    theta = vector_of(GliderModel(effects=(effect,)))
    scales = dataclasses.replace(FLOOR, position=5e-4, pitch=3e-3, memory=0.05)
    task, _ = task_of(campaign)
    flights = []
    for flight, record in zip(campaign.flights, task.records, strict=True):
        linear = linearize(record, theta, NO_GAUSSIANS)
        moves = floors._moves_of(linear, scales)
        first = np.zeros((len(linear.start), 1))
        # Small enough for the flight to stay linear.
        first[NUM_STATES] = 0.05 * rng.choice([-1.0, 1.0])
        moved = floors._flown(moves, linear.shows, first)[:, :3, 0]
        flights.append(dataclasses.replace(flight, pose=flight.pose + moved))
    task, noise = task_of(dataclasses.replace(campaign, flights=tuple(flights)))
    model = begin(task, noise, [effect.kind.kind])
    model = dataclasses.replace(model, theta=theta)
    flown = flown_by(task, model, scales)
    floor = find_floor(flown, task.records, perfect_of(scales, noise))
    own = [predict(flown, record) for record in task.records]
    errors = np.sqrt(mean_squares(task.records, own)[:, :2])
    assert floor.chance(errors) > UNLIKELY
    rms = np.sqrt(np.mean(errors[:, 1] ** 2))
    assert rms < 1.5 * floor.errors(NO_NOISE, 6).rollout_measured_pitch.position_rms_m


def test_what_is_at_the_floor_of_its_scale_is_not_in_that_of_the_error():
    """A wind of 1 mm/s alone would be half a millimetre of a flight."""
    scales = dataclasses.replace(FLOOR, air=0.1, trim=1.5 * FLOOR.trim).without_floors
    assert (scales.air, scales.air_time) == (0.1, FLOOR.air_time)
    assert max(scales.wind, scales.trim, scales.moment) < 1e-8
    assert scales.position == FLOOR.position


@pytest.mark.parametrize("name", ["wing_area", "elevator_area", "hinge_offset"])
@pytest.mark.parametrize("factor", [100.0, 1e4])
def test_the_floor_of_a_model_that_diverges_is_unknown(still, name, factor):
    """No warning, which pytest would raise, and no singular matrix."""
    campaign, truth = still
    few = dataclasses.replace(campaign, flights=campaign.flights[:2])
    task, noise = task_of(few)
    scales = scales_of(truth)
    model = dataclasses.replace(begin(task, noise), scales=scales)
    model.theta[task.space.index[name]] *= factor
    flown = flown_by(task, model, scales)
    perfect = perfect_of(scales, noise)
    floor = find_floor(flown, task.records, perfect)
    errors = floor.errors(NO_NOISE, 2)
    assert not errors.position_rms_m < 10.0
