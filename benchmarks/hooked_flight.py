"""Flights of the library's own chain with any function in any of its links.

`glider.physics.compose` joins the one text of the physics with hooks, effects whose
formulas are closures over numpy arrays; nothing is compiled. Where the library's
formulas end, the truth of a benchmark begins.
"""

import dataclasses
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from scipy.linalg import block_diag

from glider.campaign.logs import Flight
from glider.physics.compose import compose, initial_extra
from glider.physics.effects import ELEVATOR_TRIM, PITCH_OFFSET, STAGES, Flow
from glider.physics.model import GliderModel
from glider.physics.parameter_space import space_of
from tests.helpers.lifelike import Capture
from tests.helpers.lifelike_flight import STEP

EVERY = round(1.0 / (Capture().rate * STEP))
"""Steps from one row of the log to the next."""

CONSTANTS = ("wind_x", "wind_z", "elevator_trim", "pitch_offset")
"""What may differ from flight to flight [m/s, m/s, rad, rad]."""

_SIZES = np.array([1e-3, 1e-3, 1e-3, 1e-2, 1e-2, 1e-2, 1e-2, 1e-2, 1e-3, 1e-3])
"""Differences in launch and CONSTANTS, for slopes."""


class Hook(NamedTuple):
    """What `compose` takes of an EffectKind, without coefficients."""

    kind: str
    stage: str
    adds_to: tuple[str, ...]
    formula: Callable
    states: tuple[str, ...]
    state_rate: Callable | None
    steady_state: Callable | None
    coefficients: tuple[()] = ()
    rate_by_alphadot: bool = False
    pending: Callable | None = None
    is_free: bool = False
    state_scales: tuple[float, ...] = ()


def hook(
    name: str,
    adds_to: tuple[str, ...],
    formula: Callable,
    rate: Callable | None = None,
    rest: Callable | None = None,
) -> Hook:
    """Returns a formula without coefficients as an effect, see EffectKind.

    With a `rate` and a `rest` it has states of its own, one for each result of them.
    """
    count = 0
    if rest is not None:
        given = rest(_SOME_FLOW)
        count = len(given) if isinstance(given, tuple) else 1
    return Hook(
        kind=name,
        stage=next(stage for stage, known in STAGES.items() if adds_to[0] in known),
        adds_to=adds_to,
        formula=formula,
        states=tuple(f"state_{i}" for i in range(count)),
        state_rate=rate,
        steady_state=rest,
    )


_SOME_FLOW = Flow(*np.full(len(Flow._fields), 0.1))


@dataclasses.dataclass(frozen=True, kw_only=True)
class HookedGlider:
    """The nominal glider with hooks, along the paths of F flights' elevators.

    Attributes:
        hooks: what differs from the nominal glider.
        elevator: (2 K + 1, F) its angles at every half STEP [rad].
    """

    hooks: Sequence[Hook] = ()
    elevator: np.ndarray

    def fly(
        self,
        start: np.ndarray,
        constants: np.ndarray | None = None,
        air: np.ndarray | None = None,
        steps: int | None = None,
    ) -> np.ndarray:
        """Flies by the Runge-Kutta steps of `glider.compiled.replay`.

        Args:
            start: (6, ..., F) x, z, pitch and their rates.
            constants: (4, ..., F) CONSTANTS; None for zero.
            air: (2 K + 1, ..., F) moving air, x + i z [m/s]; None for still.
            steps: how many; None for all.

        Returns:
            The poses (rows, ..., F, 3) that the sensors would show without noise.
        """
        steps = len(self.elevator) // 2 if steps is None else steps
        if constants is None:
            constants = np.zeros((4, *start.shape[1:]))
        effects = (ELEVATOR_TRIM, PITCH_OFFSET, *self.hooks)
        chain = compose(effects)
        theta = GliderModel().numbers._replace(c=constants[2:])
        count = 7 + sum(len(e.states) for e in effects)
        state = np.zeros((count, *start.shape[1:]))
        state[[0, 1, 2, 4, 5, 6]] = start
        state[3] = self.elevator[0]

        def rates(half: int, x: np.ndarray, turning: np.ndarray) -> np.ndarray:
            x[3] = self.elevator[half]
            wind = 0.0 if air is None else air[half]
            wind_x, wind_z = constants[0] + np.real(wind), constants[1] + np.imag(wind)
            time = 0.5 * STEP * half
            d = np.empty_like(x)
            for i, rate in enumerate(
                chain.derivatives(time, x, turning, wind_x, wind_z, theta)
            ):
                d[i] = rate
            return d

        def shown() -> np.ndarray:
            columns = np.broadcast_arrays(*chain.measure(state, theta))
            return np.stack(columns, axis=-1)

        turning = (self.elevator[2] - self.elevator[0]) / STEP
        flow, _ = chain.meet_air(0.0, state, turning, *constants[:2], theta)
        for i, rest in enumerate(
            initial_extra(space_of(effects), flow, turning, theta.c)
        ):
            state[7 + i] = rest
        poses = [shown()]
        for k in range(steps):
            j = 2 * k
            turning = (self.elevator[j + 2] - self.elevator[j]) / STEP
            first = rates(j, state.copy(), turning)
            second = rates(j + 1, state + 0.5 * STEP * first, turning)
            third = rates(j + 1, state + 0.5 * STEP * second, turning)
            fourth = rates(j + 2, state + STEP * third, turning)
            state = state + STEP / 6.0 * (first + 2.0 * (second + third) + fourth)
            state[3] = self.elevator[j + 2]
            if (k + 1) % EVERY == 0:
                poses.append(shown())
        return np.array(poses)


