"""The loop that flies gliders: batches under a feedback, which may be a tape.

Gliders go in blocks, and of a block all take a step before any takes the next: so the
compiler puts several gliders into one instruction. For that it must see that nothing
overlaps, hence one work array of a fixed width.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from glider.compiled.kernel import Family
from glider.compiled.runge_kutta import BLOCK, advance_block, put
from glider.physics.chain import demanded_angle, derivatives
from glider.physics.model import GliderModel
from glider.physics.servo import NO_LIMITS, Servo, limited_rate, rate_bounds


def _feed_back(row, first, feedback, work):
    """Writes into work[n, 1] the commands for the states work[:n, 0].

    Args:
        row: of the feedback's table.
        first: index of the block's first glider.
        feedback: see `Feedback`.
        work: of the block, see `slopes_held`.
    """
    n = work.shape[0] - 1
    fed = feedback.gain.shape[2]
    tables = feedback.offset.shape[0]
    if tables == 1:
        for j in range(BLOCK):
            work[n, 1, j] = feedback.offset[0, row]
        for i in range(fed):
            for j in range(BLOCK):
                work[n, 1, j] -= feedback.gain[0, row, i] * work[i, 0, j]
    else:
        for j in range(BLOCK):
            own = min(first + j, tables - 1)
            work[n, 1, j] = feedback.offset[own, row]
            for i in range(fed):
                work[n, 1, j] -= feedback.gain[own, row, i] * work[i, 0, j]


def slopes_held(t, node, work, data):
    """Writes into work[:n, 1] the derivatives of the states work[:n, 0].

    Between the command, work[n, 1], and the elevator's rate, work[n, 0], lies the
    servo's `limited_rate`, unless the command is cut to what the servo follows. Few
    arrays are handed over: references to each are counted at every stage.
    """
    cut, servo, theta = data
    n = work.shape[0] - 1
    if cut:
        put(work[n, 1], work[n, 0])
    else:
        for j in range(BLOCK):
            angle = demanded_angle(work[:, 0, j], theta.c)
            work[n, 0, j] = limited_rate(work[n, 1, j], angle, servo)
    for j in range(BLOCK):
        d = derivatives(t, work[:, 0, j], work[n, 0, j], 0.0, 0.0, theta)
        for i in range(len(d)):
            work[i, 1, j] = d[i]


def slopes_guided(t, node, work, data):
    """Writes the derivatives under commands that follow the state at once."""
    k, first, feedback, servo, theta = data
    _feed_back(2 * k + node, first, feedback, work)
    slopes_held(t, node, work, (False, servo, theta))


def _approach(wire, before, work, nearest, arrival):
    """Lowers the least squared distances from the wire by one segment of the path.

    Args:
        wire: (x, z) [m].
        before: (n, BLOCK) states where the segment begins.
        work: work[:n, 0] where it ends.
        nearest: (BLOCK,) least squared distances so far, lowered [m²].
        arrival: (n, BLOCK) states there, written with them.
    """
    for j in range(BLOCK):
        from_x = before[0, j] - wire[0]
        from_z = before[1, j] - wire[1]
        along_x = work[0, 0, j] - before[0, j]
        along_z = work[1, 0, j] - before[1, j]
        square = along_x * along_x + along_z * along_z + 1e-300
        share = -(from_x * along_x + from_z * along_z) / square
        share = min(max(share, 0.0), 1.0)
        x = from_x + share * along_x
        z = from_z + share * along_z
        if x * x + z * z < nearest[j]:
            nearest[j] = x * x + z * z
            for i in range(before.shape[0]):
                arrival[i, j] = before[i, j] + share * (work[i, 0, j] - before[i, j])


def flights(start, steps, feedback, servo, wire, theta, found):
    """Flies a batch of gliders.

    Args:
        start: (B, n) states at launch, or (1, n).
        steps: see `Steps`.
        feedback: see `Feedback`.
        servo: its limits.
        wire: (x, z) [m].
        theta: the glider's numbers.
        found: written, see `Flown`.
    """
    batch = found.states.shape[0]
    n = start.shape[1]
    hold = feedback.hold
    passes_wire = found.miss.shape[0] > 0
    work = np.empty((n + 1, 4, BLOCK))
    before = np.empty((n, BLOCK))
    nearest = np.empty(BLOCK)
    arrival = np.empty((n, BLOCK))
    path = np.empty((found.states.shape[1], n, BLOCK))
    for first in range(0, batch, BLOCK):
        count = min(BLOCK, batch - first)
        for j in range(BLOCK):  # What is left of the last block repeats a glider.
            launch = min(first + j, start.shape[0] - 1)
            for i in range(n):
                work[i, 0, j] = start[launch, i]
        for i in range(n):
            put(work[i, 0], path[0, i])
        nearest[:] = np.inf
        arrival[:] = np.nan
        for k in range(steps.number):
            if passes_wire:
                for i in range(n):
                    put(work[i, 0], before[i])
            if hold > 0 and k % hold == 0:
                _feed_back(k // hold, first, feedback, work)
                if feedback.cut:
                    for j in range(BLOCK):
                        angle = demanded_angle(work[:, 0, j], theta.c)
                        low, high = rate_bounds(angle, servo, hold * steps.length)
                        work[n, 1, j] = min(max(work[n, 1, j], low), high)
            step = steps.length
            t = step * k
            if hold > 0:
                held = (feedback.cut, servo, theta)
                advance_block(slopes_held, t, work, step, steps.order, held)
            else:
                guided = (k, first, feedback, servo, theta)
                advance_block(slopes_guided, t, work, step, steps.order, guided)
            if passes_wire:
                _approach(wire, before, work, nearest, arrival)
            if (k + 1) % steps.every == 0:
                for i in range(n):
                    put(work[i, 0], path[(k + 1) // steps.every, i])
        for j in range(count):
            for k in range(path.shape[0]):
                for i in range(n):
                    found.states[first + j, k, i] = path[k, i, j]
            if passes_wire:
                found.miss[first + j] = np.sqrt(nearest[j])
                for i in range(n):
                    found.arrivals[first + j, i] = arrival[i, j]


LOOPS = Family((_feed_back, slopes_held, slopes_guided, _approach, flights), (flights,))


class Steps(NamedTuple):
    """The steps of a flight.

    Attributes:
        number: N, how many they are.
        length: of each [s].
        order: 1 for explicit Euler, 4 for classical Runge-Kutta.
        every: number of steps from a state that is kept to the next.
    """

    number: int
    length: float
    order: int = 4
    every: int = 1


class Feedback(NamedTuple):
    """A feedback u = offset - gain x of N steps, as a table.

    One for all gliders, G = 1, or one for each.

    Attributes:
        offset: (G, 2 N + 1) at the steps and half steps, or with a hold (G, H), one for
            each command [rad/s].
        gain: (G, 2 N + 1, m) or (G, H, m); the first m states are fed back.
        hold: number of steps that a command is held; 0 where it follows at once.
        cut: whether a command is cut to what the servo follows while it is held; if
            not, the servo limits it at each moment.
    """

    offset: np.ndarray
    gain: np.ndarray
    hold: int
    cut: bool = False


def make_tape(commands: np.ndarray, hold: int = 1, cut: bool = False) -> Feedback:
    """Returns commands (G, H) [rad/s], each held for some steps, as a feedback."""
    return Feedback(commands, np.empty((*commands.shape, 0)), hold, cut)


def make_feedback(
    sample: Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]],
    steps: Steps,
    begin: ArrayLike = 0.0,
) -> Feedback:
    """Returns a feedback that acts at once, as a table.

    Args:
        sample: returns offset (J,) [rad/s] and gain (J, m) at times (J,) [s].
        steps: of the flight.
        begin: when it begins, or (G,) for each glider [s].
    """
    nodes = 0.5 * steps.length * np.arange(2 * steps.number + 1)
    times = np.reshape(begin, (-1, 1)) + nodes
    offset, gain = sample(times.ravel())
    return Feedback(offset.reshape(times.shape), gain.reshape(*times.shape, -1), 0)


class Flown(NamedTuple):
    """What a batch of gliders flew.

    Attributes:
        states: (B, K + 1, n) at the launch, and each that was kept.
        miss: (B,) least distance of the path from the wire, by straight segments
            between the steps [m]; (0,) without a wire.
        arrivals: (B, n) states there; NaN where no distance is finite.
    """

    states: np.ndarray
    miss: np.ndarray
    arrivals: np.ndarray


def fly_batch(
    model: GliderModel,
    starts: np.ndarray,
    steps: Steps,
    feedback: Feedback,
    *,
    servo: Servo | None = None,
    wire: Sequence[float] | None = None,
) -> Flown:
    """Flies launches of a glider.

    Args:
        model: the glider.
        starts: (B, n) states at launch, or (1, n).
        steps: of the flight.
        feedback: over these steps.
        servo: its limits; None for the model's.
        wire: (x, z) [m]; None where no distance is asked for.
    """
    n = starts.shape[1]
    batch = len(feedback.offset) if len(starts) == 1 else len(starts)
    passing = batch if wire is not None else 0
    found = Flown(
        states=np.empty((batch, steps.number // steps.every + 1, n)),
        miss=np.empty(passing),
        arrivals=np.empty((passing, n)),
    )
    x, z = (0.0, 0.0) if wire is None else wire
    offset = np.ascontiguousarray(feedback.offset)
    gain = np.ascontiguousarray(feedback.gain)
    LOOPS.over(model.kinds).flights(
        np.array(starts, dtype=float, order="C"),
        steps,
        feedback._replace(offset=offset, gain=gain),
        model.parameters.servo if servo is None else servo,
        (float(x), float(z)),
        model.numbers,
        found,
    )
    return found


def fly_tapes(
    model: GliderModel,
    starts: np.ndarray,
    commands: np.ndarray,
    step: float,
    order: int = 4,
    *,
    servo: Servo = NO_LIMITS,
) -> np.ndarray:
    """Returns states (B, N + 1, n) of a glider under tapes of commands in still air.

    Args:
        model: the glider.
        starts: (B, n) states at launch, or (1, n).
        commands: (B, N) elevator-rate commands, each held for a step [rad/s], and cut
            to what the servo follows.
        step: [s].
        order: 1 for explicit Euler, 4 for classical Runge-Kutta; a step is divided
            where the effects' own states ask for it.
        servo: its limits.
    """
    laps = model.count_laps(step, order)
    steps = Steps(commands.shape[1] * laps, step / laps, order, laps)
    tape = make_tape(commands, laps, cut=True)
    return fly_batch(model, starts, steps, tape, servo=servo).states
