"""The servo that a campaign's elevators follow, and what they do beside it.

The measured angles of all flights are compared with the exact path of a servo behind
the logged commands. If the servo as specified leaves no more than noise, nothing is
done; otherwise these are fitted:

1. a plain servo: its delay and lag, which are effects to be traced later;
2. limits of its own, which replace those of the campaign;
3. forms that are not even: a lag of one way, a lag or a rate limit that depends on the
   load, free play, commands that are lost or rounded.

The form that makes the angles most likely is named, if it leaves less than half of what
the plain servo does. If none explains all flights, but one plain servo those up to some
flight and another the rest, the servo changed there.

What elevators do beside a servo of a delay, a lag and limits, named or not, is their
`Departure`: flights are replayed with it, so that the aerodynamics are traced along the
measured elevator.
"""

import bisect
import dataclasses
import math
from collections.abc import Mapping, Sequence

import numpy as np

from glider.campaign.changes import LEAST_SIDE, SERVO, Change, by_number
from glider.campaign.checks.masks import Masks
from glider.campaign.checks.servo import (
    Elevator,
    LateServo,
    are_still,
    measure_elevators,
)
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
_NUMBERS = (
    ("lower stop", "rad", 0.1),
    ("upper stop", "rad", 0.1),
    ("rate limit", "rad/s", 1.0),
    ("delay", "s", 0.01),
    ("lag", "s", 0.01),
)
"""Numbers of an even servo, and the scales by which their changes are compared."""
_SURELY = 5.0  # Standard errors of what is not by chance, whatever is tried.
_MOSTLY = 0.5  # Share of a departure's evidence that its cause may leave.


def identify_servo(
    campaign: Campaign, masks: Mapping[str, Masks]
) -> tuple[Campaign, tuple[str, ...], Change | None]:
    """Compares the measured elevators of a campaign with its servo.

    Args:
        campaign: its flights; the signs of elevators and commands must be right.
        masks: rows that are excluded, by the flights' names.

    Returns:
        The campaign with the limits that the servo shows and with the departures of
        elevators from it; a sentence for each of the two that changed; and how the
        servo changes during the session, if it does.
    """
    log = campaign.servo
    if log.angle != "measured" or log.command == "reconstructed":
        return campaign, (), None
    elevators = _measure(campaign, masks)
    specified = LateServo(*campaign.limits)
    if are_still(elevators) or Fit(servo=specified, elevators=elevators).explains:
        return campaign, (), None

    plain = fit_servo(elevators, specified, log.command_std)
    found = _find_cause(campaign, masks, plain)
    change = None
    if not found.explains:
        sides = _find_break(plain, log.command_std)
        if sides:
            change = _change_of(*sides)

    told = []
    if found.free in _LIMITS:
        campaign, sentence = _with_limits(campaign, found.servo.limits)
        told.append(sentence)
        plain = found
        if found.explains:
            return campaign, (sentence,), None
    elif plain.explains and not found.cause:
        return campaign, (), None  # A delay and a lag are effects to be traced.

    # A few flights may be odd, or lose commands: the others follow a plain servo.
    if found.servo == found.servo.even:
        places = range(len(elevators))
        odd = [place for place in places if not plain.on([place]).explains]
        others = [place for place in places if place not in odd]
        if odd and others and plain.on(others).explains:
            plain = plain.on(odd)
            found = found.on(odd)
    unknown = "." if change else _UNKNOWN
    changed, sentence = _with_departures(campaign, plain, found, unknown)
    return changed, (*told, sentence), change


def measure_elevator_noise(campaign: Campaign, masks: Mapping[str, Masks]) -> float:
    """Returns the noise of the logged elevators [rad], 0 without any."""
    elevators = _measure(campaign, masks)
    if not elevators:
        return 0.0
    return Fit(servo=LateServo(*campaign.limits), elevators=elevators).departures.noise


def _measure(campaign: Campaign, masks: Mapping[str, Masks]) -> list[Elevator]:
    """Returns the elevators of flights with enough rows."""
    elevators = measure_elevators(campaign, masks)
    return [each for each in elevators if len(each.rows) >= _FEWEST_ROWS]


