"""Parts that the diagrams share: a glider with its servo, and its logs."""

import math

from pydrake.geometry import Meshcat
from pydrake.systems.framework import Diagram, DiagramBuilder, OutputPort, System
from pydrake.systems.primitives import (
    LogVectorOutput,
    MatrixGain,
    Multiplexer,
    ZeroOrderHold,
)

from diagrams.scene import AddScene
from glider.errors import expect
from glider.physics.model import GliderModel
from glider.physics.state import NUM_STATES, POSE_NAMES, STATE_NAMES
from glider.systems.elevator_servo import ElevatorServo
from glider.systems.noise import SampledNoise
from glider.systems.plant import GliderPlant

LONGEST = 3.0
"""Duration of the longest flight with noise [s]: how long its tapes are."""


def add_glider(builder: DiagramBuilder, model: GliderModel) -> tuple[System, System]:
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
    add_log(builder, state, "state_log")
    add_log(builder, rate, "rate_log")
    add_log(builder, glider.GetOutputPort("forces"), "force_log")
    return glider, servo


def check_controller(system: System) -> tuple[int, OutputPort]:
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


def hold_command(
    builder: DiagramBuilder, command: OutputPort, rate: float | None
) -> OutputPort:
    """Returns a command held by a "command_hold" of a rate [Hz], itself for none."""
    if rate is None:
        return command
    hold = builder.AddNamedSystem("command_hold", ZeroOrderHold(1.0 / rate, 1))
    builder.Connect(command, hold.get_input_port())
    return hold.get_output_port()


def add_log(
    builder: DiagramBuilder, port: OutputPort, name: str, rate: float | None = None
) -> None:
    """Adds a log, of every integrator step or at a rate [Hz]."""
    if rate is None:
        LogVectorOutput(port, builder).set_name(name)
    else:
        LogVectorOutput(port, builder, 1.0 / rate).set_name(name)


def add_motion_capture(builder: DiagramBuilder, glider: System, rate: float) -> None:
    """Adds a motion capture of pose and elevator, sampled at a rate [Hz].

    Adds "elevator_angle" and "markers", which gather POSE_NAMES and the elevator,
    "motion_capture", which adds noise, and the log "capture_log". Exports "capture".
    """
    state = glider.GetOutputPort("state")
    row = [[float(name == "elevator") for name in STATE_NAMES]]
    row[0] += [0.0] * (state.size() - len(STATE_NAMES))
    angle = builder.AddNamedSystem("elevator_angle", MatrixGain(row))
    markers = builder.AddNamedSystem("markers", Multiplexer([len(POSE_NAMES), 1]))
    size = len(POSE_NAMES) + 1
    capture = builder.AddNamedSystem(
        "motion_capture", SampledNoise(size, rate, tape_rows(rate))
    )
    builder.Connect(state, angle.get_input_port())
    builder.Connect(glider.GetOutputPort("pose"), markers.get_input_port(0))
    builder.Connect(angle.get_output_port(), markers.get_input_port(1))
    builder.Connect(markers.get_output_port(), capture.GetInputPort("signal"))
    measured = capture.GetOutputPort("measured")
    builder.ExportOutput(measured, "capture")
    add_log(builder, measured, "capture_log", rate)


def tape_rows(rate: float) -> int:
    """Returns the number of samples of the longest flight."""
    return math.ceil(LONGEST * rate) + 1


def finish(
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
