"""Many flights of one diagram, which Drake need not build again."""

from collections.abc import Callable, Sequence

import numpy as np
from pydrake.systems.analysis import ApplySimulatorConfig, Simulator, SimulatorConfig
from pydrake.systems.framework import Context, Diagram, EventStatus, System

from diagrams.loops import LONGEST, tape_rows
from glider.campaign.logs import Campaign, Flight, campaign_of
from glider.campaign.motion_capture import MotionCapture
from glider.errors import InputError, expect
from glider.physics.held_commands import latest_command
from glider.physics.state import NUM_STATES, POSE_NAMES, POSITION, VELOCITY
from glider.planning.problem import PerchingProblem
from glider.progress import Progress
from glider.simulation.flown_flights import FlownFlight, Perches, closest_pass, hooked

_CONFIG = {"integration_scheme": "runge_kutta5", "max_step_size": 0.02}


def simulate_flights(
    diagram: Diagram,
    starts: np.ndarray,
    duration: float,
    *,
    problem: PerchingProblem | None = None,
    capture_noise: np.ndarray | np.random.Generator | None = None,
    accuracy: float = 1e-6,
    progress: Progress | None = None,
) -> Perches:
    """Flies launches through one diagram of `diagrams.loops`.

    A glider that the hook takes stays at the wire: its flight ends there. Where the
    diagram has a motion capture and holds its commands, the logs are the campaign of
    what is returned, which has the diagram's name.

    Each flight starts from the diagram's default context: Drake 1.51.1 loses
    about 0.2 MB with every diagram that is built.

    Args:
        diagram: with "glider" and "state_log".
        starts: (B, 7), the effects' own states at rest, or (B, n).
        duration: of the flights [s]; the plan's and what it takes to pass the
            wire, `glider.simulation.fly.AFTER`. With noise at most
            `diagrams.loops.LONGEST`.
        problem: whose wire and hook; None for the article's.
        capture_noise: (B, R, 4) of pose and elevator, one row for each sample; or
            what draws it, with the deviations of `MotionCapture`.
        accuracy: of the integrator.
        progress: called with the launch that is flown.
    """
    starts = np.atleast_2d(np.asarray(starts, dtype=float))
    problem = PerchingProblem() if problem is None else problem
    simulator = Simulator(diagram)
    simulator.set_monitor(stop_at_hook(diagram, problem))
    config = SimulatorConfig(accuracy=accuracy, **_CONFIG)
    if isinstance(capture_noise, np.random.Generator):
        capture_noise = _draw_capture(diagram, len(starts), capture_noise)
    if capture_noise is not None:
        tapes = len(capture_noise)
        what = "the number of tapes of noise"
        expect(tapes == len(starts), what, tapes, f"{len(starts)}, as of flights")
        what = "the duration of flights with noise"
        expect(duration <= LONGEST, what, duration, f"at most {LONGEST:g} s")
    flights = []
    for k, start in enumerate(starts):
        if progress:
            progress(f"launch {k + 1} of {len(starts)}")
        ApplySimulatorConfig(config, simulator)  # No step size of the last flight.
        context = simulator.get_mutable_context()
        reset(diagram, context, start)
        if capture_noise is not None:
            capture = _capture_of(diagram)
            own = diagram.GetMutableSubsystemContext(capture, context)
            capture.set_tape(own, capture_noise[k])
        simulator.Initialize()
        simulator.AdvanceTo(duration)
        flights.append(_collect(diagram, context, problem, f"flight_{k:03d}.csv"))
    return Perches(flights, _campaign(diagram, flights))


def _draw_capture(diagram: Diagram, count: int, rng: np.random.Generator) -> np.ndarray:
    """Draws the noise of a diagram's motion capture for some flights, (count, R, 4).

    The deviations are the property `measured_std` of the filter that gets what is
    captured, such as an `ExtendedKalmanFilter`; otherwise those of `MotionCapture`.
    """
    rate = _capture_of(diagram).rate
    std = MotionCapture().std
    if diagram.HasSubsystemNamed("estimator"):
        estimator = diagram.GetSubsystemByName("estimator")
        given = getattr(estimator, "measured_std", ())
        std[: len(given)] = given
    return rng.normal(size=(count, tape_rows(rate), 4)) * std


def _capture_of(diagram: Diagram) -> System:
    """Returns the motion capture that noise is for."""
    if not diagram.HasSubsystemNamed("motion_capture"):
        raise InputError("Noise is that of a motion capture; the diagram has none.")
    return diagram.GetSubsystemByName("motion_capture")