def _find_cause(campaign: Campaign, masks: Mapping[str, Masks], plain: Fit) -> Fit:
    """Finds what explains most of the departures from a plain servo.

    Returns the fit of that form, with its cause in words; one with other limits, which
    has none; or the plain one where nothing explains them.
    """
    command_std = campaign.servo.command_std
    even = _fit_limits(plain, command_std)
    loaded = with_loads(campaign, masks, plain.elevators)
    causes = []
    for form in _UNEVEN:
        fit = fit_servo(loaded, plain.servo, command_std, form)
        if abs(getattr(fit.servo, form[-1])) > _SURELY * fit.std:
            causes.append(dataclasses.replace(fit, cause=_describe(fit)))

    if not any(fit.explains for fit in (even, *causes)):
        causes += [restore_lost(plain, command_std), find_step(plain, command_std)]
    return _better(even, causes)


def _fit_limits(plain: Fit, command_std: float) -> Fit:
    """Fits limits of its own to a servo; returns the plain one if they say little.

    They are the first of _LIMITS that leave but noise, or the likeliest.
    """
    if plain.explains:
        return plain
    limited = []
    for free in _LIMITS:
        fit = fit_servo(plain.elevators, plain.servo, command_std, free)
        if fit.explains:
            return _better(plain, [fit])
        limited.append(fit)
    return _better(plain, limited)


def _find_break(plain: Fit, command_std: float) -> list[Fit]:
    """Finds the flight at which the servo changes for another.

    Before it are as many flights, by number, as a delay, a lag and limits explain. Both
    sides together are off by noise alone, as halves of a departure are not.

    Args:
        plain: a servo that does not explain all elevators.
        command_std: see `fit_servo`.

    Returns:
        The servos before and since then; none where there is no such flight.
    """

    def fit(some: list[Elevator]) -> Fit:
        return _fit_limits(fit_servo(some, plain.servo, command_std), command_std)

    elevators = sorted(plain.elevators, key=lambda each: by_number(each.name))
    counts = range(LEAST_SIDE + 1, len(elevators))
    at = LEAST_SIDE + bisect.bisect_left(
        counts, True, key=lambda count: not fit(elevators[:count]).explains
    )
    if len(elevators) - at < LEAST_SIDE:
        return []
    parts = elevators[:at], elevators[at:]
    sides = [fit(part) for part in parts]
    # A side that does not reach a limit has that of the other.
    shared = []
    for own in sides:
        if fit_servo(elevators, own.servo, command_std).explains:
            return []
        shared.append([fit_servo(part, own.servo, command_std) for part in parts])

    for fits in (*shared, sides):
        if sum(side.departures.evidence for side in fits) < LEAST_EVIDENCE:
            return fits
    return []


def _change_of(before: Fit, since: Fit) -> Change:
    """Returns the change of the number of a servo that differs most.

    Stops and rates without a limit are those that nothing exceeds.
    """
    fastest = np.abs(before.commands).max()
    most = -MAX_ANGLE, MAX_ANGLE, fastest, 0.0, 0.0
    numbers = np.array([before.servo[:5], since.servo[:5]])
    old, new = np.where(np.isfinite(numbers), numbers, most)
    scales = [scale for _, _, scale in _NUMBERS]
    place = int(np.argmax(np.abs(new - old) / scales))
    name, unit, _ = _NUMBERS[place]
    return Change(
        kind=SERVO,
        coefficient=name,
        unit=unit,
        value=float(new[place] - old[place]),
        flight=since.elevators[0].name,
        before=float(numbers[0, place]),
        since=float(numbers[1, place]),
    )


def _better(before: Fit, others: Sequence[Fit]) -> Fit:
    """Returns the likeliest of others, or the fit before if that one is as good.

    The other must be clearly likelier, and leave less than a share of _MOSTLY of the
    departures' evidence, or no more than noise.
    """
    best = max(others, key=lambda fit: fit.likelihood, default=before)
    if not best.likelihood - before.likelihood > LEAST_EVIDENCE:
        return before
    most = max(_MOSTLY * before.departures.evidence, LEAST_EVIDENCE)
    return best if best.departures.evidence < most else before


def _describe(fit: Fit) -> str:
    """Says how a servo is not even, in the words of _UNEVEN; lags in ms."""
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
    """Returns the step that logged commands are rounded to [rad/s].

    It is 0 where they are not multiples of one, or of one too fine to explain anything.
    """
    levels = np.unique(np.abs(fit.commands))
    if len(levels) < _FEWEST_LEVELS:
        return 0.0
    step = float(np.diff(levels).min())
    multiples = levels / step
    off = np.abs(multiples - np.round(multiples))
    if off.max() < 0.01 and step > least_step(fit):
        return step
    return 0.0


