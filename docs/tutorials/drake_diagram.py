# ---
# jupyter:
#   kernelspec: {name: python3, display_name: Python 3, language: python}
# ---

# %% [markdown]
# # The glider in a Drake diagram
#
# We build a diagram system by system, fly it with Drake's `Simulator`, close the loop
# on what it logged, and fly again with the corrected model. You need to know Drake's
# [`DiagramBuilder`](https://drake.mit.edu/pydrake/pydrake.systems.framework.html). The
# [page beside this tutorial](../drake.md) lists all ports, and shows controllers,
# filters, costs and effects of your own.
#
# {nb-download}`Download this page as a notebook <drake_diagram.ipynb>`.

# %%
import logging

import matplotlib.pyplot as plt
import numpy as np
from pydrake.geometry import Meshcat
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import (
    FirstOrderTaylorApproximation,
    LogVectorOutput,
    ZeroOrderHold,
)

from diagrams import AddScene
from glider import (
    Campaign,
    ElevatorServo,
    ExtendedKalmanFilter,
    GliderModel,
    GliderPlant,
    PerchingProblem,
    SampledNoise,
    close_the_loop,
    perching_filter,
    plan,
    tracking_regulator,
)

logging.getLogger("drake").setLevel(logging.WARNING)  # No address of Meshcat below.

# %% [markdown]
# ## The plant
#
# `GliderPlant` is a `LeafSystem` with seven states. Its input is the *rate* of the
# elevator; a second input, the wind, may be left open.

# %%
plant = GliderPlant()
for kind, count, port_of in (
    ("input ", plant.num_input_ports(), plant.get_input_port),
    ("output", plant.num_output_ports(), plant.get_output_port),
):
    for k in range(count):
        print(kind, port_of(k).get_name(), port_of(k).size())
print(plant.state_names)

# %% [markdown]
# Pitch is positive nose **down** and the elevator positive trailing edge **up**:
#
# ![The glider with its axes, angles, lever arms and forces](../pictures/glider.svg)
#
# The plant converts to AutoDiffXd and to Expression, so that Drake's tools take it as
# it is. Here it is linearized at a launch:

# %%
context = plant.CreateDefaultContext()
context.SetContinuousState([-3.5, 0.1, 0.0, 0.0, 7.0, 0.0, 0.0])
port = plant.GetInputPort("elevator_rate")
port.FixValue(context, [0.0])
linear = FirstOrderTaylorApproximation(plant, context, port.get_index())
poles = np.linalg.eigvals(linear.A())
print("slowest and fastest pole:", poles.real.max().round(2), poles.real.min().round(2))
print("pitch acceleration by elevator rate:", linear.B()[6, 0].round(2), "1/s")

# %% [markdown]
# The plant turns its elevator at any rate. The limits of rate and travel are in a
# separate system, `ElevatorServo`, so that you decide what is in front of the glider.
# It has the state as an input, because it slows down before a stop.

# %%
servo = ElevatorServo()
context = servo.CreateDefaultContext()
for angle in (0.0, 0.93):
    servo.GetInputPort("command").FixValue(context, [100.0])
    servo.GetInputPort("state").FixValue(context, [0.0, 0.0, 0.0, angle, 7.0, 0.0, 0.0])
    [rate] = servo.GetOutputPort("elevator_rate").Eval(context)
    print(f"asked for 100 rad/s at {angle} rad: {rate:.1f} rad/s")
assert rate < 13.0

# %% [markdown]
# ## The diagram
#
# It has Drake's finite-horizon LQR along a plan, cameras with noise, and an extended
# Kalman filter in front of the regulator. The glider that flies and the model that
# everything else is made for are two arguments.


# %%
def build(truth, model):
    """Returns a diagram, its logs by name, and the plan that it follows."""
    planned = plan(model, PerchingProblem())
    ekf, prior = perching_filter(model, planned.states[0], elevator=False)
    period = ekf.period
    builder = DiagramBuilder()
    glider = builder.AddNamedSystem("glider", GliderPlant(truth))
    cameras = builder.AddNamedSystem("cameras", SampledNoise(3, 1.0 / period, 200))
    estimator = builder.AddNamedSystem("estimator", ExtendedKalmanFilter(ekf, prior))
    regulator = builder.AddNamedSystem("regulator", tracking_regulator(model, planned))
    hold = builder.AddNamedSystem("hold", ZeroOrderHold(period, 1))
    servo = builder.AddNamedSystem("servo", ElevatorServo(truth))

    state = glider.GetOutputPort("state")
    measured = cameras.GetOutputPort("measured")
    estimate = estimator.GetOutputPort("state")
    command = regulator.GetOutputPort("command")
    rate = servo.GetOutputPort("elevator_rate")
    builder.Connect(glider.GetOutputPort("pose"), cameras.GetInputPort("signal"))
    builder.Connect(measured, estimator.GetInputPort("measured"))
    builder.Connect(rate, estimator.GetInputPort("elevator_rate"))
    builder.Connect(estimate, regulator.GetInputPort("plant_state"))
    builder.Connect(command, hold.get_input_port())
    builder.Connect(hold.get_output_port(), servo.GetInputPort("command"))
    builder.Connect(state, servo.GetInputPort("state"))
    builder.Connect(rate, glider.GetInputPort("elevator_rate"))

    ports = {"pose": measured, "state": state, "estimate": estimate, "command": command}
    logs = {
        name: LogVectorOutput(port, builder, period) for name, port in ports.items()
    }
    AddScene(builder, state, Meshcat(), forces=glider.GetOutputPort("forces"))
    return builder.Build(), logs, planned


