"""Recipe of the flights of a basis exercise: a file, read and checked."""

import dataclasses
import math
from collections.abc import Sequence
from pathlib import Path

from basis_features import FEATURES
from glider.errors import InputError, show
from glider.files import schema
from glider.physics.state import NUM_STATES, STATE_NAMES

_SEEDS = 2**32
"""Bound that the seeds of NumPy's legacy generator are below."""

_CHANNELS = 3
"""Number of channels: along the wing, normal to it and in pitch."""


@dataclasses.dataclass(kw_only=True)
class Recipe:
    """Launches and tapes about nominal ones, and features to fit to the flights.

    The defaults stand for "not given", which `check_recipe` refuses.
    """

    flights: int = 0
    """Number of flights, the held-out one among them."""

    held_out: int = -1
    """The flight that is not fitted, counted from zero."""

    seed: int = -1
    """Seed of NumPy's legacy generator."""

    step: float = math.nan
    """Step of explicit Euler [s]."""

    launch: list[float] = dataclasses.field(default_factory=list)
    """Nominal state at release, of STATE_NAMES [m, rad, m/s, rad/s]."""

    launch_spread: float = math.nan
    """Largest difference of each entry of a launch from the nominal one."""

    tape_spread: float = math.nan
    """Largest difference of each rate of a tape from the nominal one [rad/s]."""

    tape: list[float] = dataclasses.field(default_factory=list)
    """Nominal elevator rates, one a step [rad/s]."""

    configurations: dict[str, list[list[int]]] = dataclasses.field(default_factory=dict)
    """Name to the numbers of the features of each channel."""


def load_recipe(path: Path) -> Recipe:
    """Loads a recipe; what is missing, misspelt or cannot be is an InputError."""
    recipe = schema.load_yaml(Recipe, path, "an exercise")
    check_recipe(recipe, source=str(path))
    return recipe


def check_recipe(recipe: Recipe, source: str) -> None:
    """Raises InputError, naming `source` and the field, where a value cannot be."""
    last = recipe.flights - 1
    state = f"{NUM_STATES} finite numbers ({', '.join(STATE_NAMES)})"
    for name, is_right, needed in (
        ("flights", last >= 1, "2 or more"),
        ("held_out", 0 <= recipe.held_out <= last, f"a flight from 0 to {last}"),
        ("seed", 0 <= recipe.seed < _SEEDS, f"0 to {_SEEDS - 1}"),
        ("step", 0.0 < recipe.step < math.inf, "a positive number of seconds"),
        ("launch", _are_finite(recipe.launch, NUM_STATES), state),
        ("launch_spread", 0.0 <= recipe.launch_spread < math.inf, "a number >= 0"),
        ("tape_spread", 0.0 <= recipe.tape_spread < math.inf, "a number >= 0"),
        ("tape", _are_finite(recipe.tape), "one finite rate a step"),
        ("configurations", bool(recipe.configurations), "one or more"),
    ):
        if not is_right:
            found = getattr(recipe, name)
            raise InputError(
                f"{source}: field '{name}' is missing or {show(found)}; {needed} "
                "needed."
            )
    for name, channels in recipe.configurations.items():
        if len(channels) != _CHANNELS or not all(channels):
            raise InputError(
                f"{source}: configuration '{name}' is {show(channels)}; expected a "
                f"list of features for each of {_CHANNELS} channels."
            )
        for number in (number for channel in channels for number in channel):
            if number not in FEATURES:
                raise InputError(
                    f"{source}: configuration '{name}' names feature {number}; "
                    f"expected one of {', '.join(map(str, FEATURES))}."
                )


def _are_finite(values: Sequence[float], count: int | None = None) -> bool:
    """Returns whether there are as many, or any, and all are finite."""
    is_right_size = len(values) == count if count else len(values) > 0
    return is_right_size and all(map(math.isfinite, values))
