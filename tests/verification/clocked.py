"""A funnel of held commands, to try what is proven of them on."""

import dataclasses

import numpy as np
from scipy.interpolate import CubicSpline

from glider.verification.dynamics.moving_center import make_moving_center
from glider.verification.dynamics.nominal import make_nominal
from glider.verification.funnel.clock import (
    BEND_ROOM,
    bend_sizes,
    command_errors,
    effect_of_hold,
    undo_hold,
)
from glider.verification.funnel.funnel import Funnel, funnel_policy
from glider.verification.funnel.servo_limits import steepest_gains

PERIOD, ERROR, WIND = 0.02, 0.05, 0.02


def make_clocked(proven):
    """A funnel of held commands along a shipped one's flight; not a certificate."""
    policy = funnel_policy(proven)
    nominal = make_nominal(proven.nominal.model, policy, 0.0045, PERIOD)
    times, last = nominal.times, len(nominal.times) - 1
    S = 2.0 * proven.shape(times)
    for k in np.append(np.flatnonzero(np.diff(times) == 0.0), last):
        first = nominal.starts[k]
        toward = effect_of_hold(nominal, first, k) / PERIOD
        undo_hold(nominal, first, k, steepest_gains(S[k], toward, 5.0, 40.0))
    S[np.flatnonzero(np.diff(times) == 0.0)] *= 1.0 + 1e-9
    holds = np.split(np.arange(last + 1), nominal.samples[1:])
    slopes = [CubicSpline(times[k], S[k])(times[k], 1) for k in holds]

    def along(values):
        curve = CubicSpline(proven.nominal.times, values)
        return np.maximum(curve(times), 0.0)

    beta, focus = along(proven.beta), 0.0 * S
    nominal = dataclasses.replace(nominal)
    settings = dataclasses.replace(
        proven.settings,
        period=PERIOD,
        elevator_gain=40.0,
        command_error=ERROR,
        wind=WIND,
    )
    rests = command_errors(nominal, S, np.arange(last + 1), settings, beta, focus)
    return Funnel(
        nominal=nominal,
        gliders=make_moving_center(nominal),
        S=S,
        slopes=np.concatenate(slopes),
        settings=settings,
        grams=np.zeros((last + 1, proven.grams.shape[1])),
        solver="none",
        seconds=0.0,
        beta=beta,
        weights=along(proven.weights),
        focus=focus,
        push_weights=np.ones((last + 1, 2)),
        errors=rests + BEND_ROOM * bend_sizes(S, nominal.bends),
        rests=rests,
    )


def part(clocked, holds):
    """The first holds of it."""
    starts = clocked.nominal.samples
    return clocked.between(0, starts[holds] - 1)


def changed(funnel, name, where, factor=1.0, more=0.0):
    """The same with one of its nominal's arrays changed at some times."""
    values = getattr(funnel.nominal, name).copy()
    values[where] = factor * values[where] + more
    nominal = dataclasses.replace(funnel.nominal, **{name: values})
    return dataclasses.replace(funnel, nominal=nominal)
