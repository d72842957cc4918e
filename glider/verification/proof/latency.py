"""A latency that is predicted: how far the prediction, and so its command, may be off.

docs/certificate.md has the proof. In a wind w and with errors d of the commands on
their way, a glider whose numbers deviate by A v is δ = x - x̂ from its prediction,
    δ̇ = J δ + G (d, w) + H v,  J = ∂f/∂x, G = ∂f/∂(u, w), H = ∂f/∂v between them,
    λ(0)ᵀ δ(t) = ∫₀^ℓ (Jᵀ λ - dλ/dσ)ᵀ δ + λᵀ (G (d, w) + H v) dσ
for any λ of the time σ until t. Here λ(0) is a gain K, or a row of a root of S. |δ| is
bounded state by state, and `slopes` bounds J, G, H and both parts of the integral on
the sets of an interval and on all states that near. From the servo's stops the sets
keep that much more away, so that no prediction meets them; a command that is computed
keeps the limit of rate.
"""

import dataclasses
from collections.abc import Sequence

import joblib
import numpy as np
import scipy.linalg

from glider.compiled.taylor import WIDER
from glider.errors import InputError, expect
from glider.progress import Shares, silent
from glider.verification.funnel.funnel import Funnel
from glider.verification.proof.phases import GRID_ROOM, PREDICTED, first_commands
from glider.verification.proof.slopes import NearSets, Slopes
from glider.verification.sos.exact import exact, is_positive_definite
from glider.verification.sos.forms import linear_part

PARTS, _TERMS = 4, 30
"""Straight lines of λ, and terms of the series that bounds |δ|, but for their rest."""

_NEARBY, TURNS = 1.1, 4
"""Distance from the sets on which slopes are bounded, over |δ| by the turn before, and
turns until |δ| is no larger; two are enough as a rule."""

_COARSE, FINE = (2.5,), (1.1, 1.2, 1.5)
"""Bounds over the largest sampled value that are tried in turn: for all predictions,
then for those that leave least."""

_DIGIT = 1e-4
"""Step to which the error that is left is rounded down [rad/s]."""

_CHOICE_ROOM = 1.001
"""Factor on the inlet of one funnel that holds those of all."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Prediction:
    """A state that is predicted, and what it is for."""

    window: Funnel  #: The part in which the commands of the latency act.
    ends: tuple[float, float]  #: First and last time at which the latency may end [s].
    latency: float  #: From the state that is known to the one that is predicted [s].
    gains: np.ndarray  #: K (n,) of the command that is computed from it.
    bound: float  #: Of that command's error [rad/s].
    #: R (n, n), RᵀR >= S, of inlets of which one is chosen by it; (0, n) if none is.
    root: np.ndarray

    def error_left(self, slopes: Slopes, rooms: tuple[float, ...]) -> float:
        """Returns what predictions leave of the command's error [rad/s]."""
        rows = np.vstack([self.gains, self.root])
        pushed, error = _missed(self, slopes, rows, rooms).T
        lefts = [(self.bound - pushed[0]) / (1.0 + error[0])]
        lefts.append(self.window.settings.command_error)
        if len(self.root):
            of_rest, of_error = (np.linalg.norm(of[1:]) for of in (pushed, error))
            lefts.append((PREDICTED - of_rest) / of_error)
        return float(np.min(np.where(np.isnan(lefts), -np.inf, lefts)))


@dataclasses.dataclass(frozen=True, kw_only=True)
class ProvenLatency:
    """What a latency leaves of the bound of the command's error."""

    latency: float  #: From a state to the command that is computed from it [s].
    error_left: float  #: Proven; negative where nothing is [rad/s].
    least: float  #: What has to be left [rad/s].

    @property
    def holds(self) -> bool:
        """Whether that much is left."""
        return self.error_left >= self.least


def check_latency(funnel: Funnel, latency: float) -> None:
    """Raises InputError where a funnel's commands can have no proven latency."""
    period = funnel.settings.period
    if not period:
        raise InputError(
            "--latency is proven of held commands; the funnel is for a feedback that "
            "acts at all times."
        )
    words = f"0 or more, and less than the funnel's period, {period:g} s"
    expect(0.0 <= latency < period, "the latency", latency, words)
    duration = float(funnel.nominal.times[-1])
    words = "more than one command's"
    expect(duration > period + GRID_ROOM, "the funnel's duration", duration, words)


def predictions_of(funnel: Funnel, latency: float) -> list[Prediction]:
    """Returns those of all commands of a funnel, but the first.

    Raises:
        InputError: they are not held, or not for longer than the latency.
    """
    check_latency(funnel, latency)
    nominal = funnel.nominal
    found = []
    for k in nominal.samples[1:].tolist():
        end = float(nominal.times[k])
        first = int(np.searchsorted(nominal.times, end - latency, side="right")) - 1
        found.append(
            Prediction(
                window=funnel.between(max(first, 0), k - 1),
                ends=(end, end),
                latency=latency,
                gains=nominal.gains[k],
                bound=funnel.settings.command_error,
                root=np.zeros((0, funnel.num_states)),
            )
        )
    return found


