"""The diagrams hold what they promise, convert, and fly what they should."""

import dataclasses

import numpy as np
import pytest
from pydrake.autodiffutils import ExtractGradient, InitializeAutoDiff
from pydrake.geometry import Meshcat
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder, LeafSystem
from pydrake.systems.primitives import ConstantVectorSource, Gain, MatrixGain

from diagrams.loops import LONGEST, closed_loop, estimated_loop, open_loop, tape_rows
from diagrams.playback import track_of
from diagrams.simulate import _draw_capture, reset, simulate_flights
from glider.campaign.logs import Campaign
from glider.campaign.motion_capture import MotionCapture
from glider.campaign.reader import load_campaign
from glider.campaign.writer import save_campaign
from glider.compiled.actuators import elevator_path
from glider.errors import InputError
from glider.estimation.perching import perching_filter
from glider.physics.effects import DYNAMIC_STALL, SERVO_LAG
from glider.physics.held_commands import command_steps
from glider.physics.model import GliderModel
from glider.physics.parameters import PARAMETER_NAMES
from glider.physics.servo import limited_rate
from glider.planning.problem import PerchingProblem
from glider.simulation.flown_flights import closest_pass
from glider.simulation.fly import AFTER, fly
from glider.systems.kalman_filter import ExtendedKalmanFilter
from glider.systems.noise import SampledNoise
from glider.systems.plant import GliderPlant
from glider.systems.regulator import tracking_regulator
from tests.helpers.flights import LAGGING, NO_HOOK, NOMINAL, PROBLEM, plan_of, policy

DURATION = 0.98
STALLING = GliderModel(effects=(DYNAMIC_STALL(strength=0.5),))
ALWAYS = {"glider", "servo", "state_log", "rate_log", "force_log"}
CAPTURE = {"elevator_angle", "markers", "motion_capture", "capture_log", "command_log"}


def regulator(lagging=False):
    """A System fits into one diagram: each needs its own."""
    return tracking_regulator(LAGGING if lagging else NOMINAL, plan_of(lagging))


def names_of(diagram):
    return {system.get_name() for system in diagram.GetSystems()}


def launches(count):
    return PROBLEM.draw_launches(count, np.random.default_rng(3))


@pytest.fixture(scope="module")
def replay():
    return open_loop(NOMINAL, plan_of())


@pytest.fixture(scope="module")
def plain():
    return closed_loop(NOMINAL, regulator())


@pytest.fixture(scope="module")
def sampled():
    """Everything at once: an observer, a hold and motion capture."""
    return closed_loop(
        LAGGING,
        regulator(lagging=True),
        planned=LAGGING,
        command_rate=50.0,
        motion_capture=120.0,
    )


@pytest.fixture(params=["replay", "plain", "sampled"])
def diagram(request):
    return request.getfixturevalue(request.param)


# ---------------------------------------------------------------- what they hold


@pytest.mark.parametrize(
    ("name", "systems"),
    [
        ("replay", ALWAYS | {"plan"}),
        ("plain", ALWAYS | {"regulator"}),
        (
            "sampled",
            ALWAYS
            | CAPTURE
            | {"regulator", "measured_state", "observer"}
            | {"command_hold"},
        ),
    ],
)
def test_the_names_promised_are_there(name, systems, request):
    diagram = request.getfixturevalue(name)
    assert names_of(diagram) == systems
    outputs = {
        diagram.get_output_port(i).get_name() for i in range(diagram.num_output_ports())
    }
    assert outputs >= {"state", "pose", "elevator_rate"}
    assert diagram.get_name() == ("open_loop" if name == "replay" else "closed_loop")


def test_every_input_is_connected_but_the_wind(diagram):
    assert diagram.num_input_ports() == 0
    connected = {
        (system.get_name(), int(port)) for system, port in diagram.connection_map()
    }
    for system in diagram.GetSystems():
        for index in range(system.num_input_ports()):
            name = system.get_input_port(index).get_name()
            found = (system.get_name(), index) in connected
            assert found != ((system.get_name(), name) == ("glider", "wind")), name


def test_the_servo_is_what_the_glider_gets(diagram):
    sources = {
        (system.get_name(), system.get_output_port(port).get_name())
        for (target, _), (system, port) in diagram.connection_map().items()
        if target.get_name() == "glider"
    }
    assert sources == {("servo", "elevator_rate")}


