"""Effects of every family in functional forms that the library does not have.

A family is a link of the force chain and the variables of the function in it. A form
draws one function and returns it as hooks of `hooked_flight`, or as what the servo
does. None is the library's formula, whatever its coefficients.
"""

import dataclasses
import functools
from collections.abc import Callable

import numpy as np

from benchmarks.hooked_flight import Hook, hook
from glider.physics.aerodynamics import elevator_velocity, plate_force, turned
from tests.helpers.lifelike_flight import Servo


@dataclasses.dataclass(frozen=True, kw_only=True)
class Family:
    """Where a function enters, what it depends on, and the names that are right."""

    link: str  #: As "family" in report.json.
    variables: tuple[str, ...]  #: Any one of them identifies the family.
    names: frozenset[str]  #: Any one of them names it.
    allowed: frozenset[str] = frozenset()  #: Not wrong beside them, and not asked for.


def _family(link: str, variables: str, names: str, allowed: str = "") -> Family:
    return Family(
        link=link,
        variables=tuple(variables.split()),
        names=frozenset(names.split()),
        allowed=frozenset(allowed.split()),
    )


_DRAGS = "profile_drag axial_drag induced_drag"
FAMILIES = {
    "lift": _family("wing_force", "alpha", "attached_lift"),
    "stall": _family("wing_force", "alpha", "attached_lift"),
    "lagged_stall": _family(
        "wing_force",
        "alphadot alpha reduced_rate",
        "dynamic_stall lagged_separation",
        "attached_lift",
    ),
    "drag": _family("wing_force", "alpha V", _DRAGS),
    "airspeed": _family("wing_force", "V", "airspeed_dependence"),
    "camber": _family("wing_force", "alpha", "camber"),
    "moment": _family("moment", "alpha V", "pitch_moment center_of_pressure"),
    "downwash": _family("tail_angle", "alpha", "downwash stalled_downwash"),
    "lagged_downwash": _family(
        "tail_angle",
        "alphadot alpha reduced_rate",
        "downwash stalled_downwash lagged_downwash",
        "pitch_damping",  # The lag of a downwash is the textbook's C_m_alphadot.
    ),
    "tail_wake": _family("tail_pressure", "alpha elevator", "tail_wake"),
    "compliance": _family("tail_angle", "elevator V alpha load", "elevator_blowback"),
    "servo": _family("actuator", "elevator_rate", "servo_lag command_delay"),
    "ground": _family("wing_force", "z", "ground_effect"),
    "added_mass": _family(
        "inertia",
        "alphadot alpha pitchdot reduced_rate",
        "added_mass",
        "inertia center_of_pressure",  # Its rotational inertia, and Munk's moment.
    ),
    "damping": _family("moment", "pitchdot", "pitch_damping"),
    "rate_lift": _family("wing_force", "pitchdot reduced_rate", "pitch_rate_lift"),
    "wind": _family("air", "t x z", "wind wind_shear"),
    "sensor_position": _family(
        "sensor", "x z", "position_scale frame_tilt marker_offset"
    ),
    "sensor_pitch": _family("sensor", "pitch", "pitch_offset"),
}
"""The drag of a wing is one family whichever of its names is given."""

