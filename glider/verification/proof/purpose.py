"""A funnel is the intended one: its glider, and the problem that it solves.

A certificate is about whatever its file says; that this is the caller's glider, launch
and wire is compared here. The last set lies in the goal (`check`): no flight ends
farther off than the goal reaches.
"""

import dataclasses
import math

import numpy as np
from numpy.typing import ArrayLike

from glider.errors import show
from glider.files.schema import parse_yaml
from glider.physics.confidence import (
    LEVEL,
    ConfidenceSet,
    describe_set,
    make_confidence,
)
from glider.physics.covariance import Covariance
from glider.physics.model import GliderModel, model_text
from glider.physics.state import PITCH, POSITION, VELOCITY
from glider.planning.constraints import Bound, constraints_of
from glider.planning.problem import PerchingProblem
from glider.verification.funnel.funnel import Funnel

_PLAN_ROOM = 1e-4
"""Amount by which a nominal may exceed the limits of its plan [m, rad, m/s]: planners
keep them up to a tolerance. The shipped funnels exceed them by up to 2e-6."""

_PLACE_ROOM = 1e-6
"""Amount by which launch and wire may be off [m, rad, m/s, rad/s]; it is 6e-8 in the
shipped funnels."""

_EDGE = "At the goal's edge,"
"""Subject of a sentence on what the last set may hold."""


def unmet(*checks: tuple[object, str]) -> list[str]:
    """Returns the sentences of pairs of a condition and one where that is false."""
    return [fault for holds, fault in checks if not holds]


@dataclasses.dataclass(frozen=True, kw_only=True)
class Purpose:
    """What a funnel is wanted for; nothing where a field is left out."""

    problem: PerchingProblem | None = None  #: To be solved, from launch to wire.
    hook: bool = False  #: Whether the hook must accept every state of the last set.
    model: GliderModel | None = None  #: The glider.
    #: Its covariance, whose set of gliders must be contained in the funnel's, if that
    #: has one.
    covariance: Covariance | None = None
    command_error: float = 0.0  #: That it must account for [rad/s].
    wind: float = 0.0  #: That it must account for [m/s].
    period: float | None = None  #: Time that its commands must be held [s].

    def set_level(self, own: ConfidenceSet) -> float:
        """Returns the level of the covariance's set that a funnel's must contain.

        It is the file's own, but at least LEVEL: a file may state any.
        """
        return max(own.level, LEVEL)

    def faults_of(self, funnel: Funnel) -> list[str]:
        """Returns what of this a funnel lacks, a sentence each."""
        faults = _model_faults(funnel, self.model) if self.model else []
        if self.covariance and funnel.is_of_set and not faults:
            faults = _set_faults(funnel, self)
        faults += _push_faults(funnel, self)
        if self.problem:
            faults += _problem_faults(funnel, self.problem)
        if self.problem and self.hook:
            faults += hook_faults(funnel, self.problem)
        return faults


@dataclasses.dataclass(frozen=True, kw_only=True)
class _Arrival:
    """Bounds of the funnel's goal, and so of its last set."""

    time: float  #: Of the end [s].
    miss: float  #: Largest distance from the wire [m].
    speed: float  #: Largest speed [m/s].
    pitch: tuple[float, float]  #: Least and largest pitch [rad].


def arrival(funnel: Funnel, problem: PerchingProblem) -> _Arrival:
    """Returns what the goal about the nominal's end reaches, at most."""
    end = funnel.nominal.states[-1]
    axes = np.array(funnel.settings.goal)
    distance = np.linalg.norm(end[POSITION] - problem.wire)
    speed = np.linalg.norm(end[VELOCITY])
    pitch = float(end[PITCH])
    tilt = float(axes[PITCH])
    return _Arrival(
        time=float(funnel.nominal.times[-1]),
        miss=float(distance + axes[POSITION].max()),
        speed=float(speed + axes[VELOCITY].max()),
        pitch=(pitch - tilt, pitch + tilt),
    )


@np.errstate(all="ignore")
def set_sizes(funnel: Funnel, time: float) -> dict[str, dict[str, float]]:
    """Returns how far each state may deviate at a time, alone and with others [SI].

    It is infinite or NaN where the set is no ellipsoid.
    """
    S = funnel.shape(time)
    try:
        extents = np.sqrt(np.diag(np.linalg.inv(S)))
    except np.linalg.LinAlgError:
        extents = np.full(funnel.num_states, np.inf)
    widths = funnel.half_widths(time)
    names = funnel.nominal.model.state_names
    return {
        "half_widths": dict(zip(names, widths.tolist(), strict=True)),
        "extents": dict(zip(names, extents.tolist(), strict=True)),
    }