def test_its_autodiff_twin_has_its_slopes(diagram):
    """Of the state's derivatives by the glider's state, by finite differences."""
    start = np.array(PROBLEM.launch) + 0.02
    context = diagram.CreateDefaultContext()
    reset(diagram, context, start)
    x = context.get_continuous_state_vector().CopyToVector()
    twin = diagram.ToAutoDiffXd()
    twin_context = twin.CreateDefaultContext()
    twin_context.SetTimeStateAndParametersFrom(context)
    twin_context.SetContinuousState(InitializeAutoDiff(x))
    slopes = ExtractGradient(twin.EvalTimeDerivatives(twin_context).CopyToVector())

    def rates(state):
        context.SetContinuousState(state)
        return diagram.EvalTimeDerivatives(context).CopyToVector()

    for i in range(len(x)):
        step = 1e-6 * np.eye(len(x))[i]
        column = (rates(x + step) - rates(x - step)) / 2e-6
        np.testing.assert_allclose(slopes[:, i], column, rtol=1e-4, atol=1e-4)


def test_a_meshcat_shows_the_flight():
    meshcat = Meshcat(port=0)
    diagram = open_loop(NOMINAL, plan_of(), meshcat=meshcat)
    assert {"glider_scene_graph", "glider_visualizer"} <= names_of(diagram)
    simulate_flights(diagram, launches(1), 0.05)
    assert meshcat.HasPath("/drake/glider")


# ------------------------------------------------------------------ how they fly


def test_the_replay_is_the_compiled_rollout_and_the_plan(replay):
    starts = np.vstack([PROBLEM.launch, launches(2)])
    none = dataclasses.replace(
        policy(), gains=0.0 * policy().gains, corrections=0.0 * policy().corrections
    )
    ours = fly(NOMINAL, none, starts, step=0.0005)
    flights = simulate_flights(
        replay, starts, ours.times[-1], problem=NO_HOOK, accuracy=1e-9
    )
    ends = [flight.states[-1] for flight in flights]
    np.testing.assert_allclose(ours.ends, ends, atol=1e-5)
    assert flights[0].miss < 1e-3
    assert min(flight.miss for flight in flights[1:]) > 0.01


def test_noise_is_drawn_with_the_deviations_of_motion_capture(sampled):
    drawn = _draw_capture(sampled, 40, np.random.default_rng(0))
    assert drawn.shape == (40, tape_rows(120.0), 4)
    np.testing.assert_allclose(drawn.std(axis=(0, 1)), MotionCapture().std, rtol=0.05)
    noise = MotionCapture().draw(np.random.default_rng(0), *drawn.shape[:2])
    np.testing.assert_array_equal(drawn, noise)


def test_no_noise_is_drawn_without_motion_capture(plain):
    with pytest.raises(InputError, match="the diagram has none"):
        simulate_flights(
            plain, launches(1), 0.1, capture_noise=np.random.default_rng(0)
        )


def test_feedback_brings_a_launch_to_the_wire(plain):
    flights = simulate_flights(plain, launches(3), plan_of().duration + AFTER)
    assert all(flight.perched for flight in flights)
    assert max(flight.miss for flight in flights) < 0.02


