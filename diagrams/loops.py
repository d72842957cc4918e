"""Diagrams of a glider: a plan replayed, feedback of the state, or of a filter."""

import numpy as np
from pydrake.geometry import Meshcat
from pydrake.systems.framework import Diagram, DiagramBuilder, OutputPort, System
from pydrake.systems.primitives import MatrixGain, TrajectorySource

from diagrams.wiring import (
    add_glider,
    add_log,
    add_motion_capture,
    check_controller,
    finish,
    hold_command,
    tape_rows,
)
from glider.errors import InputError, expect
from glider.physics.model import GliderModel
from glider.physics.state import NUM_STATES
from glider.planning.plan import Plan
from glider.simulation.fly import check_command_rate
from glider.systems.elevator_servo import ElevatorServo
from glider.systems.noise import SampledNoise
from glider.systems.observer import ExtraStates

_CAPTURED = ("x", "z", "pitch", "elevator")
"""States that motion capture measures, in its order."""


def open_loop(
    truth: GliderModel,
    plan: Plan,
    *,
    motion_capture: float | None = None,
    meshcat: Meshcat | None = None,
) -> Diagram:
    """Wires plan -> servo -> glider.

    Args:
        truth: the glider that flies; it need not be the planner's.
        plan: whose input is replayed; after its end the last command stays.
        motion_capture: rate of a sensor [Hz]; None for no sensor.
        meshcat: where to show the flight.

    Returns:
        A Diagram "open_loop" with no open input, the systems "plan", "servo",
        "glider", and the logs "state_log", "rate_log" and "force_log"; the outputs
        "state", "pose" and "elevator_rate"; and those of
        `diagrams.wiring.add_motion_capture`.
    """
    builder = DiagramBuilder()
    glider, servo = add_glider(builder, truth)
    source = builder.AddNamedSystem("plan", TrajectorySource(plan.input_trajectory))
    builder.Connect(source.get_output_port(), servo.GetInputPort("command"))
    if motion_capture is not None:
        add_motion_capture(builder, glider, motion_capture)
        add_log(builder, source.get_output_port(), "command_log")
    return finish(builder, "open_loop", glider, truth, meshcat)


def closed_loop(
    truth: GliderModel,
    regulator: System,
    *,
    planned: GliderModel | None = None,
    all_states: bool = False,
    command_rate: float | None = None,
    feedback_noise: bool = False,
    motion_capture: float | None = None,
    meshcat: Meshcat | None = None,
) -> Diagram:
    """Wires glider -> regulator -> servo -> glider.

    Args:
        truth: the glider that flies. It may have effects that the regulator was not
            made for: then the first states are fed back.
        regulator: any System from the state, its first input, to a command of one
            number [rad/s], its first output, as `tracking_regulator` makes it. It
            becomes a part of this diagram, and fits into no other.
        planned: the model that the regulator was made for, where its effects have
            states of their own. No sensor measures these: "observer" runs them
            beside the flight. None: the regulator has none.
        all_states: instead of `planned`, for a regulator made for the truth itself:
            it gets all states of the glider, unmeasured ones included.
        command_rate: the command is held between samples at this rate [Hz]; None:
            it follows the state at once.
        feedback_noise: whether there is a "feedback_noise", which adds a tape to
            the samples that the commands are computed from.
        motion_capture: rate of a sensor [Hz]; None for no sensor.
        meshcat: where to show the flight.

    Returns:
        A Diagram "closed_loop" with no open input, the systems "glider",
        "regulator", "servo" and the logs "state_log", "rate_log" and "force_log"; as
        asked for "command_hold", "feedback_noise", "observer", "measured_state" (the
        first of more states) and those of `diagrams.wiring.add_motion_capture`; the
        outputs "state", "pose" and "elevator_rate".
        `diagrams.simulate.simulate_flights` flies it.

    Raises:
        InputError: what is given does not fit together.
    """
    if command_rate is not None:
        check_command_rate(command_rate)
    if feedback_noise and command_rate is None:
        raise InputError("Feedback noise comes with each command; expected a rate.")
    fed_back = _states_fed_back(truth, regulator, planned, all_states)
    builder = DiagramBuilder()
    glider, servo = add_glider(builder, truth)
    signal = glider.GetOutputPort("state")
    if signal.size() > fed_back:
        signal = _first_of(builder, "measured_state", signal, fed_back)
    if feedback_noise and command_rate is not None:
        noise = SampledNoise(fed_back, command_rate, tape_rows(command_rate))
        builder.AddNamedSystem("feedback_noise", noise)
        builder.Connect(signal, noise.GetInputPort("signal"))
        signal = noise.GetOutputPort("measured")
    if regulator.get_input_port(0).size() > fed_back:
        observer = builder.AddNamedSystem("observer", ExtraStates(planned))
        builder.Connect(signal, observer.GetInputPort("measured"))
        builder.Connect(
            servo.GetOutputPort("elevator_rate"), observer.GetInputPort("elevator_rate")
        )
        signal = observer.GetOutputPort("state")
    builder.AddNamedSystem("regulator", regulator)
    builder.Connect(signal, regulator.get_input_port(0))
    command = hold_command(builder, regulator.get_output_port(0), command_rate)
    builder.Connect(command, servo.GetInputPort("command"))
    if motion_capture is not None:
        add_motion_capture(builder, glider, motion_capture)
        add_log(builder, command, "command_log")
    return finish(builder, "closed_loop", glider, truth, meshcat)


