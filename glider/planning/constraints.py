"""What a perching problem demands of a flight, as data.

`constraints_of` is the one place that spells out the limits of a problem and of a
servo. Drake's program (`glider.planning.program`), the controller that plans again
(`glider.control.mpc`), the verdict on a path (`find_violations`) and the check that a
funnel is the intended one (`glider.verification.proof.purpose`) read them from here.
"""

import dataclasses
import math
from typing import NamedTuple

import numpy as np

from glider.errors import InputError, expect
from glider.physics.model import GliderModel
from glider.physics.parameters import check_units
from glider.physics.servo import NO_LIMITS, Servo
from glider.physics.state import ELEVATOR, PITCH, POSITION, STATE_NAMES, VELOCITY
from glider.planning.path import Path
from glider.planning.problem import Hook, PerchingProblem

_UNITS = ("m", "m", "rad", "rad", "m/s", "m/s", "rad/s")
"""Units of the states; an effect's own state goes without."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Bound:
    """Least and largest value of a quantity, a state in most cases."""

    name: str
    low: float
    high: float
    unit: str
    state: int = -1  #: Index of the state, -1 for what is none.

    @property
    def is_equation(self) -> bool:
        """Whether only one value is left."""
        return self.low == self.high

    def excess(self, values: np.ndarray) -> float:
        """Largest amount by which values lie outside; negative if all are inside."""
        below = self.low - np.asarray(values)
        above = np.asarray(values) - self.high
        return float(np.maximum(below, above).max())


@dataclasses.dataclass(frozen=True, kw_only=True)
class Constraints:
    """Everything that a flight has to keep besides the dynamics and its launch."""

    path: tuple[Bound, ...]  #: Of states, over the whole flight.
    command: Bound  #: Over the whole flight.
    arrival: tuple[Bound, ...]  #: Of states, at the end; the place is an equation.
    duration: Bound  #: Of the number of knots times the step between them.
    hook: Hook  #: At the glider: no part of a plan, but of what it is for.


class Violation(NamedTuple):
    """A constraint that a path does not keep."""

    name: str
    amount: float
    unit: str

    @property
    def size(self) -> str:
        """The amount with its unit, as a message has it."""
        return f"{self.amount:.3g} {self.unit}".rstrip()


def constraints_of(problem: PerchingProblem, servo: Servo = NO_LIMITS) -> Constraints:
    """Returns what a problem, and the servo of its glider, demand of a flight."""
    x, z = POSITION
    speed = problem.final_speed_limit
    travel = (servo.low, servo.high)
    path = {x: problem.x_limits, z: problem.z_limits, PITCH: problem.pitch_limits}
    arrival = {
        place: [wire, wire] for place, wire in zip(POSITION, problem.wire, strict=True)
    }
    arrival[PITCH] = problem.final_pitch_limits
    arrival |= {state: [-speed, speed] for state in VELOCITY}
    shortest, longest = problem.duration_limits
    return Constraints(
        path=tuple(
            _bound_state(state, limits)
            for state, limits in (path | {ELEVATOR: travel}).items()
        ),
        command=Bound(
            name="elevator rate", low=-servo.rate, high=servo.rate, unit="rad/s"
        ),
        arrival=tuple(
            _bound_state(state, limits, " at the wire")
            for state, limits in arrival.items()
        ),
        duration=Bound(name="duration", low=shortest, high=longest, unit="s"),
        hook=problem.hook,
    )


def _bound_state(state, limits, where=""):
    low, high = limits
    return Bound(
        name=STATE_NAMES[state] + where,
        low=low,
        high=high,
        unit=_UNITS[state],
        state=state,
    )


def check_plannable(model: GliderModel, problem: PerchingProblem) -> None:
    """Raises InputError where direct collocation cannot take a problem.

    The glider varies in time, its mass and inertia cannot be of one glider, or the
    launch is outside the problem's own limits.
    """
    check_units(vars(model.parameters))
    if model.is_time_varying:
        raise InputError(
            "plan: the glider's motion depends on time, which direct collocation does "
            "not support; expected a free function of x instead."
        )
    constraints = constraints_of(problem, model.parameters.servo)
    for bound in constraints.path:
        value = problem.launch[bound.state]
        expected = f"a value from {bound.low:g} to {bound.high:g}"
        good = bound.low <= value <= bound.high
        expect(good, f"plan: the launch's {bound.name}", value, expected)


def find_violations(constraints: Constraints, path: Path) -> list[Violation]:
    """Returns what a path violates, the largest amount in SI units first.

    What is not a number violates by an infinite amount.
    Bounds hold at the knots; the dynamics hold at the collocation points, where what
    they miss is the defect of a segment.
    """
    knots = path.states
    length = len(knots) * path.times[1]
    bounded = [(bound, knots[1:, bound.state]) for bound in constraints.path]
    bounded += [(bound, knots[-1, bound.state]) for bound in constraints.arrival]
    bounded += [(constraints.command, path.inputs), (constraints.duration, length)]
    rows = [(bound.name, bound.excess(values), bound.unit) for bound, values in bounded]
    defects = np.abs(path.defects).max(axis=0)
    units = _UNITS + ("",) * (len(defects) - len(_UNITS))
    for name, amount, unit in zip(path.model.state_names, defects, units, strict=True):
        rows.append((f"dynamics of {name}", float(amount), unit))
    violations = [
        Violation(name, math.inf if math.isnan(amount) else amount, unit)
        for name, amount, unit in rows
    ]
    violations.sort(key=lambda violation: -violation.amount)
    return [violation for violation in violations if violation.amount > 0.0]
