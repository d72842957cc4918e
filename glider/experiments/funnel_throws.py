"""Throws inside a funnel: its nominal flight, and departures from it.

A tape is flown open loop: a launch error grows, where the funnel's feedback would
reduce it. A throw therefore ends where the first of its flights would leave the sets,
    V = (x - x₀(t))ᵀ S(t) (x - x₀(t)) <= 1,
and until then the feedback may take over at any moment: the certificate holds for each
state of the sets, however the flight got there.
"""

import dataclasses
import math
from collections.abc import Sequence

import numpy as np

from glider.compiled.actuators import replayed_path
from glider.errors import InputError, expect
from glider.experiments.known_funnel import KnownFunnel
from glider.experiments.throw_limits import LAUNCH, ThrowLimits
from glider.experiments.throws import (
    GENES,
    MARGIN,
    MOVES,
    USED,
    Range,
    Throw,
    launch_state,
    launches,
    tape_towards,
)
from glider.physics.effects import Field
from glider.physics.parameter_space import ParameterSpace
from glider.physics.state import ELEVATOR, NUM_STATES, POSITION, STATE_NAMES
from glider.simulation.campaigns import fly_path

FUNNEL_GENES = GENES + 2
"""Genes of a throw in a funnel: those of a throw, and the size of the departures of its
launch and of its elevator."""

SHORTEST = 0.1
"""Least duration of a tape [s]: a dozen rows at 120 Hz."""

_STEP = 0.002
"""Longest time between two evaluations of V [s]. V of the shipped funnels grows by 10
1/s within 0.05 s: in between it deviates from a line by less than 0.001."""

_X, _Z = POSITION
_PITCHDOT = STATE_NAMES.index("pitchdot")


@dataclasses.dataclass(frozen=True, kw_only=True)
class Kept:
    """The part of a throw that keeps inside a funnel."""

    throw: Throw | None  #: Cut to that part; None where it is shorter than SHORTEST.
    #: Largest V until it ends; without a throw that until the end of the shortest tape,
    #: above 1.
    level: float


def draw_sizes(rng: np.random.Generator, count: int) -> np.ndarray:
    """Draws the last genes of throws, from no departures to large ones."""
    sizes = rng.random((count, FUNNEL_GENES - GENES))
    return sizes * np.linspace(0.0, 1.0, count)[:, None]


def throw_in_funnel(genes: np.ndarray, place: Range) -> Throw:
    """The throw that genes encode, as long as the funnel.

    Args:
        genes: (FUNNEL_GENES,) in 0 .. 1: height, speed, climb, pitch; angles beside the
            nominal elevator's; when each begins; how fast it moves; how large the
            departures are, of the launch and of the elevator.
        place: with a funnel, whose limits of launch and elevator it keeps.
    """
    limits, known = place.limits, place.funnel
    assert known is not None
    funnel = known.funnel
    launch_size, size = genes[-2:] ** 2  # Most of the draws are small departures.
    pairs = np.array([getattr(limits, name) for name in LAUNCH])
    departures = launch_size * (2.0 * genes[:4] - 1.0) * known.launch_widths
    launch = launch_state(np.clip(known.launch + departures, *pairs.T), place)
    launch[_PITCHDOT] = funnel.center(0.0)[_PITCHDOT]
    low, high = np.add(limits.elevator, [MARGIN, -MARGIN])
    beside = size * (2.0 * genes[4 : 4 + MOVES] - 1.0) * 0.5 * (high - low)
    begins = np.sort(genes[4 + MOVES : 4 + 2 * MOVES]) * known.duration
    most = USED * limits.elevator_rate
    fastest = most - (1.0 - genes[4 + 2 * MOVES]) * max(most - known.fastest, 0.0)
    count = int(known.duration * place.command_rate + 1e-9)
    times = np.arange(count) / place.command_rate
    moves = np.searchsorted(begins, times, side="right") - 1
    wanted = funnel.center(times + 1.0 / place.command_rate)[:, ELEVATOR]
    wanted = np.clip(wanted + np.where(moves < 0, 0.0, beside[moves]), low, high)
    return Throw(
        launch=launch,
        times=times,
        commands=tape_towards(wanted, fastest, place),
        duration=count / place.command_rate,
    )