def test_the_forces_are_those_of_the_wing_and_then_the_elevator(sampled):
    """Along the whole flight the glider's own port, and so in what is shown."""
    [flight] = simulate_flights(sampled, launches(1), 0.3)
    plant = GliderPlant(LAGGING)
    context = plant.CreateDefaultContext()
    # Behind its lag, the elevator turns at a rate that is a state.
    plant.GetInputPort("elevator_rate").FixValue(context, [0.0])
    for k in (0, len(flight.times) // 2, -1):
        context.SetContinuousState(flight.states[k])
        wing, elevator = plant.GetOutputPort("forces").Eval(context)[:2]
        assert flight.forces[k] == pytest.approx([wing, elevator])
        assert abs(wing - elevator) > 0.01
    shown = track_of("flown", flight)
    rows = np.searchsorted(flight.times, shown.times, side="right") - 1
    np.testing.assert_array_equal(shown.forces, flight.forces[rows])


def test_a_compiled_flight_is_shown_without_forces():
    flights = fly(
        NOMINAL,
        policy(),
        launches(1),
        problem=NO_HOOK,
        command_rate=50.0,
        keep_paths=True,
    )
    shown = track_of("compiled", flights.flight(0))
    assert shown.forces is None
    np.testing.assert_array_equal(shown.times, flights.times)
    np.testing.assert_array_equal(shown.poses, flights.paths[0, :, :4])


@pytest.mark.parametrize("wire", [(-0.3, 0.2), (-3.0, 0.1)])
def test_the_miss_is_of_the_wire_that_is_given(replay, wire):
    problem = PerchingProblem(wire=list(wire), hook=NO_HOOK.hook)
    [flight] = simulate_flights(replay, launches(1), 0.95, problem=problem)
    of_wire, of_origin = (
        closest_pass(flight.times, flight.states, np.array(place)).miss
        for place in (wire, (0.0, 0.0))
    )
    assert flight.miss == of_wire != of_origin


def test_a_glider_that_the_hook_takes_stays_at_the_wire(sampled):
    """Its flight and its log end there, and so does the simulation."""
    duration = plan_of().duration + AFTER
    held = simulate_flights(sampled, launches(3), duration)
    left = simulate_flights(sampled, launches(3), duration, problem=NO_HOOK)
    assert held.perched == 3
    for flight, path in zip(held, left, strict=True):
        assert not path.perched
        assert flight.times[-1] < path.times[-1] - 0.05
        np.testing.assert_allclose(flight.states[-1], flight.arrival)
        np.testing.assert_allclose(path.miss, flight.miss, atol=1e-4)
        wire = np.linalg.norm(flight.states[-1, :2])
        assert wire == pytest.approx(flight.miss)
        assert len(flight.times) == len(flight.states) == len(flight.forces)
        assert flight.log.time[-1] <= flight.times[-1] < flight.log.time[-1] + 0.01


@pytest.mark.parametrize(
    ("miss", "pitch", "speed", "perched"),
    [
        (0.049, -0.8, 2.0, True),
        (0.051, -0.8, 2.0, False),  # Beyond reach.
        (0.0, -0.34, 2.0, False),  # Too flat.
        (0.0, -1.18, 2.0, False),  # Too steep.
        (0.0, -0.8, 2.79, True),
        (0.0, -0.8, 2.81, False),  # Too fast.
        (np.nan, -0.8, 2.0, False),
    ],
)
def test_a_perch_is_what_the_hook_can_take(replay, miss, pitch, speed, perched):
    [flight] = simulate_flights(replay, launches(1), 0.01)
    arrival = np.array([0.0, 0.0, pitch, 0.0, 0.6 * speed, -0.8 * speed, 1.0])
    flight = dataclasses.replace(flight, miss=miss, arrival=arrival)
    assert flight.perched is perched
    assert flight.speed == pytest.approx(speed)


def test_flights_of_one_diagram_know_nothing_of_one_another(sampled):
    starts, noise = launches(2), MotionCapture().draw(np.random.default_rng(5), 2, 49)
    both = simulate_flights(sampled, starts, 0.3, capture_noise=noise)
    [alone] = simulate_flights(sampled, starts[1:], 0.3, capture_noise=noise[1:])
    np.testing.assert_array_equal(both[1].states, alone.states)
    np.testing.assert_array_equal(both[1].times, alone.times)
    np.testing.assert_array_equal(both[1].log.pose, alone.log.pose)
    # Nor of noise that is no longer asked for.
    [quiet] = simulate_flights(sampled, starts[1:], 0.3)
    assert np.max(np.abs(quiet.log.pose - alone.log.pose)) > 1e-3


def test_the_observer_knows_the_lag_as_the_glider_itself(sampled):
    """On the right model, the states it runs are those that the glider has."""
    told = closed_loop(
        LAGGING, regulator(lagging=True), all_states=True, command_rate=50.0
    )
    ends = [
        simulate_flights(diagram, launches(1), DURATION, problem=NO_HOOK, accuracy=1e-8)
        for diagram in (sampled, told)
    ]
    for one, other in zip(*ends, strict=True):
        np.testing.assert_allclose(one.states[-1], other.states[-1], atol=1e-6)


def test_an_observer_flies_a_glider_without_those_states():
    diagram = closed_loop(NOMINAL, regulator(lagging=True), planned=LAGGING)
    assert "measured_state" not in names_of(diagram)
    [flight] = simulate_flights(diagram, launches(1), DURATION)
    assert flight.perched


def test_a_regulator_sees_the_first_states_of_a_glider_with_more():
    diagram = closed_loop(LAGGING, regulator())
    assert "measured_state" in names_of(diagram)
    [flight] = simulate_flights(diagram, launches(1), DURATION)
    assert flight.states.shape[1] == 8
    assert flight.perched


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"command_rate": -1.0}, "rate is -1.0"),
        ({"planned": NOMINAL}, "wants 8"),
        ({}, "`planned`"),
        ({"truth": STALLING}, "`planned`"),  # As many states, but others.
        ({"all_states": True}, "8 states and the glider has 7"),
        (
            {"truth": LAGGING, "planned": LAGGING, "all_states": True},
            "without `planned`",
        ),
    ],
)
def test_what_does_not_fit_is_refused(options, message):
    truth = options.get("truth", NOMINAL)
    others = {name: value for name, value in options.items() if name != "truth"}
    with pytest.raises(InputError, match=message):
        closed_loop(truth, MatrixGain(np.ones((1, 8))), **others)


