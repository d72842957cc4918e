"""An effect is a named physical formula that adds to one link of the chain.

    command -> [actuator] -> [air] -> [geometry] -> [surface] -> [wrench]
            -> [inertia] -> acceleration -> state -> [sensor] -> log

Each link (stage) has a few named terms that are zero on the nominal model; an effect
adds to some of them. Since all effects add, their order does not matter, the default
coefficients mean no effect, and a new effect is one formula and one line in
the library.
"""

import dataclasses
import inspect
import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from glider.errors import InputError, expect, show
from glider.physics.formulas import scalar

STAGES = {
    "actuator": (),
    "air": ("wind_x", "wind_z"),
    "geometry": ("wing_incidence", "wing_shift", "elevator_trim", "downwash"),
    "surface": ("wing_normal", "wing_factor", "elevator_factor"),
    "wrench": ("force_x", "force_z", "moment"),
    "inertia": ("mass", "inertia", "added_mass", "added_inertia", "added_coupling"),
    "sensor": ("pose_x", "pose_z", "pose_pitch"),
    "log": ("pose_x", "pose_z", "pose_pitch"),
}
"""The terms that effects of each stage may add to.

air: velocity of the air [m/s]. geometry: angle of the wing plate [rad], shift
of the wing's center of pressure ahead [m], angle of the elevator plate [rad],
downward flow at the tail along the body's normal [m/s]. surface: normal-force
coefficient of the wing [-], relative change of the wing's and the elevator's
force [-]. wrench: world force [N] and moment about +y [N m]. inertia: relative
change of mass and pitch inertia [-], added mass along the body's normal [kg], added
pitch inertia [kg m²], coupling of both [kg m]. sensor: measured minus true pose [m, m,
rad]. log: the same, of a fault that is corrected in the log before it is used.
"""


@scalar
def constant(flow, value):
    """Returns the coefficient itself: the formula of an effect that is constant."""
    return value


class Replay(NamedTuple):
    """How the elevator follows logged commands, and the time that a row shows.

    A log is not flown through the plant's actuators and clocks but through these,
    which are exact.
    """

    delay: float = 0.0  #: Time between a command and its action [s].
    #: First-order lag of the elevator's rate [s]; 0 for none.
    time_constant: float = 0.0
    latency: float = 0.0  #: The row of time t shows the pose of t - latency [s].
    drift: float = 0.0  #: Growth of the latency from a session's begin to its end [s].
    #: Further ones and their coefficients, integrated by their formulas.
    actuators: tuple[tuple["EffectKind", tuple[float, ...]], ...] = ()


class Motion(NamedTuple):
    """Motion of the glider, without the air."""

    t: float
    x: float
    z: float
    pitch: float
    elevator: float
    xdot: float
    zdot: float
    pitchdot: float
    elevator_rate: float
    sin_pitch: float
    cos_pitch: float


class Flow(NamedTuple):
    """Motion with the stream at the center of mass, for formulas of later stages.

    air_x, air_z: velocity through the air, in the world [m/s]; speed: its
    length; sin_alpha, cos_alpha: of the angle of attack of the body axis. mass
    to gravity: the parameters of the glider.
    """

    t: float
    x: float
    z: float
    pitch: float
    elevator: float
    xdot: float
    zdot: float
    pitchdot: float
    elevator_rate: float
    sin_pitch: float
    cos_pitch: float
    air_x: float
    air_z: float
    speed: float
    sin_alpha: float
    cos_alpha: float
    mass: float
    pitch_inertia: float
    wing_area: float
    elevator_area: float
    wing_offset: float
    hinge_offset: float
    elevator_offset: float
    air_density: float
    gravity: float


FACTS = (*Flow._fields[Flow._fields.index("mass") :], "servo", "elevator_angle", "tail")
"""What a campaign may give and effects may need: parameters of the vehicle, a log of
the servo, an angle of the elevator that is not one unknown constant, a tail of known
size or angle."""

TAIL_LINKS = ("tail's force", "stream at the tail", "tail's angle")
"""Links of the free functions that act at the tail."""

