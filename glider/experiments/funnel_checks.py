"""Checks, before the search, that throws of a campaign can be inside a funnel."""

import dataclasses
import math

import numpy as np

from glider.errors import InputError
from glider.experiments.funnel_throws import FUNNEL_GENES, shortest, throw_in_funnel
from glider.experiments.known_funnel import KnownFunnel
from glider.experiments.throw_limits import ThrowLimits
from glider.experiments.throws import Range, Throw, launches
from glider.physics.state import STATE_NAMES

_X, _Z = STATE_NAMES.index("x"), STATE_NAMES.index("z")

_NAMES = ("missed_height", "missed_pitch", "missed_speed")
"""Launch errors of the limits, in the order of `launches`."""


def check_frame(known: KnownFunnel, place: Range, until: float) -> None:
    """Raises InputError where the limits leave no space for a funnel's flight.

    For example where a campaign has another origin. Throws are released at the
    funnel's x and follow the nominal flight; their z is within the sets.

    Args:
        known: the funnel.
        place: whose limits of x and z count.
        until: end of the part of the nominal flight that is checked [s].
    """
    rows = np.arange(1, int(until * place.pose_rate + 1e-9) + 1) / place.pose_rate
    path = known.funnel.center(rows)
    heights = np.sqrt(np.linalg.inv(known.funnel.shape(rows))[:, _Z, _Z])
    for name, index, margin in (("x", _X, 0.0), ("z", _Z, heights)):
        low, high = getattr(place.limits, name)
        along = path[:, index]
        if np.any((along + margin < low) | (along - margin > high)):
            start, end = known.funnel.center(np.array([0.0, until]))
            raise InputError(
                f"{known.name}: its flight goes from {name} = {start[index]:.2f} m to "
                f"{end[index]:.2f} m in {until:.2g} s, and the limits' {name} (where "
                f"none is given, as flown) is {low:.2f} to {high:.2f} m; expected "
                "wider limits, or a campaign with the funnel's origin: its release is "
                f"at x = {known.x:.2f} m, z = {known.launch[0]:.2f} m."
            )


def check_launch(known: KnownFunnel, place: Range) -> None:
    """Raises InputError where no throw can keep inside a funnel after its launch.

    The commands are too slow for it, or the nominal launch or a perturbed one lies
    outside of the first set: the elevator may rest elsewhere than the funnel's.
    """
    if shortest(place) > known.duration:
        raise InputError(
            f"{known.name}: its flight of {known.duration:.3g} s is shorter than the "
            f"shortest tape, {shortest(place):.3g} s at {place.command_rate:g} "
            "commands a second; expected a longer funnel."
        )
    genes = np.full(FUNNEL_GENES, 0.5)
    genes[-2:] = 0.0
    throw = throw_in_funnel(genes, place)
    limits = place.limits
    nominal, *missed = known.funnel.level(0.0, np.stack(launches(throw, limits)))
    if nominal > 1.0:
        raise InputError(
            f"{known.name}: its launch, within the limits and with the elevator "
            f"resting at {place.rest:.3g} rad, is at level {nominal:.3g} of the "
            "funnel's first set; expected at most 1."
        )
    expected = [
        f"{name} up to {math.floor(1e3 * largest) / 1e3:g} (it is {far:g})"
        for name, largest in _largest_errors(known, throw, limits).items()
        if (far := getattr(limits, name)) > largest
    ]
    if expected:
        raise InputError(
            f"{known.name}: a launch that is missed is at level {max(missed):.3g} of "
            "the funnel's first set, where 1 is its boundary; expected "
            f"{' and '.join(expected)} in the limits, or a wider funnel."
        )


def _largest_errors(
    known: KnownFunnel, throw: Throw, limits: ThrowLimits
) -> dict[str, float]:
    """Largest launch error of each name, either way: f in V = a + 2 b f + c f² = 1."""
    far = dataclasses.replace(
        limits, missed_height=1.0, missed_pitch=1.0, missed_speed=1.0
    )
    nominal, *missed = np.stack(launches(throw, far)) - known.funnel.center(0.0)
    ways = np.array(missed) - nominal
    shape = known.funnel.shape(0.0)
    a = nominal @ shape @ nominal
    b = ways @ shape @ nominal
    c = np.einsum("ki,ij,kj->k", ways, shape, ways)
    errors = ((np.sqrt(b**2 + c * (1.0 - a)) - b) / c).reshape(2, len(_NAMES))
    return dict(zip(_NAMES, errors.min(axis=0).tolist(), strict=True))
