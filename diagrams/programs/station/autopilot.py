"""The autopilot: a Drake diagram from poses that come late, and not all, to commands.

    pose -----> [         ] state    [            ]
    commanded > [ tracker ] -------> [ controller ] -> elevator_rate

Any System from the state to a rate is a controller: those of `glider.control` that fly
in the diagrams of `diagrams.loops`, too. Time is the plan's. No Simulator runs the
diagram: poses and commands come when they do, and each is an event that the station
forces. It is the same for a simulated glider and for a real one.

LCM is outside of it. A Simulator between Drake's LcmSubscriberSystem and
LcmPublisherSystem looks for messages at its publish times, and keeps only the last: at
1 ms it takes 1.1 ms (median) and 3.3 ms (99.9 %) from a frame to its answer where
`Bus` takes 0.5 and 0.8, and at 5 ms it loses one frame of eleven.
"""

import math
from collections.abc import Sequence

import numpy as np
from pydrake.systems.framework import (
    BasicVector,
    Context,
    Diagram,
    DiagramBuilder,
    DiscreteValues,
    FixedInputPortValue,
    InputPort,
    LeafSystem,
    System,
)

from diagrams.programs.station.scenario import Filter, Sensors
from diagrams.programs.station.tracker import NO_COMMANDS, CommandTape, mean_rates
from glider.campaign.motion_capture import MotionCapture
from glider.estimation.ekf import Ekf
from glider.estimation.perching import perching_filter
from glider.estimation.running import Belief, make_prior, predict_mean, run_ekf
from glider.physics.model import GliderModel
from glider.physics.state import ELEVATOR, NUM_STATES

_RELEASE_STD = (0.002, 0.002, 0.01, 0.02, 0.3, 0.3, 0.5)
"""Standard deviations of the state at release, from the last poses before it: a slope
over three frames, 1/60 s old, of a glider that still accelerates or not."""


class PoseTracker(LeafSystem):
    """An extended Kalman filter for poses at any times, and its prediction.

    Input ports:
        pose (5): time [s], x, z, pitch and elevator; an elevator that is NaN was not
            seen. A forced event takes it.
        commanded (3 k): rows of time, angle and rate, see `CommandTape`.

    Output ports:
        state (n): predicted until now, under what was commanded.
        estimate (n): at the last pose.
        surprise (3): of the last pose: its normalized innovation squared, and its
            distance [m] and turn [rad] from the prediction.

    Args:
        model: the glider.
        sensors: what is measured, and how often.
        noise: of what is measured.
    """

    def __init__(self, model: GliderModel, sensors: Sensors, noise: Filter) -> None:
        super().__init__()
        self.set_name("tracker")
        start = model.initial_state(np.zeros(NUM_STATES))
        capture = MotionCapture(rate=sensors.rate, **vars(noise))
        self._filters: dict[bool, Ekf] = {}  # Of poses with and without an elevator.
        for seen in (False, True):
            self._filters[seen], belief = perching_filter(
                model, start, elevator=seen, capture=capture
            )
        self._servo = model.parameters.servo
        self._measures_elevator = sensors.elevator
        self._frame = 1.0 / sensors.rate
        self._count = len(belief.mean)
        self._pose = self.DeclareVectorInputPort("pose", 1 + ELEVATOR + 1)
        self._commanded = self.DeclareVectorInputPort("commanded", NO_COMMANDS.size)
        # One vector: mean, covariance, time and surprise; parts would take longer.
        nothing = _packed(belief, 0.0, (0.0, 0.0, 0.0))
        self.DeclareDiscreteState(nothing)
        self.DeclareForcedDiscreteUpdateEvent(self._take_pose)
        self.DeclareVectorOutputPort("state", self._count, self._calc_state)
        self._declare_part("estimate", slice(self._count), self._count)
        self._declare_part("surprise", slice(-3, None), 3)

    def _declare_part(self, name: str, part: slice, size: int) -> None:
        """Declares an output that is a part of the state."""

        def calc(context: Context, output: BasicVector) -> None:
            output.SetFromVector(_held(context)[part])

        self.DeclareVectorOutputPort(name, size, calc, {self.xd_ticket()})

    def begin(self, context: Context, time: float, state: np.ndarray) -> None:
        """Begins with a state (n,) that poses showed [s]."""
        prior = make_prior(self._filters[False], state, _RELEASE_STD)
        context.SetDiscreteState(_packed(prior, time, (0.0,) * 3))

    def _take_pose(self, context: Context, into: DiscreteValues) -> None:
        time, *pose = self._pose.Eval(context).tolist()
        seen = self._measures_elevator and math.isfinite(pose[ELEVATOR])
        measured = pose[: 4 if seen else 3]
        held = _held(context)
        size = self._count
        covariance = held[size:-4].reshape(size, size)
        belief = Belief(mean=held[:size], covariance=covariance)
        begin = float(held[-4])
        span = time - begin
        count = max(round(span / self._frame), 1)
        # The last sample is the pose; those before it are not seen.
        times = np.linspace(begin, time, count + 1)
        rates = mean_rates(self._tape(context), times, self._servo)
        shown = np.full((1, count, len(measured)), math.nan)
        shown[0, -1] = measured
        ekf = self._filters[seen]
        inputs = rates[None, :, None]
        found = run_ekf(ekf, belief, inputs, shown, period=span / count)
        mean = found.means[0, -1]
        belief = Belief(mean=mean, covariance=found.covariances[0, -1])
        innovation = found.innovations[0, -1]
        x, z, pitch = innovation[:3].tolist()
        nis = float(found.nis[0, -1])
        surprise = (nis, math.hypot(x, z), abs(pitch))
        into.set_value(_packed(belief, time, surprise))

    def _calc_state(self, context: Context, output: BasicVector) -> None:
        held = _held(context)
        now = context.get_time()
        mean = held[: self._count]
        begin = held[-4]
        ekf = self._filters[False]
        tape = self._tape(context)
        switches = tape[:, 0]
        inside = switches[(switches > begin) & (switches < now)]
        if now > begin:
            times = np.concatenate([[begin], inside, [now]])
            rates = mean_rates(tape, times, self._servo)
            for span, rate in zip(np.diff(times), rates, strict=True):
                mean, _ = predict_mean(ekf, mean, [rate], span)
        output.SetFromVector(mean)

    def _tape(self, context: Context) -> np.ndarray:
        return self._commanded.Eval(context).reshape(NO_COMMANDS.shape)