def predict(
    glider: HookedGlider,
    flights: Sequence[Flight],
    start: np.ndarray,
    spreads: np.ndarray,
    air: tuple[float, float] = (0.0, 0.0),
    share: float = 0.2,
) -> np.ndarray:
    """Predicts flights by the true glider, as the product predicts held-out ones.

    Launch, per-flight constants and gusts are the likeliest by the first share of the
    rows. Constants and gusts have their true strength as priors, so that gusts fade
    beyond those rows: no model can predict better.

    Args:
        glider: the true one.
        flights: F as logged.
        start: (6, F) the true launches, where the search begins.
        spreads: (4,) standard deviations of CONSTANTS over flights.
        air: standard deviation [m/s] and correlation time [s] of gusts.
        share: of the rows.

    Returns:
        The poses (rows, F, 3) from there to the end.
    """
    capture, count = Capture(), len(flights)
    sizes = np.array([capture.position, capture.position, capture.pitch])
    logged = np.stack([f.pose for f in flights], axis=1)
    rows = int(np.searchsorted(flights[0].time, share * flights[0].time[-1]))
    steps = EVERY * (rows - 1)
    nodes = int(np.ceil(steps * STEP / _BETWEEN)) + 1 if air[0] else 0
    free = np.array([*range(6), *(6 + np.flatnonzero(spreads))])
    free = np.append(free, 10 + np.arange(2 * nodes))
    known = [np.zeros((6, 6)), np.diag(1.0 / spreads[spreads > 0.0])]
    known += 2 * [_gust_prior(nodes, *air)] if nodes else []
    prior = block_diag(*known)
    moves = np.append(_SIZES, np.full(2 * nodes, 2e-2))[free]

    def fly(own: np.ndarray, steps: int) -> np.ndarray:
        if not nodes:
            return glider.fly(own[:6], own[6:10], steps=steps)
        gusts = own[10 : 10 + nodes] + 1j * own[10 + nodes :]
        moving = np.tensordot(_gust_weights(steps, nodes, air[1]), gusts, 1)
        return glider.fly(own[:6], own[6:10], moving, steps)

    own = np.concatenate([start, np.zeros((4 + 2 * nodes, count))])
    for _ in range(4):
        moved = np.repeat(own[:, None], len(free) + 1, axis=1)
        moved[free, 1 + np.arange(len(free))] += moves[:, None]
        flown = fly(moved, steps)
        error = (logged[:rows] - flown[:, 0]) / sizes
        slopes = (flown[:, 1:] - flown[:, :1]) / moves[:, None, None] / sizes
        for i in range(count):
            by_free = np.moveaxis(slopes[:, :, i], 1, -1).reshape(-1, len(free))
            wanted = np.append(error[:, i].ravel(), -prior @ own[free, i])
            step = np.linalg.lstsq(np.vstack([by_free, prior]), wanted, rcond=None)[0]
            own[free, i] += step
    return fly(own, len(glider.elevator) // 2)


_BETWEEN = 0.03
"""Time between two nodes of the gusts that are fitted [s]."""


def _gust_prior(nodes: int, std: float, correlation: float) -> np.ndarray:
    """Whitens the nodes (nodes,) of first-order gusts."""
    keep = np.exp(-_BETWEEN / correlation)
    whiten = (np.eye(nodes) - keep * np.eye(nodes, k=-1)) / np.sqrt(1.0 - keep**2)
    whiten[0, 0] = 1.0
    return whiten / std


def _gust_weights(steps: int, nodes: int, correlation: float) -> np.ndarray:
    """Weights (2 steps + 1, nodes) of gusts: linear, and fading after the last node."""
    time = 0.5 * STEP * np.arange(2 * steps + 1)
    at = _BETWEEN * np.arange(nodes)
    weights = np.stack([np.interp(time, at, row) for row in np.eye(nodes)], axis=1)
    fading = np.exp(-np.maximum(time - at[-1], 0.0) / correlation)
    return weights * fading[:, None]