def _with_limits(campaign: Campaign, servo: Servo) -> tuple[Campaign, str]:
    """Returns the campaign with other limits of the servo, and how they differ.

    A stop beyond MAX_ANGLE is set to that, as a campaign has both stops or none.
    """
    words = (
        "The servo stops at {:.3g} and {:.3g} rad and turns by {:.3g} rad/s at most, "
        "where 'elevator_limits' and 'elevator_rate_limit' say {:.3g}, {:.3g} and "
        "{:.3g}: its own limits are used."
    ).format(*servo, *campaign.limits)
    stops = None
    if np.isfinite(servo[:2]).any():
        low, high = np.clip(servo[:2], -MAX_ANGLE, MAX_ANGLE).tolist()
        stops = low, high
    changed = dataclasses.replace(
        campaign,
        elevator_limits=stops,
        elevator_rate_limit=servo.rate if math.isfinite(servo.rate) else None,
    )
    return changed, words


def _with_departures(
    campaign: Campaign, plain: Fit, uneven: Fit, unknown: str
) -> tuple[Campaign, str]:
    """Returns the campaign with its elevators' departures, and a sentence on them.

    Args:
        campaign: its flights; those without an elevator in the fits depart from
            nothing.
        plain: a servo of a delay, a lag and limits, of some flights.
        uneven: the form that explains the departures, of the same flights; without a
            cause, the plain servo.
        unknown: end of the sentence where there is no cause.
    """
    times = {flight.name: flight.time for flight in campaign.flights}
    departures = _calc_departures(times, plain, uneven)
    flights = []
    for flight in campaign.flights:
        own = departures.get(flight.name)
        flights.append(dataclasses.replace(flight, departure=own))

    # Why elevators depart from the plain servo, by how much, and where most.
    cause = uneven.cause
    if not cause:
        step = _logged_step(plain)
        if step > 0.0:
            cause = f"has a log that rounds commands, in steps of {step:.3g} rad/s"
    beginning = ""
    ending = unknown
    if cause:
        beginning = f"The servo {cause}. "
        ending = "."
    sizes = {name: np.abs(own.angle) for name, own in departures.items()}
    worst = max(sizes, key=lambda name: sizes[name].max())
    row = sizes[worst].argmax()
    rms = math.sqrt(np.mean([own.angle.var() for own in departures.values()]))
    sentence = (
        f"{beginning}The elevator departs from its commands by {1e3 * rms:.2g} mrad "
        f"(RMS; its noise is {1e3 * uneven.departures.noise:.2g}), in {worst} by "
        f"{sizes[worst][row]:.2g} rad at {times[worst][row]:.3g} s{ending} "
        "Flights are replayed along the measured elevator."
    )
    return dataclasses.replace(campaign, flights=tuple(flights)), sentence


def _calc_departures(
    times: Mapping[str, np.ndarray], plain: Fit, uneven: Fit
) -> dict[str, Departure]:
    """Returns how each elevator departs from a plain servo, by the flight's name.

    That is the path of the uneven servo, and what smoothing finds beside it, less the
    path of the plain one. `times` are those (n,) of all rows of each flight [s].
    """
    servo = plain.servo
    is_named = bool(uneven.cause)
    if is_named and uneven.free not in _LAGGING:
        servo = LateServo(*servo.limits, uneven.servo.delay, uneven.servo.lag)
    found = uneven.departures
    paths = {}
    shares = []
    for told, each in zip(plain.elevators, uneven.elevators, strict=True):
        time = times[each.name]
        rest, expected = follow_from_rest(each, uneven.servo)
        # Beyond the measured angles the departure stays as it is.
        known = np.clip(time, each.seen[0], each.seen[-1])
        smooth = smoothing_maps(each.seen, known, found.ratio, ORDER)[0]
        curve = smooth @ (each.angle - expected)
        curve += each.follow(time, uneven.servo, rest)
        curve -= told.follow(time, servo, rest)
        paths[each.name] = curve, rest
        # The weight of a row on its own value is the share of its noise that is left.
        shares.append(smooth.max(axis=1).mean())

    std = min(_ERROR_SCALE * math.sqrt(np.mean(shares)), 1.0) * found.noise
    return {
        name: Departure(curve, rest, std, is_named)
        for name, (curve, rest) in paths.items()
    }
