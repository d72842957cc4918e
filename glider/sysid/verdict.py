"""The verdict: can the findings be trusted?

Process noise and per-flight constants absorb whatever a model lacks; where they explain
most of the error the effects mean nothing. That happens where a log is inconsistent in
a way that no check of its rows detects, as with the commands of another flight or a
clock that runs slow. `find_doubt` and `too_few_fly` find such reasons; `judge` weighs
them with what was found and with the errors on held-out flights.
"""

import math
from collections.abc import Mapping, Sequence

import numpy as np

from glider.campaign.checks.motion import robust_std
from glider.physics.effects import ELEVATOR_SCALE, LIBRARY, POSE_LATENCY, EffectKind
from glider.physics.parameters import PARAMETER_NAMES
from glider.sysid.constants import (
    CLOCK_ERROR,
    GAIN_ERROR,
    MOMENT_SHARE,
    MOMENT_TIME,
    PER_OUTLIER,
    TAIL_SPREAD,
    WORSE,
    Z,
)
from glider.sysid.fit.folds import Gains
from glider.sysid.likelihood.scales import CEILING
from glider.sysid.likelihood.task import FitResult, Task
from glider.sysid.replay.log_space import SERVO_LOG
from glider.sysid.replay.record import Record
from glider.sysid.replay.replayed import signals
from glider.sysid.result import (
    LIBRARY_SHAPE,
    Errors,
    FlightNames,
    FoundEffect,
    Residual,
    Spread,
)
from glider.sysid.search.tracing import SearchResult

_AT_CEILING = 0.97  # Share of the largest scale, which a fit only comes near.

_BOUNDED = {
    "air": "gusts of {:.2g} m/s",
    "wind": "flight-to-flight winds of {:.2g} m/s",
    "trim": "flight-to-flight trims of {:.2g} rad",
    "pitch_zero": "flight-to-flight pitch offsets of {:.2g} rad",
}
"""Scales whose ceilings no flight of a known glider reaches, and their words."""


_CLOCK = "(is 'clock' right in the MAP of the import?)"


def find_doubt(task: Task, model: FitResult) -> str | None:
    """Finds the reason why a model cannot be trusted: one clause, or None."""

    def value_of(kind: EffectKind) -> float:
        """The first coefficient of an effect."""
        return float(model.theta[task.space.slots_of(kind.kind)[0]])

    early = -value_of(POSE_LATENCY)
    step = float(np.median(np.diff(task.records[0].time)))
    # Times that are rounded to rows are off by half a step.
    if early > 0.5 * step or (early > 0.0 and len(model.kinds) == 1):
        return f"poses are logged {1e3 * early:.1f} ms before they happen {_CLOCK}"

    shift = value_of(SERVO_LOG)
    if abs(shift) > CLOCK_ERROR:
        return f"the servo's log is {1e3 * shift:+.0f} ms off the poses {_CLOCK}"

    change = value_of(ELEVATOR_SCALE)
    if abs(change) > TAIL_SPREAD:
        return (
            f"the elevator turns {1.0 + change:.2f} times as far as its log says (are "
            "the 'units' of its angles and rates right in the MAP of the import?)"
        )

    return _left_to_chance(task, model) if task.vehicle.knows_forces else None


def too_few_fly(flights: FlightNames) -> str | None:
    """Finds that flights on which every model diverges are no exceptions, or None."""
    count = len(flights.diverged)
    if count * PER_OUTLIER <= len(flights.held_out):
        return None
    return (
        f"every model diverges on {count} of {len(flights.held_out)} held-out flights"
    )


def _left_to_chance(task: Task, model: FitResult) -> str | None:
    """Finds noise of a known glider, or an elevator, that no right log shows."""
    scales = vars(model.scales)
    found = [
        words.format(scales[name])
        for name, words in _BOUNDED.items()
        if scales[name] > _AT_CEILING * getattr(CEILING, name)
    ]
    # Pitch accelerations where the pitch was measured.
    turning = [r.acceleration[r.seen[:, 2], 2] for r in task.records]
    usual = float(np.sqrt(np.mean(np.concatenate(turning) ** 2)))
    if scales["moment"] > MOMENT_SHARE * usual:
        found.append(
            f"unmodelled pitch accelerations of {scales['moment']:.2g} rad/s² "
            f"(measured ones are {usual:.2g})"
        )

    if found:
        return f"the model needs {' and '.join(found)}"
    gain, error = _elevator_gain(task, model)
    if abs(gain - 1.0) > max(GAIN_ERROR, Z * error):
        return (
            f"the elevator moves {gain:.3f} times as far as commanded (± {error:.1g}), "
            "as with a wrong clock or unit"
        )

    return None