RIVALS = (
    {"lift", "stall", "lagged_stall"},
    {"downwash", "lagged_downwash", "compliance"},
    {"damping", "rate_lift", "added_mass"},
    {"drag", "airspeed"},
    {"ground", "wind"},
)
"""At most one of each is drawn into a campaign: two would be one function."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class OtherForm:
    """One function drawn of a form."""

    words: str = ""
    hooks: tuple[Hook, ...] = ()
    servo: Servo = dataclasses.field(default_factory=Servo)
    play: float = 0.0  #: Half of the linkage's [rad].


FORMS: dict[str, dict[str, Callable[[np.random.Generator], OtherForm]]]
FORMS = {family: {} for family in FAMILIES}
"""Family and name of a form to what draws one."""

_EITHER = "either sign"


def _form(
    family: str,
    terms: str = "",
    *,
    name: str = "",
    rate: Callable | None = None,
    rest: Callable | None = None,
    moment: Callable | None = None,
    **ranges: tuple,
) -> Callable[[Callable], Callable]:
    """Registers a formula of a flow, its own states and numbers drawn from ranges.

    Args:
        family: of FAMILIES.
        terms: of the chain that it adds to; without any it returns an OtherForm.
        name: of the form; the formula's by default.
        rate: rates of its states, of the same arguments.
        rest: its states at rest, of the same arguments but them.
        moment: a formula that adds to the moment too.
        ranges: name of a number to its least and largest value, and _EITHER.
    """

    def register(formula: Callable) -> Callable:
        label = name or formula.__name__.strip("_")

        def draw(rng: np.random.Generator) -> OtherForm:
            numbers = {}
            for key, (low, high, *either) in ranges.items():
                sign = float(rng.choice([-1.0, 1.0])) if either else 1.0
                numbers[key] = sign * float(rng.uniform(low, high))
            words = ", ".join(f"{key} {value:.3g}" for key, value in numbers.items())
            if not terms:
                return dataclasses.replace(formula(**numbers), words=words)
            own = functools.partial
            hooks = [
                hook(
                    label,
                    tuple(terms.split()),
                    own(formula, **numbers),
                    rate and own(rate, **numbers),
                    rest and own(rest, **numbers),
                )
            ]
            if moment is not None:
                hooks.append(hook(label + "_m", ("moment",), own(moment, **numbers)))
            return OtherForm(words=words, hooks=tuple(hooks))

        FORMS[family][label] = draw
        return formula

    return register


def _alpha(flow):
    return np.arctan2(flow.sin_alpha, flow.cos_alpha)


def _step(value, begin, end):
    """A smoothstep from 0 at begin to 1 at end."""
    part = np.clip((value - begin) / (end - begin), 0.0, 1.0)
    return part**2 * (3.0 - 2.0 * part)


def _area(flow):
    return 0.5 * flow.air_density * flow.speed * flow.wing_area


def _drag(flow, cd):
    return -cd * _area(flow) * flow.air_x, -cd * _area(flow) * flow.air_z


@_form("lift", "wing_normal", slope=(2.0, 3.5), end=(0.4, 0.7))
def _parabola(f, slope, end):
    return slope * f.sin_alpha * np.maximum(1.0 - (_alpha(f) / end) ** 2, 0.0)


@_form("lift", "wing_normal", slope=(1.5, 3.0), most=(0.15, 0.3))
def _saturated(f, slope, most):
    return slope * most * np.arctan(f.sin_alpha / most) * f.cos_alpha**2


@_form(
    "stall",
    "wing_normal",
    slope=(2.0, 3.5),
    stall=(0.2, 0.3),
    dip=(0.15, 0.3),
    width=(0.1, 0.18),
)
def _undershoot(f, slope, stall, dip, width):
    """Beyond stall the lift falls below the plate's for a while."""
    a = _alpha(f)
    kept = slope * f.sin_alpha * (1.0 - _step(np.abs(a), stall, stall + 0.12))
    beyond = (np.abs(a) - stall - 0.15) / width
    return kept - dip * np.tanh(8.0 * a) * np.exp(-(beyond**2))


@_form(
    "stall",
    "wing_normal",
    slope=(2.0, 3.5),
    first=(0.15, 0.22),
    second=(0.4, 0.55),
    share=(0.35, 0.65),
)
def _two_steps(f, slope, first, second, share):
    """A part of the wing stalls first."""
    a = np.abs(_alpha(f))
    lost = share * _step(a, first, first + 0.08)
    lost = lost + (1.0 - share) * _step(a, second, second + 0.1)
    return slope * f.sin_alpha * (1.0 - lost)


def _attached(a, stall, width):
    return 0.5 - 0.5 * np.tanh((np.abs(a) - stall) / width)


def _separation_rate(f, point, slow, slope, stall, width, late, lead):
    alphadot = (_alpha(f) - slow) / 0.008  # By a washout.
    return (
        (_attached(_alpha(f) - lead * alphadot, stall, width) - point) / late,
        alphadot,
    )


def _separation_rest(f, slope, stall, width, late, lead):
    return _attached(_alpha(f), stall, width), _alpha(f)


def _separation(f, point, slow, slope, stall, width, late, lead):
    """Goman and Khrabrov (J. Aircraft 31, 1994), beyond the plate's lift."""
    share = (1.0 + np.sqrt(np.clip(point, 0.0, 1.0))) ** 2
    return slope * f.sin_alpha * (share - 1.0) / 3.0


for _name, _lead in (("goman_khrabrov", (0.02, 0.05)), ("relaxation", (0.0, 0.0))):
    _form(
        "lagged_stall",
        "wing_normal",
        name=_name,
        rate=_separation_rate,
        rest=_separation_rest,
        slope=(2.0, 3.5),
        stall=(0.2, 0.35),
        width=(0.06, 0.12),
        late=(0.04, 0.12),
        lead=_lead,
    )(_separation)


