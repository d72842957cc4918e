"""A column is what the errors do when its coefficient moves."""

import dataclasses
import warnings

import numpy as np
import pytest

from glider.campaign.motion_capture import MotionCapture
from glider.compiled.replay import OFFSET, LogPath, roll_out
from glider.physics.effects import KINDS, NO_GAUSSIANS
from glider.physics.effects.free_functions import (
    FREE_FUNCTIONS,
    SENSOR_TERMS,
    FreeFunction,
    gaussians_of,
)
from glider.physics.servo import Servo
from glider.physics.state import NUM_STATES
from glider.sysid.likelihood.directions import Direction, slopes, starts_of
from glider.sysid.likelihood.filtering import whiten
from glider.sysid.likelihood.linear_flight import (
    STILL_AIR,
    Surroundings,
    linearize,
    path_of,
)
from glider.sysid.replay.replayed import offset_persists, signals, true_nodes
from tests.helpers.columns import SCALES, column_error, of_launch, whitened
from tests.helpers.tasks import fly, task_of

NAMES = [k for k, kind in KINDS.items() if kind.stage != "log"]


FINE = MotionCapture(position=1e-7, pitch=1e-7, elevator=1e-7)
"""Cameras without noise: the columns are of first order in the errors."""


def fly_finely(*effects):
    return task_of(fly(*effects, flights=2, duration=0.4, capture=FINE))[0]


@pytest.fixture(scope="module")
def task():
    return fly_finely()


@pytest.mark.parametrize("kind", NAMES)
def test_columns_of_an_effect_that_acts_are_derivatives(kind):
    values = {
        c.name: 0.9 * c.grid[0] if c.is_shape else 0.4 * c.scale
        for c in KINDS[kind].coefficients
    }
    task = fly_finely(KINDS[kind](**values))
    space, theta = task.space, task.vehicle.theta.copy()
    slots = space.slots_of(kind)
    theta[list(slots)] = list(values.values())
    for direction in slopes(space, slots):
        assert column_error(task.records[0], theta, direction) < 0.03


@pytest.mark.parametrize("kind", NAMES)
def test_columns_of_an_effect_that_is_absent_are_derivatives(task, kind):
    """Of its size, under each of its starting shapes; a shape alone goes by secants."""
    space, theta = task.space, task.vehicle.theta
    if all(c.is_shape for c in KINDS[kind].coefficients):
        for (secant,) in starts_of(space, KINDS[kind], theta):
            assert secant.moved(theta)[secant.slot] == theta[secant.slot] + secant.size
            assert secant.size in KINDS[kind].coefficients[0].grid
        return
    for columns in starts_of(space, KINDS[kind], theta):
        for direction in columns:
            assert column_error(task.records[0], theta, direction) < 0.03


def test_columns_of_a_servo_log_are_derivatives(task):
    """Of the offsets of its clocks, and of their drift."""
    space, theta = task.space, task.vehicle.theta
    for direction in slopes(space, space.slots_of("servo_log")):
        error = column_error(task.records[0], theta, direction)
        assert error < 0.1  # A path has kinks.


@pytest.mark.parametrize("term", sorted({*FREE_FUNCTIONS} - {*SENSOR_TERMS}))
def test_columns_of_free_functions_are_derivatives(task, term):
    """A constant of each term, put in as a free function and as a column."""
    record, theta, small = task.records[0], task.vehicle.theta, 1e-4
    one = np.ones((len(record.time) - 1, 1))
    flight = linearize(record, theta, NO_GAUSSIANS, terms=[term])
    added = [(FREE_FUNCTIONS[term], one)]
    wide = dataclasses.replace(flight, added=added).expanded()
    one = FreeFunction(constant=True, weights={term: [small]})
    gaussians = gaussians_of([one])
    column, error = np.moveaxis(whiten(wide, SCALES).innovations, 2, 0)
    there = whiten(linearize(record, theta, gaussians), SCALES).innovations[..., 0]
    numeric = (error - there) / small
    np.testing.assert_allclose(column, numeric, atol=0.02 * np.abs(numeric).max())


