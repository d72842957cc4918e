"""Sentences about proposed throws: what they are for, and what they would tell."""

import itertools
import math

import numpy as np

from glider.experiments.alike import MOST_THROWS
from glider.experiments.known_funnel import KnownFunnel
from glider.experiments.proposal import Proposal
from glider.experiments.throws import Throw
from glider.report.numbers import format_length

SURE = 0.99
"""Probability of the best explanation among those that are left, from which on the
others are out."""

SMALL = 1.0 / 3.0
"""Scatter by the coefficients over that by the air, below which the air is what is
left: they then add less than 6 % to it."""

_TOLD = 0.02
"""Probability that throws must add to be worth a word."""

_NAMED = 0.01
"""Probability from which on an explanation is named."""

_ALIKE = 3.0
"""Expected log-evidence below which explanations stay one [nats]."""


def is_one_left(proposal: Proposal) -> bool:
    """Returns whether one explanation is all that the flights leave."""
    return proposal.chance_now > SURE * (1.0 - proposal.missing)


def is_done(proposal: Proposal) -> bool:
    """Returns whether nothing more is to be learned that flights would show."""
    learned = proposal.ending_now < SMALL * proposal.ending_air
    return is_one_left(proposal) and learned


def sentences(proposal: Proposal) -> list[str]:
    """Returns what the flights leave open, and what the throws are expected to do."""
    said = [_explanations(proposal)]
    if not is_one_left(proposal):
        said.append(_chances(proposal))
        said += _one_still(proposal)
    said += _keeping(proposal)
    said.append(_ending(proposal))
    if is_done(proposal):
        said.append("What is left is the air: more throws would not show more.")
    return said


def _explanations(p: Proposal) -> str:
    likely = [e for e in p.explanations if e.probability >= _NAMED]
    told = [f"{e.name} ({_chance(e.probability)})" for e in likely]
    if len(told) == 1:
        begin = f"The flights leave one explanation, {told[0]}"
    else:
        begin = f"The flights leave {len(told)} explanations: {', '.join(told)}"
    return f"{begin}; that it is another has probability {_chance(_other(p))}."


def _other(p: Proposal) -> float:
    """Returns the probability of everything that is not named."""
    return 1.0 - sum(e.probability for e in p.explanations if e.probability >= _NAMED)


def _chances(p: Proposal) -> str:
    count = len(p.throws)
    with_throws = f"With {count} such throws" if count > 1 else "With one such throw"
    today = _chance(p.chance_now)
    if p.chance_then < p.chance_now + _TOLD:
        return (
            "No throw within the limits helps much to tell them apart: the most "
            f"probable one is right with probability {today} today, "
            f"{_chance(p.chance_then)} then."
        )
    names = [e.name for e in p.explanations if e.probability >= _NAMED]
    told = (
        f"{names[0]} and {names[1]} separate"
        if len(names) == 2
        else "the right one is known"
    )
    if p.alike is None:
        same = f"more than {MOST_THROWS} of them would do the same"
    else:
        same = f"{p.alike} of them would do the same"
    return (
        f"{with_throws} {told} with probability {_chance(p.chance_then)}; today "
        f"{today}. As many throws of the present kind reach "
        f"{_chance(p.chance_alike)}; {same}."
    )


def _one_still(p: Proposal) -> list[str]:
    """Returns which explanations stay one even then."""
    both = np.minimum(p.distances, p.distances.T)
    likely = [i for i, e in enumerate(p.explanations) if e.probability >= _NAMED]
    pairs = [
        f"{p.explanations[i].name} and {p.explanations[j].name}"
        for i, j in itertools.combinations(likely, 2)
        if both[i, j] < _ALIKE
    ]
    if not pairs:
        return []
    return [f"Not told apart by them: {'; '.join(pairs)}."]


def _keeping(p: Proposal) -> list[str]:
    """Returns how the throws keep inside a funnel, where one is known."""
    known = p.place.funnel
    if known is None:
        return []
    throws = "every throw keeps" if len(p.throws) > 1 else "the throw keeps"
    x, level = float(p.throws[0].launch[0]), _level(max(p.levels))
    return [
        f"Released at x = {x:.2f} m, {throws} inside {known.words} by every "
        f"explanation, also where the launch is missed, up to level {level} of 1: "
        "until its tape ends, and then, the funnel's feedback may take over.",
        _checking(known),
    ]


def _checking(known: KnownFunnel) -> str:
    """Returns what was checked of a funnel, and what was not."""
    if not known.is_checked:
        return (
            "The funnel's sets are taken as they are and were not checked; "
            f"`{known.proof}` does that."
        )
    return (
        "The funnel's certificate was checked, exactly at all its "
        f"{len(known.funnel.nominal.times)} times; that no flight leaves it was not "
        f"proven here: `{known.proof}` does that, in minutes."
    )


def keeping_words(p: Proposal, index: int) -> str:
    """Returns how a throw keeps inside a funnel; nothing where none is known."""
    if p.place.funnel is None:
        return ""
    return (
        f"; up to level {_level(p.levels[index])} of the funnel, "
        f"its feedback from {p.throws[index].duration:.2f} s on"
    )


def _level(value: float) -> str:
    return f"{math.ceil(100.0 * value - 1e-9) / 100.0:.2f}"  # Never less than it is.


def _ending(p: Proposal) -> str:
    air = format_length(p.ending_air)
    if not p.ending_now > 0.0:
        return f"The air scatters where such flights end by {air}."
    now, then, alike = map(format_length, (p.ending_now, p.ending_then, p.ending_alike))
    return (
        f"What is not known of the coefficients moves the end of a flight by {now}; "
        f"after these throws by {then}, after as many of the present kind by {alike}. "
        f"The air and what differs from flight to flight move it by {air}."
    )


def launch_words(throw: Throw) -> str:
    """Returns a launch as people set it."""
    pitch = float(throw.launch[2])
    return (
        f"release at {throw.launch[1]:.2f} m, {throw.speed:.2f} m/s, flight path "
        f"{_up_or_down(throw.climb)}, nose {_up_or_down(-pitch)}"
    )


def _up_or_down(angle: float) -> str:
    return f"{abs(math.degrees(angle)):.1f}° {'up' if angle >= 0.0 else 'down'}"


def _chance(value: float) -> str:
    if value < 0.01:
        return "under 0.01"
    return "over 0.99" if value > 0.99 else f"{value:.2f}"
