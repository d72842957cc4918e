"""One line of an examination."""

import dataclasses

STATES = ("works", "look", "fails")
"""All is well; something that is not needed by all is missing; something needed is."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Finding:
    """What was looked at, and what came out.

    Attributes:
        name: of what was looked at.
        state: one of STATES.
        found: in a few words.
        advice: what to do about it; empty where there is nothing to do.
    """

    name: str
    state: str
    found: str
    advice: str = ""


def works(name: str, found: str) -> Finding:
    """Returns that something works."""
    return Finding(name=name, state="works", found=found)


def look(name: str, found: str, advice: str) -> Finding:
    """Returns that something is missing which not everybody needs."""
    return Finding(name=name, state="look", found=found, advice=advice)


def fails(name: str, found: str, advice: str) -> Finding:
    """Returns that something which is needed does not work."""
    return Finding(name=name, state="fails", found=found, advice=advice)
