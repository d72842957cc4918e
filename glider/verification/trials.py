"""Flights of the full dynamics that try to falsify a funnel; they prove nothing.

Full means: the physics, not its Taylor polynomial, and the servo with its limits.
Flights start from random points of the boundary and with random gliders on the edge of
a confidence set, if one is given; from the worst of them, start and glider climb. For a
funnel of a set, V of each glider is about its own center. Flights that escape are
counted, never dropped. The feedback acts at all times, as in the theorem.
"""

import dataclasses
import math
from collections.abc import Sequence

import numpy as np

from glider.errors import InputError
from glider.physics.confidence import ALONE, ConfidenceSet, numbers_at, physical
from glider.physics.model import GliderModel
from glider.progress import Shares, silent
from glider.simulation.fly import check_states, full_starts
from glider.verification.dynamics.nominal import fly_plan
from glider.verification.funnel.funnel import Funnel, funnel_policy
from glider.verification.sos.forms import to_ball
from glider.verification.sos.sphere import normalized

ESCAPE_LEVEL = 1.005
"""Level V that only flights which have left the funnel exceed: from 1, rounding and
integration take others to 1 + 1e-6."""

_START_SHARES = (0.0, 0.12, 0.25, 0.37, 0.5, 0.62, 0.75, 0.87)
"""Times when flights start, as shares of the funnel's duration."""

_CLIMB_ROUNDS = 6
"""Rounds of ascent along the boundary, each with a fifth as many flights."""

_CLIMB_WIDTH = 0.3
"""Length by which the first round strays from the worst points, on the unit sphere."""

_CLIMB_NARROWING = 0.6
"""Factor on this length from a round to the next."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Trial:
    """The outcome of flights from a funnel's boundary."""

    gliders: ConfidenceSet  #: Set on whose edge the gliders are, one or many.
    times: np.ndarray  #: Times (B,) when they started [s].
    states: np.ndarray  #: States (B, n) where they started.
    deviations: np.ndarray  #: δ (B, m) of the gliders; m is 0 where all flew the same.
    levels: np.ndarray  #: Largest V (B,) of each; 1 is the boundary, where it starts.
    later: np.ndarray  #: Largest V (B,) after the start.
    ends: np.ndarray  #: V (B,) at the end, in the last set if at most 1.
    climbed: np.ndarray  #: Whether it is of the ascent, (B,).

    @property
    def samples(self) -> int:
        """Number of flights."""
        return len(self.levels)

    @property
    def escapes(self) -> int:
        """Number of flights that left the funnel."""
        return int((~(self.levels <= ESCAPE_LEVEL)).sum())  # NaN is an escape.

    @property
    def astray(self) -> int:
        """Number of flights that end outside the last set."""
        return int((~(self.ends <= ESCAPE_LEVEL)).sum())


