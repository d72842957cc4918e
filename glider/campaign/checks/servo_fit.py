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
    errors_of,
    find_rest,
    find_step,
    fit_of,
    fit_servo,
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
_UNEVEN = (("skew",), ("lag_by_load",), ("rate", "rate_by_load"), ("play",), ("slew",))
"""What may make a servo uneven."""
_LAGGING = ("skew",), ("lag_by_load",), ("rate", "rate_by_load")
"""Those that are most like a delay and a lag, which remain effects to be traced."""
_UNKNOWN = (
    ", whatever its delay, lag and limits: are commands lost or rounded, has it play, "
    "or another lag under load?"
)
_Z = 5.0  # Standard errors of what is not by chance, whatever is tried.
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
    specified = LateServo(campaign.limits)
    if not elevators or fit_of(specified, elevators).explains:
        return campaign, ()
    plain = fit_servo(elevators, specified, log.command_std)
    found, words = _find_cause(campaign, masks, plain)
    told: tuple[str, ...] = ()
    if found.free and {*found.free} <= {*Servo._fields}:
        campaign, told = _with_limits(campaign, found.servo.limits)
        plain = found
        if found.explains:
            return campaign, told
    elif plain.explains and not words:  # A delay and a lag are effects to be traced.
        return campaign, ()
    places = range(len(elevators))
    if words and found.servo == found.servo.even:  # Other commands reach it in some.
        odd = [place for place in places if _has_other_commands(plain, found, place)]
        plain, found = plain.on(odd), found.on(odd)
    elif not words:  # A few flights may be odd: the others are left as they are.
        odd = [place for place in places if not plain.on([place]).explains]
        others = [place for place in places if place not in odd]
        if odd and others and plain.on(others).explains:
            plain, found = plain.on(odd), found.on(odd)
    changed, sentence = _with_departures(campaign, plain, found, words)
    return changed, (*told, sentence)


def measure_elevator_noise(campaign: Campaign, masks: Mapping[str, Masks]) -> float:
    """Returns the noise of the logged elevators [rad], 0 without any."""
    elevators = _measure(campaign, masks)
    if not elevators:
        return 0.0
    return fit_of(LateServo(campaign.limits), elevators).departures.noise


def _measure(campaign: Campaign, masks: Mapping[str, Masks]) -> list[Elevator]:
    """Elevators of flights with enough rows, behind commands by their clock."""
    elevators = measure_elevators(campaign, masks, at_rows=False)
    return [each for each in elevators if len(each.rows) >= _FEWEST_ROWS]


def _find_cause(
    campaign: Campaign, masks: Mapping[str, Masks], plain: Fit
) -> tuple[Fit, str]:
    """Finds what explains most of the departures from a plain servo, and its words.

    Limits have words of their own. It is the plain servo where nothing does.
    """
    clock_std = campaign.servo.command_std
    even = plain
    if not plain.explains:
        limited = []
        for free in _LIMITS:
            limited.append(fit_servo(plain.elevators, plain.servo, clock_std, free))
            if limited[-1].explains:
                break
        even = _better(plain, limited[-1:] if limited[-1].explains else limited)
    loaded = with_loads(campaign, masks, plain.elevators)
    causes = {}
    for free in _UNEVEN:
        fit = fit_servo(loaded, plain.servo, clock_std, free)
        value = getattr(fit.servo, free[-1])
        if abs(value) > _Z * fit.std:
            causes[fit] = _describe(fit, value)
    if not any(fit.explains for fit in (even, *causes)):
        lost, share = restore_lost(plain, clock_std)
        causes[lost] = f"loses about {100.0 * share:.2g} % of its commands"
        rounded, step = find_step(plain, clock_std)
        causes[rounded] = f"rounds its commands, in steps of {step:.3g} rad/s"
    best = _better(even, [*causes])
    return best, causes.get(best, "")


def _better(before: Fit, others: Sequence[Fit]) -> Fit:
    """The likeliest of others, if it explains most of what the one before leaves."""
    best = max(others, key=lambda fit: fit.likelihood, default=before)
    most = max(_MOSTLY * before.departures.evidence, LEAST_EVIDENCE)
    gain = best.likelihood - before.likelihood
    return best if gain > LEAST_EVIDENCE and best.departures.evidence < most else before


def _has_other_commands(plain: Fit, found: Fit, place: int) -> bool:
    logged = plain.elevators[place].tape
    return not np.array_equal(logged.commands, found.elevators[place].tape.commands)


