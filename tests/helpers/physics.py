"""What the tests of the physics share: random states, effects at work."""

import numpy as np
from pydrake.common.containers import namedview

from glider.physics.compose import compose, initial_extra
from glider.physics.effects import NO_GAUSSIANS
from glider.physics.effects.effect import Effect, EffectKind
from glider.physics.effects.free_functions import FreeFunction
from glider.physics.model import GliderModel
from glider.physics.parameter_space import space_of
from glider.physics.parameters import Parameters, Theta
from glider.physics.state import STATE_NAMES

GliderState = namedview("GliderState", STATE_NAMES)
"""A view by name; it aliases what it wraps, so that writing through a slice of it
writes into the state (the published notebook's first fault)."""

PARAMETERS = GliderModel().numbers.p
NO_COEFFICIENTS = np.zeros(0)


def random_states(count, seed=0):
    """Returns states (count, 7) of a perch and its neighborhood."""
    rng = np.random.default_rng(seed)
    middle = np.array([-1.0, 0.3, -0.3, 0.2, 5.0, -0.5, 0.5])
    spread = np.array([2.0, 0.6, 0.6, 0.4, 2.0, 1.5, 3.0])
    return middle + spread * rng.uniform(-1, 1, (count, 7))


def nominal_derivatives(x, u=0.0, p=PARAMETERS, wind=(0.0, 0.0)):
    """Returns the derivatives of the glider without effects, shape (7,)."""
    theta = Theta(Parameters(*p), NO_COEFFICIENTS, NO_GAUSSIANS)
    return np.array(compose().derivatives(0.0, x, u, *wind, theta))


def nose_up_dynamics(x, u, p):
    """An independent glider, in the article's signs (nose up positive).

    Vectors instead of formulas: theta = -pitch, phi = -elevator, rates too; the
    moment is the cross product of arms and forces.
    """
    s, p = GliderState(x.copy()), Parameters(*p)
    theta, phi, thetadot, phidot = -s.pitch, -s.elevator, -s.pitchdot, -u

    def axis(angle):
        return np.array([np.cos(angle), np.sin(angle)])

    def across(vector):  # A quarter turn nose up.
        return np.array([-vector[1], vector[0]])

    def plate(velocity, angle, area):
        speed = np.linalg.norm(velocity)
        attack = angle - np.arctan2(velocity[1], velocity[0])
        lift = 2 * np.sin(attack) * np.cos(attack)
        drag = 2 * np.sin(attack) ** 2
        along = velocity / speed
        size = 0.5 * p.air_density * area * speed**2
        return size * (lift * across(along) - drag * along)

    velocity = np.array([s.xdot, s.zdot])
    wing_arm = p.wing_offset * axis(theta)
    hinge_arm = -p.hinge_offset * axis(theta)
    tail_arm = -p.elevator_offset * axis(theta + phi)
    wing_velocity = velocity + thetadot * across(wing_arm)
    tail_velocity = (
        velocity + thetadot * across(hinge_arm) + (thetadot + phidot) * across(tail_arm)
    )
    wing = plate(wing_velocity, theta, p.wing_area)
    tail = plate(tail_velocity, theta + phi, p.elevator_area)
    moment = np.dot(across(wing_arm), wing)
    moment += np.dot(across(hinge_arm + tail_arm), tail)
    force = (wing + tail) / p.mass - np.array([0, p.gravity])
    return np.array([s.xdot, s.zdot, s.pitchdot, u, *force, -moment / p.pitch_inertia])


def at_work(kind: EffectKind) -> Effect:
    """Returns the effect with every coefficient off what does nothing."""
    values = {}
    for c in kind.coefficients:
        is_sign = kind.kind == "angle_sign"
        values[c.name] = -1.0 if is_sign else c.default + c.scale
    return kind(**values)


def full_state(effects, x):
    """Returns the state with the effects' own states off their rest."""
    kinds = tuple(e.kind for e in effects)
    c = np.concatenate([[], *(e.values for e in effects)])
    chain = compose(kinds)
    extra = sum(len(e.states) for e in kinds)
    blank = np.concatenate([x, np.zeros(extra)])
    flow, _ = chain.meet_air(
        0.0, blank, 0.0, 0.0, 0.0, Theta(PARAMETERS, c, NO_GAUSSIANS)
    )
    rest = np.array(initial_extra(space_of(kinds), flow, 0.0, c))
    return np.concatenate([x, rest + 0.05]), c


FREE = (
    FreeFunction(
        variables=["alpha", "V", "x", "t"],
        centers=[[0.3, 6.0, -1.0, 0.2], [0.8, 4.0, 0.0, 0.5]],
        widths=[0.4, 2.0, 1.5, 0.5],
        constant=True,
        weights={
            "c_lift": [0.2, -0.3, 0.1],
            "c_moment": [0.01, 0.02, 0.0],
            "c_drag": [0.1, 0.0, 0.05],
        },
    ),
    FreeFunction(
        variables=["x", "t", "pitch"],
        centers=[[-1.0, 0.2, -0.1], [0.0, 0.5, 0.2]],
        widths=[1.5, 0.5, 0.4],
        weights={"wind_x": [0.3, 0.1]},
    ),
)
"""Free functions that use most of what they can do."""