def falsify_funnel(
    funnel: Funnel,
    samples: int,
    rng: np.random.Generator,
    gliders: ConfidenceSet | None = None,
    *,
    model: GliderModel | None = None,
    shares: Sequence[float] = _START_SHARES,
    climb: bool = True,
    progress: Shares = silent,
) -> Trial:
    """Flies from random points of the boundary, then climbs from the worst of them.

    Args:
        samples: flights from random points, divided among start times; at least one at
            each. The climb adds as many and a fifth more.
        gliders: set on whose edge the gliders are that fly; None for the funnel's own.
        model: another glider that flies alone; states that the funnel lacks start at
            rest.
        shares: of the duration: when flights start.
        climb: whether to look for worse flights near the worst.
        progress: called with the share that is done.

    Raises:
        InputError: the funnel is for held commands, or of gliders that deviate in other
            numbers.
    """
    _check_gliders(funnel, gliders)
    last = len(funnel.nominal.times) - 1
    rounds = _CLIMB_ROUNDS if climb else 0
    parts = []
    for number, share in enumerate(shares):
        k = min(round(share * last), last - 1)
        more = number < samples % len(shares)
        count = max(1, samples // len(shares) + more)
        genes = _draw_genes(funnel, gliders, count, rng)
        found = _fly(funnel, gliders, model, k, genes)
        parts.append(found)
        for turn in range(rounds):
            done = number + (turn + 1) / (rounds + 1)
            progress(done / len(shares))
            genes = _stray(funnel, _worst(found, count), turn, rng)
            found = _fly(funnel, gliders, model, k, genes, climbed=True)
            parts.append(found)
        progress((number + 1) / len(shares))
    columns = {}
    for field in dataclasses.fields(Trial):
        if field.name != "gliders":
            each = [part[field.name] for part in parts]
            columns[field.name] = np.concatenate(each)
    return Trial(gliders=gliders or ALONE, **columns)


def _check_gliders(funnel, allowed):
    """Raises InputError where a funnel is of gliders that deviate in other numbers."""
    made_for = funnel.allowed.names
    if allowed and made_for not in ((), allowed.names):
        raise InputError(
            f"The funnel is of gliders that deviate in {', '.join(made_for)}; those to "
            f"fly deviate in {', '.join(allowed.names) or 'nothing'}."
        )


# Genes of a flight: the directions of its start (n) and of its glider (r).


def _draw_genes(funnel, gliders, count, rng):
    """Returns random genes (count, n + r)."""
    allowed = gliders or ALONE
    start = normalized(rng.normal(size=(count, funnel.num_states)))
    glider = normalized(rng.normal(size=(count, allowed.dimension)))
    return np.hstack([start, glider])


def _worst(found, samples):
    """Returns the genes of the worst flights, a twenty-fifth of the random ones."""
    levels = found["levels"]
    # A flight starts at 1: what counts is how close it comes again, or goes beyond.
    values = np.where(levels > ESCAPE_LEVEL, levels, found["later"])
    kept = max(1, samples // 25)
    worst = np.argsort(-values)[:kept]
    return found["genes"][worst]


def _stray(funnel, worst, turn, rng):
    """Returns genes near each of the worst, five of each, closer from turn to turn."""
    n = funnel.num_states
    near = np.repeat(worst, 5, axis=0)
    width = _CLIMB_WIDTH * _CLIMB_NARROWING**turn
    noise = width * rng.normal(size=near.shape)
    noise[:, :n] /= math.sqrt(n)
    moved = near + noise
    return np.hstack([normalized(moved[:, :n]), normalized(moved[:, n:])])


def _fly(funnel, gliders, model, k, genes, climbed=False):
    """Returns what came of the genes' flights from one of the funnel's times."""
    n = funnel.num_states
    allowed = gliders or ALONE
    at_edge = allowed.on_boundary(genes[:, n:])
    deviations = physical(funnel.nominal.model, allowed.names, at_edge)
    own = deviations if gliders else None
    states = _boundary_states(funnel, k, genes[:, :n], own)
    V, _ = _fly_from(funnel, k, states, model, allowed.names, own)
    V = np.where(np.isfinite(V), V, np.inf)  # What diverges is the worst.
    return {
        "genes": genes,
        "climbed": np.full(len(genes), climbed),
        "times": np.full(len(genes), funnel.nominal.times[k]),
        "states": states,
        "deviations": deviations,
        "levels": V.max(axis=1),
        "later": V[:, 1:].max(axis=1),
        "ends": V[:, -1],
    }


def _boundary_states(
    funnel: Funnel, k: int, directions: np.ndarray, deviation: np.ndarray | None = None
) -> np.ndarray:
    """Returns states (B, n) on the boundary at a time, given unit vectors (B, n).

    Those of gliders of the funnel's set, (m,) or (B, m), are about their own centers.
    """
    states = funnel.nominal.states[k] + directions @ to_ball(funnel.S[k])[1].T
    if deviation is not None and funnel.is_of_set:
        states = states + deviation @ funnel.gliders.shifts[k].T
    return states


def _fly_from(
    funnel: Funnel,
    first: int,
    states: np.ndarray,
    model: GliderModel | None = None,
    names: tuple[str, ...] = (),
    deviations: np.ndarray | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Flies states (B, n) from one of the funnel's times to its end.

    The funnel's own glider flies if no other does, or gliders that deviate from it in
    some numbers by (B, m). V is about the center of each if the funnel is of a set.

    Returns:
        V of each at the funnel's times from `first` on, (B, T - first), and the
        paths (B, T - first, n'), n' the states of the glider that flies.
    """
    model = model or funnel.nominal.model
    policy = funnel_policy(funnel, first)
    check_states(model, policy)
    times = funnel.nominal.times[first:]
    numbers = None
    center = None
    if deviations is not None:
        numbers = numbers_at(model, names, deviations)
        center = deviations[:, None]
    starts = full_starts(model, states)
    step = 0.5 * (times[1] - times[0])
    paths = fly_plan(model, policy, starts, len(times) - 1, step, numbers)
    return funnel.level(times, paths[..., : funnel.num_states], center), paths


def draw_inside(funnel: Funnel, count: int, rng: np.random.Generator) -> np.ndarray:
    """Draws launches (count, n) that are uniform in the inlet."""
    n = funnel.num_states
    points = normalized(rng.normal(size=(count, n)))
    points *= rng.uniform(size=(count, 1)) ** (1 / n)
    return _boundary_states(funnel, 0, points)


def fly_inside(funnel: Funnel, count: int, rng: np.random.Generator) -> np.ndarray:
    """Flies launches that are uniform in the inlet; returns paths (count, T, n)."""
    return _fly_from(funnel, 0, draw_inside(funnel, count, rng))[1]
