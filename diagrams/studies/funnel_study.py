"""A study of funnels made or loaded, checked, tried by flights: one, and two."""

import dataclasses
from pathlib import Path

import numpy as np

from glider.control.tvlqr import compiled_policy
from glider.errors import InputError
from glider.physics.model import GliderModel
from glider.planning.dircol import Progress, plan
from glider.planning.problem import PerchingProblem
from glider.sysid.result import Result
from glider.verification.dynamics.confidence import ConfidenceSet, make_confidence
from glider.verification.funnel.build import make_funnel
from glider.verification.funnel.funnel import Funnel, load_funnel
from glider.verification.funnel.settings import FunnelSettings
from glider.verification.proof.check import Verdict, check_funnel
from glider.verification.proof.flight_proof import FlightProof, prove_flights
from glider.verification.sos.programs import SolverError
from glider.verification.trials.estimated import EstimatedFlights
from glider.verification.trials.falsify import (
    Falsification,
    falsify_funnel,
    falsify_set,
)
from glider.verification.trials.funnel_flights import fly_inside

WORDS = {"drawn": "nominal model", "corrected": "corrected model"}
"""Name of a funnel in files to that for people."""

SHOWN = 40
"""Number of flights from inside that are kept to look at."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class FunnelTrials:
    """Settings by which funnels are made and tried."""

    settings: FunnelSettings = FunnelSettings()
    """Settings of a funnel that is made."""

    samples: int = 8000
    """Number of flights from a boundary, before the climb."""

    every: int = 1
    """Step between the times at which a certificate is checked."""

    prove: bool = False
    """Whether it is proven that no flight leaves, where a remainder is borne."""

    problem: PerchingProblem = dataclasses.field(default_factory=PerchingProblem)
    """Problem that a funnel is made for and compared with."""

    hook: bool = False
    """Whether the problem's hook has to take every state of the last set."""

    confidence: float | None = None
    """Probability with which the gliders that a funnel is made for hold the true one,
    where logs tell how well it is known; None: it is made for the model alone."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class FunnelStudy:
    """A funnel and what was found of it."""

    funnel: Funnel
    """Funnel that was made or loaded."""

    verdict: Verdict
    """Outcome of the check in whole numbers."""

    falsification: Falsification
    """Flights of its own glider from its boundary."""

    proof: FlightProof | None
    """Proof that no flight leaves it, where asked for."""

    flights: np.ndarray
    """Paths (SHOWN, T, n) of launches from inside."""

    on_truth: Falsification | None
    """Flights of the true glider; None where their states differ."""

    on_set: Falsification | None = None
    """Flights of the gliders that it was made for; None where it is one alone."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class FunnelComparison:
    """Funnels of a nominal model, and of the model which its flights' logs show."""

    nominal: FunnelStudy
    """Funnel of the nominal model."""

    corrected: FunnelStudy
    """Funnel of the model that was found."""

    estimated: list[EstimatedFlights]
    """Flights in the first on an estimate; none where not asked for."""

    @property
    def studies(self) -> dict[str, FunnelStudy]:
        """Both studies, by their names in files."""
        return {"drawn": self.nominal, "corrected": self.corrected}


def certify_perch(
    model: GliderModel,
    trials: FunnelTrials,
    progress: Progress | None = None,
    confidence: ConfidenceSet | None = None,
) -> Funnel:
    """Plans a perch with a model and computes the funnel of its feedback.

    Args:
        model: the glider.
        trials: the problem, whether its hook is the goal, and the settings.
        progress: told what is being done.
        confidence: set of gliders that it is for; None for the model alone.

    Raises:
        InputError: there is no certified funnel.
        PlanningError: there is no plan.
    """
    problem = trials.problem
    planned = plan(model, problem, progress=progress)
    try:
        return make_funnel(
            model,
            compiled_policy(model, planned),
            trials.settings,
            confidence=confidence,
            hook_of=problem if trials.hook else None,
            progress=progress,
        )
    except SolverError as error:
        raise InputError(f"There is no funnel for this glider: {error}") from None


def study_funnel(
    source: GliderModel | Result | Path,
    truth: GliderModel,
    trials: FunnelTrials,
    rng: np.random.Generator,
    progress: Progress,
) -> FunnelStudy:
    """Makes a funnel for a model or loads one from a file, checks it and tries it.

    Args:
        source: the model, what logs tell of one, or a file of a funnel.
        truth: a glider that flies in it too.
        trials: how.
        rng: of the flights.
        progress: told what is being done.
    """
    if isinstance(source, Path):
        funnel = load_funnel(source)
    elif isinstance(source, Result):
        confidence = _confidence_of(source, trials.confidence)
        funnel = certify_perch(source.model, trials, progress, confidence)
    else:
        funnel = certify_perch(source, trials, progress)
    progress("checking the certificate in whole numbers")
    verdict = check_funnel(
        funnel, trials.every, problem=trials.problem, hook=trials.hook
    )
    progress("trying to falsify the funnel by flights")
    falsification, on_set = falsify_funnel(funnel, trials.samples, rng), None
    if funnel.gliders:
        allowed = funnel.gliders.confidence
        on_set = falsify_set(funnel, allowed, trials.samples, rng)
    proof = None
    if trials.prove and verdict.holds and funnel.beta.any():
        proof = prove_flights(
            funnel,
            trials.every,
            progress=lambda share: progress(f"funnel: proof, {100.0 * share:.0f} %"),
        )
    flights = fly_inside(funnel, SHOWN, rng)
    progress("the funnel, flown by the true glider")
    try:
        on_truth = falsify_funnel(funnel, trials.samples, rng, model=truth)
    except InputError:  # The funnel's model has states that the true glider lacks.
        on_truth = None
    return FunnelStudy(
        funnel=funnel,
        verdict=verdict,
        falsification=falsification,
        proof=proof,
        flights=flights,
        on_truth=on_truth,
        on_set=on_set,
    )


def _confidence_of(found: Result, level: float | None) -> ConfidenceSet | None:
    """Returns the gliders that logs allow at a level; None without one."""
    if level is None or found.covariance is None:
        return None
    return make_confidence(found.model, found.covariance, level)