def _campaign(diagram: Diagram, flights: Sequence[FlownFlight]) -> Campaign | None:
    """Returns the logs of a diagram's flights, if it has all that logs them."""
    names = ("glider", "motion_capture", "command_hold")
    if not all(map(diagram.HasSubsystemNamed, names)):
        return None
    glider, capture, hold = map(diagram.GetSubsystemByName, names)
    logs = [flight.log for flight in flights if flight.log is not None]
    parameters = glider.model.parameters
    command_rate = 1.0 / hold.period()
    name = diagram.get_name()
    return campaign_of(name, parameters, logs, capture.rate, command_rate)


def stop_at_hook(
    diagram: Diagram, problem: PerchingProblem
) -> Callable[[Context], EventStatus]:
    """Returns a monitor that ends a simulation where the hook takes the glider.

        simulator.set_monitor(stop_at_hook(diagram, PerchingProblem()))

    The glider then stays at the wire in Meshcat too. The end is that of the
    integrator's step in which the glider passes.

    Args:
        diagram: with "glider".
        problem: whose wire and hook.
    """
    glider = diagram.GetSubsystemByName("glider")
    wire = np.array(problem.wire)
    steps: list[tuple[float, np.ndarray, float]] = []

    def is_held(context: Context) -> EventStatus:
        own = diagram.GetSubsystemContext(glider, context)
        state = own.get_continuous_state_vector().CopyToVector()
        closing = float((wire - state[POSITION]) @ state[VELOCITY])
        steps.append((context.get_time(), state, closing))
        del steps[:-2]
        is_passing = len(steps) == 2 and steps[0][2] > 0.0 >= closing
        if is_passing:
            times = np.array([step[0] for step in steps])
            states = np.array([step[1] for step in steps])
            passed = closest_pass(times, states, wire)
            if problem.hook.takes(np.array(passed.miss), passed.arrival):
                return EventStatus.ReachedTermination(diagram, "held by the hook")
        return EventStatus.Succeeded()

    return is_held


def reset(diagram: Diagram, context: Context, start: np.ndarray) -> None:
    """Puts a diagram's context at a launch, time 0, logs empty."""
    diagram.SetDefaultContext(context)
    context.SetTime(0.0)
    glider = diagram.GetSubsystemByName("glider")
    own = diagram.GetMutableSubsystemContext(glider, context)
    own.SetContinuousState(glider.model.initial_state(start))
    if diagram.HasSubsystemNamed("observer"):
        observer = diagram.GetSubsystemByName("observer")
        own = diagram.GetMutableSubsystemContext(observer, context)
        own.SetContinuousState(observer.at_rest(start[:NUM_STATES]))
    for system in diagram.GetSystems():
        if system.get_name().endswith("_log"):
            system.FindMutableLog(context).Clear()


def _collect(
    diagram: Diagram, context: Context, problem: PerchingProblem, name: str
) -> FlownFlight:
    times, states = _read(diagram, context, "state_log")
    _, forces = _read(diagram, context, "force_log")
    log = None
    if diagram.HasSubsystemNamed("capture_log"):
        log = _log_of(diagram, context, name)
    return hooked(times, states, problem, forces=forces[:, :2], log=log)


def _log_of(diagram: Diagram, context: Context, name: str) -> Flight:
    """Returns the flight that motion capture has logged, for a campaign.

    A row's command is in force from its time on, within the servo's rate limit. The
    logs hold values before the updates at their times, so that it is the command of
    the integrator's next step.

    Args:
        diagram: with a motion capture.
        context: after the flight.
        name: of the flight's file, flight_*.csv.
    """
    times, capture = _read(diagram, context, "capture_log")
    steps, commands = _read(diagram, context, "command_log")
    step = latest_command(steps, times)
    held = commands[np.minimum(step + 1, len(steps) - 1), 0]
    fastest = diagram.GetSubsystemByName("glider").model.parameters.servo.rate
    pose = len(POSE_NAMES)
    return Flight(
        name=name,
        time=times,
        pose=capture[:, :pose],
        elevator=capture[:, pose],
        command=np.clip(held, -fastest, fastest),
    )


def _read(
    diagram: Diagram, context: Context, name: str
) -> tuple[np.ndarray, np.ndarray]:
    log = diagram.GetSubsystemByName(name).FindLog(context)
    return log.sample_times().copy(), log.data().T.copy()
