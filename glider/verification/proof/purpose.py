"""A funnel is the intended one: its glider, and the problem that it solves.

A certificate is about whatever its file says; that this is the caller's glider, launch
and wire is compared here. The last set lies in the goal (`exact_check`): no flight ends
farther off than the goal reaches.
"""

import dataclasses
from collections.abc import Mapping

import numpy as np

from glider.errors import expect, show
from glider.files.schema import parse_yaml
from glider.physics.confidence import (
    LEVEL,
    ConfidenceSet,
    describe_level,
    describe_set,
    make_confidence,
)
from glider.physics.covariance import Covariance
from glider.physics.model import GliderModel, model_text
from glider.physics.state import PITCH, POSITION, VELOCITY
from glider.planning.constraints import Bound, constraints_of
from glider.planning.problem import PerchingProblem
from glider.verification.funnel.funnel import Funnel

_PLAN_TOLERANCE = 1e-4
"""Amount by which a nominal may exceed the limits of its plan [m, rad, m/s]: planners
keep them up to a tolerance. The shipped funnels exceed them by up to 2e-6."""

_PLACE_TOLERANCE = 1e-6
"""Amount by which launch and wire may be off [m, rad, m/s, rad/s]; it is 6e-8 in the
shipped funnels."""


def unmet(*checks: tuple[object, str]) -> list[str]:
    """Returns the sentences of pairs of a condition and one where that is false."""
    return [fault for holds, fault in checks if not holds]


@dataclasses.dataclass(frozen=True, kw_only=True)
class Arrival:
    """Bounds of the funnel's goal, and so of its last set."""

    time: float  #: Of the end [s].
    miss: float  #: Largest distance from the wire [m].
    speed: float  #: Largest speed [m/s].
    pitch: tuple[float, float]  #: Least and largest pitch [rad].


def arrival(funnel: Funnel, problem: PerchingProblem) -> Arrival:
    """Returns what the goal about the nominal's end reaches, at most."""
    end = funnel.nominal.states[-1]
    axes = np.array(funnel.settings.goal)
    miss = np.linalg.norm(end[POSITION] - problem.wire) + axes[POSITION].max()
    return Arrival(
        time=float(funnel.nominal.times[-1]),
        miss=float(miss),
        speed=float(np.linalg.norm(end[VELOCITY]) + axes[VELOCITY].max()),
        pitch=(float(end[PITCH] - axes[PITCH]), float(end[PITCH] + axes[PITCH])),
    )


@np.errstate(all="ignore")
def set_sizes(funnel: Funnel, time: float) -> dict[str, dict[str, float]]:
    """Returns how far each state may deviate at a time, alone and with others [SI].

    It is infinite or NaN where the set is no ellipsoid.
    """
    try:
        extents = np.sqrt(np.diag(np.linalg.inv(funnel.shape(time))))
    except np.linalg.LinAlgError:
        extents = np.full(funnel.num_states, np.inf)
    found = {"half_widths": funnel.half_widths(time), "extents": extents}
    names = funnel.nominal.model.state_names
    return {k: dict(zip(names, v.tolist(), strict=True)) for k, v in found.items()}


def model_faults(funnel: Funnel, model: GliderModel) -> list[str]:
    """Returns the first difference of a funnel's glider from a model, if any."""
    texts = map(model_text, (funnel.nominal.model, model))
    own, other = (parse_yaml(text, "model") for text in texts)
    place = ""
    while own != other:
        if isinstance(own, list) and isinstance(other, list) and len(own) == len(other):
            own = dict(enumerate(own))
            other = dict(enumerate(other))
        if not (isinstance(own, dict) and isinstance(other, dict)):
            break
        key = next(k for k in {**own, **other} if own.get(k) != other.get(k))
        place += f".{key}" if place else key
        own = own.get(key)
        other = other.get(key)
    if own == other:
        return []
    # Digits that a message omits may be all that differs.
    found = show(own)
    expected = show(other)
    if found == expected:
        found = repr(own)
        expected = repr(other)
    words = f"The funnel is of another glider: '{place}' of its model is {found};"
    return [f"{words} expected {expected}."]


def compared_level(own: ConfidenceSet, least: float | None = None) -> float:
    """Returns the level of a model's set that a funnel's set has to contain.

    It is the file's own, or a least one where that is less: a file may state any.
    """
    return max(own.level, LEVEL if least is None else least)


def set_faults(
    funnel: Funnel, covariance: Covariance, least: float | None = None
) -> list[str]:
    """Returns why a funnel's set does not contain that of a model's covariance.

    The model's is of the same shape and of the `compared_level`.
    """
    if funnel.gliders is None:
        words = "The funnel is of one glider; expected a set that contains the model's"
        return [f"{words} {describe_level(least)} set."] if least else []
    own = funnel.gliders.confidence
    model = funnel.nominal.model
    level = compared_level(own, least)
    given = make_confidence(model, covariance, level, own.shape)
    words = f"The funnel's set of gliders, the {describe_set(own)}, is smaller than"
    fault = f"{words} the model's, the {describe_set(given)}."
    return unmet((own.covers(given), fault))


def wind_for_set(funnel: Funnel, covariance: Covariance) -> float | None:
    """Returns the wind that a funnel leaves to every glider of a model's set [m/s].

    Gliders that differ in a steady wind alone fly as the estimated one does in another.
    None where those of the default set differ in more, or the funnel is of a set;
    negative where it accounts for less wind than they differ by.
    """
    given = make_confidence(funnel.nominal.model, covariance)
    if funnel.gliders or not {*given.names} <= {"wind.x", "wind.z"}:
        return None
    return funnel.settings.wind - given.farthest(given.factor) * (1.0 + 1e-9)