def _two_lags_rate(f, first, second, size, late):
    return (np.tanh(2.0 * f.sin_alpha) - first) / late, (first - second) / late


def _two_lags_rest(f, size, late):
    return np.tanh(2.0 * f.sin_alpha), np.tanh(2.0 * f.sin_alpha)


@_form(
    "lagged_stall",
    "wing_normal",
    rate=_two_lags_rate,
    rest=_two_lags_rest,
    size=(0.6, 1.4),
    late=(0.03, 0.06),
)
def _two_lags(f, first, second, size, late):
    return size * (np.tanh(2.0 * f.sin_alpha) - second)


@_form(
    "drag",
    "force_x force_z",
    least=(0.03, 0.06),
    more=(0.08, 0.2),
    middle=(0.0, 0.15),
    width=(0.2, 0.4),
)
def _bucket(f, least, more, middle, width):
    off = (_alpha(f) - middle) / width
    return _drag(f, least + more * (1.0 - np.exp(-(off**2))))


@_form("drag", "force_x force_z", cd0=(0.06, 0.12))
def _laminar(f, cd0):
    return _drag(f, cd0 * np.sqrt(7.0 / np.maximum(f.speed, 0.5)))


@_form("airspeed", "wing_factor", loss=(0.1, 0.25), middle=(4.5, 6.0))
def _reynolds_step(f, loss, middle):
    return -loss * (0.5 - 0.5 * np.tanh((f.speed - middle) / 0.6))


@_form("camber", "wing_normal", size=(0.08, 0.2, _EITHER), end=(0.3, 0.5))
def _fading_camber(f, size, end):
    return size * (1.0 - _step(np.abs(_alpha(f)), end - 0.15, end + 0.15))


@_form("camber", "wing_normal", size=(0.06, 0.15, _EITHER))
def _rising_camber(f, size):
    return size * (1.0 + 0.5 * f.sin_alpha)


@_form("moment", "moment", size=(0.002, 0.005, _EITHER), end=(0.25, 0.45))
def _attached_moment(f, size, end):
    return size * np.exp(-((_alpha(f) / end) ** 2)) * _area(f) * f.speed


@_form(
    "moment", "wing_shift", ahead=(0.003, 0.007), back=(0.006, 0.014), stall=(0.2, 0.4)
)
def _travel_at_stall(f, ahead, back, stall):
    return ahead - back * _step(np.abs(_alpha(f)), stall, stall + 0.2)


@_form("downwash", "downwash", gradient=(0.35, 0.6), end=(0.3, 0.5))
def _decaying(f, gradient, end):
    return gradient * f.speed * f.sin_alpha * np.exp(-((_alpha(f) / end) ** 2))


@_form("downwash", "downwash", angle=(0.06, 0.14), width=(0.15, 0.3))
def _saturating(f, angle, width):
    return f.speed * np.sin(angle * np.tanh(_alpha(f) / width))


def _convected_rate(f, lagged, gradient, behind):
    return (f.sin_alpha * f.cos_alpha - lagged) * f.speed / behind


def _convected_rest(f, gradient, behind):
    return f.sin_alpha * f.cos_alpha


@_form(
    "lagged_downwash",
    "downwash",
    rate=_convected_rate,
    rest=_convected_rest,
    gradient=(0.3, 0.5),
    behind=(0.25, 0.6),
)
def _convected(f, lagged, gradient, behind):
    return gradient * f.speed * lagged


@_form("tail_wake", "elevator_factor", loss=(0.3, 0.6), begin=(0.2, 0.45))
def _immersed(f, loss, begin):
    return -loss * _step(np.abs(_alpha(f)), begin, begin + 0.25)


@_form(
    "tail_wake",
    "elevator_factor",
    loss=(0.3, 0.6),
    angle=(0.3, 0.6),
    half=(0.25, 0.45),
    share=(0.2, 0.4),
)
def _by_deflection(f, loss, angle, half, share):
    """A triangle over the angle of attack that moves with the elevator."""
    off = (_alpha(f) - angle - share * f.elevator) / half
    return -loss * np.maximum(1.0 - np.abs(off), 0.0)


def _bent(f, law):
    """The elevator's deflection by a law of its load [Pa] where that takes it."""
    turn = 0.0
    for _ in range(6):
        plate = turned(f, f.elevator + turn)
        velocity = elevator_velocity(f, plate, 0.0)
        turn = law(plate_force(velocity, plate, 1.0, f.air_density))
    return turn