truth, model = GliderModel.load("head_wind"), GliderModel()
diagram, logs, planned = build(truth, model)
print(planned)

# %% [markdown]
# With Graphviz installed, `plot_system_graphviz(diagram)` of `pydrake.systems.drawing`
# draws it. Here the systems that draw in Meshcat are one box, and the logs another;
# that of the estimate is left out:
#
# ![Block diagram of the systems and signals](../pictures/drake_diagram.svg)
#
# ## Flights
#
# A new `Simulator` has a new context, with empty logs. The noise of a flight is a
# numeric parameter of the cameras. If you run this yourself,
# `simulator.set_target_realtime_rate(0.2)` shows the flight in slow motion at
# `http://localhost:7000`.


# %%
def fly(diagram, logs, launch, duration, rng):
    """Flies once; returns the times of the logs, and what they have by name."""
    simulator = Simulator(diagram)
    context = simulator.get_mutable_context()
    glider = diagram.GetSubsystemByName("glider")
    start = glider.model.initial_state(launch)
    cameras = diagram.GetSubsystemByName("cameras")
    glider.GetMyMutableContextFromRoot(context).SetContinuousState(start)
    noise = rng.normal(size=(200, 3)) * [0.001, 0.001, 0.0025]  # [m, m, rad]
    cameras.set_tape(cameras.GetMyMutableContextFromRoot(context), noise)
    simulator.AdvanceTo(duration)
    times = logs["pose"].FindLog(context).sample_times().copy()
    return times, {
        name: log.FindLog(context).data().copy() for name, log in logs.items()
    }


problem = PerchingProblem()
rng = np.random.default_rng(0)
flown = [
    fly(diagram, logs, launch, planned.duration, rng)
    for launch in problem.draw_launches(8, rng)
]

# %%
figure, (paths, speeds) = plt.subplots(1, 2, figsize=(9, 3), layout="constrained")
for _, rows in flown:
    paths.plot(*rows["state"][:2], color="#8A8A8A", lw=1)
paths.plot(*planned.states[:, :2].T, color="#0072B2", lw=2, label="plan")
paths.plot(*problem.wire, "o", ms=9, mfc="none", color="#D55E00", label="wire")
paths.set(xlabel="x [m]", ylabel="z [m]", title="eight flights")
paths.legend(frameon=False)
times, rows = flown[0]
speeds.plot(times, rows["state"][4], color="#8A8A8A", label="true")
speeds.plot(times, rows["estimate"][4], color="#0072B2", label="estimated")
speeds.set(xlabel="time [s]", ylabel="forward speed [m/s]", title="first flight")
speeds.legend(frameon=False)
plt.show()

# %% [markdown]
# No flight follows the plan, and the filter's estimate of the speed is wrong, too: its
# model has no wind.
#
# ## Close the loop
#
# A flight is a table with the columns of a [campaign's files](../file_formats.md). The
# commands are logged in front of the hold, because a Drake log has the values *before*
# the updates at its times.


# %%
def table(times, rows):
    """Returns a flight as a table."""
    x, z, pitch = rows["pose"]
    return {
        "time": times,
        "x": x,
        "z": z,
        "pitch": pitch,
        "elevator": rows["state"][3],
        "elevator_rate_command": rows["command"][0],
    }


tables = [table(times, rows) for times, rows in flown]
result = close_the_loop(Campaign.from_arrays(tables, model, command_rate=120.0))
print(result.verdict, "-", result.reason)
for effect in result.effects:
    for name, c in effect.coefficients.items():
        print(f"{effect.kind}.{name} = {c.value:.3f} ± {c.std:.1g} {c.unit}")
assert result.verdict == "effect_found"
assert [effect.kind for effect in result.effects] == ["wind"]

# %% [markdown]
# ## Fly with the corrected model
#
# Planner, regulator and filter are made for the corrected model. The glider is the
# same.

# %%
corrected, logs, planned = build(truth, result.model)
again = [
    fly(corrected, logs, launch, planned.duration, rng)
    for launch in problem.draw_launches(8, rng)
]


def end_distances(flights):
    """Returns the distance from the wire at the end of each flight [mm]."""
    ends = np.array([rows["state"][:2, -1] for _, rows in flights])
    return 1000.0 * np.linalg.norm(ends - problem.wire, axis=1)


print("nominal model:  ", end_distances(flown).round().astype(int), "mm from the wire")
print("corrected model:", end_distances(again).round().astype(int), "mm")
assert end_distances(again).max() < 50.0 < end_distances(flown).min()

# %%
figure, ax = plt.subplots(figsize=(8, 3), layout="constrained")
for flights, color, label in (
    (flown, "#8A8A8A", "nominal model"),
    (again, "#0072B2", "corrected model"),
):
    for k, (_, rows) in enumerate(flights):
        ax.plot(*rows["state"][:2], color=color, lw=1, label=label if k == 0 else None)
ax.plot(*problem.wire, "o", ms=9, mfc="none", color="#D55E00", label="wire")
ax.set(xlabel="x [m]", ylabel="z [m]", aspect="equal")
figure.legend(loc="outside lower center", ncols=3, frameon=False)
plt.show()

# %% [markdown]
# `diagrams.estimated_loop` wires a diagram like this one in one call, and
# `simulate_flights` flies and logs it. Next: [systems of your own](../drake.md), and
# [planning and flying](../planning.md).
