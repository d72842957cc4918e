"""A plan replayed without feedback."""

from pydrake.geometry import Meshcat
from pydrake.systems.framework import Diagram, DiagramBuilder
from pydrake.systems.primitives import TrajectorySource

from diagrams.wiring import add_glider, add_motion_capture, finish
from glider.physics.model import GliderModel
from glider.planning.plan import Plan


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
        add_motion_capture(builder, glider, servo, motion_capture)
    return finish(builder, "open_loop", glider, truth, meshcat)
