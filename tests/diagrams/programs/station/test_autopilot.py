"""The station's controller diagram: estimate, prediction, and any Drake controller."""

import numpy as np
import pytest
from pydrake.systems.primitives import MatrixGain

from diagrams.programs.station.autopilot import Autopilot, make_autopilot
from diagrams.programs.station.scenario import Filter, Scenario, Sensors, Simulation
from diagrams.programs.station.throw_log import read_throw
from diagrams.programs.station.tracker import CommandTape
from glider.control.mppi import shifted
from glider.physics.model import GliderModel
from glider.planning.problem import PerchingProblem
from glider.systems.mppi import MppiController
from tests.helpers.lockstep import Lockstep, guidance_for

NOMINAL = GliderModel()
LAUNCH = NOMINAL.initial_state(np.array([-3.5, 0.1, 0.0, 0.0, 7.0, 0.0, 0.0]))
GAIN = [[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]]  # Of the elevator alone.


@pytest.fixture
def make_pilot():
    """Autopilots that share one diagram."""
    diagram = make_autopilot(NOMINAL, Sensors(), Filter(), MatrixGain(GAIN))
    return lambda: Autopilot(diagram, CommandTape())


def flown(state, span, rate, steps=400):
    """The state after a time under a rate, by midpoint steps."""
    chain, numbers, step = NOMINAL.chain, NOMINAL.numbers, span / steps

    def slope(x):
        return np.array(chain.derivatives(0.0, x, rate, 0.0, 0.0, numbers))

    for _ in range(steps):
        state = state + step * slope(state + 0.5 * step * slope(state))
    return state


def test_commands_are_for_the_state_when_they_act(make_pilot):
    """Under what was commanded until then: here of two rates, and none before."""
    pilot, begin = make_pilot(), 1000.0
    pilot.start(begin, 0.2, LAUNCH)
    assert pilot.begin == begin - 0.2
    pilot._tape.add(begin + 0.004, 0.0, 5.0)
    pilot._tape.add(begin + 0.012, 0.04, -2.0)
    turned = 5.0 * 0.008 - 2.0 * 0.012
    assert pilot.command(begin + 0.024) == pytest.approx(turned, abs=1e-6)
    assert pilot.read("estimate") == pytest.approx(LAUNCH)


def test_poses_move_the_estimate_to_where_the_glider_is(make_pilot):
    pilot, begin, state = make_pilot(), 1000.0, LAUNCH
    off = LAUNCH + np.array([0.002, 0.002, 0.01, 0.0, 0.3, 0.3, 0.3])
    pilot.start(begin, 0.0, off)
    pilot._tape.add(begin, 0.0, 3.0)
    surprises = []
    for k in range(1, 21):
        state = flown(state, 1.0 / 120.0, 3.0)
        seen = state[3] if k % 2 else np.nan  # The elevator is not always seen.
        pilot.take_pose(begin + k / 120.0, np.append(state[:3], seen))
        surprises.append(pilot.read("surprise"))
    assert pilot.read("estimate")[:4] == pytest.approx(state[:4], abs=1e-3)
    assert pilot.read("estimate")[4:] == pytest.approx(state[4:], abs=0.05)
    assert surprises[0][1] == pytest.approx(0.003, abs=0.004)
    assert surprises[-1][1] < 1e-3 and surprises[-1][2] < 1e-3
    later = flown(state, 0.03, 3.0)[3]
    assert pilot.command(begin + k / 120.0 + 0.03) == pytest.approx(later, abs=2e-3)


def test_a_diagram_is_shared_and_a_flight_is_not(make_pilot):
    one, other = make_pilot(), make_pilot()
    for pilot in (one, other):
        pilot.start(0.0, 0.0, LAUNCH)
    one.take_pose(0.01, flown(LAUNCH, 0.01, 0.0)[:4])
    assert other.read("estimate") == pytest.approx(LAUNCH)
    one.start(5.0, 0.0, LAUNCH)  # The next throw knows nothing of the last.
    assert one.read("estimate") == pytest.approx(LAUNCH)
    assert one.read("surprise") == pytest.approx(np.zeros(3))


def test_a_controller_of_ones_own_flies(tmp_path):
    """Any System from the state to a rate: this one holds the elevator at zero."""
    NOMINAL.save(tmp_path / "nominal.yaml")
    simulation = Simulation(truth=str(tmp_path / "nominal.yaml"))
    lab = Lockstep(tmp_path / "s", simulation, MatrixGain(-30.0 * np.array(GAIN)))
    [throw] = lab.fly()
    assert not throw.perched
    _, topics = read_throw(tmp_path / "s" / "throw_001.mcap")
    asked = [c["asked"] for c in topics["/command"] if "asked" in c]
    assert len(asked) > 20 and np.max(np.abs(asked)) < 1.0


def test_a_later_start_begins_with_a_later_part_of_a_sequence():
    guidance = guidance_for()
    problem = PerchingProblem.load("replanning")
    mppi = MppiController(NOMINAL, problem, guidance.plan)
    context = mppi.CreateDefaultContext()
    sequence = context.get_discrete_state_vector().CopyToVector()[:-1]
    context.SetTime(0.05)
    mppi.ExecuteInitializationEvents(context)
    held = context.get_discrete_state_vector().CopyToVector()
    np.testing.assert_array_equal(held[:-1], shifted(shifted(sequence)))


def test_a_scenario_names_systems_that_fly_in_simulation_too():
    kinds = {
        c: guidance_for(c).autopilot.GetSubsystemByName("controller")
        for c in ("tvlqr", "mpc", "mppi")
    }
    assert {c: type(k).__name__ for c, k in kinds.items()} == {
        "tvlqr": "TrajectoryAffineSystem",
        "mpc": "ModelPredictiveController",
        "mppi": "MppiController",
    }
    assert Scenario().controller in kinds
