"""A glider under feedback of what a filter makes of its motion capture."""

import dataclasses
from collections.abc import Callable

import numpy as np
from pydrake.geometry import Meshcat
from pydrake.systems.framework import Diagram, DiagramBuilder, System
from pydrake.systems.primitives import LogVectorOutput, MatrixGain

from diagrams.closed_loop import closed_loop
from diagrams.simulate import simulate_flights
from diagrams.wiring import (
    add_glider,
    add_motion_capture,
    finish,
    hold_command,
    tape_rows,
)
from glider.control.tvlqr_drake import tracking_regulator
from glider.errors import InputError
from glider.estimation.ekf import Ekf
from glider.estimation.perching import CAPTURE, launch_prior, perching_ekf
from glider.estimation.running import Belief
from glider.estimation.system import ExtendedKalmanFilter
from glider.physics.model import GliderModel
from glider.planning.plan import Plan
from glider.simulation.flown_flights import Perches
from glider.simulation.fly import AFTER
from glider.systems.elevator_servo import ElevatorServo

CAPTURED = ("x", "z", "pitch", "elevator")
"""States that motion capture measures, in its order."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class EstimatedPerches:
    """The same launches of one glider with and without a filter's eyes."""

    on_state: Perches
    """The regulator gets the true state."""

    on_estimate: Perches
    """It gets what a filter makes of motion capture."""


def fly_on_estimate(
    model: GliderModel,
    plan: Plan,
    starts: np.ndarray,
    rng: np.random.Generator,
    progress: Callable[[str], None] | None = None,
) -> EstimatedPerches:
    """Flies launches under TVLQR, on the state and on the estimate.

    Args:
        model: of plan, feedback and filter, and the glider that flies.
        plan: to track.
        starts: (B, 7) launches.
        rng: draws the noise of motion capture, CAPTURE.std.
        progress: told which launch is flown.
    """
    ekf = perching_ekf(model)
    seeing = closed_loop(model, tracking_regulator(model, plan), all_states=True)
    prior = launch_prior(ekf, plan.states[0])
    filtering = estimated_loop(model, tracking_regulator(model, plan), ekf, prior)
    noise = CAPTURE.draw(rng, len(starts), tape_rows(CAPTURE.rate))
    duration = plan.duration + AFTER
    return EstimatedPerches(
        on_state=simulate_flights(seeing, starts, duration, progress=progress),
        on_estimate=simulate_flights(
            filtering, starts, duration, capture_noise=noise, progress=progress
        ),
    )


def estimated_loop(
    truth: GliderModel,
    regulator: System,
    ekf: Ekf,
    prior: Belief,
    *,
    command_rate: float | None = None,
    meshcat: Meshcat | None = None,
) -> Diagram:
    """Wires glider -> motion capture -> filter -> regulator -> servo -> glider.

    The filter takes no state and no rate from the true glider: what the servo makes
    of a command it gets from a second servo, which sees the estimate.

    Args:
        truth: the glider that flies; it need not be the filter's.
        regulator: from the state of the filter's glider to one command, its first
            output. It becomes a part of this diagram, and fits into no other.
        ekf: samples motion capture at its own rate.
        prior: what the filter believes at launch.
        command_rate: the command is held between samples at this rate [Hz]; None:
            it follows the estimate at once.
        meshcat: where to show the flight.

    Returns:
        A Diagram "estimated_loop" with no open input and the systems "glider",
        "servo", "motion_capture", "estimator", "believed_servo", "regulator", as
        asked for "command_hold" and "pose_capture"; the logs of
        `diagrams.closed_loop`, of motion capture, and "estimate_log" of the
        filter's state, which is exported as "estimate" beside the glider's outputs.

    Raises:
        InputError: what is given does not fit together.
    """
    wanted, rows = regulator.get_input_port().size(), len(ekf.noise)
    if wanted != ekf.num_states:
        raise InputError(
            f"The regulator wants {wanted} states, but the filter's glider has "
            f"{ekf.num_states}."
        )
    if ekf.measured_names != CAPTURED[:rows]:
        raise InputError(
            f"The filter measures {', '.join(ekf.measured_names)}; motion capture "
            f"shows {', '.join(CAPTURED)}, of which the first are needed."
        )
    builder = DiagramBuilder()
    glider, servo = add_glider(builder, truth)
    add_motion_capture(builder, glider, servo, 1.0 / ekf.period)
    capture = builder.GetSubsystemByName("motion_capture").GetOutputPort("measured")
    if rows < len(CAPTURED):
        first = np.eye(rows, len(CAPTURED))
        pose = builder.AddNamedSystem("pose_capture", MatrixGain(first))
        builder.Connect(capture, pose.get_input_port())
        capture = pose.get_output_port()
    estimator = builder.AddNamedSystem("estimator", ExtendedKalmanFilter(ekf, prior))
    believed = ElevatorServo(ekf.model.parameters, ekf.num_states)
    builder.AddNamedSystem("believed_servo", believed)
    builder.AddNamedSystem("regulator", regulator)
    state = estimator.GetOutputPort("state")
    builder.Connect(capture, estimator.GetInputPort("measured"))
    builder.Connect(state, regulator.get_input_port())
    builder.Connect(state, believed.GetInputPort("state"))
    command = hold_command(builder, regulator.get_output_port(0), command_rate)
    builder.ExportOutput(state, "estimate")
    builder.Connect(command, servo.GetInputPort("command"))
    builder.Connect(command, believed.GetInputPort("command"))
    builder.Connect(
        believed.GetOutputPort("elevator_rate"), estimator.GetInputPort("elevator_rate")
    )
    LogVectorOutput(state, builder).set_name("estimate_log")
    return finish(builder, "estimated_loop", glider, truth, meshcat)
