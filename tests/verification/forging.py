"""Forged funnels: files that look like the shipped one and must be refused.

Each takes the arrays and notes of a good file and changes them in place; beside it, the
words of the sentence that refuses it. A review found the first; the others follow.
"""

import dataclasses
import json

import numpy as np
from scipy.stats import chi2

from glider.files import schema
from glider.paths import models_path
from glider.physics.state import PITCH, POSITION
from glider.planning.problem import Hook, PerchingProblem
from glider.verification.funnel.funnel import load_funnel, save_funnel


def forge(source, path, change):
    """Writes a file, changed, as NumPy writes it: nothing of the package looks on."""
    with np.load(source) as data:
        arrays = {name: data[name].copy() for name in data.files}
    notes = json.loads(str(arrays.pop("notes")))
    change(arrays, notes)
    np.savez_compressed(path, notes=np.array(json.dumps(notes)), **arrays)


def shorten(name, count, folder):
    """Writes the first intervals of a shipped funnel, as a funnel of its own.

    Returns the command's arguments for it, with a problem that ends there.
    """
    source, problem = folder / f"{name}.npz", folder / f"{name}.yaml"
    whole = load_funnel(models_path("funnels", f"{name}.npz"))
    part = whole.between(0, whole.nominal.flows[count - 1] + 1)
    end = part.nominal.states[-1]
    goal = 3.0 * np.sqrt(np.diagonal(np.linalg.inv(part.S[-1])))
    settings = dataclasses.replace(part.settings, goal=tuple(goal.tolist()))
    save_funnel(source, dataclasses.replace(part, settings=settings))
    near = end[PITCH] + np.array([-0.1, 0.1])
    reach = 1.01 * goal[POSITION].max()
    place = PerchingProblem(
        wire=end[POSITION].tolist(),
        final_pitch_limits=near.tolist(),
        final_speed_limit=9.0,
        duration_limits=[0.01, 2.0],
        hook=Hook(reach=reach, speed_limit=20.0, pitch_limits=[-1.5, 1.5]),
    )
    problem.write_text(schema.yaml_text(place))
    model = models_path("identified", "head_wind.yaml")
    options = ["--hook", "--problem", str(problem), "--model", str(model)]
    return source, [*options, "--every", "1000"]


def _widened_goal(arrays, notes, factor=10.0):
    notes["settings"]["goal"] = [factor * axis for axis in notes["settings"]["goal"]]


def _shifted(arrays, notes):
    arrays["states"][:, :2] += 1.0


def _cut(arrays, notes):
    for name in arrays:
        arrays[name] = arrays[name][:100]
    _widened_goal(arrays, notes)


def _drifting(arrays, notes, step=0.99e-4):
    rise = np.arange(len(arrays["times"])) * step
    arrays["states"][:, 0] -= rise - rise[-1]
    arrays["states"][:, 1] += rise - rise[-1]


def _model(old, new):
    def change(arrays, notes):
        assert old in notes["model"]
        notes["model"] = notes["model"].replace(old, new)

    return change


def _times(name, factor):
    def change(arrays, notes):
        arrays[name] = arrays[name] * factor

    return change


def _heavier_weights(arrays, notes):
    arrays["weights"][:, 4:] *= 3.0


def _skew(arrays, notes):
    turn = np.random.default_rng(0).normal(size=(7, 7))
    arrays["slopes"] = arrays["slopes"] + 1e3 * (turn - turn.T)


def _complex(arrays, notes):
    arrays["beta"] = arrays["beta"].astype(complex)


def _wrapping(arrays, notes):
    """16 * 16 is 0 in eight bits."""
    arrays["beta"] = np.zeros(arrays["beta"].shape, dtype=np.uint8)
    arrays["beta"][:, 4:] = 16
    arrays["weights"][:, 4:] = 1e-300


def _deviations(change):
    """Of a funnel of a set of gliders: changes its covariance and level."""

    def forge_set(arrays, notes):
        note = notes["confidence"]
        note["matrix"] = np.array(note["matrix"])
        change(note)
        note["matrix"] = note["matrix"].tolist()

    return forge_set


def _shrunk(note):
    note["matrix"] *= 1e-12


def _a_little_smaller(note):
    note["matrix"] *= 0.999


def _without_z(note):
    note["names"], note["matrix"] = note["names"][:1], note["matrix"][:1, :1]


def _turned_correlation(note):
    note["matrix"] *= [[1.0, -1.0], [-1.0, 1.0]]


def _surer(note):
    """The same ellipsoid, called one of 100 %."""
    note["matrix"] *= chi2.ppf(0.95, 2) / chi2.ppf(1.0 - 1e-12, 2)
    note["level"] = 1.0 - 1e-12


def _of_more_flights(note):
    """The same numbers, of fewer degrees of freedom than is said."""
    note["matrix"] *= 0.5
    note["degrees_of_freedom"] = 1e9


def _with_exact_mass_instead(note):
    note["names"][1] = "mass"
    note["matrix"][1] = note["matrix"][:, 1] = 0.0