LIFT_BY_RATE = ("lift over reduced_rate", "lift over alpha and reduced_rate")
MOMENT_BY_RATE = ("moment over reduced_rate", "moment over alpha and reduced_rate")
"""Free functions of the rate at which the glider turns."""

_TRIAL_FLOW = Flow(
    t=0.1,
    x=-2.0,
    z=0.3,
    pitch=-0.2,
    elevator=0.1,
    xdot=6.0,
    zdot=-1.0,
    pitchdot=0.5,
    elevator_rate=1.0,
    sin_pitch=math.sin(-0.2),
    cos_pitch=math.cos(-0.2),
    air_x=6.0,
    air_z=-1.0,
    speed=math.hypot(6.0, 1.0),
    sin_alpha=math.sin(math.atan2(1.0, 6.0) + 0.2),
    cos_alpha=math.cos(math.atan2(1.0, 6.0) + 0.2),
    mass=0.08,
    pitch_inertia=0.0015,
    wing_area=0.09,
    elevator_area=0.015,
    wing_offset=0.01,
    hinge_offset=0.27,
    elevator_offset=0.02,
    air_density=1.2,
    gravity=9.81,
)
"""A flow in which formulas are tried, with nothing at zero."""


@dataclasses.dataclass(frozen=True)
class Coefficient:
    """One number of an effect."""

    name: str  #: As in the report.
    unit: str  #: SI, as in the report.
    default: float = 0.0  #: Value when not given; all defaults together do nothing.
    _: dataclasses.KW_ONLY
    scale: float = (
        1.0  #: A typical size: of steps, of a fit's prior, of planted effects.
    )
    lower: float = -math.inf  #: Smallest physical value.
    upper: float = math.inf  #: Largest physical value.
    #: Starting values to try where the effect is not linear in this coefficient; empty
    #: where it is (nearly) linear.
    grid: tuple[float, ...] = ()

    @property
    def is_shape(self) -> bool:
        """Whether it only shapes the effect, whose size is another's."""
        return bool(self.grid)


def stalling(fade: float, *angles: float) -> tuple[Coefficient, ...]:
    """Returns the shapes of `attached_share`, with angles to start at [rad]."""
    return (
        Coefficient(
            "stall_angle", "rad", 0.26, scale=0.03, lower=0.05, upper=0.8, grid=angles
        ),
        Coefficient(
            "fade", "rad", fade, scale=0.01, lower=0.008, upper=0.3, grid=(fade,)
        ),
    )


def lag(name: str, *times: float) -> Coefficient:
    """Returns the time constant of a lag, with times to start at [s]."""
    return Coefficient(name, "s", 0.08, scale=0.02, lower=0.012, upper=1.0, grid=times)


