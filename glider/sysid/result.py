"""The result of closing the loop, as inert data.

`Result` adds to a `Report` what the program needs: the model, and arrays of figures.
"""

import dataclasses
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from glider.physics.covariance import Covariance
from glider.physics.effects import EffectKind
from glider.physics.model import GliderModel
from glider.sysid.report import Report, ReportedEffect


@dataclasses.dataclass(frozen=True, kw_only=True)
class FoundEffect(ReportedEffect):
    """An effect with a short phrase for people."""

    words: str


@dataclasses.dataclass(frozen=True, kw_only=True)
class HeldOutFlight:
    """A held-out flight measured and flown by each model."""

    name: str  #: Of its file.
    time: np.ndarray  #: (n,) from the first row [s].
    measured: np.ndarray  #: (n, 3) x [m], z [m], pitch [rad].
    flown: dict[str, np.ndarray]  #: The same from rollouts of MODELS.
    fitted_until: float  #: The launch state was fitted on the rows up to here [s].


@dataclasses.dataclass(frozen=True, kw_only=True)
class ResidualTable:
    """The article's residual data set of one model, all flights stacked."""

    variables: dict[str, np.ndarray]  #: Of FLOW_VARIABLES and "alphadot", (N,) each.
    #: (N, 3) measured minus modelled: along the wing, normal [m/s²], pitch [rad/s²].
    residual: np.ndarray
    coefficients: dict[str, np.ndarray]  #: Measured COEFFICIENTS, over ½ρV²S_w, (N,).
    modelled: dict[str, np.ndarray]  #: The same of the model.
    flight: np.ndarray  #: (N,) index of `names` of each row.
    names: tuple[str, ...]  #: Of the flights.
    noise: np.ndarray  #: (N, 3) deviation of `residual` by smoothed noise alone.
    unit: np.ndarray  #: (N, 2) ½ρV²S_w over mass [m/s²] and over inertia [rad/s²/m].


@dataclasses.dataclass(frozen=True, kw_only=True)
class Alternative:
    """A glider that may be the right one, of another set of effects than others."""

    probability: float  #: Of those that are nearly as likely.
    model: GliderModel
    covariance: Covariance | None  #: Given that the set is right; None where all is.


@dataclasses.dataclass(frozen=True, kw_only=True)
class Result(Report):
    """Result of `close_the_loop`."""

    effects: Sequence[FoundEffect]
    path: Path  #: Of the campaign's folder.
    knows_forces: bool  #: Whether mass and areas are specified.
    model: GliderModel  #: The corrected glider.
    held_out: tuple[HeldOutFlight, ...]  #: Held-out flights, measured and flown.
    residual_before: ResidualTable  #: Of the nominal model, else of the baseline.
    residual_after: ResidualTable  #: Of the corrected model.
    own_effects: tuple[EffectKind, ...] = ()  #: User effects that were tried.
    covariance: Covariance | None = None  #: Of all fitted parameters, if any.
    #: The corrected glider and those of sets that are nearly as likely.
    alternatives: tuple[Alternative, ...] = ()
    #: The model as it was fitted, a `FitResult`: where another run may begin.
    fit: Any = dataclasses.field(default=None, repr=False)

    def __repr__(self) -> str:
        """Returns one line, as a notebook shows it."""
        names = ", ".join(effect.kind for effect in self.effects) or "nothing"
        return f"Result('{self.campaign}', {self.verdict}: {names})"

    @property
    def rivals(self) -> list[Alternative]:
        """Those of the other sets, the likeliest first."""
        return sorted(self.alternatives[1:], key=lambda own: -own.probability)

    @property
    def report(self) -> Report:
        """The part that report.json holds."""
        own = {f.name: getattr(self, f.name) for f in dataclasses.fields(Report)}
        own["effects"] = tuple(
            ReportedEffect(**{k: v for k, v in vars(e).items() if k != "words"})
            for e in self.effects
        )
        return Report(**own)
