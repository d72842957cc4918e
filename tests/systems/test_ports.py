"""Each system documents its ports as it has them, under a name that people read."""

import dataclasses
import inspect
import re

import pytest

from diagrams.programs.station.autopilot import PoseTracker
from diagrams.programs.station.proposed import TapePlayer
from diagrams.programs.station.scenario import Filter, Sensors
from glider.estimation.perching import perching_filter
from glider.paths import models_path
from glider.physics.model import GliderModel
from glider.planning.problem import PerchingProblem
from glider.systems.elevator_servo import ElevatorServo
from glider.systems.funnel_monitor import FunnelMonitor
from glider.systems.kalman_filter import ExtendedKalmanFilter
from glider.systems.mpc import ModelPredictiveController
from glider.systems.mppi import MppiController
from glider.systems.noise import SampledNoise
from glider.systems.observer import ExtraStates
from glider.systems.plant import GliderPlant
from glider.verification.funnel.funnel import load_funnel
from tests.helpers.flights import LAGGING, NOMINAL, plan_of

SECTION = re.compile(r"(In|Out)put ports:\n((?:\n| +.*\n?)*)")
PORT = re.compile(r"    (\w+) \(([^)]*)\): ")


def kalman_filter():
    return ExtendedKalmanFilter(*perching_filter(NOMINAL, PerchingProblem().launch))


def monitor():
    return FunnelMonitor(load_funnel(models_path("funnels", "drawn.npz")))


def tape_player():
    held = dataclasses.replace(plan_of(), inputs=plan_of().inputs[:-1])
    return TapePlayer(held, 0.02, 13.0)


SYSTEMS = [
    GliderPlant,
    lambda: GliderPlant(LAGGING),
    ElevatorServo,
    lambda: SampledNoise(4, 120.0, 3),
    lambda: ExtraStates(LAGGING),
    kalman_filter,
    monitor,
    lambda: MppiController(NOMINAL, PerchingProblem.load("replanning")),
    lambda: ModelPredictiveController(NOMINAL, PerchingProblem.load("replanning")),
    lambda: PoseTracker(NOMINAL, Sensors(), Filter()),
    tape_player,
]


def documented(system):
    """Returns the ports of a class's docstring, {"In": {name: size}, "Out": ...}."""
    text = inspect.getdoc(type(system))
    found = {"In": {}, "Out": {}}
    for kind, block in SECTION.findall(text + "\n"):
        found[kind] = dict(PORT.findall(block.split("\n\n")[0] + "\n"))
    return found


@pytest.mark.parametrize("make", SYSTEMS)
def test_the_docstring_has_the_ports_and_their_sizes(make):
    system = make()
    said = documented(system)
    inputs = map(system.get_input_port, range(system.num_input_ports()))
    outputs = map(system.get_output_port, range(system.num_output_ports()))
    for kind, ports in (("In", list(inputs)), ("Out", list(outputs))):
        has = {port.get_name(): port.size() for port in ports}
        optional = {"known"} - set(has)  # Of a filter that knows no more inputs.
        assert list(has) == [name for name in said[kind] if name not in optional]
        for name, size in has.items():
            symbol = said[kind][name]
            assert not symbol.isdecimal() or int(symbol) == size, name


@pytest.mark.parametrize(
    ("system", "arguments"),
    [
        (GliderPlant, ["model", "fast"]),
        (ElevatorServo, ["model", "num_states"]),
        (SampledNoise, ["size", "rate", "rows"]),
        (ExtraStates, ["model"]),
    ],
)
def test_help_shows_a_plain_name_and_the_arguments(system, arguments):
    assert system.__name__ == system.__qualname__
    assert system.__name__.isascii()
    assert list(inspect.signature(system).parameters) == arguments


def test_a_system_with_a_plain_name_still_converts():
    plant = GliderPlant(GliderModel())
    again = plant.ToAutoDiffXd().ToScalarType[float]()
    assert type(again) is GliderPlant