def shortest(place: Range) -> float:
    """Duration of the shortest tape, in full commands [s]."""
    return float(np.ceil(SHORTEST * place.command_rate - 1e-9)) / place.command_rate


def keep(
    throw: Throw,
    place: Range,
    space: ParameterSpace,
    models: Sequence[tuple[np.ndarray, Field]],
) -> Kept:
    """Cuts a throw to how long every model keeps it, and launch errors, in a funnel."""
    count = round(throw.duration * place.command_rate)
    fine = int(np.ceil(1.0 / (place.command_rate * _STEP)))
    times = np.arange(count * fine + 1) / (place.command_rate * fine)
    level = np.max(
        [
            levels(throw, place, space, theta, field, times).max(axis=0)
            for theta, field in models
        ],
        axis=0,
    )
    outside = np.flatnonzero(~(level <= 1.0))  # Also where a flight diverges.
    if len(outside):
        count = (int(outside[0]) - 1) // fine if outside[0] else 0
    duration = count / place.command_rate
    if duration < SHORTEST:
        reached = float(np.max(level[times <= shortest(place) + 1e-9]))
        return Kept(throw=None, level=reached if np.isfinite(reached) else np.inf)
    cut = dataclasses.replace(
        throw,
        times=throw.times[:count],
        commands=throw.commands[:count],
        duration=duration,
    )
    return Kept(throw=cut, level=float(np.max(level[: count * fine + 1])))


def levels(
    throw: Throw,
    place: Range,
    space: ParameterSpace,
    theta: np.ndarray,
    field: Field,
    times: np.ndarray,
) -> np.ndarray:
    """V of a throw at some times by one model, (launches, n)."""
    assert place.funnel is not None
    replay = space.replay(theta)
    rest = float(throw.launch[ELEVATOR])
    here, middle = (
        replayed_path(
            replay, throw.times, throw.commands, query, start=rest, limits=place.stops
        )
        for query in (times, 0.5 * (times[1:] + times[:-1]))
    )
    elevator = np.stack([here[:-1], middle, here[1:]], axis=1)
    rate = np.diff(here) / np.diff(times)
    flights = np.stack(
        [
            fly_path(space, theta, launch, times, elevator, rate, field)
            for launch in launches(throw, place.limits)
        ]
    )[..., :NUM_STATES]
    flights[..., ELEVATOR] = here  # Flown as an offset from its path.
    with np.errstate(over="ignore", invalid="ignore"):  # A model may diverge.
        return place.funnel.funnel.level(times, flights)


_NAMES = ("missed_height", "missed_pitch", "missed_speed")
"""Launch errors of the limits, in the order of `launches`."""


def check_frame(known: KnownFunnel, place: Range, until: float) -> None:
    """Raises InputError where the limits leave no space for a funnel's flight.

    For example where a campaign has another origin. Throws are released at the
    funnel's x and follow the nominal flight; their z is within the sets. It is checked
    from the launch to the time `until` [s].
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
    expect(
        known.duration >= shortest(place),
        f"{known.name}: the duration of its flight",
        known.duration,
        f"at least {shortest(place):.3g} s, that of the shortest tape at "
        f"{place.command_rate:g} commands a second",
    )
    genes = np.full(FUNNEL_GENES, 0.5)
    genes[-2:] = 0.0
    throw = throw_in_funnel(genes, place)
    limits = place.limits
    nominal, *missed = known.funnel.level(0.0, np.stack(launches(throw, limits)))
    launch = f"its launch, within the limits, the elevator at {place.rest:.3g} rad"
    expect(
        nominal <= 1.0, f"{known.name}: the level of {launch},", nominal, "at most 1"
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