@dataclasses.dataclass(frozen=True, kw_only=True)
class EffectKind:
    """A physical effect that a flat-plate glider may lack."""

    kind: str  #: Its name in models and reports.
    stage: str  #: The link of the chain where it enters, a key of STAGES.
    #: The terms of that stage that the formula's results add to.
    adds_to: tuple[str, ...]
    coefficients: tuple[Coefficient, ...]  #: In the order of the formula's arguments.
    #: ``formula(flow, *states, *coefficients)`` returns the addition, a scalar for one
    #: term, else a tuple. Air effects get a Motion, all others a Flow. Actuators: the
    #: elevator's rate that comes out.
    formula: Callable
    words: str  #: A short phrase for people.
    depends_on: tuple[str, ...] = ()  #: The variables that its signature varies with.
    #: What a campaign must give so that its flights can show the effect: names of
    #: FACTS, "a or b" where either is enough.
    needs: tuple[str, ...] = ()
    #: Parameters of the vehicle of which its first coefficient is another value; and
    #: `angle_sign`, where a turned sign looks like the effect. No others are read.
    like: tuple[str, ...] = ()
    #: The fact without which the first coefficient is an unknown of the vehicle, fitted
    #: with all else, and its prior spread. The moment shows it, but hardly the forces.
    unknown_without: tuple[str, float] | None = None
    #: Whether every glider has it, as no wing's lift is exactly a flat plate's.
    is_common: bool = False
    #: Whether gliders often have it: it is rehearsed unless others are asked for.
    is_likely: bool = False
    #: Whether it is tried last: it is rare, and to first order imitates many effects.
    is_rare: bool = False
    #: The scale of noise by which the coefficients vary from flight to flight, or none.
    varies_by: str = ""
    families: tuple[str, ...] = ()  #: Those of FAMILIES of which it is a formula.
    #: Further free functions that may bend its formula, or links of which all may:
    #: lags are soon over, and only the deflection distinguishes a change of the tail's
    #: angle from one of its force.
    bent_by: tuple[str, ...] = ()
    states: tuple[str, ...] = ()  #: Names of the effect's own states.
    #: ``state_rate(flow, *states, *coefficients)``, their rates: a scalar for one
    #: state, else a tuple. Actuators get the incoming rate instead of a Flow.
    state_rate: Callable | None = None
    #: Whether `state_rate` gets α̇ [rad/s] after the Flow.
    rate_by_alphadot: bool = False
    #: The arguments of the formula without states: their values at rest.
    steady_state: Callable | None = None
    #: ``pending(*states, *coefficients)`` of an actuator with states: the angle by
    #: which the elevator still turns where no rate comes in [rad]. Its rate is the
    #: incoming one minus the outgoing. Without a formula none is pending.
    pending: Callable | None = None
    #: Typical sizes of the states; 1 where not given.
    state_scales: tuple[float, ...] = ()
    #: ``replay(before, *coefficients)`` returns the Replay with this effect, where a
    #: log is replayed through it; then it is no part of the dynamics that fly the log.
    #: An actuator without one is integrated by its formulas.
    replay: Callable[..., Replay] | None = None
    #: Whether its coefficient is a function of the flow, of FREE_FUNCTIONS, which no
    #: vector of numbers holds.
    is_free: bool = False

    def __post_init__(self):
        """Raises InputError where the effect could not be used."""
        _check_form(self)
        for c in self.coefficients:
            _check_coefficient(f"effect '{self.kind}': coefficient '{c.name}'", c)
        _check_defaults(self)
        if self.pending is not None:
            _check_pending(self)

    @property
    def defaults(self) -> tuple[float, ...]:
        """The coefficients that do nothing."""
        return tuple(c.default for c in self.coefficients)

    @property
    def is_replayed(self) -> bool:
        """Whether a log is replayed through it, not flown with it."""
        return self.stage == "actuator" or self.replay is not None

    def replayed(self, before: Replay, values: tuple[float, ...]) -> Replay:
        """Returns a Replay with this effect at some coefficients."""
        if self.replay is not None:
            return self.replay(before, *values)
        if values == self.defaults:
            return before  # It does nothing.
        return before._replace(actuators=(*before.actuators, (self, values)))

    def __repr__(self) -> str:
        """Returns its name, as users write it."""
        return self.kind.upper()

    def __hash__(self) -> int:
        """Returns the name's: kinds are looked up before each compiled call."""
        return hash(self.kind)

    def __call__(self, **values: float) -> "Effect":
        """Returns this effect with the given coefficients, others at default."""
        names = [c.name for c in self.coefficients]
        for name in values:
            known = f"one of {', '.join(names)}"
            what = f"effect '{self.kind}'"
            expect(name in names, f"{what}: a coefficient", name, known)
        complete = []
        for c in self.coefficients:
            value = values.get(c.name, c.default)
            what = f"effect '{self.kind}': coefficient '{c.name}'"
            finite = isinstance(value, (int, float)) and math.isfinite(value)
            expect(finite, what, value, f"a finite number in {c.unit}")
            limits = f"a value in [{c.lower:g}, {c.upper:g}] {c.unit}"
            expect(c.lower <= value <= c.upper, what, value, limits)
            complete.append(float(value))
        return Effect(kind=self, values=tuple(complete))


