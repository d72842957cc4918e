"""Diagrams of a glider: a plan replayed, feedback of the state, or of a filter."""

import math
from pathlib import Path

import numpy as np
from pydrake.geometry import Meshcat
from pydrake.systems.framework import Diagram, DiagramBuilder, OutputPort, System
from pydrake.systems.primitives import (
    LogVectorOutput,
    MatrixGain,
    Multiplexer,
    TrajectorySource,
    ZeroOrderHold,
)

from diagrams.scene import AddScene
from glider.errors import InputError, expect
from glider.physics.model import GliderModel, as_model
from glider.physics.state import ELEVATOR, NUM_STATES, POSE_NAMES, STATE_NAMES
from glider.planning.plan import Plan
from glider.simulation.fly import check_command_rate
from glider.systems.elevator_servo import ElevatorServo
from glider.systems.noise import SampledNoise
from glider.systems.observer import ExtraStates
from glider.systems.plant import GliderPlant

LONGEST = 3.0
"""Duration of the longest flight with noise [s]: how long its tapes are."""

_CAPTURED = (*POSE_NAMES, "elevator")
"""What motion capture measures, in its order."""


def open_loop(
    truth: GliderModel | Path | str, plan: Plan, *, meshcat: Meshcat | None = None
) -> Diagram:
    """Wires plan -> servo -> glider.

    Args:
        truth: the glider that flies, or its file or name; it need not be the planner's.
        plan: whose input is replayed; after its end the last command stays.
        meshcat: where to show the flight.

    Returns:
        A Diagram "open_loop" with no open input, the systems "plan", "servo",
        "glider", and the logs "state_log", "rate_log" and "force_log"; the outputs
        "state", "pose" and "elevator_rate".
    """
    truth = as_model(truth)
    builder = DiagramBuilder()
    glider, servo = _add_glider(builder, truth)
    source = builder.AddNamedSystem("plan", TrajectorySource(plan.input_trajectory))
    builder.Connect(source.get_output_port(), servo.GetInputPort("command"))
    return _finish(builder, "open_loop", glider, truth, meshcat)


def closed_loop(
    truth: GliderModel | Path | str,
    regulator: System,
    *,
    planned: GliderModel | None = None,
    all_states: bool = False,
    command_rate: float | None = None,
    motion_capture: float | None = None,
    meshcat: Meshcat | None = None,
) -> Diagram:
    """Wires glider -> regulator -> servo -> glider.

    Args:
        truth: the glider that flies, or its file or name. It may have effects that the
            regulator was not made for: then the first states are fed back.
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
        motion_capture: rate of a sensor [Hz]; None for no sensor.
        meshcat: where to show the flight.

    Returns:
        A Diagram "closed_loop" with no open input, the systems "glider",
        "regulator", "servo" and the logs "state_log", "rate_log" and "force_log"; as
        asked for "command_hold", "observer", "measured_state" (the first of more
        states), and those of motion capture, "elevator_angle", "markers",
        "motion_capture" and "capture_log"; the outputs "state", "pose" and
        "elevator_rate".
        `diagrams.simulate.simulate_flights` flies it.

    Raises:
        InputError: what is given does not fit together.
    """
    if command_rate is not None:
        check_command_rate(command_rate)
    truth = as_model(truth)
    fed_back = _states_fed_back(truth, regulator, planned, all_states)
    builder = DiagramBuilder()
    glider, servo = _add_glider(builder, truth)
    signal = glider.GetOutputPort("state")
    if signal.size() > fed_back:
        signal = _first_of(builder, "measured_state", signal, fed_back)
    if regulator.get_input_port(0).size() > fed_back:
        observer = builder.AddNamedSystem("observer", ExtraStates(planned))
        builder.Connect(signal, observer.GetInputPort("measured"))
        builder.Connect(
            servo.GetOutputPort("elevator_rate"), observer.GetInputPort("elevator_rate")
        )
        signal = observer.GetOutputPort("state")
    builder.AddNamedSystem("regulator", regulator)
    builder.Connect(signal, regulator.get_input_port(0))
    command = _hold_command(builder, regulator.get_output_port(0), command_rate)
    builder.Connect(command, servo.GetInputPort("command"))
    if motion_capture is not None:
        _add_motion_capture(builder, glider, motion_capture)
        _add_log(builder, command, "command_log")
    return _finish(builder, "closed_loop", glider, truth, meshcat)


def _states_fed_back(
    truth: GliderModel, regulator: System, planned: GliderModel | None, all_states: bool
) -> int:
    """Checks that glider and regulator fit; returns the number of states fed back."""
    wanted, _ = _check_controller(regulator)
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
    truth: GliderModel | Path | str,
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
        truth: the glider that flies, or its file or name; it need not be the filter's.
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
    truth = as_model(truth)
    wanted, command = _check_controller(regulator)
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
    glider, servo = _add_glider(builder, truth)
    _add_motion_capture(builder, glider, capture_rate or _sample_rate(filter))
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
    command = _hold_command(builder, command, command_rate)
    builder.ExportOutput(state, "estimate")
    builder.Connect(command, servo.GetInputPort("command"))
    builder.Connect(command, believed.GetInputPort("command"))
    builder.Connect(believed.GetOutputPort("elevator_rate"), believed_rate)
    _add_log(builder, state, "estimate_log")
    _add_log(builder, command, "command_log")
    return _finish(builder, "estimated_loop", glider, truth, meshcat)