class OwnController(LeafSystem):
    """A user's controller: gains about the plan."""

    def __init__(self, states=7, commands=1):
        super().__init__()
        self._state = self.DeclareVectorInputPort("x", states)
        self.DeclareVectorOutputPort("u", commands, self._calc)

    def _calc(self, context, output):
        time = min(context.get_time(), plan_of().duration)
        offset, gain = policy().sample(np.array([time]))
        output.SetFromVector(offset - gain @ self._state.Eval(context))


class OwnFilter(LeafSystem):
    """A user's filter: the model's flight, drawn to each pose by constant gains."""

    def __init__(self, missing=None, poses=3, states=7, ticks=True):
        super().__init__()
        self._plant = GliderPlant(NOMINAL)
        self._flown = self._plant.CreateDefaultContext()
        self._ports = {
            name: self.DeclareVectorInputPort(name, size)
            for name, size in (("measured", poses), ("elevator_rate", 1))
            if name != missing
        }
        start = np.resize(PROBLEM.launch, states)
        held = self.DeclareDiscreteState(start)
        if ticks:
            self.DeclarePeriodicDiscreteUpdateEvent(1 / 240, 0.0, self._step)
        if missing != "state":
            self.DeclareStateOutputPort("state", held)

    def _step(self, context, into):
        state = context.get_discrete_state_vector().CopyToVector()
        rate = self._ports["elevator_rate"].Eval(context)
        self._plant.GetInputPort("elevator_rate").FixValue(self._flown, rate)
        self._flown.SetContinuousState(state)
        state += self._plant.EvalTimeDerivatives(self._flown).CopyToVector() / 240
        away = self._ports["measured"].Eval(context) - state[:3]
        state[:3] += 0.3 * away
        state[4:] += 10.0 * away
        into.set_value(state)


def test_a_users_controller_and_filter_fly_to_the_wire():
    loop = estimated_loop(NOMINAL, OwnController(), OwnFilter(), command_rate=50.0)
    assert loop.GetSubsystemByName("motion_capture").rate == 240.0
    noise = np.random.default_rng(0)
    seeing = closed_loop(NOMINAL, OwnController(), command_rate=50.0)
    duration = plan_of().duration + AFTER
    [flight] = simulate_flights(loop, launches(1), duration, capture_noise=noise)
    [other] = simulate_flights(seeing, launches(1), duration)
    assert flight.perched and other.perched
    assert np.max(np.abs(flight.states[-1] - other.states[-1])) > 1e-4


@pytest.mark.parametrize("planned", [None, NOMINAL])
def test_the_second_servo_is_the_filters_or_the_one_that_is_given(planned):
    """Of the true glider's it knows nothing: that lags by another time."""
    truth = GliderModel(effects=(SERVO_LAG(time_constant=0.08),))
    ekf, prior = perching_filter(LAGGING, PROBLEM.launch)
    regulator = tracking_regulator(LAGGING, plan_of(lagging=True))
    loop = estimated_loop(
        truth, regulator, ExtendedKalmanFilter(ekf, prior), planned=planned
    )
    servo = loop.GetSubsystemByName("believed_servo")
    context = servo.CreateDefaultContext()
    state = np.zeros(8)
    state[[3, 7]] = 0.9, 2.0  # The elevator, and its lagged rate.
    servo.GetInputPort("command").FixValue(context, [5.0])
    servo.GetInputPort("state").FixValue(context, state)
    own = (planned or LAGGING).parameters.servo
    demanded = 0.9 if planned else 0.9 + 0.03 * 2.0
    expected = limited_rate(5.0, demanded, own)
    assert servo.GetOutputPort("elevator_rate").Eval(context) == pytest.approx(expected)


