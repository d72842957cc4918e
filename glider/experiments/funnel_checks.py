"""Whether a campaign's throws can be inside a funnel at all, before any is searched."""

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
"""Limits that say how far a launch is missed, in the order of `launches`."""


def check_frame(known: KnownFunnel, place: Range, until: float) -> None:
    """Raises InputError where the limits leave no room for a funnel's flight.

    As they do where a campaign has its origin elsewhere. Throws are released at the
    funnel's x, and soon after are where the nominal flight is; their z is within the
    sets.

    Args:
        known: the funnel.
        place: whose limits of x and z count.
        until: time of the nominal flight up to which it is looked at [s].
    """
    rows = np.arange(1, int(until * place.pose_rate + 1e-9) + 1) / place.pose_rate
    path = known.funnel.center(rows)
    heights = np.sqrt(np.linalg.inv(known.funnel.shape(rows))[:, _Z, _Z])
    for name, index, room in (("x", _X, 0.0), ("z", _Z, heights)):
        low, high = getattr(place.limits, name)
        along = path[:, index]
        if np.any((along + room < low) | (along - room > high)):
            start, end = known.funnel.center(np.array([0.0, until]))
            raise InputError(
                f"{known.name}: its flight goes from {name} = {start[index]:.2f} m to "
                f"{end[index]:.2f} m in {until:.2g} s, and the limits' {name} (where "
                f"none is given, as flown) is {low:.2f} to {high:.2f} m; wider limits, "
                "or a campaign with the funnel's origin, whose release is at x = "
                f"{known.x:.2f} m, z = {known.launch[0]:.2f} m, is needed."
            )


def check_launch(known: KnownFunnel, place: Range) -> None:
    """Raises InputError where no throw can keep inside a funnel from its launch on.

    The commands are too slow for it, or the nominal launch lies outside of the first
    set, as it is asked for or missed: the elevator may rest elsewhere than the
    funnel's.
    """
    if shortest(place) > known.duration:
        raise InputError(
            f"{known.name}: its flight of {known.duration:.3g} s is shorter than the "
            f"shortest tape, {shortest(place):.3g} s at {place.command_rate:g} "
            "commands a second; a longer funnel is needed."
        )
    genes = np.full(FUNNEL_GENES, 0.5)
    genes[-2:] = 0.0
    throw = throw_in_funnel(genes, known, place)
    limits = place.limits
    asked, *missed = known.funnel.level(0.0, np.stack(launches(throw, limits)))
    if asked > 1.0:
        raise InputError(
            f"{known.name}: its launch, within the limits and with the elevator "
            f"resting at {place.rest:.3g} rad, is at level {asked:.3g} of the funnel's "
            "first set; at most 1 is needed."
        )
    told = [
        f"{name} up to {math.floor(1e3 * room) / 1e3:g} (it is {far:g})"
        for name, room in _rooms(known, throw, limits).items()
        if (far := getattr(limits, name)) > room
    ]
    if told:
        raise InputError(
            f"{known.name}: a launch that is missed is at level {max(missed):.3g} of "
            f"the funnel's first set, where 1 is its boundary; {' and '.join(told)} in "
            "the limits, or a wider funnel, is needed."
        )


def _rooms(known: KnownFunnel, throw: Throw, limits: ThrowLimits) -> dict[str, float]:
    """Returns by how much a launch inside may be missed, either way, by each name.

    As far as f in V = a + 2 b f + c f² = 1.
    """
    far = dataclasses.replace(
        limits, missed_height=1.0, missed_pitch=1.0, missed_speed=1.0
    )
    asked, *missed = np.stack(launches(throw, far)) - known.funnel.center(0.0)
    ways = np.array(missed) - asked
    shape = known.funnel.shape(0.0)
    a = asked @ shape @ asked
    b = ways @ shape @ asked
    c = np.einsum("ki,ij,kj->k", ways, shape, ways)
    rooms = ((np.sqrt(b**2 + c * (1.0 - a)) - b) / c).reshape(2, len(_NAMES))
    return dict(zip(_NAMES, rooms.min(axis=0).tolist(), strict=True))
