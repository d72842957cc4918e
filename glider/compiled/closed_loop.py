"""Batches of gliders under feedback."""

import numpy as np

from glider.compiled.constants import BLOCK
from glider.compiled.rollouts import slopes
from glider.physics.servo import limited_rate


def feed_back(row, offset, gain, error, work):
    """Writes into work[n, 1] the commands for states that are seen with an error."""
    n = work.shape[0] - 1
    for j in range(BLOCK):
        work[n, 1, j] = offset[row]
    for i in range(gain.shape[1]):
        for j in range(BLOCK):
            work[n, 1, j] -= gain[row, i] * (work[i, 0, j] + error[i, j])


def approach(wire, work, near):
    """Lowers near[2], the least squared distances from the wire, by one segment.

    It leads from near[:2] to the positions in work.
    """
    for j in range(BLOCK):
        from_x, from_z = near[0, j] - wire[0], near[1, j] - wire[1]
        along_x, along_z = work[0, 0, j] - near[0, j], work[1, 0, j] - near[1, j]
        square = along_x * along_x + along_z * along_z + 1e-300
        share = -(from_x * along_x + from_z * along_z) / square
        share = min(max(share, 0.0), 1.0)
        x, z = from_x + share * along_x, from_z + share * along_z
        near[2, j] = min(near[2, j], x * x + z * z)


def guided_step(k, work, step, offset, gain, hold, error, limits, p, c, field):
    """Advances the states work[:n, 0] by step k; work[n, 1] holds the commands."""
    n = work.shape[0] - 1
    for i in range(n):
        for j in range(BLOCK):
            work[i, 2, j] = work[i, 0, j]
            work[i, 3, j] = work[i, 0, j]
    for stage in range(4):
        weight = 1.0 / 6.0 if stage in (0, 3) else 1.0 / 3.0
        half = (stage + 1) // 2
        ahead = 0.5 * step if stage < 2 else step
        if hold == 0:
            feed_back(2 * k + half, offset, gain, error, work)
        for j in range(BLOCK):
            work[n, 0, j] = limited_rate(
                work[n, 1, j], work[3, 0, j], limits[0], limits[1], limits[2]
            )
        slopes(step * (k + 0.5 * half), work, p, c, field)
        for i in range(n):
            for j in range(BLOCK):
                work[i, 3, j] += step * weight * work[i, 1, j]
                work[i, 0, j] = work[i, 2, j] + ahead * work[i, 1, j]
    for i in range(n):
        for j in range(BLOCK):
            work[i, 0, j] = work[i, 3, j]


def guided(
    start,
    steps,
    step,
    offset,
    gain,
    hold,
    noise,
    limits,
    wire,
    p,
    c,
    field,
    miss,
    states,
):
    """Flies a batch of gliders under the feedback u = offset - gain x.

    Blocks as in `rollouts`. The servo's `limited_rate` lies between command and
    glider.

    Args:
        start: (B, n) states at launch.
        steps: their number, N.
        step: [s].
        offset: (2 N + 1,) at the steps and half steps, or with a hold (H,), one
            for each command [rad/s].
        gain: (2 N + 1, m) or (H, m); the first m states are fed back.
        hold: number of steps that a command is held; 0 for none.
        noise: (B, H, m) added to the states fed back; (B, 0, m) for none.
        limits: elevator's lower and upper stop [rad], rate limit [rad/s].
        wire: (x, z) [m].
        p, c, field: as in `derivatives`.
        miss: (B,), written: least distance of the path from the wire, by
            straight segments between the steps [m].
        states: (B, N + 1, n), written; or (B, 1, n) to keep only the last.
    """
    batch, n = start.shape
    keep = states.shape[1] > 1
    p = (p[0], p[1], p[2], p[3], p[4], p[5], p[6], p[7], p[8])
    work = np.empty((n + 1, 4, BLOCK))
    error = np.zeros((gain.shape[1], BLOCK))
    near = np.empty((3, BLOCK))
    path = np.empty((steps if keep else 1, n, BLOCK))
    for first in range(0, batch, BLOCK):
        count = min(BLOCK, batch - first)
        for j in range(BLOCK):  # What is left of the last block repeats a glider.
            for i in range(n):
                work[i, 0, j] = start[first + min(j, count - 1), i]
            near[2, j] = np.inf
        for k in range(steps):
            for i in range(2):
                near[i] = work[i, 0]
            if hold > 0 and k % hold == 0:
                if noise.shape[1] > 0:
                    for j in range(BLOCK):
                        for i in range(gain.shape[1]):
                            row = first + min(j, count - 1)
                            error[i, j] = noise[row, k // hold, i]
                feed_back(k // hold, offset, gain, error, work)
            guided_step(k, work, step, offset, gain, hold, error, limits, p, c, field)
            approach(wire, work, near)
            if keep:
                path[k] = work[:n, 0]
        if not keep:
            path[0] = work[:n, 0]
        for j in range(count):
            miss[first + j] = np.sqrt(near[2, j])
            if keep:
                states[first + j, 0] = start[first + j]
            for k in range(path.shape[0]):
                for i in range(n):
                    states[first + j, k + keep, i] = path[k, i, j]


LOOPS = (slopes, feed_back, approach, guided_step, guided)
ENTRIES = (guided,)
USES = ()
