"""A user effect goes through the whole loop like one of the library."""

import dataclasses
import functools

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator

from glider.campaign.motion_capture import MotionCapture
from glider.compiled.actuators import replayed_path
from glider.compiled.replay import log_path, roll_out
from glider.compiled.user_effects import check_user_effects
from glider.errors import InputError
from glider.physics.effects import KINDS, Replay
from glider.physics.model import GliderModel
from glider.physics.servo import Servo
from glider.simulation.campaigns import CampaignPlan
from glider.sysid.fit import prediction
from glider.sysid.fit.prediction import RolloutModel, find_launch
from glider.sysid.likelihood.directions import slopes
from glider.sysid.likelihood.filtering import start_variances
from glider.sysid.likelihood.linear_flight import linearize
from glider.sysid.likelihood.model_fit import fit_model
from glider.sysid.likelihood.scales import Scales, start_scales
from glider.sysid.likelihood.uncertainty import uncertainty_of
from glider.sysid.pipeline import close_the_loop
from glider.sysid.replay.log_space import (
    LIBRARY_SPACE,
    SERVO_LOG,
    log_space,
    resting_states,
    vector_of,
)
from glider.sysid.replay.replayed import signals, true_nodes
from glider.systems.plant import GliderPlant
from tests.helpers.columns import column_error
from tests.helpers.own_kinds import ALL, BLEED, BOOM, FLAP, INFLOW, LEAK, STICKY, TWIST
from tests.helpers.tasks import begin, task_of


@functools.cache
def own_space():
    """Compiles formulas: not when the tests are collected."""
    return log_space(ALL)


def planted(kind, **plan):
    """A campaign whose glider has one user effect of a typical size.

    The model names the others too, at sizes that do nothing, so that all tests
    share one compiled kernel.
    """
    sizes = {c.name: c.scale for c in kind.coefficients if not c.is_shape}
    effects = tuple(e(**sizes) if e is kind else e() for e in ALL)
    model = GliderModel(effects=effects)
    campaign = CampaignPlan(**plan).simulate(model, np.random.default_rng(3))
    return model, campaign


@pytest.fixture(
    scope="module",
    params=[
        pytest.param(kind, id=kind.kind, marks=pytest.mark.nightly)
        for kind in (FLAP, BOOM)
    ],
)
def closed(request):
    """A user effect without and one with a state of its own, closed the loop on."""
    _, campaign = planted(request.param, flights=8)
    return request.param, close_the_loop(campaign, own_effects=ALL)


def test_an_own_effect_is_named(closed):
    kind, result = closed
    assert result.verdict == "effect_found"
    assert [e.kind for e in result.effects] == [kind.kind]
    found = result.effects[0].coefficients["gain"]
    assert abs(found.value - kind.coefficients[0].scale) < 5.0 * found.std
    assert found.std < 0.02 * found.value
    nominal, corrected = result.errors["nominal"], result.errors["corrected"]
    assert corrected.position_rms_m < 0.25 * nominal.position_rms_m


def test_the_report_shows_its_words(closed, capsys):
    from rich.console import Console

    from glider.report.terminal import print_summary

    kind, result = closed
    print_summary(result, Console(width=200))
    assert kind.words in capsys.readouterr().out


def test_the_corrected_model_is_saved_loaded_and_flown(closed, tmp_path):
    kind, result = closed
    result.model.save(tmp_path / "model.yaml")
    with pytest.raises(InputError, match=f"'{kind.kind}'.*own_effects"):
        GliderModel.load(tmp_path / "model.yaml")
    model = GliderModel.load(tmp_path / "model.yaml", own_effects=ALL)
    assert model == result.model
    plant = GliderPlant(model=model)
    assert plant.num_continuous_states() == 7 + len(kind.states)


@pytest.mark.parametrize("kind", ALL, ids=lambda kind: kind.kind)
def test_user_effects_of_each_stage_are_fitted(kind):
    model, campaign = planted(kind, flights=4)
    task, noise = task_of(campaign, own_space())
    truth, slots = vector_of(model), list(own_space().slots_of(kind.kind))
    found = fit_model(task, begin(task, noise, [kind.kind]))
    known = uncertainty_of(task, found)
    std = np.array([known.std(slot) for slot in slots])
    assert np.all(np.abs(found.theta[slots] - truth[slots]) < 5.0 * std)
    assert std[0] < 0.2 * abs(truth[slots[0]])
    assert found.scales.position == pytest.approx(noise.position, rel=0.25)
    assert found.cost < fit_model(task, begin(task, noise)).cost - 20.0


