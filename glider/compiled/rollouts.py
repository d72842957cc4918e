"""Batches of gliders under command tapes."""

import numpy as np

from glider.compiled.constants import BLOCK
from glider.physics.chain import derivatives


def slopes(t, work, p, c, field):
    """Writes into work[:n, 1] the derivatives of the states work[:n, 0].

    work[n, 0] holds the commands.
    """
    n = work.shape[0] - 1
    for j in range(BLOCK):
        d = derivatives(t, work[:, 0, j], work[n, 0, j], 0.0, 0.0, p, c, field)
        for i in range(len(d)):
            work[i, 1, j] = d[i]


def runge_kutta_block(t, work, step, p, c, field):
    """Advances the states work[:n, 0] by one step; work[:, 1:] is scratch."""
    n = work.shape[0] - 1
    for i in range(n):
        for j in range(BLOCK):
            work[i, 2, j] = work[i, 0, j]
            work[i, 3, j] = work[i, 0, j]
    for stage in range(4):
        weight = 1.0 / 6.0 if stage in (0, 3) else 1.0 / 3.0
        offset = 0.0 if stage == 0 else (step if stage == 3 else 0.5 * step)
        ahead = 0.5 * step if stage < 2 else step
        slopes(t + offset, work, p, c, field)
        for i in range(n):
            for j in range(BLOCK):
                work[i, 3, j] += step * weight * work[i, 1, j]
                work[i, 0, j] = work[i, 2, j] + ahead * work[i, 1, j]
    for i in range(n):
        for j in range(BLOCK):
            work[i, 0, j] = work[i, 3, j]


def rollouts(start, command, step, p, c, field, order, states):
    """Flies a batch of gliders under command tapes in still air.

    Gliders go in blocks, and of a block all take a step before any takes the
    next: so the compiler puts several gliders into one instruction. For that it
    must see that nothing overlaps, hence one work array of a fixed width and
    parameters as a tuple.

    Args:
        start: (B, n) states at launch.
        command: (B, N) elevator-rate commands, each held for one step [rad/s].
        step: [s].
        p, c, field: as in `derivatives`.
        order: 1 for explicit Euler, 4 for classical Runge-Kutta.
        states: (B, N + 1, n), written; or (B, 1, n) to keep only the last.
    """
    batch, n = start.shape
    steps = command.shape[1]
    keep = states.shape[1] > 1
    p = (p[0], p[1], p[2], p[3], p[4], p[5], p[6], p[7], p[8])
    work = np.empty((n + 1, 4, BLOCK), start.dtype)
    path = np.empty((steps if keep else 1, n, BLOCK), start.dtype)
    for first in range(0, batch, BLOCK):
        count = min(BLOCK, batch - first)
        for j in range(BLOCK):  # What is left of the last block repeats a glider.
            for i in range(n):
                work[i, 0, j] = start[first + min(j, count - 1), i]
        for k in range(steps):
            for j in range(BLOCK):
                work[n, 0, j] = command[first + min(j, count - 1), k]
            if order == 1:
                slopes(k * step, work, p, c, field)
                for i in range(n):
                    for j in range(BLOCK):
                        work[i, 0, j] += step * work[i, 1, j]
            else:
                runge_kutta_block(k * step, work, step, p, c, field)
            if keep:
                path[k] = work[:n, 0]
        if not keep:
            path[0] = work[:n, 0]
        for j in range(count):
            if keep:
                states[first + j, 0] = start[first + j]
            for k in range(path.shape[0]):
                for i in range(n):
                    states[first + j, k + keep, i] = path[k, i, j]


LOOPS = (slopes, runge_kutta_block, rollouts)
ENTRIES = (rollouts,)
USES = ()
