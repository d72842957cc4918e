"""What the tests of the physics share: random states, effects at work."""

import numpy as np

from glider.dynamics import compose, initial_extra
from glider.effects import NO_FIELD
from glider.effects.effect import Effect, EffectKind
from glider.effects.field import FieldData
from glider.parameters import GliderParameters, parameter_vector

PARAMETERS = parameter_vector(GliderParameters())
NO_COEFFICIENTS = np.zeros(0)


def random_states(count, seed=0):
    """Returns states (count, 7) of a perch and its neighborhood."""
    rng = np.random.default_rng(seed)
    middle = np.array([-1.0, 0.3, -0.3, 0.2, 5.0, -0.5, 0.5])
    spread = np.array([2.0, 0.6, 0.6, 0.4, 2.0, 1.5, 3.0])
    return middle + spread * rng.uniform(-1, 1, (count, 7))


def drawing(x, u=0.0, p=PARAMETERS, wind=(0.0, 0.0)):
    """Returns the derivatives of the glider as drawn, shape (7,)."""
    return np.array(
        compose().derivatives(0.0, x, u, *wind, p, NO_COEFFICIENTS, NO_FIELD)
    )


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
    flow, _ = chain.meet_air(0.0, blank, 0.0, 0.0, 0.0, PARAMETERS, c, NO_FIELD)
    rest = np.array(initial_extra(kinds, flow, 0.0, c))
    return np.concatenate([x, rest + 0.05]), c


FIELD = FieldData(
    variables=["alpha", "V", "x", "t"],
    centers=[[0.3, 6.0, -1.0, 0.2], [0.8, 4.0, 0.0, 0.5]],
    widths=[0.4, 2.0, 1.5, 0.5],
    constant=True,
    weights={
        "c_lift": [0.2, -0.3, 0.1],
        "c_moment": [0.01, 0.02, 0.0],
        "wind_x": [0.3, 0.1, 0.0],
        "c_drag": [0.1, 0.0, 0.05],
    },
)
"""A residual field that uses most of what a field can do."""