def test_flights_are_those_of_the_plant(monkeypatch):
    """What the log's kernel flies, with its states at rest, is what Drake flies."""
    model, campaign = planted(BOOM, flights=3)
    task, noise = task_of(campaign, own_space())
    record, theta = task.records[0], vector_of(model)
    known = RolloutModel(
        theta=theta,
        gaussians=model.gaussians,
        scales=start_scales(noise),
        per_flight_trims=False,
    )
    monkeypatch.setattr(prediction, "beginning_rows", lambda time, trims: len(time))
    start = find_launch(known, record)[0]
    start[7:] = 0.0
    path = log_path(record.time, *signals(record, theta)[:2])
    flown = roll_out(own_space().flown, path, start, theta, model.gaussians)
    present = tuple(e for e in model.effects if e.kind is BOOM)
    plant = GliderPlant(model=dataclasses.replace(model, effects=present))
    simulator = Simulator(plant)
    context = simulator.get_mutable_context()
    state = plant.model.initial_state(start[:7])
    state[3], state[7] = start[3] + record.rest, 0.0
    context.SetContinuousState(state)
    # The same command is held between its switches, within the servo's travel.
    for time, end, command in zip(
        record.switch_times,
        [*record.switch_times[1:], record.time[-1]],
        record.commands,
        strict=True,
    ):
        if end > time >= 0.0:
            plant.get_input_port(0).FixValue(context, [command])
            simulator.AdvanceTo(min(end, record.time[-1]))
    pose = context.get_continuous_state_vector().CopyToVector()[:3]
    np.testing.assert_allclose(pose, flown[-1, :3], atol=2e-3)


def test_own_states_rest_where_the_plant_has_them_rest():
    own = [
        KINDS["lagged_downwash"](gradient=0.1),
        KINDS["dynamic_stall"](strength=1.0),
        KINDS["lagged_separation"](slope=1.0),
    ]
    own += [BOOM(gain=1e-3), INFLOW(gain=0.1)]
    plant = GliderPlant(model=GliderModel(effects=tuple(own)))
    state = np.array([-2.0, 0.3, -0.2, 0.1, 6.0, -1.0, 0.5])
    theta = own_space().pack(plant.model.parameters)
    rest = resting_states(own_space(), 0.0, state, 0.0, theta)
    np.testing.assert_allclose(rest, plant.model.initial_state(state)[7:])
    assert rest[4] > 0.1  # It sinks.
    assert resting_states(own_space(), 0.0, state, 3.0, theta)[3] == 3.0


def test_a_flight_begins_near_rest():
    """Within a share of the states' scales, as its prior has it."""
    model, campaign = planted(BOOM, flights=3)
    task, _ = task_of(campaign, own_space())
    record, theta = task.records[0], vector_of(model)
    start = true_nodes(record, theta)[0]
    elevator, rate, *_ = signals(record, theta)
    launch = start + np.eye(len(start))[3] * elevator[0, 0]
    rest = resting_states(own_space(), 0.0, launch, rate[0], theta)
    assert np.all(rest != 0.0)
    np.testing.assert_allclose(start[7:], rest)
    flight = linearize(record, theta, model.gaussians)
    np.testing.assert_allclose(flight.start[7 : len(flight.states)], 0.0, atol=1e-12)
    spread = np.sqrt(start_variances(flight, Scales()))
    [state] = flight.states[7:]  # The others' effects do nothing.
    assert start[state] == rest[state - 7] and spread[7] == pytest.approx(
        Scales.memory * 5.0
    )


@pytest.mark.parametrize("kind", ALL, ids=lambda kind: kind.kind)
def test_columns_are_derivatives_of_the_errors(kind):
    fine = MotionCapture(position=1e-7, pitch=1e-7, elevator=1e-7)
    model, campaign = planted(kind, flights=2, duration=0.4, capture=fine)
    task, _ = task_of(campaign, own_space())
    theta = vector_of(model)
    tolerance = 0.1 if kind.is_replayed else 0.03  # A path has kinks.
    for direction in slopes(own_space(), own_space().slots_of(kind.kind)):
        assert column_error(task.records[0], theta, direction) < tolerance