@pytest.mark.parametrize(
    ("filter_options", "message"),
    [
        ({"poses": 2}, "input 'measured' is 2; expected 3 or 4"),
        ({"states": 6}, "output 'state' is 6; expected 7"),
        ({"ticks": False}, "no periodic discrete update; expected one"),
    ],
)
def test_a_filter_with_other_ports_is_refused(filter_options, message):
    with pytest.raises(InputError, match=message):
        estimated_loop(NOMINAL, OwnController(), OwnFilter(**filter_options))


@pytest.mark.parametrize("port", ["measured", "elevator_rate", "state"])
def test_drake_names_a_port_that_a_filter_lacks(port):
    with pytest.raises(Exception, match=f"does not have an .*port named '?{port}"):
        estimated_loop(NOMINAL, OwnController(), OwnFilter(missing=port))


def test_a_filter_without_a_clock_is_given_a_rate():
    loop = estimated_loop(
        NOMINAL, OwnController(), OwnFilter(ticks=False), capture_rate=100.0
    )
    assert loop.GetSubsystemByName("motion_capture").rate == 100.0


@pytest.mark.parametrize(
    ("controller", "message"),
    [
        # It would get the first six of seven states.
        (OwnController(states=6), r"first input is 6; expected 7 or more.*pitchdot"),
        (OwnController(commands=2), "first output is 2; expected 1"),
        (ConstantVectorSource([0.0]), "first input is 0; expected 7"),
    ],
)
def test_a_controller_with_other_ports_is_refused(controller, message):
    for wire in (closed_loop, lambda *given: estimated_loop(*given, OwnFilter())):
        with pytest.raises(InputError, match=message):
            wire(NOMINAL, controller)


def test_noise_for_a_diagram_without_is_refused(plain):
    with pytest.raises(InputError, match="the diagram has none"):
        simulate_flights(plain, launches(1), 0.1, capture_noise=np.zeros((1, 5, 4)))


def test_noise_is_that_of_each_flight_to_its_end(sampled):
    noise = np.zeros((1, 5, 4))
    with pytest.raises(InputError, match=f"expected at most {LONGEST:g} s"):
        simulate_flights(sampled, launches(1), LONGEST + 0.1, capture_noise=noise)
    with pytest.raises(InputError, match="is 1; expected 2, as of flights"):
        simulate_flights(sampled, launches(2), 0.1, capture_noise=noise)


# --------------------------------------------------------------- what is measured


def test_motion_capture_logs_a_flight_of_a_campaign(sampled, tmp_path):
    rng = np.random.default_rng(8)
    noise = MotionCapture().draw(rng, 2, 200)
    quiet, noisy = (
        simulate_flights(
            sampled, launches(2), DURATION, problem=NO_HOOK, capture_noise=tape
        )
        for tape in (None, noise)
    )
    parameters = NOMINAL.parameters
    campaign = Campaign(
        name="flown",
        path=tmp_path,
        vehicle={name: getattr(parameters, name) for name in PARAMETER_NAMES},
        elevator="servo",
        elevator_limits=tuple(parameters.elevator_limits),
        elevator_rate_limit=parameters.elevator_rate_limit,
        pose_rate=120.0,
        command_rate=50.0,
        flights=tuple(flight.log for flight in noisy),
    )
    save_campaign(tmp_path, campaign)
    loaded = load_campaign(tmp_path).flights
    assert [flight.name for flight in loaded] == ["flight_000.csv", "flight_001.csv"]
    for k in range(2):
        truth, log = quiet[k], loaded[k]
        np.testing.assert_allclose(log.time, np.arange(118) / 120.0, atol=1e-9)
        rows = np.searchsorted(truth.times, log.time - 1e-9)
        np.testing.assert_allclose(truth.times[rows], log.time, atol=1e-9)
        np.testing.assert_allclose(
            log.pose, truth.states[rows, :3] + noise[k, :118, :3], atol=1e-7
        )
        np.testing.assert_allclose(
            log.elevator, truth.states[rows, 3] + noise[k, :118, 3], atol=1e-7
        )
        np.testing.assert_array_equal(quiet[k].log.pose, truth.states[rows, :3])