@pytest.mark.parametrize("term", SENSOR_TERMS)
def test_columns_of_a_reading_are_derivatives(task, term):
    """But for the launch, which moves with the nodes where the reading is known."""
    record, theta, small = task.records[0], task.vehicle.theta, 1e-4
    variable = 2 if term == "pose_pitch" else 0
    data = FreeFunction(
        variables=["pitch" if variable else "x"],
        centers=[[float(record.nodes[20, variable])]],
        widths=[0.3],
        weights={term: [small]},
    )
    gaussians, flight = gaussians_of([data]), linearize(record, theta, NO_GAUSSIANS)
    basis = data.basis(record.nodes[:, [variable]])
    added = [(FREE_FUNCTIONS[term], basis)]
    wide = dataclasses.replace(flight, added=added).expanded()
    column, error = whitened(wide).T
    numeric = (error - whitened(linearize(record, theta, gaussians))[:, 0]) / small
    launch, _ = np.linalg.qr(whitened(of_launch(flight)))
    column, numeric = (v - launch @ (launch.T @ v) for v in (column, numeric))
    assert np.abs(numeric).max() > 1.0
    np.testing.assert_allclose(column, numeric, atol=0.02 * np.abs(numeric).max())


FUNCTIONS = gaussians_of(
    [
        FreeFunction(
            variables=["alpha", "V"],
            centers=[[0.2, 6.0], [0.6, 5.0]],
            widths=[0.2, 2.0],
            weights={"c_drag": [0.3, -0.2], "c_normal": [0.5, 0.4]},
        ),
        FreeFunction(
            variables=["elevator"],
            centers=[[-0.3]],
            widths=[0.3],
            weights={"elevator_factor": [0.4]},
        ),
    ]
)


def ends_of(record, theta, nodes, about=STILL_AIR):
    """Returns where intervals end, each flown alone from its node."""
    path, numbers = path_of(record, theta, about)
    ends = []
    for k, node in enumerate(nodes[:-1]):
        interval = LogPath(path.times[k : k + 2], *(own[k : k + 1] for own in path[1:]))
        flown = roll_out(record.space.flown, interval, node, numbers, FUNCTIONS)
        ends.append(flown[1])
    return np.array(ends)


def test_moving_air_acts_on_the_forces_of_free_functions(task):
    """As a steady wind, by central differences."""
    record, theta = task.records[0], task.vehicle.theta
    flight = linearize(record, theta, FUNCTIONS)

    def ends(*wind):
        about = Surroundings(np.array([*wind, 0.0, 0.0]))
        return ends_of(record, theta, flight.nodes, about)

    for k, wind in enumerate(1e-3 * np.eye(2)):
        expected = (ends(*wind) - ends(*-wind))[:, flight.states] / 2e-3
        by_air = flight.moves[:, :, len(flight.states) + k]
        apart = np.abs(by_air - expected).max()
        assert apart < 0.02 * np.abs(expected).max()


@pytest.mark.parametrize(("lag", "share"), [(5e-6, 0.01), (0.02, 0.03)])
def test_a_signal_acts_on_the_forces_of_free_functions(task, lag, share):
    """An elevator that lags moves the tail's force that a function changes.

    Slopes see the mean over each interval, and of functions the tangent.
    """
    record, theta, space = task.records[0], task.vehicle.theta, task.space
    [slot] = space.slots_of("servo_lag")
    direction = Direction("servo_lag", slot, lag)
    flight = linearize(record, theta, FUNCTIONS, [direction])
    lagging = ends_of(record, direction.moved(theta), flight.nodes)
    expected = (ends_of(record, theta, flight.nodes) - lagging) / lag
    velocities = slice(4, 7)
    apart = flight.inputs[:, velocities, 0] - expected[:, velocities]
    rms = np.sqrt(np.mean(expected[:, velocities] ** 2, axis=0))
    most = share * np.array([3.0, 2.0, 1.0]) * rms  # Velocities change little.
    assert np.all(np.sqrt(np.mean(apart**2, axis=0)) < most)


def test_states_along_a_flight_are_each_models_own(task):
    """They begin at rest, which for separated flow is where it stalls."""
    record, late = task.records[0], task.vehicle.theta.copy()
    late[task.space.index["lagged_separation.stall_angle"]] = 0.05
    usual, own = (
        true_nodes(record, theta, with_states=True)
        for theta in (task.vehicle.theta, late)
    )
    assert np.abs(own - usual)[0].max() > 1e-3


def test_an_absent_effect_may_have_any_shape(task):
    """What it does along others depends on those alone."""
    record, usual, space = task.records[0], task.vehicle.theta, task.space
    slot = space.index["lagged_separation.relaxation"]
    shaped = usual.copy()
    shaped[slot] = 0.05
    size = space.index["lagged_separation.slope"]
    columns = slopes(space, [size], ((slot, 0.12),))
    found = [
        linearize(record, theta, NO_GAUSSIANS, columns).inputs[:, :NUM_STATES, 0]
        for theta in (usual, shaped)
    ]
    assert np.abs(found[0]).max() > 1e-4
    np.testing.assert_allclose(*found, atol=1e-6)
    whole = linearize(record, shaped, NO_GAUSSIANS, columns).inputs
    assert np.abs(whole[..., 0]).max() < 10.0


