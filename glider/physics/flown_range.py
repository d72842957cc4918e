"""Where a traced model was flown, and a warning where a path leaves that.

A corrected model is right for what the flights showed. An effect that was found below
stall may be wrong beyond it, so the model keeps the range of each variable that its
effects and free functions depend on.
"""

import warnings
from collections.abc import Mapping

import numpy as np

from glider.physics.effects.free_functions import FLOW_UNITS
from glider.physics.model import GliderModel

_RESOLVED = 0.125
"""Share of a range below which a departure is none: the spacing of the widest Gaussians
of a free function, within which no function that flights show varies much."""


def ranges_of(
    model: GliderModel, values: Mapping[str, np.ndarray], flight: np.ndarray
) -> dict[str, tuple[float, float]]:
    """Returns the flown range of each variable that a model's corrections depend on.

    At least two flights reach its ends: what one alone has shown, no other has tested.

    Args:
        model: the corrected glider.
        values: of the variables in the flights, (n,) each.
        flight: index of the flight of each value, (n,).
    """
    wanted = {name for effect in model.effects for name in effect.kind.depends_on}
    wanted |= {name for part in model.free_functions for name in part.variables}
    rows = [flight == own for own in np.unique(flight)]
    second = min(1, len(rows) - 1)
    ranges = {}
    for name in FLOW_UNITS:
        if name in wanted:
            least = sorted(values[name][own].min() for own in rows)[second]
            most = sorted(values[name][own].max() for own in rows)[-1 - second]
            ranges[name] = (float(least), float(most))
    return ranges


def describe_departures(
    model: GliderModel, times: np.ndarray, states: np.ndarray, rates: np.ndarray
) -> str:
    """Describes how far states are beyond what a model was traced on; empty if not.

    Beyond is by more than an eighth of a variable's range.

    Args:
        model: with ranges, or without: then nothing is beyond.
        times: (K,) [s].
        states: (K, n) of the model.
        rates: (K,) of the elevator [rad/s].
    """
    chain, theta = model.chain, model.numbers
    flow, _ = chain.meet_air(times, states.T, rates, 0.0, 0.0, theta)
    values = dict(zip(FLOW_UNITS, chain.flow_variables(flow), strict=True))
    beyond = []
    for name, (low, high) in model.flown.items():
        least, most = np.min(values[name]), np.max(values[name])
        slack = _RESOLVED * (high - low)
        if least < low - slack or most > high + slack:
            beyond.append(
                f"{name} from {least:z.3g} to {most:z.3g} {FLOW_UNITS[name]} (flown: "
                f"{low:.3g} to {high:.3g})"
            )
    return ", ".join(beyond)


def warn_beyond(
    what: str,
    model: GliderModel,
    times: np.ndarray,
    states: np.ndarray,
    rates: np.ndarray,
) -> None:
    """Warns where a plan, a funnel or a throw leaves what a model was traced on.

    `what` is its name in the sentence; the others are as in `describe_departures`.
    """
    beyond = describe_departures(model, times, states, rates)
    if beyond:
        warnings.warn(
            f"{what} leaves what the model was traced on: {beyond}. Its corrections "
            "are extrapolated there: fly that range, and trace again.",
            stacklevel=3,
        )