def first_predictions(
    launch: Funnel, rests: Sequence[Funnel], latency: float
) -> list[Prediction]:
    """Returns those of first commands at any phase, which also choose a funnel.

    Raises:
        InputError: the inlets are no ellipsoids.
    """
    sets = np.array([own.S[0] for own in rests])
    try:
        wider = np.linalg.eigvals(np.linalg.solve(sets[0], sets)).real.max()
        root = np.linalg.cholesky(_CHOICE_ROOM * wider * sets[0]).T
    except np.linalg.LinAlgError:
        root = np.zeros_like(sets[0])
    whole = exact(root).T @ exact(root)
    if not all(is_positive_definite(whole - exact(S)) for S in sets):
        raise InputError("The inlets of the phases' funnels are no ellipsoids.")
    return [
        Prediction(
            window=launch,
            ends=first_commands(launch, rests),
            latency=latency,
            gains=own.nominal.gains[0],
            bound=own.settings.command_error,
            root=root if own is rests[0] else root[:0],
        )
        for own in rests
    ]


def prove_latency(
    predictions: Sequence[Prediction],
    least: float = 0.0,
    *,
    workers: int = -1,
    progress: Shares = silent,
) -> ProvenLatency:
    """Bounds what predictions leave of the funnels' `command_error` to other errors.

    Args:
        predictions: one or more, of one set of gliders and one latency.
        least: what has to be left [rad/s].
        workers: processes; as many as there are cores if -1.
    """
    slopes = Slopes(predictions[0].window)
    lefts = list[float]()
    tasks = (joblib.delayed(own.error_left)(slopes, _COARSE) for own in predictions)
    for left in joblib.Parallel(n_jobs=workers, return_as="generator")(tasks):
        lefts.append(left)
        progress(len(lefts) / len(predictions))
    fine = set[int]()
    while (k := int(np.argmin(lefts))) not in fine:
        fine.add(k)
        lefts[k] = max(lefts[k], predictions[k].error_left(slopes, FINE))
    left = round(float(np.floor(lefts[k] / _DIGIT) * _DIGIT), 6)
    return ProvenLatency(latency=predictions[0].latency, error_left=left, least=least)


@np.errstate(all="ignore")  # What is infinite is bounded by infinity.
def _missed(prediction, slopes, directions, rooms):
    """Returns bounds (R, 2) of |λᵀ δ|: without errors, and per rad/s of error.

    λ are directions (R, n); bounds are infinite where nothing is proven.
    """
    window = prediction.window
    duration = prediction.latency / PARTS
    near = np.zeros(window.num_states)
    flows = window.nominal.flows
    nothing = np.full((len(directions), 2), np.inf)
    for _ in range(TURNS):
        enclosed = [NearSets(slopes, window.between(k, k + 1), near) for k in flows]
        sizes = np.max([part.sizes(rooms) for part in enclosed], axis=0)
        apart = [_apart(sizes, duration * (PARTS - k)) for k in range(PARTS)]
        pushes = enclosed[0].pushes
        farthest = apart[0] @ pushes
        if np.all(farthest <= near):
            break
        near = _NEARBY * farthest
        if not np.all(np.isfinite(near)):
            return nothing
    else:
        return nothing
    step = scipy.linalg.expm(duration * linear_part(window.nominal.open_loop).mean(0))
    first = directions
    total = np.zeros((len(directions), len(pushes)))
    for k, away in enumerate(apart):
        last = first @ step
        begins = prediction.ends[0] - (k + 1) * duration
        ends = prediction.ends[1] - k * duration
        rates = [
            part.pulls(first, last, duration, away, rooms)
            for part in enclosed
            if part.last >= begins and part.first <= ends
        ]
        total += np.max(rates, axis=0) * (duration * WIDER)
        first = last
    wind, error, *numbers = total.T
    return np.column_stack([wind * pushes[0] + sum(numbers), error])


def _apart(sizes, latency):
    """Returns bounds of |δ| (n, P), by pushes of 1, given those of J, G and H."""
    J, term = np.split(latency * sizes, [len(sizes)], axis=1)
    total = term
    for k in range(2, _TERMS + 2):
        term = J @ term / k
        total = total + term
    share = np.linalg.norm(J, np.inf) / (_TERMS + 2)
    rest = term.max(axis=0) * share / (1.0 - share) if share < 1.0 else np.inf
    return (total + rest) * WIDER
