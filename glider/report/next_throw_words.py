"""Sentences about proposed throws: what they are for, and what they would tell."""

import math

import numpy as np

from glider.design.proposal import MOST_THROWS, Proposal
from glider.design.throws import Throw
from glider.report.numbers import format_length

SURE = 0.99
"""Probability of the best explanation from which on the others are out."""

SMALL = 1.0 / 3.0
"""Scatter by the coefficients over that by the air, below which the air is what is
left: they then add less than 6 % to it."""

_TOLD = 0.02
"""Probability that throws must add to be worth a word."""

_ALIKE = 3.0
"""Expected log-evidence below which explanations stay one [nats]."""


def is_done(proposal: Proposal) -> bool:
    """Returns whether nothing more is to be learned that flights would show."""
    learned = proposal.ending_now < SMALL * proposal.ending_air
    return proposal.chance_now > SURE and learned


def sentences(proposal: Proposal) -> list[str]:
    """Returns what the flights leave open, and what the throws are expected to do."""
    said = [_explanations(proposal)]
    if len(proposal.explanations) > 1:
        said.append(_chances(proposal))
        said += _one_still(proposal)
    said.append(_ending(proposal))
    if is_done(proposal):
        said.append("What is left is the air: more throws would not show more.")
    return said


def _explanations(p: Proposal) -> str:
    told = [f"{e.name} ({_chance(e.probability)})" for e in p.explanations]
    if len(told) == 1:
        return f"The flights leave one explanation: {p.explanations[0].name}."
    return f"The flights leave {len(told)} explanations: {', '.join(told)}."


def _chances(p: Proposal) -> str:
    count = len(p.throws)
    with_throws = f"With {count} such throws" if count > 1 else "With such a throw"
    if p.chance_then < p.chance_now + _TOLD:
        return (
            "No throw within the limits helps much to tell them apart: the most "
            "probable one is right "
            f"with probability {_chance(p.chance_now)} today, "
            f"{_chance(p.chance_then)} then."
        )
    alike = (
        f"more than {MOST_THROWS} would be needed"
        if p.alike is None
        else f"{p.alike} would do the same"
    )
    return (
        f"{with_throws} the right one is told with probability "
        f"{_chance(p.chance_then)}; today {_chance(p.chance_now)}. As many more of the "
        f"present kind reach {_chance(p.chance_alike)}; {alike}."
    )


def _one_still(p: Proposal) -> list[str]:
    """Returns which explanations stay one even then."""
    both = np.minimum(p.distances, p.distances.T)
    names = [e.name for e in p.explanations]
    pairs = [
        f"{names[i]} and {names[j]}"
        for i in range(len(names))
        for j in range(i + 1, len(names))
        if both[i, j] < _ALIKE
    ]
    if not pairs:
        return []
    return [f"Not told apart by them: {'; '.join(pairs)}."]


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
    return "over 0.99" if value > 0.99 else f"{value:.2f}"