def test_a_row_shows_the_command_in_force_from_its_time_on(sampled):
    [flight] = simulate_flights(sampled, launches(1), DURATION, problem=NO_HOOK)
    changes = np.flatnonzero(np.diff(flight.log.command)) + 1
    before, after = flight.log.time[changes - 1], flight.log.time[changes]
    # After the plan's end the command stays: its gain on a lagging servo is zero there.
    switches = np.arange(1, 50.0 * plan_of(lagging=True).times[-1]) / 50.0
    assert changes[0] > 1  # The first command is in force from the first row on.
    for switch in switches:
        assert np.any((before < switch - 1e-9) & (switch - 1e-9 <= after))


def test_the_log_replays_to_the_elevator_that_flew(sampled):
    """A command that is late by a row would be an effect of the glider."""
    flown = simulate_flights(sampled, launches(3), DURATION, problem=NO_HOOK)
    [lag] = LAGGING.effects[0].values
    for flight in flown:
        log = flight.log
        tape = command_steps(log.time, log.command, 50.0)
        servo = LAGGING.parameters.servo
        path = elevator_path(*tape, log.time, servo, time_constant=lag)
        np.testing.assert_allclose(path, log.elevator, atol=1e-6)


def test_a_log_replays_where_the_servo_is_at_its_limits(sampled):
    """Also behind a lag: it keeps its limits in the plant as in the replay."""
    rng = np.random.default_rng(1)
    far = PROBLEM.draw_launches(3, rng, height=0.5, speed=0.8, pitch=0.3)
    flown = simulate_flights(
        sampled, far, plan_of().duration + AFTER, problem=NO_HOOK, accuracy=1e-8
    )
    servo = LAGGING.parameters.servo
    [lag] = LAGGING.effects[0].values
    fastest, room = 0.0, np.inf
    for flight in flown:
        log = flight.log
        tape = command_steps(log.time, log.command, 50.0)
        path = elevator_path(*tape, log.time, servo, time_constant=lag)
        np.testing.assert_allclose(path, log.elevator, atol=1e-5)
        assert servo.low <= log.elevator.min() and log.elevator.max() <= servo.high
        fastest = max(fastest, np.abs(log.command).max())
        room = min(room, log.elevator.min() - servo.low)
        room = min(room, servo.high - log.elevator.max())
    assert fastest == servo.rate and room < 0.01  # Both limits were at work.


def test_each_sample_gets_its_row_of_noise():
    system = SampledNoise(2, 10.0, 3)
    builder = DiagramBuilder()
    builder.AddNamedSystem("noise", system)
    gain = builder.AddNamedSystem("gain", Gain(2.0, 2))
    builder.ExportInput(system.get_input_port(), "signal")
    builder.Connect(system.get_output_port(), gain.get_input_port())
    builder.ExportOutput(gain.get_output_port(), "y")
    diagram = builder.Build()
    simulator = Simulator(diagram)
    context = simulator.get_mutable_context()
    diagram.GetInputPort("signal").FixValue(context, [1.0, 2.0])
    tape = np.array([[0.1, 0.2], [0.3, 0.4]])
    system.set_tape(system.GetMyMutableContextFromRoot(context), tape)
    expected = [*tape, [0.0, 0.0], [0.0, 0.0]]
    for k, row in enumerate(expected):
        simulator.AdvanceTo(k / 10.0)
        measured = diagram.GetOutputPort("y").Eval(context) / 2.0 - [1.0, 2.0]
        np.testing.assert_allclose(measured, row, atol=1e-12)


@pytest.mark.parametrize("shape", [(4, 2), (3, 1), (6,)])
def test_a_tape_that_does_not_fit_is_refused(shape):
    system = SampledNoise(2, 10.0, 3)
    with pytest.raises(InputError, match="the noise's shape"):
        system.set_tape(system.CreateDefaultContext(), np.zeros(shape))


@pytest.mark.parametrize(("rate", "rows"), [(0.0, 1), (np.inf, 1), (10.0, 0)])
def test_a_sampler_that_cannot_be_is_refused(rate, rows):
    with pytest.raises(InputError, match="SampledNoise: 'r"):
        SampledNoise(1, rate, rows)
