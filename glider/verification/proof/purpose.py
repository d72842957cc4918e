"""A funnel is the one that is meant: its glider, and the problem that it solves.

A certificate is about whatever its file says. That this is the caller's glider, and a
flight from the caller's launch to the caller's wire, is compared here. The last set
lies in the goal (`exact_check`): no flight ends farther off than the goal reaches.
"""

import dataclasses
import hashlib
from itertools import zip_longest

import numpy as np

from glider.physics.model import GliderModel, model_text
from glider.physics.state import STATE_NAMES, VELOCITY
from glider.planning.problem import PerchingProblem
from glider.verification.funnel.funnel import Funnel

PLAN_TOLERANCE = 1e-4
"""Amount by which a nominal may exceed the limits of its plan [m, rad, m/s]: planners
keep them up to a tolerance, and the nominal flies on from there. The shipped funnels
exceed them by up to 2e-6."""

PLACE_TOLERANCE = 1e-6
"""Amount by which launch and wire may be off [m, rad, m/s, rad/s]. In the shipped
funnels they are by 6e-8."""

_X, _Z, _PITCH = (STATE_NAMES.index(name) for name in ("x", "z", "pitch"))


@dataclasses.dataclass(frozen=True, kw_only=True)
class Arrival:
    """What a funnel's goal holds, and with it the last set."""

    time: float
    """Time of the end [s]."""

    miss: float
    """Largest distance from the wire [m]."""

    speed: float
    """Largest speed [m/s]."""

    pitch: tuple[float, float]
    """Least and largest pitch [rad]."""


def arrival(funnel: Funnel, problem: PerchingProblem) -> Arrival:
    """Returns what the goal about the nominal's end reaches, at most."""
    end, axes = funnel.nominal.states[-1], np.array(funnel.settings.goal)
    place, pitch = [_X, _Z], end[_PITCH]
    return Arrival(
        time=float(funnel.nominal.times[-1]),
        miss=float(np.linalg.norm(end[place] - problem.wire) + axes[place].max()),
        speed=float(np.linalg.norm(end[VELOCITY]) + axes[VELOCITY].max()),
        pitch=(float(pitch - axes[_PITCH]), float(pitch + axes[_PITCH])),
    )


def model_hash(model: GliderModel) -> str:
    """Returns the hash of a glider's file, in hexadecimal: the same for equal ones."""
    return hashlib.sha256(model_text(model).encode()).hexdigest()


def model_faults(funnel: Funnel, model: GliderModel) -> list[str]:
    """Returns the first thing in which a funnel's glider is not a model's, if any."""
    texts = (model_text(m).splitlines() for m in (funnel.nominal.model, model))
    for own, meant in zip_longest(*texts, fillvalue="nothing more"):
        if own != meant:
            return [
                "The funnel is of another glider: its model has "
                f"'{own.strip()}' where the one that is meant has '{meant.strip()}'."
            ]
    return []


def problem_faults(funnel: Funnel, problem: PerchingProblem) -> list[str]:
    """Returns why a funnel is none of a problem, launch to wire, a sentence each."""
    nominal, reached = funnel.nominal, arrival(funnel, problem)
    first, last = nominal.states[0], nominal.states[-1]
    faults = []
    for off, name, value, meant in _differences(
        first, nominal.model.initial_state(problem.launch), nominal.state_names
    ):
        if not off <= PLACE_TOLERANCE:
            faults.append(
                f"The flight starts with {name} = {value:.6g}; the problem's launch "
                f"has {meant:.6g}."
            )
    reach = problem.hook.reach
    if not reached.miss <= reach + PLACE_TOLERANCE:
        faults.append(
            f"The goal reaches {reached.miss:.4g} m from the wire; the hook reaches "
            f"{reach:.4g} m."
        )
    low, high = problem.duration_limits
    if not low <= reached.time <= high:
        faults.append(
            f"The flight ends at {reached.time:.4f} s; the problem's duration_limits "
            f"are {low:.4g} to {high:.4g} s."
        )
    speed = problem.final_speed_limit
    bounds = [
        ("ends with a pitch", last[_PITCH], problem.final_pitch_limits),
        *(("ends with a speed", v, [-speed, speed]) for v in last[VELOCITY]),
        ("passes an x", nominal.states[:, _X], problem.x_limits),
        ("passes a z", nominal.states[:, _Z], problem.z_limits),
        ("passes a pitch", nominal.states[:, _PITCH], problem.pitch_limits),
    ]
    for what, values, (least, most) in bounds:
        beyond = np.maximum(least - values, values - most)
        if not np.max(beyond) <= PLAN_TOLERANCE:
            value = np.ravel(values)[np.argmax(beyond)]
            faults.append(
                f"The flight {what} of {value:.4g}; the problem allows {least:.4g} to "
                f"{most:.4g}."
            )
    least, most = problem.pitch_limits
    if not (least <= reached.pitch[0] and reached.pitch[1] <= most):
        faults.append(
            f"The goal has pitches from {reached.pitch[0]:.4g} to "
            f"{reached.pitch[1]:.4g} rad; the problem allows {least:.4g} to {most:.4g}."
        )
    return faults


def hook_faults(funnel: Funnel, problem: PerchingProblem) -> list[str]:
    """Returns what of a funnel's goal the problem's hook does not take, if anything.

    Where it takes all, every state of the last set is one that it holds at the wire.
    """
    reached, hook = arrival(funnel, problem), problem.hook
    least, most = np.degrees(hook.pitch_limits)
    low, high = np.degrees(reached.pitch)
    faults = []
    if not reached.miss < hook.reach:
        faults.append(
            f"The goal reaches {reached.miss:.8g} m from the wire; the hook takes less "
            f"than {hook.reach:.4g} m."
        )
    if not reached.speed <= hook.speed_limit:
        faults.append(
            f"The goal has speeds of up to {reached.speed:.4g} m/s; the hook takes up "
            f"to {hook.speed_limit:.4g} m/s."
        )
    if not (least <= low and high <= most):
        faults.append(
            f"The goal has pitches from {low:.1f}° to {high:.1f}°; the hook takes "
            f"{least:.1f}° to {most:.1f}°."
        )
    return faults


def _differences(values, meant, names):
    """Returns |difference|, name, value and what is meant, of each state."""
    return list(zip(np.abs(values - meant), names, values, meant, strict=True))
