"""Where the tests find recorded campaigns of flights."""

from pathlib import Path

from glider.paths import models_path

_DATA = Path(__file__).parents[1] / "data" / "campaigns"

PRACTICE = ("attached_lift", "floor_vent", "head_wind", "slow_servo", "still_air")
"""Campaigns whose missing effect is in the name (nothing is, in still air)."""

BLIND = ("a", "b", "c", "d", "e", "f")
"""Campaigns whose missing effect nobody has told us."""


def campaign_path(name: str) -> Path:
    """Returns the folder of a campaign; the sample campaign is among the models."""
    if name == "attached_lift":
        return models_path("campaigns", name)
    for group, names in (("practice", PRACTICE), ("blind", BLIND)):
        if name in names:
            return _DATA / group / name
    raise FileNotFoundError(f"No campaign '{name}'; there are {PRACTICE + BLIND}.")