def _describe(fit: Fit, value: float) -> str:
    """Says how a servo is not even."""
    servo = fit.servo
    lag = 1e3 * servo.lag
    std = fit.std
    match fit.free[-1]:
        case "skew":
            return (
                f"lags by {lag * (1.0 + value):.3g} ms turning up and by "
                f"{lag * (1.0 - value):.3g} ms turning down (± {2.0 * lag * std:.1g} "
                "apart)"
            )
        case "lag_by_load":
            return (
                f"has a lag that grows with the load of the air, from {lag:.3g} to "
                f"{lag + 1e3 * value:.3g} ± {1e3 * std:.1g} ms"
            )
        case "rate_by_load":
            rate = servo.limits.rate
            return (
                "has a rate limit that falls with the load of the air, from "
                f"{rate:.3g} to {rate * (1.0 - value):.3g} ± {rate * std:.1g} rad/s"
            )
        case "slew":
            return (
                f"catches up with its commands by {value:.3g} ± {std:.1g} rad/s at most"
            )
    return f"has a free play of {value:.3g} ± {std:.1g} rad"


def _logged_step(fit: Fit) -> float:
    """Step that logged commands are rounded to [rad/s]; 0 where it explains nothing."""
    commands = np.concatenate([each.tape.commands for each in fit.elevators])
    levels = np.unique(np.abs(commands))
    if len(levels) < _FEWEST_LEVELS:
        return 0.0
    step = float(np.min(np.diff(levels)))
    is_rounded = np.allclose(levels / step, np.round(levels / step), atol=0.01)
    return step if is_rounded and step > least_step(fit) else 0.0


def _with_limits(campaign: Campaign, servo: Servo) -> tuple[Campaign, tuple[str, ...]]:
    """Returns the campaign with other limits of the servo, and how they differ."""
    known = campaign.limits
    words = (
        f"The servo stops at {servo.low:.3g} and {servo.high:.3g} rad and turns by "
        f"{servo.rate:.3g} rad/s at most, where 'elevator_limits' and "
        f"'elevator_rate_limit' say {known.low:.3g}, {known.high:.3g} and "
        f"{known.rate:.3g}: its own limits are used."
    )
    stops = None
    if math.isfinite(servo.low) or math.isfinite(servo.high):
        stops = (max(servo.low, -MAX_ANGLE), min(servo.high, MAX_ANGLE))
    changed = dataclasses.replace(
        campaign,
        elevator_limits=stops,
        elevator_rate_limit=servo.rate if math.isfinite(servo.rate) else None,
    )
    return changed, (words,)


def _with_departures(
    campaign: Campaign, plain: Fit, uneven: Fit, cause: str
) -> tuple[Campaign, str]:
    """Returns the campaign with its elevators' departures from a plain servo.

    Without a cause, an uneven servo is the same.
    """
    servo = plain.servo
    if cause and uneven.free not in _LAGGING:
        servo = uneven.servo.even._replace(limits=servo.limits)
    found = uneven.departures
    times = {flight.name: flight.time for flight in campaign.flights}
    curves = {}
    shares = []
    departures = {}
    for told, each in zip(plain.elevators, uneven.elevators, strict=True):
        clock = times[each.name]
        query = np.append(clock, each.seen)
        query = np.clip(query, each.seen[0], each.seen[-1])
        smoothed = smoothing_maps(each.seen, query, found.ratio, ORDER)[0]
        shares.append(np.mean(smoothed[len(clock) :].diagonal()))
        curve = smoothed[: len(clock)] @ errors_of(each, uneven.servo)
        rest = find_rest(each, uneven.servo)
        curve += each.follow(clock, uneven.servo, rest) - told.follow(
            clock, servo, rest
        )
        curves[each.name] = curve
        departures[each.name] = Departure(curve, rest, 0.0, bool(cause))
    std = min(_ERROR_SCALE * math.sqrt(np.mean(shares)), 1.0) * found.noise
    flights = []
    for flight in campaign.flights:
        own = departures.get(flight.name)
        own = own if own is None else own._replace(std=std)
        flights.append(dataclasses.replace(flight, departure=own))
    largest = {name: float(np.max(np.abs(curve))) for name, curve in curves.items()}
    worst = max(largest, key=largest.__getitem__)
    when = times[worst][np.argmax(np.abs(curves[worst]))]
    rms = math.sqrt(np.mean([np.var(curve) for curve in curves.values()]))
    if step := 0.0 if cause else _logged_step(plain):
        cause = f"has a log that rounds commands, in steps of {step:.3g} rad/s"
    beginning = f"The servo {cause}. " if cause else ""
    ending = "." if cause else _UNKNOWN
    sentence = (
        f"{beginning}The elevator departs from its commands by {1e3 * rms:.2g} mrad "
        f"(RMS; its noise is {1e3 * found.noise:.2g}), in {worst} by "
        f"{largest[worst]:.2g} rad at {when:.3g} s{ending} "
        "Flights are replayed along the measured elevator."
    )
    return dataclasses.replace(campaign, flights=tuple(flights)), sentence
