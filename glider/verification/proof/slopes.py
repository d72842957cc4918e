"""Slopes of a glider's dynamics, bounded over the sets of an interval.

Taylor models on boxes of a ball that covers the sets bound ∂f/∂(x, u, w), and ∂f/∂v of
gliders whose numbers deviate by A v. A bound is first guessed by samples and then
proven.
"""

import dataclasses

import numpy as np
import scipy.linalg

from glider.compiled.taylor import ROUNDING, WIDER
from glider.physics.confidence import theta_at
from glider.physics.servo import STOPPING_TIME
from glider.verification.dynamics.nominal import (
    hermite_powers,
    line_powers,
    nonlinear_parts,
    open_loop_rates,
)
from glider.verification.dynamics.numbers import Slope, monomials
from glider.verification.dynamics.taylor_models import Recording
from glider.verification.funnel.funnel import Funnel
from glider.verification.proof.boxes import excess_in_balls, run_on_boxes
from glider.verification.proof.interval import (
    acts_elsewhere,
    covers,
    gliders_path,
    keeps_servo,
    make_interval,
    stays_definite,
    tight_cover,
)
from glider.verification.proof.interval_proof import bound_remainder

_DEGREE = 2
"""Of the Taylor models."""

_SAMPLES, _WIDTHS = 300, (0.5, 0.2, 0.1, 0.05)
"""Points that are sampled, and the steps by which they climb."""

_LEAST, _BUDGET = 1e-9, 3_000
"""Bound of what is zero, and boxes on which a bound is tried."""


class Slopes:
    """∂f/∂(x, u, w, v) of a funnel's gliders, as operations on Taylor models.

    Boxes are of y in the ball that covers sets, the command's error, the wind in a
    ball, the time of a line of λ, and s of an interval.
    """

    def __init__(self, funnel: Funnel):
        """Records how they are computed, and Jᵀ λ - dλ/dσ and λᵀ (G, H) of a line."""
        model = funnel.nominal.model
        n = funnel.num_states
        self.num_states = n
        self.allowed = funnel.allowed
        self.which, _ = nonlinear_parts(model)
        m = len(self.which)
        self.table = monomials(m + 5, _DEGREE)
        self.balls = slice(m), slice(m + 1, m + 3)

        recording = Recording(self.table)
        count = n + 3 + len(self.allowed.names)
        total = count + 2 * n
        inputs = recording.inputs(total)
        line = inputs[count : count + n]
        changes = inputs[count + n :]
        J = _slopes_of_rates(model, inputs[:count], self.allowed)
        flat = [slope for row in J for slope in row]
        pulls = []
        for column in zip(*J, strict=True):
            products = zip(line, column, strict=True)
            pulls.append(sum(a * slope for a, slope in products))
        for i, change in enumerate(changes):
            pulls[i] = pulls[i] - change

        on_boxes = np.ones((total, len(self.table.degrees)), dtype=bool)
        at_points = on_boxes.copy()
        at_points[:, 1:] = False  # Only the constant term remains.
        patterns = on_boxes, at_points
        self.of_states = tuple(recording.program(flat, of) for of in patterns)
        self.of_line = tuple(recording.program(pulls, of) for of in patterns)


def _slopes_of_rates(model, inputs, allowed):
    """Returns the slopes of each rate along x, u, w and v, in Taylor models.

    Inputs are the states, the command, the wind and the numbers that deviate.
    """
    n = model.num_states
    directions = scipy.linalg.block_diag(np.eye(n + 3), allowed.factor)
    own = []
    for value, direction in zip(inputs, directions.tolist(), strict=True):
        own.append(Slope(value, tuple(direction)))
    states = own[:n]
    command = own[n]
    wind = own[n + 1 : n + 3]
    theta = theta_at(model, allowed.names, own[n + 3 :])
    rates = open_loop_rates(model, states, command, theta, wind)
    flat = Slope(0.0, (0.0,) * directions.shape[1])
    return [(flat + rate).slopes for rate in rates]