@dataclasses.dataclass(frozen=True, kw_only=True)
class Effect:
    """An effect kind with its coefficients."""

    kind: EffectKind
    values: tuple[float, ...]

    def __repr__(self) -> str:
        """Returns the call that makes it."""
        given = (f"{name}={show(value)}" for name, value in self.to_dict().items())
        return f"{self.kind}({', '.join(given)})"

    def to_dict(self) -> dict[str, float]:
        """Returns coefficient name to value."""
        names = [c.name for c in self.kind.coefficients]
        return dict(zip(names, self.values, strict=True))


def _check_form(kind: EffectKind) -> None:
    where = f"effect '{kind.kind}'"
    needed = f"one of {', '.join(STAGES)}"
    expect(kind.stage in STAGES, f"{where}: stage", kind.stage, needed)
    terms = STAGES[kind.stage]
    is_actuator = kind.stage == "actuator"
    fits = bool(kind.adds_to) != is_actuator and set(kind.adds_to) <= set(terms)
    needed = f"a choice of {', '.join(terms) or '()'} at stage {kind.stage}"
    expect(fits, f"{where}: adds_to", kind.adds_to, needed)
    names = [c.name for c in kind.coefficients]
    has_size = is_actuator or not all(c.is_shape for c in kind.coefficients)
    good = names and len(set(names)) == len(names) and has_size
    needed = "different names, and one without a grid, which is the effect's size"
    expect(good, f"{where}: the list of its coefficients", names, needed)
    functions = (kind.state_rate, kind.steady_state)
    if any((f is not None) != bool(kind.states) for f in functions):
        raise InputError(
            f"{where}: found only some of states, state_rate and steady_state; "
            "expected all or none."
        )
    if kind.pending is not None:
        good = is_actuator and bool(kind.states)
        needed = "none, as only an actuator with states has one"
        expect(good, f"{where}: pending", "a formula", needed)
    needed = f"some of {', '.join(FACTS)}"
    facts = {fact for need in kind.needs for fact in need.split(" or ")}
    if kind.unknown_without:
        facts.add(kind.unknown_without[0])
    expect(facts <= {*FACTS}, f"{where}: its needs", sorted(facts), needed)
    scales = len(kind.state_scales)
    states = len(kind.states)
    what = f"{where}: the length of state_scales"
    expect(scales in (0, states), what, scales, f"{states}, one for each state")


def _check_coefficient(where: str, c: Coefficient) -> None:
    bounds = [c.lower, c.upper]
    good = all(map(math.isfinite, bounds)) and c.lower < c.upper
    expect(good, f"{where}: lower and upper", bounds, "finite numbers in this order")
    starts = [c.default, *c.grid]
    good = all(c.lower <= start <= c.upper for start in starts)
    needed = f"values in [{c.lower:g}, {c.upper:g}] {c.unit}"
    expect(good, f"{where}: default and grid", starts, needed)
    good = math.isfinite(c.scale) and c.scale > 0.0
    expect(good, f"{where}: scale", c.scale, "a positive number")


def _check_defaults(kind: EffectKind) -> None:
    """Checks that the effect does nothing, whatever its shapes, with default sizes."""
    is_actuator = kind.stage == "actuator"
    defaults = kind.defaults
    where = f"effect '{kind.kind}'"
    if kind.replay is not None:
        found = kind.replay(Replay(), *defaults)
        needed = f"{Replay()}, so that the defaults do nothing"
        expect(found == Replay(), f"{where}: replay at its defaults", found, needed)
        if is_actuator:  # Without any duration its formulas may be singular.
            return
    nothing = _TRIAL_FLOW.elevator_rate if is_actuator else 0.0
    trials = [defaults]
    if not all(c.is_shape for c in kind.coefficients):
        for i, c in enumerate(kind.coefficients):
            between = (0.5 * (c.default + bound) for bound in (c.lower, c.upper))
            for shape in (*c.grid, *between) if c.is_shape else ():
                trials.append((*defaults[:i], shape, *defaults[i + 1 :]))
    for values in trials:
        added = try_formulas(kind, values)
        if any(a != nothing for a in added):
            raise InputError(
                f"{where}: with the coefficients {show(values)} the formula returns "
                f"{', '.join(f'{a:g}' for a in added)}; expected {nothing:g}, so that "
                "the effect does nothing where its sizes are at their defaults."
            )


