"""The article's identification exercise: its flights and its configurations."""

import dataclasses
from pathlib import Path

import numpy as np

from basis_dynamics import BasisFrame, Numbers, SampledFlights
from basis_features import angle_sign
from basis_recipe import load_recipe
from glider.compiled.flight import fly_tapes
from glider.errors import InputError
from glider.physics.model import GliderModel
from glider.physics.parameters import GliderParameters
from glider.physics.state import NUM_STATES

EXERCISE = Path(__file__).with_name("identification.yaml")
"""File of the article's exercise."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Exercise:
    """The exercise's flights and the configurations that it compares.

    Attributes:
        flights: all of them; angles nose down, as everywhere in this project.
        fitted: those to fit.
        held_out: the one that is not.
        configurations: name to features of each channel.
        parameters: of the glider that flew.
    """

    flights: SampledFlights
    fitted: SampledFlights
    held_out: SampledFlights
    configurations: dict[str, Numbers]
    parameters: GliderParameters

    def frame(self, angles: str) -> BasisFrame:
        """Returns the frame of a model that takes the angles as said."""
        angle_sign(angles)
        return BasisFrame(
            arm=self.parameters.hinge_offset + self.parameters.elevator_offset,
            gravity=self.parameters.gravity,
            angles=angles,
        )


def load_exercise(path: Path = EXERCISE) -> Exercise:
    """Reads the exercise and flies its flights; by default that of the article.

    Raises:
        InputError: the file is not an exercise.
    """
    recipe = load_recipe(path)
    parameters = GliderParameters()
    # The published data come from this generator, which NumPy keeps as it is.
    rng = np.random.RandomState(recipe.seed)
    spread, tape_spread = recipe.launch_spread, recipe.tape_spread
    starts, rates = [], []
    for _ in range(recipe.flights):
        starts.append(recipe.launch + rng.uniform(-spread, spread, NUM_STATES))
        rates.append(
            recipe.tape + rng.uniform(-tape_spread, tape_spread, len(recipe.tape))
        )
    flights = fly_exercise(
        parameters, np.array(starts), np.array(rates), recipe.step, order=1
    )
    rest = [i for i in range(recipe.flights) if i != recipe.held_out]
    return Exercise(
        flights=flights,
        fitted=flights.pick(rest),
        held_out=flights.pick([recipe.held_out]),
        configurations={
            name: (tuple(along), tuple(normal), tuple(pitch))
            for name, (along, normal, pitch) in recipe.configurations.items()
        },
        parameters=parameters,
    )


def fly_exercise(
    parameters: GliderParameters,
    start: np.ndarray,
    rates: np.ndarray,
    step: float,
    order: int,
) -> SampledFlights:
    """Flies the flat-plate glider under tapes of elevator rates.

    Args:
        parameters: of the glider.
        start: (B, 7) launch states.
        rates: (B, N) [rad/s].
        step: [s].
        order: 1 for explicit Euler, as the exercise; 4 for Runge-Kutta.

    Raises:
        InputError: the launches or the tapes have another shape.
    """
    if rates.ndim != 2 or start.shape != (len(rates), NUM_STATES):
        raise InputError(
            f"fly_exercise: launches are {start.shape} and tapes {rates.shape}; "
            f"(B, {NUM_STATES}) and (B, N) are needed."
        )
    states = fly_tapes(
        GliderModel(parameters=parameters), start, rates, step, order=order
    )
    return SampledFlights(states=states, rates=rates, step=step)