def test_an_own_actuator_of_the_servos_formula_replays_as_the_servo_does():
    """Integrated by its formula here, solved exactly there."""
    switches = np.array([0.0, 0.02, 0.05, 0.11, 0.2])
    commands = np.array([5.0, -8.0, 3.0, 13.0, 0.0])
    query = np.linspace(-0.05, 0.4, 60)
    servo = Servo(-0.4, 0.3, 12.0)
    own, exact = (
        replayed_path(replay, switches, commands, query, servo, start=0.1)
        for replay in (
            Replay(delay=0.01, actuators=((STICKY, (1.0, 0.04)),)),
            Replay(delay=0.01, time_constant=0.04),
        )
    )
    np.testing.assert_allclose(own, exact, atol=1e-5)
    assert exact.max() > 0.29


@pytest.mark.parametrize(
    ("pending", "message"),
    [
        (lambda late: late, "its pending does not take"),
        (lambda late, gain, time: -gain * time * late, "is 0.03; expected -0.03, the"),
    ],
)
def test_what_is_pending_is_checked(pending, message):
    """The servo keeps its limits by it."""
    with pytest.raises(InputError, match=message):
        dataclasses.replace(STICKY, pending=pending)


def test_an_own_actuator_needs_no_state():
    weak = dataclasses.replace(
        STICKY,
        kind="weak",
        coefficients=STICKY.coefficients[:1],
        formula=weak_servo,
        states=(),
        state_rate=None,
        steady_state=None,
        pending=None,
    )
    check_user_effects((weak,))
    model = GliderModel(effects=(weak(gain=0.25),))
    assert model.num_states == 7
    x = np.array([-2.0, 0.3, -0.2, 0.1, 6.0, -1.0, 0.5])
    slow, whole = (
        m.chain.derivatives(0.0, x, u, 0.0, 0.0, m.numbers)
        for m, u in ((model, 8.0), (GliderModel(), 6.0))
    )
    assert slow == whole
    switches, query = np.array([0.0, 0.02, 0.05, 0.11]), np.linspace(-0.05, 0.2, 30)
    commands = np.array([5.0, -8.0, 3.0, 0.0])
    replay = Replay(actuators=((weak, (0.25,)),))
    turned = replayed_path(replay, switches, commands, query)
    expected = replayed_path(Replay(), switches, 0.75 * commands, query)
    np.testing.assert_allclose(turned, expected, atol=1e-7)
    assert np.ptp(expected) > 0.1


def weak_servo(rate, gain):
    return (1.0 - gain) * rate


def test_the_library_keeps_its_layout():
    assert log_space(()) is LIBRARY_SPACE
    of_logs = {SERVO_LOG.kind: SERVO_LOG}  # Fitted, never an effect.
    corrected = {"angle_sign": KINDS["angle_sign"]}  # Before a log is replayed.
    assert LIBRARY_SPACE.kinds | corrected == KINDS | of_logs
    shared = LIBRARY_SPACE.names[: LIBRARY_SPACE.num_flown]
    assert own_space().names[: len(shared)] == shared


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"kind": "wind"}, "name is taken"),
        ({"kind": "unexplained"}, "name is taken"),
        ({"kind": "servo_log"}, "name is taken"),
        ({"stage": "log", "adds_to": ("pose_x", "pose_z")}, "stage is 'log'"),
        ({"formula": lambda flow, gain: (float(str(gain)), 0.0)}, "does not compile"),
    ],
)
def test_an_own_effect_that_cannot_be_traced_is_one_sentence(changes, words):
    bad = dataclasses.replace(FLAP, **changes)
    with pytest.raises(InputError, match=words) as error:
        check_user_effects((bad,))
    assert "\n" not in str(error.value)


def test_an_effect_in_the_place_of_its_kind_is_refused():
    with pytest.raises(InputError, match="found a Effect; expected an EffectKind"):
        close_the_loop("nowhere", own_effects=[FLAP(gain=0.1)])


def test_the_same_own_effect_twice_is_refused():
    with pytest.raises(InputError, match="name is taken"):
        check_user_effects((TWIST, BLEED, LEAK, TWIST))


def test_an_own_effect_can_be_asked_for_alone():
    with pytest.raises(InputError, match="unknown effect 'flap'"):
        close_the_loop("nowhere", effects=["flap"])
    with pytest.raises(InputError, match="nowhere"):
        close_the_loop("nowhere", effects=["flap"], own_effects=[FLAP])
