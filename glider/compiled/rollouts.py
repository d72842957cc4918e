"""Batches of gliders under command tapes."""

import numpy as np

from glider.compiled.kernel import Family
from glider.compiled.runge_kutta import BLOCK, advance_block, put
from glider.physics.chain import derivatives


def slopes(t, node, work, theta):
    """Writes into work[:n, 1] the derivatives of the states work[:n, 0].

    work[n, 0] holds the commands.
    """
    n = work.shape[0] - 1
    for j in range(BLOCK):
        d = derivatives(t, work[:, 0, j], work[n, 0, j], 0.0, 0.0, theta)
        for i in range(len(d)):
            work[i, 1, j] = d[i]


def rollouts(start, command, step, order, laps, theta, states):
    """Flies a batch of gliders under command tapes in still air.

    Gliders go in blocks, and of a block all take a step before any takes the
    next: so the compiler puts several gliders into one instruction. For that it
    must see that nothing overlaps, hence one work array of a fixed width.

    Args:
        start: (B, n) states at launch.
        command: (B, N) elevator-rate commands, each held for one step [rad/s].
        step: [s].
        order: 1 for explicit Euler, 4 for classical Runge-Kutta.
        laps: equal steps of the integrator to one of them.
        theta: the gliders' numbers.
        states: (B, N + 1, n), written.
    """
    batch, n = start.shape
    steps = command.shape[1]
    work = np.empty((n + 1, 4, BLOCK), start.dtype)
    path = np.empty((steps, n, BLOCK), start.dtype)
    for first in range(0, batch, BLOCK):
        count = min(BLOCK, batch - first)
        for j in range(BLOCK):  # What is left of the last block repeats a glider.
            for i in range(n):
                work[i, 0, j] = start[first + min(j, count - 1), i]
        for k in range(steps):
            for j in range(BLOCK):
                work[n, 0, j] = command[first + min(j, count - 1), k]
            for lap in range(laps):
                t = (k + lap / laps) * step
                advance_block(slopes, t, work, step / laps, order, theta)
            for i in range(n):
                put(work[i, 0], path[k, i])
        for j in range(count):
            put(start[first + j], states[first + j, 0])
            for k in range(steps):
                for i in range(n):
                    states[first + j, k + 1, i] = path[k, i, j]


LOOPS = Family((slopes, rollouts), (rollouts,))