SETS = {
    "a set of nearly nothing": _shrunk,
    "a set 0.05 % too small": _a_little_smaller,
    "a wind that deviates in x alone": _without_z,
    "a correlation of the other sign": _turned_correlation,
    "a set of 100 %": _surer,
    "a set of more flights": _of_more_flights,
    "a mass that does not deviate": _with_exact_mass_instead,
}
"""Forged sets of gliders, smaller than the model's covariance has them."""

SETS = {name: _deviations(change) for name, change in SETS.items()}


def _names(arrays, notes):
    notes["state_names"] = ["a"] * 7


def _every_fourth(arrays, notes):
    for name in arrays:
        arrays[name] = arrays[name][::4]


def _no_grams(arrays, notes):
    arrays["grams"][:] = 0.0


def _scaled(arrays, notes):
    arrays["S"] *= 0.97
    arrays["slopes"] *= 0.97


REVIEWED = {
    "a set 3 % wider": (_scaled, "The servo would meet its limits"),
    "half of the remainder": (_times("beta", 0.5), "The remainder is 1."),
    "a remainder 14 % smaller": (_times("beta", 0.86), "The remainder is 1.0"),
    "a goal ten times as large": (_widened_goal, "distance from the wire = 0.5 m"),
    "a flight 1 m from the wire": (_shifted, "the problem's launch has"),
    "a flight cut in the middle": (_cut, "The flight's duration = 0.435"),
    "a nominal that drifts": (_drifting, "The nominal is not a flight"),
    "a heavier glider": (_model("mass: 0.08", "mass: 0.0801"), "another glider"),
    "gains of the other sign": (_times("gains", -1.0), "V was not proven to fall"),
    "a slower clock": (_times("times", 1.003), "The nominal is not a flight"),
    "a servo of any rate": (
        _model("elevator_rate_limit: 13.0", "elevator_rate_limit: 1300.0"),
        "'parameters.elevator_rate_limit' of its model is 1300",
    ),
    "heavier weights": (_heavier_weights, "V was not proven to fall"),
    "skew slopes": (_skew, "'slopes' is not symmetric"),
    "complex bounds": (_complex, "'beta' is of type complex128"),
    "bounds that wrap": (_wrapping, "'beta' is of type uint8"),
    "states of other names": (_names, "its states are a, a"),
    "every fourth time": (_every_fourth, "The nominal is not a flight"),
    "a mass that is no number": (
        _model("mass: 0.08", "mass: .nan"),
        "its glider: field 'mass' is nan",
    ),
    "no Gram matrices": (_no_grams, "V was not proven to fall"),
}
"""Forged files of a review: the change and words of the sentence that refuses it."""


def _zero(name, where):
    def change(arrays, notes):
        arrays[name][where] = 0.0

    return change


def _least_bounds(arrays, notes):
    arrays["beta"][:] = 5e-324


def _huge_bend(arrays, notes):
    arrays["bends"][3] = 1e308


def _level(value):
    def change(arrays, notes):
        notes["confidence"]["level"] = value

    return change


_UNBOUNDED = "The error of the held command is not bounded at 0."

HELD = {
    "no weight of a push at one time": (_zero("push_weights", 7), _UNBOUNDED),
    "no weights of pushes": (_zero("push_weights", slice(None)), _UNBOUNDED),
    "no weights": (_zero("weights", slice(None)), _UNBOUNDED),
    "bounds of 5e-324": (_least_bounds, _UNBOUNDED),
    "a bend of 1e308": (_huge_bend, _UNBOUNDED),
    "a set of 50 %": (_level(0.5), "the 50 % ellipsoid of wind.x ± 0.0004"),
    "a set of nothing": (_level(5e-324), "ellipsoid of nothing, is smaller than the"),
}
"""Forged files of held commands and of a set of gliders."""


def _late_launch(arrays, notes):
    for name in arrays:
        arrays[name] = arrays[name][60:]
    arrays["times"] = arrays["times"] - arrays["times"][0]


def _beside_the_wire(arrays, notes):
    """Launch and wire 4 mm lower, which the dynamics do not see."""
    arrays["states"][:, 1] -= 0.004


def _beside_the_wire_at_the_end(arrays, notes):
    """From the launch to 1 cm beside the wire, by a drift that a step hardly shows."""
    share = np.linspace(0.0, 1.0, len(arrays["times"]))
    arrays["states"][:, 0] -= 0.01 * share**2


def _trembling(arrays, notes):
    """A drift of 1e-5 m a step, to and fro."""
    arrays["states"][1:-1:2, 1] += 1e-5


def _moved_time(arrays, notes):
    arrays["times"] = arrays["times"] + 1.0


def _no_number_between(arrays, notes):
    arrays["beta"][7, 4] = np.nan


def _one_sided(arrays, notes):
    """Cholesky reads one triangle of S, the growth of V both."""
    arrays["S"][:, 0, 1] *= 0.5


def _no_remainder_in_pitch(arrays, notes):
    arrays["beta"][:, 6] = arrays["weights"][:, 6] = 0.0


def _turned_goal(arrays, notes):
    notes["settings"]["goal"][2] = 30.0


def _worded_goal(arrays, notes):
    notes["settings"]["goal"] = [str(axis) for axis in notes["settings"]["goal"]]