class NearSets:
    """Bounds of slopes on the sets of an interval, and on what is near them."""

    def __init__(self, slopes: Slopes, part: Funnel, near: np.ndarray):
        """Covers those of a funnel of two times, and what is as near as `near` (n,)."""
        nominal = part.nominal
        settings = part.settings
        allowed = part.allowed
        self._slopes = slopes
        self.first, self.last = nominal.times
        self.pushes = np.array([settings.wind, settings.command_error])
        if allowed.names:
            self.pushes = np.append(self.pushes, 1.0)

        turned = np.abs(nominal.demanded) @ near
        ahead = settings.command_error + turned / STOPPING_TIME
        wider = dataclasses.replace(part, errors=part.errors + ahead)
        interval = make_interval(wider)
        basis, _ = tight_cover(interval)
        curve, _ = hermite_powers(nominal.times, nominal.states, nominal.slopes)
        self._polynomials = self._inputs(wider, basis, curve)
        self._lacks = self._left_out(part, near, curve)
        proven = (
            stays_definite(interval.S)
            and keeps_servo(interval)
            and covers(interval, basis)
            and not acts_elsewhere(part)
            and allowed.is_same(slopes.allowed)
        )
        if not proven:
            self._lacks[:] = np.inf

    def _inputs(self, part, basis, curve):
        """Returns states, command and wind as polynomials on boxes, and zeros of v."""
        slopes = self._slopes
        n = slopes.num_states
        m = len(slopes.which)
        time = [0, m + 5, -1]  # Places of 1, s and s² in the table.
        self._line = m + 4
        numbers = len(part.allowed.names)
        found = np.zeros((n + 3 + numbers, len(slopes.table.degrees)))
        found[:n, time] = curve[:, : _DEGREE + 1]
        found[n, time[:2]] = line_powers(part.nominal.inputs)
        found[slopes.which, 1 : m + 1] = basis
        wind = part.settings.wind
        pushes = np.diag([part.errors.max(), wind, wind])
        found[n : n + 3, m + 1 : m + 4] += pushes
        return found

    def _left_out(self, part, near, curve):
        """Returns bounds of what the inputs lack: what is near, centers and numbers.

        Centers and numbers need not be of the same v: states are between two flights.
        """
        allowed = part.allowed
        path, _ = gliders_path(part)
        centers = np.abs(path).sum(axis=(1, 2))
        wind = np.zeros(2)
        numbers = allowed.reach(np.eye(len(allowed.names)))
        lacks = np.concatenate([centers, wind, numbers]) * WIDER
        higher = np.abs(curve[:, _DEGREE + 1 :]).sum(axis=1)
        lacks[: len(near)] += near + higher * WIDER
        return lacks

    def sizes(self, rooms: tuple[float, ...]) -> np.ndarray:
        """Returns bounds (n, n + P) of |J|, and of |(G, H)| by P `pushes` of 1."""
        n = self._slopes.num_states
        line = np.zeros((2 * n, self._polynomials.shape[1]))
        return self._bounded(self._slopes.of_states, line, rooms).reshape(n, -1)

    def pulls(self, first, last, duration, apart, rooms):
        """Returns bounds (P,) of d(λᵀ δ)/dt, by P `pushes` of 1.

        Args:
            first, last: ends (n,) of a line λ of some duration [s].
            apart: bounds of |δ| (n, P) by these pushes.
            rooms: of bounds that are tried.
        """
        n = len(apart)
        mean, change = line_powers([first, last])
        line = np.zeros((2 * n, self._polynomials.shape[1]))
        line[:n, 0] = mean
        line[:n, self._line] = change
        line[n:, 0] = (last - first) / duration
        weights = np.append(apart @ self.pushes, self.pushes)
        found = self._bounded(self._slopes.of_line, line, rooms, weights)
        by_states = found[:n]
        by_pushes = found[n:]
        return by_pushes + by_states @ apart

    def _bounded(self, program, line, rooms, weights=None):
        """Returns bounds of all results, those of each push together.

        Each has the room of its own size, or an equal share of a weighted sum's.
        """
        polynomials = np.concatenate([self._polynomials, line])
        rounding = ROUNDING * np.abs(line).max(axis=1)
        lacks = np.append(self._lacks, rounding)
        boxes = _Boxes(self._slopes, program, polynomials, lacks)
        largest = boxes.largest()
        own_room = largest
        if weights is not None:
            share = largest @ weights / len(weights)
            even = share / np.maximum(weights, _LEAST)
            own_room = 0.5 * (largest + even)
        if not np.all(np.isfinite(lacks)):
            return np.full_like(largest, np.inf)
        for room in rooms:
            boxes.limits = largest + (room - 1.0) * own_room + _LEAST
            if bound_remainder(boxes, _BUDGET).proven:
                return boxes.limits
        return np.full_like(largest, np.inf)


