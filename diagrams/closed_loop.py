"""A glider under feedback."""

import numpy as np
from pydrake.geometry import Meshcat
from pydrake.systems.framework import Diagram, DiagramBuilder, System
from pydrake.systems.primitives import MatrixGain

from diagrams.wiring import (
    add_glider,
    add_motion_capture,
    finish,
    hold_command,
    tape_rows,
)
from glider.errors import InputError
from glider.physics.model import GliderModel
from glider.physics.state import NUM_STATES
from glider.simulation.fly import check_command_rate
from glider.systems.noise import SampledNoise
from glider.systems.observer import ExtraStates


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
        truth: the glider that flies. It may have effects that the regulator does
            not know: then the first states are fed back.
        regulator: from the state to one command, its first output, as
            `tracking_regulator` makes it. It becomes a part of this diagram, and
            fits into no other.
        planned: the model that the regulator was made for, where its effects have
            states of their own. Nobody measures these: "observer" runs them
            beside the flight. None: the regulator knows of none.
        all_states: instead of `planned`, for a regulator made for the truth itself:
            it gets all states of the glider, those that nobody measures too.
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
    wanted = regulator.get_input_port().size()
    observed = _is_observed(planned, wanted)
    measured_size = NUM_STATES if observed else wanted
    if command_rate is not None:
        check_command_rate(command_rate)
    if feedback_noise and command_rate is None:
        raise InputError("Feedback noise comes with each command: a rate is needed.")

    builder = DiagramBuilder()
    glider, servo = add_glider(builder, truth)
    signal = glider.GetOutputPort("state")
    if measured_size > NUM_STATES and not all_states:
        raise InputError(
            f"The regulator wants {wanted} states; `planned`, its model, is needed "
            "(or `all_states`, where it was made for the truth itself)."
        )
    if all_states and (planned is not None or wanted != signal.size()):
        raise InputError(
            f"The regulator wants {wanted} states and the glider has "
            f"{signal.size()}; `all_states` is for as many, without `planned`."
        )
    if signal.size() > measured_size:
        first = np.eye(measured_size, signal.size())
        system = builder.AddNamedSystem("measured_state", MatrixGain(first))
        builder.Connect(signal, system.get_input_port())
        signal = system.get_output_port()
    if feedback_noise and command_rate is not None:
        noise = SampledNoise(measured_size, command_rate, tape_rows(command_rate))
        builder.AddNamedSystem("feedback_noise", noise)
        builder.Connect(signal, noise.GetInputPort("signal"))
        signal = noise.GetOutputPort("measured")
    if observed:
        observer = builder.AddNamedSystem("observer", ExtraStates(planned))
        builder.Connect(signal, observer.GetInputPort("measured"))
        builder.Connect(
            servo.GetOutputPort("elevator_rate"), observer.GetInputPort("elevator_rate")
        )
        signal = observer.GetOutputPort("state")
    builder.AddNamedSystem("regulator", regulator)
    builder.Connect(signal, regulator.get_input_port())
    command = hold_command(builder, regulator.get_output_port(0), command_rate)
    builder.Connect(command, servo.GetInputPort("command"))
    if motion_capture is not None:
        add_motion_capture(builder, glider, servo, motion_capture)
    return finish(builder, "closed_loop", glider, truth, meshcat)


def _is_observed(planned: GliderModel | None, wanted: int) -> bool:
    if planned is None:
        return False
    n = planned.num_states
    if n != wanted:
        raise InputError(
            f"The planned model has {n} states, but its regulator wants {wanted}."
        )
    return n > NUM_STATES
