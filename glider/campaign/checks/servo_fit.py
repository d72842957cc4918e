"""The servo that a campaign's elevators follow, and what they do beside it.

The measured angles of all flights are compared with the exact path of a servo behind
the logged commands. Where what is left of them is noise, the servo is as specified;
else its delay and lag are fitted, and then its limits, and forms that are not even: a
lag of one way, a lag or a rate that depends on the load, free play, commands that are
lost or rounded. The form that makes the angles most likely is named, if it leaves less
than half of what a delay and a lag do. Flights are replayed with what a servo of a
delay, a lag and limits does not do, so that the aerodynamics are traced along the
measured elevator; so they are with departures that no form explains.
"""

import dataclasses
import math
from collections.abc import Mapping, Sequence

import numpy as np

from glider.campaign.checks.masks import Masks
from glider.campaign.checks.servo import Elevator, LateServo, measure_elevators
from glider.campaign.checks.servo_forms import (
    LEAST_EVIDENCE,
    ORDER,
    Fit,
    find_step,
    fit_servo,
    follow_from_rest,
    least_step,
    restore_lost,
    with_loads,
)
from glider.campaign.logs import Campaign, Departure
from glider.campaign.smoothing import smoothing_maps
from glider.physics.parameters import MAX_ANGLE
from glider.physics.servo import Servo

_ERROR_SCALE = 1.5
"""Ratio of a departure's error to its standard error as a Gaussian process: 0.6 to 1.4,
as departures are uneven (bench_departures)."""
_FEWEST_ROWS = 10  # Of a flight whose departure can be smoothed.
_FEWEST_LEVELS = 10  # Of commands that are rounded, not chosen.
_LIMITS = ("low",), ("high",), ("rate",), ("low", "high"), ("low", "high", "rate")
"""Limits that a servo may have of its own: the first that explain the elevators."""
_UNEVEN: dict[tuple[str, ...], str] = {
    ("skew",): (
        "lags by {up:.3g} ms turning up and by {down:.3g} ms turning down "
        "(± {apart:.1g} apart)"
    ),
    ("lag_by_load",): (
        "has a lag that grows with the load of the air, from {lag:.3g} to "
        "{loaded:.3g} ± {loaded_std:.1g} ms"
    ),
    ("rate", "rate_by_load"): (
        "has a rate limit that falls with the load of the air, from {rate:.3g} to "
        "{weak:.3g} ± {weak_std:.1g} rad/s"
    ),
    ("play",): "has a free play of {value:.3g} ± {std:.1g} rad",
    ("slew",): "catches up with its commands by {value:.3g} ± {std:.1g} rad/s at most",
}
"""What may make a servo uneven, and the words for it."""
_LAGGING = ("skew",), ("lag_by_load",), ("rate", "rate_by_load")
"""Those that are most like a delay and a lag, which remain effects to be traced."""
_UNKNOWN = (
    ", whatever its delay, lag and limits: are commands lost or rounded, has it play, "
    "or another lag under load?"
)
_SURELY = 5.0  # Standard errors of what is not by chance, whatever is tried.
_MOSTLY = 0.5  # Share of a departure's evidence that its cause may leave.


def identify_servo(
    campaign: Campaign, masks: Mapping[str, Masks]
) -> tuple[Campaign, tuple[str, ...]]:
    """Compares the measured elevators of a campaign with its servo.

    Signs must be right. Returns the campaign with the limits that the servo shows and
    with the departures of elevators from it, and a sentence for each.
    """
    log = campaign.servo
    if log.angle != "measured" or log.command == "reconstructed":
        return campaign, ()
    elevators = _measure(campaign, masks)
    specified = LateServo(*campaign.limits)
    if not elevators or Fit(servo=specified, elevators=elevators).explains:
        return campaign, ()
    plain = fit_servo(elevators, specified, log.command_std)
    found = _find_cause(campaign, masks, plain)
    told: tuple[str, ...] = ()
    if found.free and {*found.free} <= {*Servo._fields}:
        campaign, told = _with_limits(campaign, found.servo.limits)
        plain = found
        if found.explains:
            return campaign, told
    elif plain.explains and not found.cause:
        return campaign, ()  # A delay and a lag are effects to be traced.
    if found.servo == found.servo.even:  # A few flights may be odd, or lose commands.
        places = range(len(elevators))
        odd = [place for place in places if not plain.on([place]).explains]
        others = [place for place in places if place not in odd]
        if odd and others and plain.on(others).explains:
            plain, found = plain.on(odd), found.on(odd)
    changed, sentence = _with_departures(campaign, plain, found)
    return changed, (*told, sentence)


def measure_elevator_noise(campaign: Campaign, masks: Mapping[str, Masks]) -> float:
    """Returns the noise of the logged elevators [rad], 0 without any."""
    elevators = _measure(campaign, masks)
    if not elevators:
        return 0.0
    specified = LateServo(*campaign.limits)
    return Fit(servo=specified, elevators=elevators).departures.noise


def _measure(campaign: Campaign, masks: Mapping[str, Masks]) -> list[Elevator]:
    """Elevators of flights with enough rows, behind commands by their clock."""
    elevators = measure_elevators(campaign, masks)
    return [each for each in elevators if len(each.rows) >= _FEWEST_ROWS]


