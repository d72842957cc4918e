"""A proposed throw: its launch, and its commands, which nothing corrects."""

import dataclasses
import math
from pathlib import Path

import numpy as np
from pydrake.systems.framework import BasicVector, Context, DiscreteValues, LeafSystem

from glider.compiled.flight import Steps, fly_batch, make_tape
from glider.errors import InputError, expect
from glider.files import schema
from glider.physics.flown_range import warn_beyond
from glider.physics.model import GliderModel
from glider.physics.state import NUM_STATES, VELOCITY
from glider.planning.plan import Plan
from glider.simulation.fly import STEP
from glider.systems.command_tape import load_commands

_NEXT_THROW = "next_throw.json"
"""File beside the commands, with the launches that they are for."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class _Launch:
    """A throw of the file."""

    commands: str
    x_m: float
    height_m: float
    speed_m_s: float
    climb_rad: float
    pitch_rad: float


def load_launch(commands: Path) -> list[float]:
    """State at release (7,) of a file of commands, from `next_throw.json` beside it.

    Raises:
        InputError: it is of no proposed throw.
    """
    file = commands.parent / _NEXT_THROW
    if not commands.is_file():
        raise InputError(
            f"{commands}: does not exist; expected commands_N.csv of {file}."
        )
    found = schema.parse_json(
        schema.read_text(file, "the throws of glider next-throw"), str(file)
    )
    known = found.get("throws") if isinstance(found, dict) else None
    throws = schema.convert(known, list[_Launch], str(file))
    named = {throw.commands: throw for throw in throws}
    expected = f"commands of a throw in {file}"
    expect(commands.name in named, "the commands", str(commands), expected)
    throw = named[commands.name]
    launch = np.zeros(NUM_STATES)
    launch[:3] = throw.x_m, throw.height_m, throw.pitch_rad
    direction = math.cos(throw.climb_rad), math.sin(throw.climb_rad)
    launch[VELOCITY] = np.multiply(throw.speed_m_s, direction)
    return launch.tolist()


def tape_plan(model: GliderModel, launch: list[float], commands: Path) -> Plan:
    """The flight of a model under a file of commands, as a plan.

    Warns where it leaves what the model was traced on.
    """
    begins, rates = load_commands(commands)
    count = math.ceil(begins[-1] / STEP)
    times = STEP * np.arange(count + 1)
    latest = np.searchsorted(begins, times[:-1] + 1e-9, side="right") - 1
    inputs = np.where(latest < 0, 0.0, rates[latest])
    tape = make_tape(inputs[None])
    start = model.initial_state(np.array(launch))[None]
    states = fly_batch(model, start, Steps(count, STEP), tape).states[0]
    warn_beyond("The throw", model, times[:-1], states[:-1], inputs)
    return Plan(
        times=times,
        states=states,
        slopes=np.gradient(states, STEP, axis=0),
        inputs=inputs,
        state_names=model.state_names,
        cost=0.0,
    )


class TapePlayer(LeafSystem):
    """Turns the elevator as a plan does, whatever the glider does.

    A forced event is a command. One of the plan that began before the flight did is
    made good by the first.

    Input ports:
        state (n): not used; every controller of a station has it.

    Output ports:
        elevator_rate (1): command [rad/s].

    Args:
        planned: with commands that are held.
        period: time between two commands [s].
        fastest: rate of the servo [rad/s].
    """

    def __init__(self, planned: Plan, period: float, fastest: float) -> None:
        """Declares the ports, and angle and rate given as discrete state."""
        super().__init__()
        self._times = planned.times
        self._period = period
        self._fastest = fastest
        turned = np.cumsum(planned.inputs * np.diff(planned.times))
        self._turned = np.append(0.0, turned)
        self.DeclareVectorInputPort("state", planned.states.shape[1])
        self.DeclareDiscreteState(2)
        self.DeclareForcedDiscreteUpdateEvent(self._update)
        self.DeclareVectorOutputPort(
            "elevator_rate", 1, self._calc_rate, {self.xd_ticket()}
        )

    def _update(self, context: Context, into: DiscreteValues) -> None:
        given = context.get_discrete_state_vector().GetAtIndex(0)
        end = context.get_time() + self._period
        wanted = float(np.interp(end, self._times, self._turned))
        rate = (wanted - given) / self._period
        rate = min(max(rate, -self._fastest), self._fastest)
        into.set_value([given + rate * self._period, rate])

    def _calc_rate(self, context: Context, output: BasicVector) -> None:
        output.SetAtIndex(0, context.get_discrete_state_vector().GetAtIndex(1))
