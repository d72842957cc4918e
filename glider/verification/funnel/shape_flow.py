"""The shape of a funnel, backward from its goal: a flow of sums of squares.

For the set {eᵀ S e <= 1}, with S = L Lᵀ,
    -Ṡ = F₁ᵀ S + S F₁ + L N Lᵀ,
    N = argmin tr(W N)  such that  zᵀ N z - c₃ - c₄ - zᵀ D z is a sum of squares on
    |z| = 1,  W = Lᵀ Σ L:
the least growth of S, in the sense of Σ, for which no deviation leaves. N is computed
every few steps and continues in a straight line between. A servo limit that the set
would break cuts it down. The feedback may be made on the way, from S one time later.

Σ says which deviations count at a time. For a wide inlet, with Φ̇ = F₁ Φ, it is Φ Σ₀ Φᵀ,
as tr(Σ₀ S(0)) is tr(Φ Σ₀ Φᵀ S(t)) and what else makes S grow before t; and a share of
deviations that count equally at all times, without which it is flat.
"""

import dataclasses
import functools

import numpy as np
from scipy.linalg import expm

from glider.control.tvlqr import weight_matrix
from glider.physics.confidence import ALONE, ConfidenceSet
from glider.progress import Shares, silent
from glider.verification.dynamics.moving_center import MovingCenter, make_moving_center
from glider.verification.dynamics.nominal import Nominal, advanced
from glider.verification.funnel import clock, servo_limits
from glider.verification.funnel.boundary import BoundarySets, boundary_forms, pushes_of
from glider.verification.funnel.remainder import (
    LEAST_REMAINDER,
    find_focus,
    push_weights,
    remainder_weights,
    sample_remainder,
)
from glider.verification.funnel.settings import FunnelSettings
from glider.verification.sos.forms import linear_part
from glider.verification.sos.programs import SolverError, first_success, least_growth

SHARE = 0.1
"""Share of the sizes that is added to the errors of a launch. Of a funnel for the hook,
0.32, 0.17, 0.1 and 0.05 leave 14.4, 15.4, 15.9 and 15.3 cm of height."""


@dataclasses.dataclass(frozen=True)
class FunnelTask:
    """A funnel that is to be made."""

    nominal: Nominal  #: Nominal flight.
    settings: FunnelSettings  #: Its goal and margins.
    directions: np.ndarray  #: (B, n + r) of `sample_remainder`.
    confidence: ConfidenceSet = ALONE  #: Gliders that it is for.

    @functools.cached_property
    def center(self) -> MovingCenter:
        """Where these gliders fly."""
        held = self.settings.period > 0.0
        return make_moving_center(self.nominal, self.confidence, held)

    @functools.cached_property
    def sizes(self) -> np.ndarray:
        """Σ (T, n, n), in squared units of the states."""
        nominal = self.nominal
        settings = self.settings
        count, n = nominal.states.shape
        steady = np.diag(np.square(settings.size_axes(n)))
        if settings.launch_sizes is None:
            return np.broadcast_to(steady, (count, n, n))
        slopes = linear_part(nominal.closed_loop)
        means = 0.5 * (slopes[:-1] + slopes[1:])
        errors = [weight_matrix(settings.launch_sizes, n)]  # Effects start at rest.
        for step in expm(np.diff(nominal.times)[:, None, None] * means):
            errors.append(step @ errors[-1])
        spread = np.array(errors)
        return spread @ np.swapaxes(spread, 1, 2) + SHARE**2 * steady

    def errors(
        self, S: np.ndarray, at: np.ndarray, *remainder: np.ndarray
    ) -> np.ndarray:
        """Returns how far the command may be off at K times, all or one, (2, K).

        Off u₀ - K e, and off u₀ - K e + eᵀ M e, with β and F of R if given.
        """
        settings = self.settings
        if not settings.period:
            return np.full((2, len(S)), settings.command_error)
        rests = clock.command_errors(self.nominal, S, at, settings, *remainder)
        known = clock.BEND_ROOM * clock.bend_sizes(S, self.nominal.bends[at])
        return np.stack([known + rests, rests])

    def sets(
        self, nominal: Nominal, S: np.ndarray, slopes: np.ndarray, at: np.ndarray
    ) -> BoundarySets:
        """Returns K sets of a flight at K times, with what acts on them.

        β (1 + eᵀ F e) is the inflated remainder, but for rounding. All is zero where
        the funnel is to be of the Taylor polynomial alone.
        """
        inflation = self.settings.remainder
        sizes = self.sizes[at]
        pushes = pushes_of(self.errors(S, at)[0], self.settings)
        given = self.nominal, S, self.directions, at, self.center
        acting = pushes if pushes.any() else None
        focus = np.zeros_like(S)
        beta = np.zeros(S.shape[:2])
        floor = self.settings.floor
        if inflation > 0.0 and floor < 1.0:
            focus = smoothed(find_focus(*given, sizes, acting, floor))
        if inflation > 0.0:
            sampled = sample_remainder(*given, focus, acting)
            beta = inflation * np.where(sampled > LEAST_REMAINDER, sampled, 0.0)
        errors, rests = self.errors(S, at, beta, focus)
        pushes = pushes_of(rests, self.settings)
        return BoundarySets(
            nominal=nominal,
            settings=self.settings,
            S=S,
            slopes=slopes,
            beta=beta,
            weights=remainder_weights(S, beta, sizes),
            focus=focus,
            push_weights=push_weights(S, pushes, self.nominal.push_slopes[at], sizes),
            errors=errors,
            rests=rests,
        )