def _find_cause(campaign: Campaign, masks: Mapping[str, Masks], plain: Fit) -> Fit:
    """Finds what explains most of the departures from a plain servo.

    It is the plain servo where nothing does.
    """
    command_std = campaign.servo.command_std
    even = plain
    if not plain.explains:
        limited = []
        for free in _LIMITS:
            limited.append(fit_servo(plain.elevators, plain.servo, command_std, free))
            if limited[-1].explains:
                break
        even = _better(plain, limited[-1:] if limited[-1].explains else limited)
    loaded = with_loads(campaign, masks, plain.elevators)
    causes = []
    for form in _UNEVEN:
        fit = fit_servo(loaded, plain.servo, command_std, form)
        if abs(getattr(fit.servo, form[-1])) > _SURELY * fit.std:
            causes.append(dataclasses.replace(fit, cause=_describe(fit)))
    if not any(fit.explains for fit in (even, *causes)):
        causes += [restore_lost(plain, command_std), find_step(plain, command_std)]
    return _better(even, causes)


def _better(before: Fit, others: Sequence[Fit]) -> Fit:
    """The likeliest of others, if it explains most of what the one before leaves."""
    best = max(others, key=lambda fit: fit.likelihood, default=before)
    most = max(_MOSTLY * before.departures.evidence, LEAST_EVIDENCE)
    gain = best.likelihood - before.likelihood
    return best if gain > LEAST_EVIDENCE and best.departures.evidence < most else before


def _describe(fit: Fit) -> str:
    """Says how a servo is not even."""
    servo = fit.servo
    value = getattr(servo, fit.free[-1])
    lag = 1e3 * servo.lag
    rate = servo.rate
    return _UNEVEN[fit.free].format(
        value=value,
        std=fit.std,
        lag=lag,
        up=lag * (1.0 + servo.skew),
        down=lag * (1.0 - servo.skew),
        apart=2.0 * lag * fit.std,
        loaded=lag + 1e3 * value,
        loaded_std=1e3 * fit.std,
        rate=rate,
        weak=rate * (1.0 - value),
        weak_std=rate * fit.std,
    )


def _logged_step(fit: Fit) -> float:
    """Step that logged commands are rounded to [rad/s]; 0 where it explains nothing."""
    commands = np.concatenate([each.tape.commands for each in fit.elevators])
    levels = np.unique(np.abs(commands))
    if len(levels) < _FEWEST_LEVELS:
        return 0.0
    step = float(np.min(np.diff(levels)))
    off = np.abs(levels / step - np.round(levels / step))
    return step if np.max(off) < 0.01 and step > least_step(fit) else 0.0


def _with_limits(campaign: Campaign, servo: Servo) -> tuple[Campaign, tuple[str, ...]]:
    """Returns the campaign with other limits of the servo, and how they differ."""
    words = (
        "The servo stops at {:.3g} and {:.3g} rad and turns by {:.3g} rad/s at most, "
        "where 'elevator_limits' and 'elevator_rate_limit' say {:.3g}, {:.3g} and "
        "{:.3g}: its own limits are used."
    ).format(*servo, *campaign.limits)
    low, high = np.clip(servo[:2], -MAX_ANGLE, MAX_ANGLE).tolist()
    stops = (low, high) if np.isfinite(servo[:2]).any() else None
    changed = dataclasses.replace(
        campaign,
        elevator_limits=stops,
        elevator_rate_limit=servo.rate if math.isfinite(servo.rate) else None,
    )
    return changed, (words,)


def _with_departures(
    campaign: Campaign, plain: Fit, uneven: Fit
) -> tuple[Campaign, str]:
    """Returns the campaign with its elevators' departures from a plain servo.

    Without a cause, an uneven servo is the same.
    """
    servo = plain.servo
    cause = uneven.cause
    if cause and uneven.free not in _LAGGING:
        servo = LateServo(*servo.limits, *uneven.servo[3:5])
    found = uneven.departures
    times = {flight.name: flight.time for flight in campaign.flights}
    departures = {}
    shares = []
    for told, each in zip(plain.elevators, uneven.elevators, strict=True):
        time = times[each.name]
        rest, expected = follow_from_rest(each, uneven.servo)
        known = np.clip(time, each.seen[0], each.seen[-1])
        smoothed = smoothing_maps(each.seen, known, found.ratio, ORDER)[0]
        shares.append(np.mean(np.max(smoothed, axis=1)))
        curve = (
            smoothed @ (each.angle - expected)
            + each.follow(time, uneven.servo, rest)
            - told.follow(time, servo, rest)
        )
        departures[each.name] = Departure(curve, rest, 0.0, bool(cause))
    std = min(_ERROR_SCALE * math.sqrt(np.mean(shares)), 1.0) * found.noise
    flights = []
    for flight in campaign.flights:
        own = departures.get(flight.name)
        own = own and own._replace(std=std)
        flights.append(dataclasses.replace(flight, departure=own))
    sizes = {name: np.abs(own.angle) for name, own in departures.items()}
    worst = max(sizes, key=lambda name: float(np.max(sizes[name])))
    row = np.argmax(sizes[worst])
    rms = math.sqrt(np.mean([np.var(own.angle) for own in departures.values()]))
    if step := 0.0 if cause else _logged_step(plain):
        cause = f"has a log that rounds commands, in steps of {step:.3g} rad/s"
    beginning = f"The servo {cause}. " if cause else ""
    ending = "." if cause else _UNKNOWN
    sentence = (
        f"{beginning}The elevator departs from its commands by {1e3 * rms:.2g} mrad "
        f"(RMS; its noise is {1e3 * found.noise:.2g}), in {worst} by "
        f"{sizes[worst][row]:.2g} rad at {times[worst][row]:.3g} s{ending} "
        "Flights are replayed along the measured elevator."
    )
    return dataclasses.replace(campaign, flights=tuple(flights)), sentence
