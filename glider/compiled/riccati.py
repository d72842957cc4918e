"""The Riccati equation back along a nominal path.

With A, B along the path, e = f(x₀, u₀) - ẋ₀ and x̃ = x - x₀ the cost-to-go is yᵀ P y of
y = (x̃, 1), whose dynamics have A and, as a last column, e. So
    P = [S  s; sᵀ  (a number)],   -Ṗ = W + P A + Aᵀ P - P B R⁻¹ Bᵀ P,
and u = u₀ - R⁻¹ Bᵀ P y.
"""

import numpy as np

from glider.compiled import jacobian
from glider.compiled.jacobian import directional
from glider.compiled.kernel import Family, called_code, machine_code
from glider.compiled.runge_kutta import put


def linearize(times, states, inputs, z, gaussians, rates, slopes):
    """Writes the dynamics along a path and their slopes, by complex steps.

    Args:
        times: (K,) [s].
        states: (K, n).
        inputs: (K,) [rad/s].
        z: of `stacked`; states and inputs are overwritten.
        gaussians: of the free functions.
        rates: (K, n), written.
        slopes: (K, n, n + 1), written: A and, as its last column, B.
    """
    count, n = states.shape
    each = np.zeros((n + 1, n + 1)).T  # As the plant asks: compiled only once.
    for i in range(n + 1):
        each[i, i] = 1.0
    for k in range(count):
        put(states[k], z[:n])
        z[n] = inputs[k]
        directional(times[k], z, each, n, gaussians, rates[k], slopes[k])


LOOPS = Family((linearize,), (linearize,), uses=(jacobian.LOOPS,))


@called_code
def _write_slope(now, steady, push, weight, rate_weight, turned, slope):
    """Writes -Ṗ of P now; P (A, B) (n + 1, n + 2) is scratch."""
    size = len(now)
    last = size - 1  # The last rows of A and B are zero.
    pulls = turned[:, size]
    for i in range(size):
        row = turned[i]
        row[:] = 0.0
        for m in range(last):
            factor = now[i, m]
            row[size] += factor * push[m]
            for j in range(size):
                row[j] += factor * steady[m, j]
    for i in range(size):
        pull = pulls[i] / rate_weight
        for j in range(size):
            both = turned[i, j] + turned[j, i]
            total = weight[i, j] + both
            slope[i, j] = total - pull * pulls[j]


@machine_code
def integrate_back(steady, push, weight, rate_weight, step, cost):
    """Integrates P back by Runge-Kutta steps that span two intervals of the path.

    Args:
        steady: (2 M + 1, n + 1, n + 1) A.
        push: (2 M + 1, n + 1) B.
        weight: (n + 1, n + 1) W.
        rate_weight: R.
        step: between the times of P [s].
        cost: (M + 1, n + 1, n + 1) P; the last is given, the others are written.
    """
    turned = np.empty((len(weight), len(weight) + 1))
    slope = np.empty(weight.shape)
    for k in range(len(cost) - 1, 0, -1):
        now = cost[k]
        total = cost[k].copy()
        for stage in range(4):
            at = 2 * k - (stage + 1) // 2
            given = steady[at], push[at], weight, rate_weight
            _write_slope(now, *given, turned, slope)
            share = step / 3.0
            if stage in (0, 3):
                share = step / 6.0
            ahead = step
            if stage < 2:
                ahead = 0.5 * step
            total += share * slope
            now = cost[k] + ahead * slope
        # Rounding would lose symmetry slowly.
        both = total + total.T
        cost[k - 1] = 0.5 * both