def smoothed(values: np.ndarray) -> np.ndarray:
    """Returns values at times in order, averaged with their neighbors.

    F is found at each time alone: where it changes much, the proof needs many boxes.
    """
    padded = np.concatenate([values[:1], values, values[-1:]])
    return 0.25 * padded[:-2] + 0.5 * values + 0.25 * padded[2:]


_SAMPLE_ROOM = 1e-9
"""Share by which S is larger before a sample than after it."""

_CHANGE_SHARE = 0.3
"""Largest change of N, as a share of it, on its line to the next program."""


class ShapeFlow:
    """The flow of the set, backward along a nominal flight.

    Attributes:
        nominal: nominal flight, with the feedback that was made where one was.
    """

    def __init__(self, task: FunnelTask, steer: bool = False):
        """Takes a task; where it may steer, for one glider, it makes the feedback."""
        nominal = task.nominal
        if steer:
            nominal = nominal.writable()
            task = dataclasses.replace(task, nominal=nominal)
        self._task = task
        self.nominal = nominal
        self._sizes = task.sizes
        self._bounds = servo_limits.servo_bounds(nominal, task.settings, task.center)
        self._slopes = nominal.push_slopes[:, :, 0, 0] if steer else None

    def run(self, progress: Shares = silent) -> np.ndarray:
        """Returns S at all times, (T, n, n).

        Raises:
            SolverError: no solver gave a usable answer, or the set vanishes.
        """
        times = self.nominal.times
        settings = self._task.settings
        count, n = self.nominal.states.shape
        last = count - 1
        # Where commands are held, at least at the end of each and in its middle.
        hold = min(settings.hold, 0.5 * settings.period or np.inf)
        hold = max(1, round(hold / (times[1] - times[0])))
        S = servo_limits.goal_about(settings.goal_axes(n), self._task.center)
        self._steer(S, last)
        shapes = np.zeros((count, n, n))
        before = None
        since = 0
        S = self._cut(S, last)
        shapes[last] = S
        for k in range(last, 0, -1):
            self._steer(S, k - 1)
            if times[k] == times[k - 1]:  # A sample: the set must not be larger before.
                before = None
                since = 0
                S = S * (1.0 + _SAMPLE_ROOM)
            else:
                if since == 0:
                    growth = self._growth(S, k)
                    slope = 0.0 * growth if before is None else (growth - before) / hold
                    before = growth
                    change = max(hold * np.linalg.norm(slope), 1e-300)
                    slope *= min(1.0, _CHANGE_SHARE * np.linalg.norm(growth) / change)
                    progress((last - k) / last)
                S = self._step(S, k, growth + since * slope, slope)
                since = (since + 1) % hold
            S = self._cut(S, k - 1)
            shapes[k - 1] = S
        return shapes

    def _steer(self, S, k):
        """Makes the feedback at a time, for a set about then, if it is to be made."""
        if self._slopes is None:
            return
        nominal = self.nominal
        directions, bounds = self._bounds
        times = nominal.times
        settings = self._task.settings
        first = k
        toward = self._slopes[k]
        if settings.period:
            if k + 1 < len(times) and times[k + 1] > times[k]:
                return  # It was made from the end of its hold.
            first = nominal.starts[k]
            toward = clock.effect_of_hold(nominal, first, k) / settings.period
        rate = bounds[first, 0] - settings.command_error
        gains = servo_limits.steepest_gains(S, toward, rate, settings.elevator_gain)
        clock.undo_hold(nominal, first, k, gains)  # Ours: of a copy.
        here = slice(first, k + 1)
        center = self._task.center.part(here)
        directions[here], _ = servo_limits.servo_bounds(
            nominal.part(here), settings, center
        )

    def _cut(self, S, k):
        """Returns S of the set within the servo's limits at a time."""
        directions, bounds = self._bounds
        error, _ = self._task.errors(S[None], np.array([k]))
        left = bounds[k] - servo_limits.error_reach(error)[0]
        return servo_limits.keep_bounds(S, directions[k], left)

    def _growth(self, S, k):
        """Returns N + D at a time."""
        at = np.array([k])
        L = np.linalg.cholesky(S)
        nominal = self.nominal.part(slice(k, k + 1))
        # What is left of V̇ where S moves with the linear part of the flow.
        product = S @ linear_part(self.nominal.closed_loop[k])
        still = -(product + product.T)
        sets = self._task.sets(nominal, S[None], still[None], at)
        forms = boundary_forms(sets, self.nominal.push_slopes[at])
        fault = "No solver shaped the funnel; the goal may be too wide."
        given = forms.cubic[0], forms.quartic[0], L.T @ self._sizes[k] @ L
        [growth] = first_success(least_growth, *given, fault=fault)
        return growth + forms.quadratic[0]

    def _step(self, S, k, growth, slope):
        """Returns S one time earlier, by a Runge-Kutta step."""
        step = self.nominal.times[k] - self.nominal.times[k - 1]
        first, second = linear_part(self.nominal.closed_loop[[k, k - 1]])

        def rate(share, S):
            L = np.linalg.cholesky(S)
            product = S @ ((1.0 - share) * first + share * second)
            return product + product.T + L @ (growth + share * slope) @ L.T

        S = advanced(rate, S, step)
        if not np.all(np.isfinite(S)):
            raise SolverError(f"The funnel vanishes at {self.nominal.times[k]:.3f} s.")
        return 0.5 * (S + S.T)
