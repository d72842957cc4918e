"""One step of an ordinary differential equation: Euler's or the classical Runge-Kutta.

Written once for a single state, which may be of any kind of number, and once for a
block of gliders side by side, whose inner loops the compiler turns into instructions
that serve several gliders (half the time of one after the other). And what else the
compiled loops share: their text begins with this module's.
"""

DIFFERENCE = 1e-6
"""Step of the finite differences, in a coefficient's own scale."""

TINY = 1e-30
"""Length of the complex steps."""

BLOCK = 32
"""Number of gliders that fly side by side, so that one instruction serves several."""


def put(source, target):
    """Writes one row of numbers into another of its length.

    `target[:] = source` does too, but costs the compiler three seconds: it brings in
    all of Python's strings, for a message about lengths that differ.
    """
    for i in range(target.shape[0]):
        target[i] = source[i]


def advance(slope, t, x, step, order, data, work):
    """Advances x (n,) in place by one step of ẋ = f(t, x).

    Plain Python as well as compiled code.

    Args:
        slope: ``slope(t, node, x, data, rate)`` writes f (n,) into rate and may not
            keep x; the node counts half steps: 0 at the start, 1 in the middle, 2 at
            the end.
        t: [s].
        x: (n,), written.
        step: [s].
        order: 1 for explicit Euler, 4 for classical Runge-Kutta.
        data: handed to slope.
        work: (3, n) scratch.
    """
    start = work[0]
    total = work[1]
    rate = work[2]
    n = x.shape[0]
    for i in range(n):
        start[i] = x[i]
        total[i] = x[i]
    for stage in range(order):
        node = (stage + 1) // 2
        slope(t + 0.5 * step * node, node, x, data, rate)
        share = step / 6.0 if stage in (0, 3) else step / 3.0
        if order == 1:
            share = step
        ahead = 0.5 * step if stage < 2 else step
        for i in range(n):
            total[i] += share * rate[i]
            x[i] = start[i] + ahead * rate[i]
    for i in range(n):
        x[i] = total[i]


def advance_block(slope, t, work, step, order, data):
    """Advances a block of states work[:n, 0] by one step, as `advance` does.

    Args:
        slope: ``slope(t, node, work, data)`` writes into work[:n, 1] the derivatives
            of work[:n, 0]; work[n] is its own.
        t: [s].
        work: (n + 1, 4, BLOCK); work[:n, 1:] is scratch.
        step: [s].
        order: 1 or 4.
        data: handed to slope.
    """
    n = work.shape[0] - 1
    for i in range(n):
        for j in range(BLOCK):
            work[i, 2, j] = work[i, 0, j]
            work[i, 3, j] = work[i, 0, j]
    for stage in range(order):
        node = (stage + 1) // 2
        slope(t + 0.5 * step * node, node, work, data)
        weight = 1.0 / 6.0 if stage in (0, 3) else 1.0 / 3.0
        if order == 1:
            weight = 1.0
        ahead = 0.5 * step if stage < 2 else step
        for i in range(n):
            for j in range(BLOCK):
                work[i, 3, j] += step * weight * work[i, 1, j]
                work[i, 0, j] = work[i, 2, j] + ahead * work[i, 1, j]
    for i in range(n):
        for j in range(BLOCK):
            work[i, 0, j] = work[i, 3, j]