def test_an_error_of_many_columns_is_that_of_each(task):
    """Those of free functions too."""
    space, rng = task.space, np.random.default_rng(0)
    columns = slopes(space, space.slots_of("attached_lift"))
    flight = linearize(
        *(task.records[0], task.vehicle.theta, NO_GAUSSIANS, columns),
        terms=["c_drag", "wind_z"],
    )
    added = []
    for name in ("c_drag", "pose_pitch", "wind_z"):
        nodes = len(flight.moves) + (name in SENSOR_TERMS)
        added.append((FREE_FUNCTIONS[name], rng.normal(size=(nodes, 3))))
    flight = dataclasses.replace(flight, added=added)
    change = rng.normal(size=len(columns) + 9)
    whitened = whiten(flight, SCALES).innovations
    at_once = whiten(flight.combined(change), SCALES).innovations[..., 0]
    np.testing.assert_allclose(
        at_once, whitened @ [*-change, 1.0], rtol=1e-6, atol=1e-4
    )
    error = whiten(flight.error_only(), SCALES).innovations
    np.testing.assert_allclose(error, whitened[..., -1:], rtol=1e-9, atol=1e-9)


def test_an_elevator_forgets_at_a_stop_where_it_began(task):
    theta, record, apart = task.vehicle.theta, task.records[0], 1e-4
    angles, _ = signals(record, theta).at_nodes
    high = angles.min() + 0.7 * np.ptp(angles)
    record = dataclasses.replace(record, servo=Servo(-1.0, high, 13.0))
    other = dataclasses.replace(record, rest=record.rest + apart)
    persists = offset_persists(record, theta)
    assert persists[0] and not persists[-1]
    moved = signals(other, theta).at_nodes[0] - signals(record, theta).at_nodes[0]
    # The servo slows down within a row: what is left then is less than a half.
    np.testing.assert_allclose(moved, apart * persists, atol=0.5 * apart)
    assert abs(moved[-1]) < 1e-3 * apart
    # A flight's deviation is that of a flight whose elevator began elsewhere.
    flown = []
    for own in (record, other):
        path, dynamics = path_of(own, theta, STILL_AIR)
        kinds, launch = task.space.flown, record.nodes[0]
        flown.append(roll_out(kinds, path, launch, dynamics, NO_GAUSSIANS))
    about = dataclasses.replace(record, nodes=flown[0], elevator=0.0 * record.elevator)
    flight = linearize(about, theta, NO_GAUSSIANS)
    expected = (flown[1] - flown[0])[-1, flight.states]
    deviation = np.zeros(len(flight.states))
    deviation[OFFSET] = apart
    for moves in flight.moves:
        deviation = moves[:, : len(deviation)] @ deviation
    assert deviation[OFFSET] == 0.0 and abs(deviation[2]) > apart
    np.testing.assert_allclose(deviation, expected, rtol=0.05, atol=0.2 * apart)
    # Measured before the stop, it is off there alone.
    tall = dataclasses.replace(record, elevator=record.elevator + apart * persists)
    off = true_nodes(tall, theta)[:, OFFSET] - true_nodes(record, theta)[:, OFFSET]
    np.testing.assert_allclose(off, apart * persists, atol=1e-12)
    space = task.space
    servo = slopes(space, range(space.num_flown, len(space.names)))
    flight = linearize(tall, theta, NO_GAUSSIANS, servo)
    assert np.abs(flight.inputs[:, OFFSET]).max() < 1e-9


def test_a_model_that_diverges_is_linearized_without_a_warning(task):
    space, theta = task.space, task.vehicle.theta.copy()
    theta[space.index["profile_drag.cd0"]] = -1e20
    directions = slopes(space, space.slots_of("servo_lag"))
    with warnings.catch_warnings(action="error"):
        flight = linearize(task.records[0], theta, NO_GAUSSIANS, directions)
        endless = dataclasses.replace(
            flight, inputs=np.full_like(flight.inputs, np.inf)
        )
        error = endless.combined(np.ones(len(directions)))
    assert not np.isfinite(flight.inputs).all()
    assert np.isnan(error.inputs).all()