def _elevator_gain(task: Task, model: FitResult) -> tuple[float, float]:
    """Ratio of measured to modelled elevator travel, and its standard error.

    The median over flights of regressions of travel on travel. It is 1 and infinity
    where there is no servo, or another than the model's is known.
    """
    gains = [
        _gain_of_flight(record, model.theta)
        for record in task.records
        if record.has_servo and not record.departure_is_named
    ]
    found = [gain for gain in gains if gain is not None]
    if len(found) < 3:
        return 1.0, np.inf
    median = float(np.median(found))
    error = 1.2533 * float(robust_std(np.array(found) - median))  # Of a median: √(π/2).
    return median, error / np.sqrt(len(found))


def _gain_of_flight(record: Record, theta: np.ndarray) -> float | None:
    """Ratio of measured to modelled elevator travel in one flight; None if it is still.

    Travel is that within `MOMENT_TIME` from a row on, where the elevator has turned one
    way for as long before: what a play loses at a reversal counts not.
    """
    rows = np.flatnonzero(record.seen[:, 3])
    if len(rows) < 2:
        return None

    time = record.time[rows]
    measured = record.elevator[rows]
    modelled = (signals(record, theta).logged - record.departure)[rows]

    reverses = np.diff(np.sign(np.gradient(modelled))) != 0.0
    reversals = np.append(0, np.cumsum(reverses))
    begins = np.searchsorted(time, time - MOMENT_TIME)
    ends = np.searchsorted(time, time + MOMENT_TIME)
    last = np.minimum(ends, len(time) - 1)
    # No reversal from a `MOMENT_TIME` before the travel to its end.
    turns_one_way = reversals[last] == reversals[begins]
    first = np.flatnonzero((ends < len(time)) & turns_one_way)

    travel = measured[ends[first]] - measured[first]
    ordered = modelled[ends[first]] - modelled[first]
    square = float(ordered @ ordered)
    return float(ordered @ travel) / square if square > 0.0 else None


_AllErrors = dict[str, Errors | None]


def judge(
    traced: SearchResult,
    gains: Mapping[str, Gains],
    errors: _AllErrors,
    effects: Sequence[FoundEffect],
    left: Residual,
    spreads: Mapping[str, Spread],
    doubt: str | None,
) -> tuple[str, str]:
    """Returns the verdict and the sentence that says why.

    Args:
        traced: outcome of the search.
        gains: of the correction over each other model, see `folds.hold_out`.
        errors: of each model on held-out flights; None for one that there is not.
        effects: that are reported.
        left: error of the correction on held-out flights.
        spreads: flight-to-flight variations that are reported.
        doubt: why the model cannot be trusted, a clause, or None.
    """
    untrusted = None
    if doubt is not None:
        untrusted = f"Too much is left to chance: {doubt}."
    elif traced.model.kinds:  # Else signs alone were put right, for all models.
        untrusted = _not_better(traced.model, gains, errors)

    if traced.bank is not None:
        about = _about_roll(traced)
        if not any(e.kind in traced.model.kinds for e in effects):
            more = "" if doubt is None else f" Besides, {doubt}."
            return "unexplained", about + more
        if untrusted is not None:
            return "not_trusted", f"{about} {untrusted}"
        return "partly_explained", about

    rest = _beyond_floor(left)
    unexplained = f"No effect of the library explains what the flat plate lacks{rest}."
    if not effects and not traced.model.kinds:
        if traced.forces is not None and left.depends_on:
            return "unexplained", (
                "What the flat plate lacks depends on "
                f"{', '.join(left.depends_on)}, and no effect explains it."
            )

        if not math.isfinite(left.position_m):
            return "not_trusted", (
                "The model diverges on held-out flights: is each number of "
                "'vehicle' in SI units?"
            )

        if left.exceeds_chance:
            return "unexplained", unexplained
        if doubt is None:
            return "no_effect", _nothing_beyond(spreads)

    if untrusted is not None:
        return "not_trusted", untrusted
    if rest or any(e.kind == "unexplained" for e in effects):
        # A variation over flights alone has no evidence and explains nothing.
        named = [e for e in effects if e.kind != "unexplained"]
        if all(math.isnan(e.evidence) for e in named):
            return "unexplained", unexplained
        return "partly_explained", (
            f"Effects of the library explain part of what the flat plate lacks{rest}."
        )

    reason = "The effects are identified and hold on held-out flights"
    if any(e.shape != LIBRARY_SHAPE for e in effects):
        reason = (
            "The effects are identified; where a formula has not the right shape, the "
            "model has a free function or another formula beside it"
        )

    return "effect_found", f"{reason}."