def _sample_rate(filter: System) -> float:
    """Returns the rate of a filter's periodic discrete update [Hz]."""
    timing = filter.GetUniquePeriodicDiscreteUpdateAttribute()
    if timing is None:
        raise InputError(
            f"The filter '{filter.get_name()}' has no periodic discrete update; "
            "expected one, at the rate of motion capture, or `capture_rate`."
        )
    return 1.0 / timing.period_sec()


def _add_glider(builder: DiagramBuilder, model: GliderModel) -> tuple[System, System]:
    """Adds "glider" and "servo", connected; the servo's "command" stays open.

    Their outputs are exported as "state", "pose" and "elevator_rate", and logged
    at the integrator's steps in "state_log" and "rate_log", the glider's "forces" in
    "force_log".
    """
    glider = builder.AddNamedSystem("glider", GliderPlant(model))
    state = glider.GetOutputPort("state")
    servo = builder.AddNamedSystem("servo", ElevatorServo(model))
    rate = servo.GetOutputPort("elevator_rate")
    builder.Connect(state, servo.GetInputPort("state"))
    builder.Connect(rate, glider.GetInputPort("elevator_rate"))
    builder.ExportOutput(state, "state")
    builder.ExportOutput(glider.GetOutputPort("pose"), "pose")
    builder.ExportOutput(rate, "elevator_rate")
    _add_log(builder, state, "state_log")
    _add_log(builder, rate, "rate_log")
    _add_log(builder, glider.GetOutputPort("forces"), "force_log")
    return glider, servo


def _check_controller(system: System) -> tuple[int, OutputPort]:
    """Returns the number of states that a controller wants, and its command.

    Raises:
        InputError: its first ports are not a state and one command.
    """
    name = system.get_name() or type(system).__name__
    needed = f"{NUM_STATES} or more, the state ({', '.join(STATE_NAMES)})"
    wanted = system.get_input_port(0).size() if system.num_input_ports() else 0
    what = f"Controller '{name}': the size of its first input"
    expect(wanted >= NUM_STATES, what, wanted, needed)
    commands = system.get_output_port(0).size() if system.num_output_ports() else 0
    what = f"Controller '{name}': the size of its first output"
    expect(commands == 1, what, commands, "1, the elevator's rate")
    return wanted, system.get_output_port(0)


def _hold_command(
    builder: DiagramBuilder, command: OutputPort, rate: float | None
) -> OutputPort:
    """Returns a command held by a "command_hold" of a rate [Hz], itself for none."""
    if rate is None:
        return command
    hold = builder.AddNamedSystem("command_hold", ZeroOrderHold(1.0 / rate, 1))
    builder.Connect(command, hold.get_input_port())
    return hold.get_output_port()


def _add_log(
    builder: DiagramBuilder, port: OutputPort, name: str, rate: float | None = None
) -> None:
    """Adds a log, of every integrator step or at a rate [Hz]."""
    if rate is None:
        LogVectorOutput(port, builder).set_name(name)
    else:
        LogVectorOutput(port, builder, 1.0 / rate).set_name(name)


def _add_motion_capture(builder: DiagramBuilder, glider: System, rate: float) -> None:
    """Adds a motion capture of pose and elevator, sampled at a rate [Hz].

    Adds "elevator_angle" and "markers", which gather POSE_NAMES and the elevator,
    "motion_capture", which adds noise, and the log "capture_log". Exports "capture".
    """
    state = glider.GetOutputPort("state")
    row = np.zeros((1, state.size()))
    row[0, ELEVATOR] = 1.0
    angle = builder.AddNamedSystem("elevator_angle", MatrixGain(row))
    markers = builder.AddNamedSystem("markers", Multiplexer([len(POSE_NAMES), 1]))
    noise = SampledNoise(len(_CAPTURED), rate, tape_rows(rate))
    capture = builder.AddNamedSystem("motion_capture", noise)
    builder.Connect(state, angle.get_input_port())
    builder.Connect(glider.GetOutputPort("pose"), markers.get_input_port(0))
    builder.Connect(angle.get_output_port(), markers.get_input_port(1))
    builder.Connect(markers.get_output_port(), capture.GetInputPort("signal"))
    measured = capture.GetOutputPort("measured")
    builder.ExportOutput(measured, "capture")
    _add_log(builder, measured, "capture_log", rate)


def tape_rows(rate: float) -> int:
    """Returns the number of samples of the longest flight."""
    return math.ceil(LONGEST * rate) + 1


def _finish(
    builder: DiagramBuilder,
    name: str,
    glider: System,
    model: GliderModel,
    meshcat: Meshcat | None,
) -> Diagram:
    """Adds the scene, if there is a Meshcat, and builds the diagram."""
    if meshcat is not None:
        state = glider.GetOutputPort("state")
        forces = glider.GetOutputPort("forces")
        parameters = model.parameters
        AddScene(builder, state, meshcat, forces=forces, parameters=parameters)
    diagram = builder.Build()
    diagram.set_name(name)
    return diagram