def inlet_faults(funnel: Funnel, least: Mapping[str, float]) -> list[str]:
    """Returns where the inlet is narrower than least half-widths of states alone."""
    names = funnel.nominal.model.state_names
    faults = []
    widths = dict(zip(names, funnel.half_widths(), strict=True))
    known = f"one of {', '.join(names)}"
    for name, width in least.items():
        expect(name in names, "the least inlet: a state", name, known)
        words = f"The inlet's half-width in {name} is {widths[name]:.3g}; expected at"
        faults += unmet((widths[name] >= width, f"{words} least {width:.3g}."))
    return faults


def push_faults(
    funnel: Funnel, least: tuple[float, float], period: float | None = None
) -> list[str]:
    """Returns what of a command error [rad/s] and a wind [m/s] a funnel leaves out.

    It is to be for commands that are held for a period [s]; any if None.
    """
    own = funnel.settings.period
    held = f"commands that are held for {1e3 * own:g} ms"
    held = held if own else "a feedback that acts at all times"
    expected = f"expected a hold of {1e3 * (period or 0.0):g} ms."
    faults = unmet((period in (None, own), f"The funnel is for {held}; {expected}"))
    words = "a command error of {:g} rad/s", "wind of {:g} m/s"
    for word, bound, wanted in zip(words, funnel.settings.pushes, least, strict=True):
        found = f"The funnel accounts for {word.format(bound)}; expected at least"
        faults += unmet((bound >= wanted, f"{found} {wanted:g}."))
    return faults


def launch_faults(funnel: Funnel, problem: PerchingProblem) -> list[str]:
    """Returns where a funnel's first set is not about a problem's launch."""
    nominal = funnel.nominal
    launch = nominal.model.initial_state(problem.launch)
    return [
        f"The flight starts with {name} = {value:.6g}; the problem's launch has "
        f"{expected:.6g}."
        for name, value, expected in zip(
            nominal.model.state_names, nominal.states[0], launch, strict=True
        )
        if not abs(value - expected) <= _PLACE_TOLERANCE
    ]


def path_faults(funnel: Funnel, problem: PerchingProblem) -> list[str]:
    """Returns where a nominal flight leaves what a problem demands of its path.

    The elevator's travel is the servo's, and proven. Obstacles are refused: the
    funnel's sets are not compared with them.
    """
    constraints = constraints_of(problem)
    states = funnel.nominal.states
    faults = []
    for bound in constraints.path:
        faults += _beyond("The flight passes", bound, states[:, bound.state])
    words = (
        "The problem has obstacles; that a funnel keeps clear of them is not proven."
    )
    return faults + unmet((not problem.obstacles, words))


def _beyond(words: str, bound: Bound, values: np.ndarray) -> list[str]:
    """Returns a sentence where a flight's values leave their bound, if they do."""
    beyond = np.maximum(bound.low - values, values - bound.high)
    value = values[np.argmax(beyond)]
    allowed = f"the problem allows {bound.low:.4g} to {bound.high:.4g}."
    sentence = f"{words} {bound.name} = {value:.4g} {bound.unit}; {allowed}"
    return unmet((np.max(beyond) <= _PLAN_TOLERANCE, sentence))


def problem_faults(
    funnel: Funnel, problem: PerchingProblem, from_launch: bool = True
) -> list[str]:
    """Returns why a funnel does not solve a problem, launch to wire, in sentences.

    It may start elsewhere if it is not `from_launch`.
    """
    constraints = constraints_of(problem)
    reached = arrival(funnel, problem)
    reach = constraints.hook.reach
    duration = constraints.duration
    low, high = reached.pitch
    pitch = {bound.state: bound for bound in constraints.path}[PITCH]
    far = f"The goal reaches {reached.miss:.4g} m from the wire; the hook reaches"
    late = f"The flight ends at {reached.time:.4f} s; the problem's duration_limits are"
    steep = f"The goal has pitches from {low:.4g} to {high:.4g} rad; the problem allows"
    faults = launch_faults(funnel, problem) if from_launch else []
    faults += unmet(
        (reached.miss <= reach + _PLACE_TOLERANCE, f"{far} {reach:.4g} m."),
        (
            duration.low <= reached.time <= duration.high,
            f"{late} {duration.low:.4g} to {duration.high:.4g} s.",
        ),
    )
    faults += path_faults(funnel, problem)
    for bound in constraints.arrival:
        if not bound.is_equation:  # The place is the hook's.
            values = funnel.nominal.states[-1:, bound.state]
            faults += _beyond("The flight ends with", bound, values)
    return faults + unmet(
        (
            pitch.low <= low and high <= pitch.high,
            f"{steep} {pitch.low:.4g} to {pitch.high:.4g}.",
        )
    )


def hook_faults(funnel: Funnel, problem: PerchingProblem) -> list[str]:
    """Returns what of a funnel's goal the problem's hook does not accept, if anything.

    Where it accepts all, it holds every state of the last set at the wire.
    """
    reached = arrival(funnel, problem)
    hook = constraints_of(problem).hook
    (low, high), (least, most) = np.degrees([reached.pitch, hook.pitch_limits])
    far = f"The goal reaches {reached.miss:.8g} m from the wire; the hook accepts less"
    fast = f"The goal has speeds of up to {reached.speed:.4g} m/s; the hook accepts up"
    steep = f"The goal has pitches from {low:.1f}° to {high:.1f}°; the hook accepts"
    return unmet(
        (reached.miss < hook.reach, f"{far} than {hook.reach:.4g} m."),
        (reached.speed <= hook.speed_limit, f"{fast} to {hook.speed_limit:.4g} m/s."),
        (least <= low and high <= most, f"{steep} {least:.1f}° to {most:.1f}°."),
    )