@_form("compliance", "elevator_trim", soft=(0.003, 0.006), load=(8.0, 16.0))
def _stiffening(f, soft, load):
    return _bent(f, lambda p: soft * load * np.tanh(p / load))


@_form("compliance", "elevator_trim", play=(0.02, 0.04), soft=(0.0005, 0.0015))
def _play_and_spring(f, play, soft):
    return _bent(f, lambda p: play * np.tanh(p / 2.0) + soft * p)


@_form("servo", quick=(30.0, 60.0), damping=(0.5, 0.9))
def _second_order(quick, damping):
    return OtherForm(servo=Servo(natural_frequency=quick, damping_ratio=damping))


@_form("servo", slew=(4.0, 7.0))
def _rate_limit(slew):
    return OtherForm(servo=Servo(slew=slew))


@_form("servo", play=(0.02, 0.05))
def _backlash(play):
    return OtherForm(play=play)


@_form("ground", "wing_factor", gain=(0.3, 0.6), half=(0.25, 0.5), floor=(-1.3, -0.9))
def _image_vortex(f, gain, half, floor):
    return gain / (1.0 + (np.maximum(f.z - floor, 0.0) / half) ** 2)


@_form("ground", "wing_factor", gain=(0.4, 0.8), span=(0.6, 1.2), floor=(-1.3, -0.9))
def _wieselsberger(f, gain, span, floor):
    height = np.maximum(f.z - floor, 1e-3) / span
    return gain * np.exp(-2.48 * height**0.768)


@_form(
    "added_mass", "added_mass added_inertia", mass=(0.012, 0.025), turning=(1e-4, 3e-4)
)
def _until_stall(f, mass, turning):
    share = 1.0 - 0.6 * _step(np.abs(_alpha(f)), 0.2, 0.6)
    return mass * share, turning * share


def _munk(f, mass, turning, share):
    return -share * mass * f.speed**2 * f.sin_alpha * f.cos_alpha


@_form(
    "added_mass",
    "added_mass added_inertia",
    moment=_munk,
    mass=(0.012, 0.025),
    turning=(1e-4, 3e-4),
    share=(0.03, 0.06),
)
def _with_munk_moment(f, mass, turning, share):
    return mass * f.cos_alpha**2, turning


@_form("damping", "moment", size=(0.005, 0.012))
def _quadratic(f, size):
    rate = f.pitchdot * np.abs(f.pitchdot)
    return -size * 0.5 * f.air_density * f.wing_area * rate


@_form("damping", "moment", size=(0.01, 0.025), end=(0.3, 0.5))
def _attached_damping(f, size, end):
    return -size * np.exp(-((_alpha(f) / end) ** 2)) * _area(f) * f.pitchdot


@_form("rate_lift", "wing_normal", arm=(0.12, 0.3), end=(0.5, 0.9))
def _saturating_rate(f, arm, end):
    quick = 0.15 * np.tanh(arm * f.pitchdot / np.maximum(f.speed, 0.3) / 0.15)
    return -quick * (1.0 - _step(np.abs(_alpha(f)), 0.2, end))


@_form("wind", "wind_x", size=(0.4, 0.9, _EITHER), late=(0.2, 0.5))
def _dying(m, size, late):
    return size * np.exp(-m.t / late)


@_form("wind", "wind_z", size=(0.4, 0.9, _EITHER), place=(-2.5, 0.0), width=(0.3, 0.7))
def _jet(m, size, place, width):
    return size / (1.0 + ((m.x - place) / width) ** 2)


@_form("wind", "wind_x", size=(0.08, 0.16, _EITHER), rough=(0.02, 0.1))
def _log_law(m, size, rough):
    return size * np.log(1.0 + np.maximum(m.z + 1.5, 0.0) / rough)


@_form("sensor_position", "pose_x pose_z", size=(0.004, 0.01, _EITHER))
def _lens(f, size):
    more = size * ((f.x + 1.0) ** 2 + f.z**2)
    return more * (f.x + 1.0), more * f.z


@_form("sensor_position", "pose_z", size=(0.006, 0.015, _EITHER))
def _bent_floor(f, size):
    return size * (f.x + 3.5) ** 2


@_form("sensor_pitch", "pose_pitch", size=(0.02, 0.05, _EITHER))
def _uneven_pitch(f, size):
    return size * np.sin(2.0 * f.pitch)
