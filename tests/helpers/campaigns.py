"""Where the tests find recorded campaigns of flights."""

from pathlib import Path

from glider.campaign.samples import campaign_folder, sample_names

_DATA = Path(__file__).parents[1] / "data" / "campaigns"

PRACTICE = ("attached_lift", "floor_vent", "head_wind", "slow_servo", "still_air")
"""Campaigns whose missing effect is in the name (nothing is, in still air)."""

LIFELIKE = ("four_at_once", "gusty_drag", "moving_air", "new_trims", "other_stall")
"""Campaigns of several effects, of moving air, of what differs between flights."""

BLIND = ("a", "b", "c", "d", "e", "f")
"""Campaigns whose missing effect nobody has told us."""


def first_flights(count: int) -> list[str]:
    """Returns the names of a campaign's first flights."""
    return [f"flight_{i:03d}" for i in range(count)]


def campaign_path(name: str) -> Path:
    """Returns the folder of a campaign; the samples are those that ship."""
    if name in sample_names():
        return campaign_folder(name)
    groups = {"practice": PRACTICE, "lifelike": LIFELIKE, "blind": BLIND}
    for group, names in groups.items():
        if name in names:
            return _DATA / group / name
    raise FileNotFoundError(f"No campaign '{name}'; there are {groups}.")
