"""A second integrator of flights, in NumPy, to check the compiled loop with."""

import numpy as np

from glider.physics.servo import STOPPING_TIME


def rates_of(model, states, command, wind=None, theta=None):
    """Returns ẋ (B, n) of gliders under commands (B,), servo limits included.

    The wind (B, 2) is that beyond the model's own [m/s]; theta has other numbers than
    the model's own.
    """
    numbers = theta or model.numbers
    servo = model.parameters.servo
    angle = model.chain.demanded_angle(states.T, numbers.c)
    top = np.clip((servo.high - angle) / STOPPING_TIME, -servo.rate, servo.rate)
    bottom = np.maximum((servo.low - angle) / STOPPING_TIME, -servo.rate)
    rate = np.clip(command, np.minimum(bottom, top), top)
    air = (0.0, 0.0) if wind is None else (wind[:, 0], wind[:, 1])
    found = model.chain.derivatives(0.0, list(states.T), rate, *air, numbers)
    return np.stack([np.broadcast_to(d, len(states)) for d in found], axis=1)


def advance(rates, states, step):
    """Returns states (B, n) one Runge-Kutta step, a number or (B, 1), later.

    `rates` are ẋ of states and of the time since the step began.
    """
    half = 0.5 * step
    k1 = rates(states, 0.0 * step)
    k2 = rates(states + half * k1, half)
    k3 = rates(states + half * k2, half)
    k4 = rates(states + step * k3, step)
    return states + step / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
