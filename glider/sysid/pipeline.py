"""Closes the loop: from a folder of flights to a corrected glider.

`close_the_loop` reads and checks its input before it imports what takes a second, so
that a fault in the input is reported at once.
"""

import time
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from threadpoolctl import threadpool_limits

from glider.campaign.logs import Campaign, split_flights
from glider.campaign.reader import load_campaign
from glider.errors import InputError
from glider.physics.effects import ANGLE_SIGN, KINDS, EffectKind
from glider.progress import Progress, Step, silent

if TYPE_CHECKING:
    from glider.sysid.result import Result

HELD_OUT = 0.3
"""Share of the flights that errors are measured on, unless another is asked for."""


def check_names(
    effects: Sequence[str] | None, own_effects: Sequence[EffectKind] = ()
) -> None:
    """Raises InputError where a name is no effect's, or where there is none."""
    if effects is not None and not effects:
        raise InputError("found no effect to try; expected the name of at least one.")
    known = (*KINDS, *(e.kind for e in own_effects))
    for name in effects or ():
        if name not in known:
            raise InputError(f"unknown effect '{name}'; known are {', '.join(known)}.")


def close_the_loop(
    campaign: Path | str | Campaign,
    *,
    flights: Sequence[str] | None = None,
    held_out: float = HELD_OUT,
    seed: int = 0,
    effects: Sequence[str] | None = None,
    own_effects: Sequence[EffectKind] = (),
    progress: Progress = silent,
) -> "Result":
    """Finds what a glider's model lacks, adds it, and measures the improvement.

    Args:
        campaign: a campaign's folder, or one in memory.
        flights: names of flights to use; all by default.
        held_out: share of the flights that errors are measured on.
        seed: of the split into fitted and held-out flights.
        effects: names of the kinds to try; by default the library and `own_effects`.
        own_effects: kinds that the library lacks, of any stage but the log.
        progress: called with a line of text as the work goes on.

    Raises:
        InputError: the campaign or an argument cannot be used.
    """
    own = tuple(own_effects)
    if own:
        from glider.sysid.replay.log_space import log_space

        log_space(own)  # Kept: checked once.
    check_names(effects, own)
    begin = time.perf_counter()
    progress(Step("read", 0.0))
    if not isinstance(campaign, Campaign):
        campaign = load_campaign(campaign, flights=flights)
    elif flights is not None:
        campaign = campaign.only(flights)
    split_flights(campaign, held_out, seed)  # Refuses too few of them at once.
    from glider.campaign.checks.inspection import inspect

    with threadpool_limits(limits=1, user_api="blas"):  # We thread over flights.
        inspection = inspect(campaign)
        fitted, _ = split_flights(inspection.campaign, held_out, seed)
        seconds = {"read": time.perf_counter() - begin}
        from glider.sysid.analysis import Analysis
        from glider.sysid.replay.log_space import log_space
        from glider.sysid.replay.vehicle import make_vehicle

        vehicle = make_vehicle(inspection.campaign, log_space(own))
        kinds = tuple(k for k in vehicle.kinds if effects is None or k in effects)
        if effects is not None and not kinds and ANGLE_SIGN.kind not in effects:
            raise InputError(
                f"none of the effects {list(effects)} can be identified from what "
                "this campaign logs and leaves unknown."
            )

        return Analysis(
            progress=progress,
            seconds=seconds,
            inspection=inspection,
            vehicle=vehicle,
            kinds=kinds,
            fitted=fitted,
            settings={
                "seed": seed,
                "held_out": held_out,
                "flights": None if flights is None else list(flights),
                "effects": None if effects is None else list(effects),
                "own_effects": [e.kind for e in own],
                "notes": list(vehicle.notes),
            },
        ).run()