def _check_pending(kind: EffectKind) -> None:
    """Checks that what is pending grows by the rate that comes in and not out."""
    values = [
        min(max(c.default + c.scale, c.lower), c.upper) for c in kind.coefficients
    ]
    try_formulas(kind, tuple(values))
    assert kind.pending and kind.steady_state and kind.state_rate
    rate = _TRIAL_FLOW.elevator_rate
    states = 0.1 + np.array(kind.steady_state(rate, *values), ndmin=1)
    slopes = np.array(kind.state_rate(rate, *states, *values), ndmin=1)
    step = 1e-6
    before = kind.pending(*(states - step * slopes), *values)
    after = kind.pending(*(states + step * slopes), *values)
    growth = (after - before) / (2.0 * step)
    expected = rate - kind.formula(rate, *states, *values)
    good = math.isclose(growth, expected, rel_tol=1e-4, abs_tol=1e-6)
    needed = f"{expected:g}, the rate that comes in less the one that goes out"
    expect(good, f"effect '{kind.kind}': the rate of pending", float(growth), needed)


def _takes(formula: Callable, arguments: tuple[object, ...]) -> bool:
    """Whether a function can be called with so many arguments."""
    try:
        inspect.signature(formula).bind(*arguments)
    except TypeError:
        return False
    except ValueError:  # Of a built-in function, whose signature is not known.
        return True
    return True


def try_formulas(
    kind: EffectKind,
    values: tuple[float, ...],
    run: Callable[[Callable, tuple], object] = lambda formula, given: formula(*given),
    fault: str = "fails",
) -> tuple[float, ...]:
    """Returns what a kind's formula adds in some flow, with states off their rest.

    Args:
        kind: whose formulas are tried.
        values: its coefficients.
        run: calls a formula with its arguments.
        fault: what a formula that cannot be run does, for the message.

    Raises:
        InputError: a formula fails, or returns other than finite numbers.
    """
    is_actuator = kind.stage == "actuator"
    flow = _TRIAL_FLOW
    along = flow.elevator_rate if is_actuator else flow
    given = Motion(*flow[: len(Motion._fields)]) if kind.stage == "air" else along

    def tried(
        name: str, formula: Callable, count: int, *arguments: object
    ) -> tuple[float, ...]:
        where = f"effect '{kind.kind}': its {name}"
        if not _takes(formula, arguments):
            raise InputError(
                f"{where} does not take {len(arguments)} arguments; expected the flow, "
                "then the effect's states, then its coefficients."
            )
        try:
            with np.errstate(all="ignore"):
                result = run(formula, arguments)
            found = result if isinstance(result, tuple) else (result,)
            numbers = tuple(map(float, found))
        except Exception as error:  # Whatever a user's formula may raise.
            text = next(iter(str(error).strip().splitlines()), type(error).__name__)
            raise InputError(
                f"{where} {fault} ({text.rstrip('.')}); expected arithmetic and the "
                "functions sin, cos, sqrt, exp, tanh and arctan of numpy."
            ) from None
        shaped = isinstance(result, tuple) == (count > 1) and len(numbers) == count
        if not shaped or not all(map(math.isfinite, numbers)):
            raise InputError(
                f"{where} returns {show(result)}; expected {count} finite number"
                f"{'s, as a tuple' if count > 1 else ''}."
            )
        return numbers

    states: tuple[float, ...] = ()
    if kind.steady_state is not None and kind.state_rate is not None:
        count = len(kind.states)
        states = tried("steady_state", kind.steady_state, count, along, *values)
        alphadot = (flow.pitchdot,) if kind.rate_by_alphadot else ()
        arguments = (*alphadot, *states, *values)
        tried("state_rate", kind.state_rate, count, along, *arguments)
        # Off rest, for at rest an effect with a state may do nothing at any size.
        states = tuple(s + 0.1 for s in states)
    if kind.pending is not None:
        tried("pending", kind.pending, 1, *states, *values)
    count = 1 if is_actuator else len(kind.adds_to)
    return tried("formula", kind.formula, count, given, *states, *values)