def _nothing_beyond(spreads: Mapping[str, Spread]) -> str:
    """Returns the sentence on flights without an effect, which may vary."""
    causes = ["noise", "moving air"]
    for kind, spread in spreads.items():
        size = f"{spread.std:.2g} {spread.unit}"
        causes.append(f"a flight-to-flight variation of {kind} ({size})")

    *first, last = causes
    return f"The flights show nothing beyond {', '.join(first)} and {last}."


def _about_roll(traced: SearchResult) -> str:
    """Returns the sentences on a roll that is not logged."""
    other = "other " if traced.model.kinds else ""
    return (
        f"Flights lose lift as a banked wing does, about {traced.bank:.2f} rad at the "
        f"end: log roll and yaw. That explains them better than {other}effects of a "
        f"glider that does not roll, so no {other}effect is named."
    )


def _beyond_floor(left: Residual) -> str:
    """Clause about what a perfect model would not leave, empty if it may be chance."""
    if left.may_be_chance:
        return ""
    free = left.ratio_to_floor
    along = left.ratio_along_pitch
    clause = (
        f": held-out flights are off by {1e3 * left.position_m:.3g} mm (RMS), "
        f"{free:.3g} times as much as a perfect model would leave"
    )
    if along > free:
        clause += f" ({along:.3g} times along the measured pitch)"
    if left.depends_on:
        clause += f", depending on {', '.join(left.depends_on)}"
    return clause


def _changes_baseline_alone(model: FitResult) -> bool:
    """Whether all effects of a model are other values of the flat plate's parameters.

    The refitted baseline has them too and may leave nothing to gain: they are
    then compared with the nominal model.
    """
    if model.functions or not model.kinds:
        return False
    baseline = {
        kind.kind for kind in LIBRARY if not {*PARAMETER_NAMES}.isdisjoint(kind.like)
    }
    return baseline.issuperset(model.kinds)


_BEFORE = {"refitted": "refitted baseline", "nominal": "nominal model"}
"""Models that a correction must be better than, and their words."""


def _not_better(
    model: FitResult, gains: Mapping[str, Gains], errors: _AllErrors
) -> str | None:
    """Reason why the correction is no better than the models before it, or None.

    What the refitted baseline has as well need only be better than the nominal model.
    """
    before = [*_BEFORE]
    if "nominal" in gains and _changes_baseline_alone(model):
        before.remove("refitted")

    over = before[0]
    gain = gains.get(over)
    if gain is not None and not gain.are_significant:
        return (
            f"On {len(gain.values)} flights, held out in folds, the correction gains "
            f"nothing significant over the {_BEFORE[over]} (t = {gain.t:.1f}, expected "
            f"{gain.least_t:.1f}; more with fewer flights)."
        )

    after = errors["corrected"]
    assert after is not None
    rms = after.position_rms_m
    for name in before:
        other = errors.get(name)
        if other is None:
            continue
        found = "the corrected model diverges"
        if math.isfinite(rms):
            ratio = rms / other.position_rms_m
            if not ratio > WORSE:
                continue
            found = f"{ratio:.4g} times the error of the {_BEFORE[name]}"
        return f"The correction makes held-out flights worse: flown freely {found}."

    return None
