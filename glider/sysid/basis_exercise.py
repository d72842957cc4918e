"""The article's identification exercise: its flights and its configurations."""

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from glider.effects import NO_FIELD
from glider.errors import InputError
from glider.kernel import compiled
from glider.parameters import GliderParameters, parameter_vector
from glider.paths import models_path
from glider.sysid.basis_features import angle_sign
from glider.sysid.basis_model import BasisFrame, Numbers, SampledFlights

_FIELDS = {
    "flights",
    "held_out",
    "seed",
    "step",
    "launch",
    "launch_spread",
    "tape_spread",
    "tape",
    "configurations",
}


@dataclasses.dataclass(frozen=True, kw_only=True)
class Exercise:
    """The exercise's flights and the configurations that it compares.

    Attributes:
        flights: all of them; angles nose down, as everywhere in this project.
        fitted: those to fit.
        held_out: the one that is not.
        configurations: name to features of each channel.
        drawing: of the glider that flew.
    """

    flights: SampledFlights
    fitted: SampledFlights
    held_out: SampledFlights
    configurations: dict[str, Numbers]
    drawing: GliderParameters

    def frame(self, angles: str) -> BasisFrame:
        """Returns the frame of a model that takes the angles as said."""
        angle_sign(angles)
        return BasisFrame(
            arm=self.drawing.hinge_offset + self.drawing.elevator_offset,
            gravity=self.drawing.gravity,
            angles=angles,
        )


def load_exercise(path: Path | None = None) -> Exercise:
    """Reads the exercise and flies its flights; by default that of the article.

    Raises:
        InputError: the file is not an exercise.
    """
    path = models_path("exercises", "identification.yaml") if path is None else path
    data = _read(path)
    drawing = GliderParameters()
    # The published data come from this generator, which NumPy keeps as it is.
    rng = np.random.RandomState(data["seed"])
    tape, launch = np.array(data["tape"]), np.array(data["launch"])
    starts, rates = [], []
    for _ in range(data["flights"]):
        spread, tape_spread = data["launch_spread"], data["tape_spread"]
        starts.append(launch + rng.uniform(-spread, spread, len(launch)))
        rates.append(tape + rng.uniform(-tape_spread, tape_spread, len(tape)))
    flights = fly_tapes(
        drawing, np.array(starts), np.array(rates), data["step"], order=1
    )
    rest = [i for i in range(len(starts)) if i != data["held_out"]]
    return Exercise(
        flights=flights,
        fitted=flights.pick(rest),
        held_out=flights.pick([data["held_out"]]),
        configurations={
            str(name): (tuple(along), tuple(normal), tuple(pitch))
            for name, (along, normal, pitch) in data["configurations"].items()
        },
        drawing=drawing,
    )


def fly_tapes(
    drawing: GliderParameters,
    start: np.ndarray,
    rates: np.ndarray,
    step: float,
    order: int,
) -> SampledFlights:
    """Flies the drawn glider under tapes of elevator rates.

    Args:
        drawing: of the glider.
        start: (B, 7) launch states.
        rates: (B, N) [rad/s].
        step: [s].
        order: 1 for explicit Euler, as the exercise; 4 for Runge-Kutta.
    """
    states = np.empty((len(rates), rates.shape[1] + 1, start.shape[1]))
    p, c = parameter_vector(drawing), np.zeros(0)
    compiled().rollouts(start, rates, step, p, c, NO_FIELD, order, states)
    return SampledFlights(states=states, rates=rates, step=step)


def _read(path: Path) -> dict[str, Any]:
    try:
        data = yaml.safe_load(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, yaml.YAMLError) as error:
        first = str(error).strip().splitlines()[0]
        raise InputError(f"{path}: not an exercise: {first}") from None
    if not isinstance(data, dict) or data.keys() != _FIELDS:
        found = ", ".join(map(str, data)) if isinstance(data, dict) else repr(data)
        raise InputError(
            f"{path}: not an exercise: it holds {found}; "
            f"{', '.join(sorted(_FIELDS))} are needed."
        )
    return data