def _states_fed_back(
    truth: GliderModel, regulator: System, planned: GliderModel | None, all_states: bool
) -> int:
    """Checks that glider and regulator fit; returns the number of states fed back."""
    wanted, _ = check_controller(regulator)
    has = truth.num_states
    if planned is not None and planned.num_states != wanted:
        raise InputError(
            f"The planned model has {planned.num_states} states, but its regulator "
            f"wants {wanted}."
        )
    if all_states and (planned is not None or wanted != has):
        raise InputError(
            f"The regulator wants {wanted} states and the glider has {has}; "
            "`all_states` is for as many, without `planned`."
        )
    if wanted > NUM_STATES and planned is None and not all_states:
        raise InputError(
            f"The regulator wants {wanted} states; expected `planned`, its model "
            "(or `all_states`, where it was made for the truth itself)."
        )
    return NUM_STATES if planned is not None else wanted


def _first_of(
    builder: DiagramBuilder, name: str, signal: OutputPort, count: int
) -> OutputPort:
    """Adds a system that passes the first components of a signal on."""
    first = builder.AddNamedSystem(name, MatrixGain(np.eye(count, signal.size())))
    builder.Connect(signal, first.get_input_port())
    return first.get_output_port()


def estimated_loop(
    truth: GliderModel,
    regulator: System,
    filter: System,
    *,
    planned: GliderModel | None = None,
    command_rate: float | None = None,
    capture_rate: float | None = None,
    meshcat: Meshcat | None = None,
) -> Diagram:
    """Wires glider -> motion capture -> filter -> regulator -> servo -> glider.

    The filter takes no state and no rate from the true glider: what the servo makes
    of a command it gets from a second servo, which sees the estimate.

    Args:
        truth: the glider that flies; it need not be the filter's.
        regulator: any System from the filter's state, its first input, to a command
            of one number [rad/s], its first output. It becomes a part of this diagram,
            and fits into no other.
        filter: any System with the inputs "measured", x, z, pitch and perhaps elevator,
            and "elevator_rate" (1), and the output "state", such as
            `ExtendedKalmanFilter`. It becomes a part of this diagram, too.
        planned: the model whose servo the second servo is; None: the filter's
            property `model`. For a filter without one it has the truth's limits and no
            actuators.
        command_rate: the command is held between samples at this rate [Hz]; None:
            it follows the estimate at once.
        capture_rate: of motion capture [Hz]; None: that of the filter's periodic
            discrete update.
        meshcat: where to show the flight.

    Returns:
        A Diagram "estimated_loop" with no open input and the systems "glider",
        "servo", "motion_capture", "estimator", "believed_servo", "regulator", as
        asked for "command_hold" and "pose_capture"; the logs of
        `closed_loop`, of motion capture, and "estimate_log" of the
        filter's state, which is exported as "estimate" beside the glider's outputs.

    Raises:
        InputError: what is given does not fit together.
    """
    wanted, command = check_controller(regulator)
    poses = len(_CAPTURED) - 1
    measured = filter.GetInputPort("measured")
    what = "The size of the filter's input 'measured'"
    sizes = (poses, poses + 1)
    expect(measured.size() in sizes, what, measured.size(), f"{poses} or {poses + 1}")
    believed_rate = filter.GetInputPort("elevator_rate")
    state = filter.GetOutputPort("state")
    what = "The size of the filter's output 'state'"
    expect(state.size() == wanted, what, state.size(), f"{wanted}, as the regulator's")
    builder = DiagramBuilder()
    glider, servo = add_glider(builder, truth)
    add_motion_capture(builder, glider, capture_rate or _sample_rate(filter))
    capture = builder.GetSubsystemByName("motion_capture").GetOutputPort("measured")
    if measured.size() < len(_CAPTURED):
        capture = _first_of(builder, "pose_capture", capture, measured.size())
    builder.AddNamedSystem("estimator", filter)
    own = planned or getattr(filter, "model", None)
    own = own or GliderModel(parameters=truth.parameters)
    believed = builder.AddNamedSystem("believed_servo", ElevatorServo(own, wanted))
    builder.AddNamedSystem("regulator", regulator)
    builder.Connect(capture, measured)
    builder.Connect(state, regulator.get_input_port(0))
    builder.Connect(state, believed.GetInputPort("state"))
    command = hold_command(builder, command, command_rate)
    builder.ExportOutput(state, "estimate")
    builder.Connect(command, servo.GetInputPort("command"))
    builder.Connect(command, believed.GetInputPort("command"))
    builder.Connect(believed.GetOutputPort("elevator_rate"), believed_rate)
    add_log(builder, state, "estimate_log")
    add_log(builder, command, "command_log")
    return finish(builder, "estimated_loop", glider, truth, meshcat)


def _sample_rate(filter: System) -> float:
    """Returns the rate of a filter's periodic discrete update [Hz]."""
    timing = filter.GetUniquePeriodicDiscreteUpdateAttribute()
    if timing is None:
        raise InputError(
            f"The filter '{filter.get_name()}' has no periodic discrete update; "
            "expected one, at the rate of motion capture, or `capture_rate`."
        )
    return 1.0 / timing.period_sec()