def _packed(belief: Belief, time: float, surprise: Sequence[float]) -> np.ndarray:
    covariance = belief.covariance.ravel()
    last = [time, *surprise]
    return np.concatenate([belief.mean, covariance, last])


def _held(context: Context) -> np.ndarray:
    return context.get_discrete_state_vector().CopyToVector()


def make_autopilot(
    model: GliderModel, sensors: Sensors, noise: Filter, controller: System
) -> Diagram:
    """Wires tracker -> controller.

    Args:
        model: the glider.
        sensors: what is measured, and how often.
        noise: of what is measured.
        controller: from the state to a rate, its first output. It becomes a part of
            this diagram, and fits into no other. Where it computes its command by an
            event, as MPC does, this is also a forced one.

    Returns:
        A Diagram "autopilot" with the systems "tracker" and "controller"; the inputs
        of the one, and its outputs beside "elevator_rate".
    """
    builder = DiagramBuilder()
    tracker = builder.AddNamedSystem("tracker", PoseTracker(model, sensors, noise))
    builder.AddNamedSystem("controller", controller)
    builder.Connect(tracker.GetOutputPort("state"), controller.get_input_port())
    for name in ("pose", "commanded"):
        builder.ExportInput(tracker.GetInputPort(name), name)
    for name in ("state", "estimate", "surprise"):
        builder.ExportOutput(tracker.GetOutputPort(name), name)
    builder.ExportOutput(controller.get_output_port(0), "elevator_rate")
    diagram = builder.Build()
    diagram.set_name("autopilot")
    return diagram


class Autopilot:
    """The diagram in flight: a context, and its events. Times are ours [s].

    Args:
        diagram: of `make_autopilot`; several may share it.
        tape: of what the servo is asked.
    """

    def __init__(self, diagram: Diagram, tape: CommandTape) -> None:
        self.begin = 0.0  #: Time 0 of the plan.
        self._tape = tape
        self._first = diagram.CreateDefaultContext()
        self._context = diagram.CreateDefaultContext()
        self._tracker = diagram.GetSubsystemByName("tracker")
        self._controller = diagram.GetSubsystemByName("controller")
        self._of_tracker = self._tracker.GetMyMutableContextFromRoot(self._context)
        self._of_controller = self._controller.GetMyMutableContextFromRoot(
            self._context
        )
        self._outputs = {
            name: diagram.GetOutputPort(name)
            for name in ("elevator_rate", "estimate", "surprise")
        }
        self._pose = self._fixed(diagram.GetInputPort("pose"))
        self._commanded = self._fixed(diagram.GetInputPort("commanded"))
        self._rows: np.ndarray = np.empty(0)  # Of the tape, as last written.

    def _fixed(self, port: InputPort) -> FixedInputPortValue:
        return port.FixValue(self._context, np.zeros(port.size()))

    def start(self, time: float, elapsed: float, state: np.ndarray) -> None:
        """Begins with a state (n,) that poses showed, at a time of the plan [s]."""
        self.begin = time - elapsed
        self._rows = np.empty(0)
        self._context.SetTime(elapsed)
        self._context.SetStateAndParametersFrom(self._first)
        self._tracker.begin(self._of_tracker, elapsed, state)
        self._controller.ExecuteInitializationEvents(self._of_controller)

    def take_pose(self, time: float, pose: np.ndarray) -> None:
        """Takes a pose (4,) of a later time: x, z, pitch, elevator."""
        row = [time - self.begin, *pose]
        _write(self._pose, np.array(row))
        self._look_at_tape()
        self._tracker.ExecuteForcedEvents(self._of_tracker, publish=False)

    def command(self, time: float) -> float:
        """Rate of the elevator [rad/s] to hold from a time on."""
        self._context.SetTime(time - self.begin)
        self._look_at_tape()
        self._controller.ExecuteForcedEvents(self._of_controller, publish=False)
        return float(self.read("elevator_rate")[0])

    def read(self, name: str) -> np.ndarray:
        """An output of the diagram."""
        return self._outputs[name].Eval(self._context)

    def _look_at_tape(self) -> None:
        if self._rows is not self._tape.rows:
            self._rows = self._tape.rows
            _write(self._commanded, self._tape.since(self.begin))


def _write(port: FixedInputPortValue, values: np.ndarray) -> None:
    """Gives a fixed port other values, in half the time of another `FixValue`."""
    port.GetMutableData().get_mutable_value().SetFromVector(values)