def _model_faults(funnel: Funnel, model: GliderModel) -> list[str]:
    """Returns the first difference of a funnel's glider from a model, if any."""
    own, other = (  # Where each was flown changes nothing.
        dict(_entries(parse_yaml(model_text(one), "model")))
        for one in (
            dataclasses.replace(funnel.nominal.model, flown={}),
            dataclasses.replace(model, flown={}),
        )
    )
    for place in {**own, **other}:
        found = own.get(place)
        expected = other.get(place)
        if found != expected:
            # Digits that a message omits may be all that differs.
            say = repr if show(found) == show(expected) else show
            words = f"The funnel is of another glider: '{place}' of its model is"
            return [f"{words} {say(found)}; expected {say(expected)}."]
    return []


def _entries(data, place=""):
    """Yields places and values of what a file has; a list is one value."""
    for key, value in data.items():
        if isinstance(value, dict) and value:
            yield from _entries(value, f"{place}{key}.")
        else:
            yield f"{place}{key}", value


def _set_faults(funnel, purpose):
    """Returns why a funnel's set does not contain that of a model's covariance."""
    own = funnel.allowed
    level = purpose.set_level(own)
    model = funnel.nominal.model
    given = make_confidence(model, purpose.covariance, level)
    words = f"The funnel's set of gliders, the {describe_set(own)}, is smaller than"
    fault = f"{words} the model's, the {describe_set(given)}."
    return unmet((own.covers(given), fault))


def _push_faults(funnel, purpose):
    """Returns what a funnel leaves out of a command error, a wind and a period."""
    own = funnel.settings
    held = "a feedback that acts at all times"
    if own.period:
        held = f"commands that are held for {1e3 * own.period:g} ms"
    wanted = own.period if purpose.period is None else purpose.period
    return unmet(
        (
            wanted == own.period,
            f"The funnel is for {held}; expected a hold of {1e3 * wanted:g} ms.",
        ),
        (
            own.command_error >= purpose.command_error,
            f"The funnel accounts for a command error of {own.command_error:g} rad/s; "
            f"expected at least {purpose.command_error:g}.",
        ),
        (
            own.wind >= purpose.wind,
            f"The funnel accounts for wind of {own.wind:g} m/s; expected at least "
            f"{purpose.wind:g}.",
        ),
    )


def _beyond(
    subject: str, bound: Bound, values: ArrayLike, whose: str, room: float
) -> list[str]:
    """Returns a sentence where values leave a bound by more than room, if they do."""
    each = np.atleast_1d(values)
    beyond = np.maximum(bound.low - each, each - bound.high)
    value = each[np.argmax(beyond)]
    allowed = f"{bound.low:.6g}"
    if not bound.is_equation:
        allowed += f" to {bound.high:.6g}"
    quantity = f"{subject} {bound.name} = {value:.6g} {bound.unit}".rstrip()
    fault = f"{quantity}; {whose} {allowed}."
    return unmet((np.max(beyond) <= room, fault))


def _problem_faults(funnel, problem):
    """Returns why a funnel does not solve a problem, launch to wire, in sentences.

    The elevator's travel is the servo's, and proven.
    """
    constraints = constraints_of(problem)
    model = funnel.nominal.model
    states = funnel.nominal.states
    launch = model.initial_state(problem.launch)
    faults = []
    for name, value, expected in zip(model.state_names, states[0], launch, strict=True):
        bound = Bound(name=name, low=expected, high=expected, unit="")
        whose = "the problem's launch has"
        faults += _beyond("The flight starts with", bound, value, whose, _PLACE_ROOM)
    reached = arrival(funnel, problem)
    reach = _distance(constraints.hook.reach)
    faults += _beyond(_EDGE, reach, reached.miss, "the hook takes", _PLACE_ROOM)
    duration = constraints.duration
    allows = "the problem allows"
    faults += _beyond("The flight's", duration, reached.time, allows, 0.0)
    for bound in constraints.path:
        passed = states[:, bound.state]
        faults += _beyond("The flight passes", bound, passed, allows, _PLAN_ROOM)
        if bound.state == PITCH:
            faults += _beyond(_EDGE, bound, reached.pitch, allows, 0.0)
    for bound in constraints.arrival:
        if not bound.is_equation:  # The place is the hook's.
            last = states[-1, bound.state]
            faults += _beyond("The flight ends with", bound, last, allows, _PLAN_ROOM)
    return faults


def hook_faults(funnel: Funnel, problem: PerchingProblem) -> list[str]:
    """Returns what of a funnel's goal the problem's hook does not accept, if anything.

    Where it accepts all, it holds every state of the last set at the wire.
    """
    reached = arrival(funnel, problem)
    hook = constraints_of(problem).hook
    low, high = hook.pitch_limits
    nearer = math.nextafter(hook.reach, 0.0)  # It must be less.
    faults = []
    for bound, values in (
        (_distance(nearer), reached.miss),
        (
            Bound(name="speed", low=0.0, high=hook.speed_limit, unit="m/s"),
            reached.speed,
        ),
        (Bound(name="pitch", low=low, high=high, unit="rad"), reached.pitch),
    ):
        faults += _beyond(_EDGE, bound, values, "the hook accepts", 0.0)
    return faults


def _distance(reach):
    """Returns the bound of the distance from the wire."""
    return Bound(name="distance from the wire", low=0.0, high=reach, unit="m")
