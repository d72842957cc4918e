"""Flights of the library's own chain with any function in any of its links.

`glider.physics.compose` joins the one text of the physics with hooks, effects whose
formulas are closures over numpy arrays; nothing is compiled. Where the library's
formulas end, the truth of a benchmark begins.
"""

import dataclasses
from collections.abc import Callable, Sequence

import numpy as np

from glider.campaign.logs import Flight
from glider.physics.compose import compose, initial_extra
from glider.physics.effects import (
    ELEVATOR_TRIM,
    NO_FIELD,
    PITCH_OFFSET,
    STAGES,
    EffectKind,
    Flow,
)
from glider.physics.parameters import GliderParameters, Theta
from tests.helpers.lifelike import Capture
from tests.helpers.lifelike_flight import STEP

EVERY = round(1.0 / (Capture().rate * STEP))
"""Steps from one row of the log to the next."""

CONSTANTS = ("wind_x", "wind_z", "elevator_trim", "pitch_offset")
"""What may differ from flight to flight [m/s, m/s, rad, rad]."""

_SIZES = np.array([1e-3, 1e-3, 1e-3, 1e-2, 1e-2, 1e-2, 1e-2, 1e-2, 1e-3, 1e-3])
"""Differences in launch and CONSTANTS, for slopes."""


def hook(
    name: str,
    adds_to: tuple[str, ...],
    formula: Callable,
    rate: Callable | None = None,
    rest: Callable | None = None,
) -> EffectKind:
    """Returns a formula without coefficients as an effect, see EffectKind.

    With a `rate` and a `rest` it has states of its own, one for each result of them.
    """
    count = 0
    if rest is not None:
        given = rest(_SOME_FLOW)
        count = len(given) if isinstance(given, tuple) else 1
    return EffectKind(
        kind=name,
        stage=next(stage for stage, known in STAGES.items() if adds_to[0] in known),
        adds_to=adds_to,
        coefficients=(),
        formula=formula,
        words="",
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

    hooks: Sequence[EffectKind] = ()
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
            air: (2 K + 1, F) moving air, x + i z [m/s]; None for still.
            steps: how many; None for all.

        Returns:
            The poses (rows, ..., F, 3) that the sensors would show without noise.
        """
        steps = len(self.elevator) // 2 if steps is None else steps
        if constants is None:
            constants = np.zeros((4, *start.shape[1:]))
        effects = (ELEVATOR_TRIM, PITCH_OFFSET, *self.hooks)
        chain = compose(effects)
        theta = Theta(GliderParameters().numbers, constants[2:], NO_FIELD)
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
        for i, rest in enumerate(initial_extra(effects, flow, turning, theta.c)):
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
    share: float = 0.2,
) -> np.ndarray:
    """Predicts flights by the true glider, as the product predicts held-out ones.

    Launch and per-flight constants are the likeliest by the first share of the rows;
    the constants have their true spreads as priors. As in
    `glider.sysid.fit.prediction`, moving air widens the errors that a rollout has.

    Args:
        glider: the true one.
        flights: F as logged.
        start: (6, F) the true launches, where the search begins.
        spreads: (4,) standard deviations of CONSTANTS over flights.
        share: of the rows.

    Returns:
        The poses (rows, F, 3) from there to the end.
    """
    capture = Capture()
    noise = np.array([capture.position, capture.position, capture.pitch])
    logged = np.stack([f.pose for f in flights], axis=1)
    rows = int(np.searchsorted(flights[0].time, share * flights[0].time[-1]))
    free = [*range(6), *(6 + np.flatnonzero(spreads))]
    prior = np.diag([0.0] * 6 + [1.0 / s for s in spreads if s])
    own = np.concatenate([start, np.zeros((4, len(flights)))])
    sizes = noise
    for _ in range(4):
        moved = np.repeat(own[:, None], len(free) + 1, axis=1)
        for column, k in enumerate(free):
            moved[k, column + 1] += _SIZES[k]
        flown = glider.fly(moved[:6], moved[6:], steps=EVERY * (rows - 1))
        error = (logged[:rows] - flown[:, 0]) / sizes
        slopes = (flown[:, 1:] - flown[:, :1]) / _SIZES[free][:, None, None]
        for i in range(len(flights)):
            by_free = np.moveaxis(slopes[:, :, i] / sizes, 1, -1).reshape(-1, len(free))
            matrix = np.vstack([by_free, prior])
            wanted = np.append(error[:, i].ravel(), -prior @ own[free, i])
            own[free, i] += np.linalg.lstsq(matrix, wanted, rcond=None)[0]
        rms = np.sqrt(np.mean((error * sizes) ** 2, axis=(0, 1)))
        rms[:2] = np.sqrt(np.mean(rms[:2] ** 2))
        sizes = np.maximum(noise, rms)
    return glider.fly(own[:6], own[6:])
