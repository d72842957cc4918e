"""Where the tests find funnels that do not ship."""

from pathlib import Path

UNPROVEN = Path(__file__).parents[1] / "data" / "funnels"
"""Funnels of Taylor polynomials alone, without their remainder."""