def _swapped_names(arrays, notes):
    notes["state_names"][:2] = ["z", "x"]


def _huge(arrays, notes):
    arrays["beta"][:, 4:] = 1e200


def _flat(arrays, notes):
    """Definite in exact arithmetic, singular in floating point."""
    arrays["S"][:] = arrays["slopes"][:] = np.ones((7, 7))
    arrays["S"][:, range(7), range(7)] += 2.0**-52


def _wild_slope(arrays, notes):
    """At one time: before it the sets are ellipsoids, after it they are not."""
    arrays["slopes"][1] = -1e7 * np.eye(7)


def _sawtooth(arrays, notes):
    """V falls faster at each time, and rises between them."""
    arrays["slopes"] -= 8.0 * arrays["S"]


def _negative(arrays, notes):
    arrays["beta"] *= -1.0


def _half_precision(arrays, notes):
    arrays["S"] = arrays["S"].astype(np.float16)


def _huge_margin(arrays, notes):
    notes["settings"]["margin"] = 10**400


def _huge_goal(arrays, notes):
    notes["settings"]["goal"][0] = 10**400


def _endless_computation(arrays, notes):
    notes["seconds"] = 10**400


def _gliders_without_names(arrays, notes):
    notes["confidence"] = {
        "names": [],
        "matrix": [],
        "level": 0.95,
        "shape": "ellipsoid",
    }


def _escape_sequence(arrays, notes):
    notes["state_names"][0] = "\x1b[2J"


def _focus(of, beta=1.0):
    """A bound of the remainder beta (1 + eᵀ F e) times the file's, F = of(S)."""

    def change(arrays, notes):
        arrays["beta"] *= beta
        arrays["weights"] *= beta
        arrays["focus"] = of(arrays["S"])
        arrays["focus"][-1] = 0.0  # Where the margin is least.

    return change


def _nearly_all(S):
    """1 + eᵀ F e is nearly zero on the boundary, and so is what it adds to V̇."""
    return -0.999 * S


def _more_than_all(S):
    return -1.5 * S


def _of_the_place(S):
    focus = np.zeros_like(S)
    focus[:, range(2), range(2)] = 400.0
    return focus


def _earlier_format(arrays, notes):
    notes["format"] = "drake-glider funnel 3"


def _without_focus(arrays, notes):
    del arrays["focus"]


INVENTED = {
    "a bound of nearly nothing": (_focus(_nearly_all), "The remainder is "),
    "a bound below zero": (_focus(_more_than_all), "The remainder is "),
    "a bound that varies with the place": (
        _focus(_of_the_place, 0.6),
        "The remainder is ",
    ),
    "a skew focus": (_focus(lambda S: S + np.triu(S, 1)), "'focus' is not symmetric"),
    "no focus": (_without_focus, "focus is not a file"),
    "an earlier format": (_earlier_format, "its format is 'drake-glider funnel"),
    "a launch in mid-flight": (_late_launch, "the problem's launch has"),
    "4 mm beside the launch": (_beside_the_wire, "The flight starts with z = 0.096"),
    "1 cm beside the wire": (_beside_the_wire_at_the_end, "from the wire"),
    "a nominal that trembles": (_trembling, "The nominal is not a flight"),
    "times that start at 1 s": (_moved_time, "'times' must increase from 0"),
    "no number at one time": (_no_number_between, "'beta' is infinite or NaN"),
    "a set of two triangles": (_one_sided, "'S' is not symmetric"),
    "no remainder in pitch": (_no_remainder_in_pitch, "The remainder is inf times"),
    "a goal of any pitch": (_turned_goal, "At the goal's edge, pitch = "),
    "a goal in words": (_worded_goal, "field 'settings.goal[0]' is '0.05"),
    "swapped names": (_swapped_names, "its states are z, x"),
    "a remainder of 1e200": (_huge, "its numbers are too large"),
    "a set that is flat": (_flat, "The servo would meet its limits"),
    "wild slopes between": (_wild_slope, "V was not proven to fall"),
    "slopes as of a saw": (_sawtooth, "V was not proven to fall"),
    "a servo of wider travel": (
        _model("[-0.4463, 0.9473]", "[-1.5, 1.5]"),
        "'parameters.elevator_limits' of its model is [-1.5, 1.5]",
    ),
    "a wind that was not asked for": (
        _model(
            "effects: []",
            "effects:\n- kind: wind\n  coefficients:\n    x: 0.0\n    z: 0.0",
        ),
        "another glider",
    ),
    "negative bounds": (_negative, "'beta' is negative somewhere"),
    "a margin of 401 digits": (_huge_margin, "field 'settings.margin' is 1000"),
    "a goal of 401 digits": (_huge_goal, "field 'settings.goal[0]' is 1000"),
    "seconds of 401 digits": (_endless_computation, "field 'seconds' is 1000"),
    "gliders without names": (_gliders_without_names, "field 'names' is []"),
    "an escape sequence": (_escape_sequence, "its states are \\x1b[2J, z"),
    "sets of half precision": (_half_precision, "'S' is of type float16"),
}
"""More of them."""
