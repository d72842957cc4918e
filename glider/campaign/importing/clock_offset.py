"""The clock step: the servo's logs are shifted onto the clock of the poses.

A mapping specifies how far the elevator's clock is ahead (`clock: SECONDS`), that it is
the same, or that the motion has to show it (`clock: find`, see `clock_search`). A clock
that is specified is compared with what the motion shows: then it is known better than
by the digits that were typed, or it is wrong.
"""

import contextlib
import dataclasses
import math
from collections.abc import Sequence

import numpy as np

from glider.campaign.importing.clock_search import Offset, find_offsets
from glider.campaign.importing.track import ServoLogs, Track, turn_along
from glider.campaign.settings import ColumnMapping
from glider.errors import InputError

_ABSORBED = 0.1  # Delay or lag of a servo that a clock found by it may hide [s].
_OFF = 3.0  # Standard errors above which a clock that is specified is in doubt.


def join_clocks(
    tracks: list[Track], flights: list[list[Track]], mapping: ColumnMapping
) -> tuple[list[Track], list[str]]:
    """Shifts the servos' logs of recordings onto the poses' clocks.

    Args:
        tracks: whole recordings.
        flights: the flights of each.
        mapping: for its `clock:`; without one, clocks of different names are found.

    Returns:
        The recordings with shifted logs, and warnings.

    Raises:
        InputError: a clock is not shown by the motion, or is contradicted by it.
    """
    clock = mapping.clock
    if clock is None:
        differ = any(log.clock != t.clock for t in tracks for log in t.servo.given)
        clock = "find" if differ else "same"
    if clock == "same":
        return tracks, []

    # Flights of the recordings whose motion shows the clock, by their place.
    flying = {}
    for place, (track, cuts) in enumerate(zip(tracks, flights, strict=True)):
        turns = track.servo.elevator or track.servo.angle_command
        if cuts and turns and not track.has_measured:
            flying[place] = list(map(turn_along, cuts))
    shown = [*flying.values()]
    if clock != "find":
        offset = Offset(float(clock))
        std, warnings = _check_clock(shown, offset.seconds, mapping.source)
        note = f"clock: shifted by {offset.seconds:g} s, as specified"
        return [_shift(track, offset, std, note) for track in tracks], warnings

    for track in tracks:
        clocks = {log.clock for log in track.servo.given}
        if track.has_measured and len(clocks) > 1:
            raise InputError(
                f"{mapping.source}: clock: the elevator was measured on the clock of "
                "the poses, and its commands are on another, which the motion does not "
                "show; expected 'clock: SECONDS', 'clock: same', or no commands."
            )
    joined = [*tracks]
    warnings = []
    for place, offset in zip(flying, find_offsets(shown), strict=True):
        track = tracks[place]
        std = offset.std
        note = (
            f"clock: the elevator's is {offset.seconds:+.3f} ± {std:.3f} s ahead of "
            f"that of the poses (correlation {offset.correlation:.2f}); it was shifted "
            "back"
        )
        if track.servo.elevator is None:
            note += ", and a delay of the servo, if any, with it"
            std = _ABSORBED
        joined[place] = _shift(track, offset, std, note)
        if offset.rate:
            gained = 1e3 * offset.rate * np.ptp(track.time)
            warnings.append(
                f"The servo's clock gains {1e6 * offset.rate:.0f} µs in a second on "
                f"that of the poses, {gained:.0f} ms over the session: that was taken "
                "out."
            )
    return joined, warnings


def _check_clock(
    recordings: Sequence[Sequence[Track]], clock: float, source: str
) -> tuple[float, list[str]]:
    """Compares a clock that a mapping specifies with the one that the motion shows.

    Two errors are combined: the clock was read to half its last digit and a step of the
    logs, and the offset that is found has a standard error of its own.

    Args:
        recordings: flights of each recording whose motion shows the clock.
        clock: how far the elevator's clock is said to be ahead [s].
        source: name of the MAP file, for messages.

    Returns:
        The standard error of the clock [s], and a warning if it is off.

    Raises:
        InputError: it is further off than a late servo explains.
    """
    digits = max(len(f"{clock:.6f}".rstrip("0").partition(".")[2]), 1)
    steps = [log.step for own in recordings for log in own[0].servo.given]
    read = math.hypot(0.1**digits, max(steps, default=0.0)) / math.sqrt(12.0)
    offsets = []
    with contextlib.suppress(InputError):
        offsets = find_offsets(recordings)
    if not offsets:
        return read, []

    found, std = np.median([(own.seconds, own.std) for own in offsets], axis=0)
    off = abs(clock - found)
    rounding = 0.1 ** max(digits, 2) / math.sqrt(12.0)
    if off <= _OFF * math.hypot(std, rounding):
        # The mean of both is `share * off` from the clock, which is used as it is.
        share = read**2 / (read**2 + std**2)
        return math.hypot(share * off, math.sqrt(share) * std), []
    words = (
        f"'clock' is {clock:g}, and the elevator turns the glider as if its clock were "
        f"{found:.3f} ± {std:.3f} s ahead of the poses'"
    )
    if off > _ABSORBED + _OFF * std:
        raise InputError(f"{source}: {words}; expected that, or 'find'.")
    return off, [f"{words}: it is wrong, or servo or poses are late"]


def _shift(track: Track, offset: Offset, std: float, note: str) -> Track:
    """Shifts the servo's logs of another clock onto the clock of the poses.

    An elevator that was measured on the clock of the poses stays.
    """
    moved = [
        log and log._replace(time=offset.on_poses(log.time)) for log in track.servo
    ]
    if track.has_measured:
        moved[0] = track.servo.elevator
    return dataclasses.replace(
        track, servo=ServoLogs(*moved), clock_std=std, notes=(*track.notes, note)
    )