class _Boxes:
    """Results of a program on boxes, and limits which they are to keep.

    A row is a result, or those of one push: both of the wind, all of a set's v.
    """

    span = -1.0, 1.0

    def __init__(self, slopes, programs, polynomials, lacks):
        """Takes inputs (I, M), and bounds (I,) of what these lack."""
        self._program, self._at_points = programs
        self._polynomials = polynomials
        self._lacks = lacks
        self._slopes = slopes
        self.balls = slopes.balls
        self.dimension = slopes.table.num_variables
        self.limits = np.zeros(0)

    def bounds(self, center, half):
        """Returns bounds over limits, what centers reach, and what is to blame."""
        table = self._slopes.table
        found, lost = run_on_boxes(
            self._program, table, self._polynomials, self._lacks, center, half
        )
        tops, blame = excess_in_balls(
            table, found, lost, 0.0, found, center, half, self.balls
        )
        values = np.abs(found[:, 0])
        surely = np.maximum(values - lost, 0.0)
        for ball in self.balls:
            outside = np.linalg.norm(center[ball], axis=0) > 1.0
            surely[:, outside] = 0.0
        return self._shares(tops), self._shares(surely), self._shares(blame)

    def _shares(self, values):
        """Returns rows as shares of the limits."""
        return (self._rows(values).T / self.limits).T

    def largest(self) -> np.ndarray:
        """Returns the largest values (rows,) that are found by a climb."""
        rng = np.random.default_rng(0)
        directions = rng.normal(size=(self.dimension, _SAMPLES))
        points = directions * rng.uniform(0.0, 2.0, _SAMPLES)
        for width in (*_WIDTHS, 0.0):
            for ball in self.balls:
                size = np.linalg.norm(points[ball], axis=0)
                points[ball] /= np.maximum(size, 1.0)
            points = np.clip(points, -1.0, 1.0)
            values = self._rows(np.abs(self._values(points)))
            best = np.unique(values.argmax(axis=1))
            copies = 1 + _SAMPLES // len(best)
            points = np.tile(points[:, best], copies)
            moved = points[:, len(best) :]
            moved += width * rng.normal(size=moved.shape)
        return values.max(axis=1)

    def _values(self, points):
        """Returns results (K, B) at points (d, B)."""
        monomials_there = self._slopes.table.values(points.T).T
        inputs = np.zeros((*self._polynomials.shape, points.shape[1]))
        inputs[:, 0] = self._polynomials @ monomials_there
        found, _ = self._at_points.run(inputs, np.zeros_like(inputs[:, 0]))
        return found[:, 0]

    def _rows(self, values):
        """Returns rows by (x, w, u, v), given results by (x, u, w, v)."""
        n = self._slopes.num_states
        allowed = self._slopes.allowed
        count = n + 3 + allowed.dimension
        others = values.shape[1:]
        each = values.reshape(-1, count, *others)
        of_x, of_u, of_w, of_v = np.split(each, [n, n + 1, n + 3], axis=1)
        wind = np.linalg.norm(of_w, axis=1, keepdims=True)
        rows = [of_x, wind, of_u]
        if allowed.names:
            numbers = np.linalg.norm(of_v, axis=1, keepdims=True)
            rows.append(numbers)
        return np.concatenate(rows, axis=1).reshape(-1, *others)
