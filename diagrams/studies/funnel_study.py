"""A study of one glider's funnel: made or loaded, checked, tried by flights."""

import dataclasses
from pathlib import Path

import numpy as np

from diagrams.studies.funnel_report import figures_of
from glider.control.tvlqr import compiled_policy
from glider.errors import InputError
from glider.physics.model import GliderModel
from glider.planning.dircol import (
    Progress,
    plan,
)
from glider.planning.problem import PerchingProblem
from glider.verification.funnel.build import make_funnel
from glider.verification.funnel.funnel import (
    Funnel,
    load_funnel,
)
from glider.verification.funnel.settings import FunnelSettings
from glider.verification.proof.check import check_funnel
from glider.verification.proof.remainder_proof import prove_remainder
from glider.verification.sos.solving import SolverError
from glider.verification.trials.falsify import falsify_funnel
from glider.verification.trials.flights import fly_inside

SHOWN = 40
"""Number of flights from inside that are kept to look at."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class FunnelStudy:
    """A funnel and what was found of it."""

    funnel: Funnel
    """Funnel that was made or loaded."""

    figures: dict
    """Key figures, of `figures_of`."""

    flights: np.ndarray
    """Paths (SHOWN, T, n) of launches from inside."""


def certify_perch(
    model: GliderModel, settings: FunnelSettings, progress: Progress | None = None
) -> Funnel:
    """Plans the article's perch with a model and computes the funnel of its feedback.

    Raises:
        InputError: there is no certified funnel.
        PlanningError: there is no plan.
    """
    planned = plan(model, PerchingProblem(), progress=progress)
    try:
        policy = compiled_policy(model, planned)
        return make_funnel(model, policy, settings, progress=progress)
    except SolverError as error:
        raise InputError(f"There is no funnel for this glider: {error}") from None


def study_funnel(
    source: GliderModel | Path,
    settings: FunnelSettings,
    samples: int,
    every: int,
    rng: np.random.Generator,
    progress: Progress,
    prove: bool = False,
) -> FunnelStudy:
    """Makes a funnel for a model or loads one from a file, checks it and tries it.

    Args:
        source: the model, or a file of a funnel.
        settings: of a funnel that is made.
        samples: flights from its boundary, before the climb.
        every: check every so many times.
        rng: of the flights.
        progress: told what is being done.
        prove: whether to prove its remainder, where it bears one.
    """
    if isinstance(source, Path):
        funnel = load_funnel(source)
    else:
        funnel = certify_perch(source, settings, progress)
    progress("checking the certificate in whole numbers")
    verdict = check_funnel(funnel, every)
    progress("trying to falsify the funnel by flights")
    falsification = falsify_funnel(funnel, samples, rng)
    proof = None
    if prove and verdict.holds and funnel.beta.any():
        proof = prove_remainder(
            funnel,
            every,
            progress=lambda share: progress(f"remainder: proof, {100.0 * share:.0f} %"),
        )
    return FunnelStudy(
        funnel=funnel,
        figures=figures_of(funnel, verdict, falsification, proof),
        flights=fly_inside(funnel, SHOWN, rng),
    )
