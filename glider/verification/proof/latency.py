"""A latency that is predicted: how far the prediction, and so its command, may be off.

docs/certificate.md has the proof. In a wind w and with errors d of the commands on
their way, a glider whose numbers deviate by A v is δ = x - x̂ from its prediction,
    δ̇ = J δ + G (d, w) + H v,  J = ∂f/∂x, G = ∂f/∂(u, w), H = ∂f/∂v between them,
    λ(0)ᵀ δ(t) = ∫₀^ℓ (Jᵀ λ - dλ/dσ)ᵀ δ + λᵀ (G (d, w) + H v) dσ
for any λ of the time σ until t. Here λ(0) is the gain K. |δ| is bounded state by state,
and `slopes` bounds J, G, H and both parts of the integral on the sets of an interval
and on all states that near. The sets keep that much farther from the servo's stops, so
that no prediction meets them; a command that is computed keeps the limit of rate.
"""

import dataclasses

import joblib
import numpy as np
import scipy.linalg

from glider.compiled.taylor import WIDER
from glider.errors import InputError, expect
from glider.progress import Shares, silent
from glider.verification.funnel.funnel import Funnel
from glider.verification.proof.slopes import NearSets, Slopes
from glider.verification.sos.forms import linear_part

_PARTS, _TERMS = 4, 30
"""Straight lines of λ, and terms of the series that bounds |δ|, without their rest."""

_NEARBY, _TURNS = 1.1, 4
"""Distance from the sets on which slopes are bounded, over |δ| by the turn before, and
turns until |δ| is no larger; two are enough as a rule."""

_COARSE, FINE = (2.5,), (1.1, 1.2, 1.5)
"""Bounds over the largest sampled value that are tried in turn: for all predictions,
then for those that leave least."""

_DIGIT = 1e-4
"""Step to which the error that is left is rounded down [rad/s]."""

_SHORTEST = 1e-9
"""Time by which a flight must last longer than its first command [s]."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Prediction:
    """The prediction of the state in which a command will begin to act."""

    window: Funnel  #: Part in which the latency passes; the command acts at its end.
    latency: float  #: From the state that is known to the one that is predicted [s].
    gains: np.ndarray  #: K (n,) of the command that is computed from it.

    def error_left(self, slopes: Slopes, rooms: tuple[float, ...]) -> float:
        """Returns what the prediction leaves of the command's error [rad/s]."""
        in_wind, by_error = _missed(self, slopes, rooms)
        left = (self.window.settings.command_error - in_wind) / (1.0 + by_error)
        return -np.inf if np.isnan(left) else float(left)


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
    expect(duration > period + _SHORTEST, "the funnel's duration", duration, words)


def predictions_of(funnel: Funnel, latency: float) -> list[Prediction]:
    """Returns the predictions for all commands of a funnel but the first.

    Raises:
        InputError: its commands are not held, or not for longer than the latency.
    """
    check_latency(funnel, latency)
    nominal = funnel.nominal
    found = []
    for k in nominal.samples[1:].tolist():
        begin = nominal.times[k] - latency
        first = int(np.searchsorted(nominal.times, begin, side="right")) - 1
        window = funnel.between(max(first, 0), k - 1)
        gains = nominal.gains[k]
        found.append(Prediction(window=window, latency=latency, gains=gains))
    return found


def prove_latency(
    predictions: list[Prediction],
    least: float = 0.0,
    *,
    workers: int = -1,
    progress: Shares = silent,
) -> ProvenLatency:
    """Bounds what predictions leave of a funnel's `command_error` to other errors.

    Args:
        predictions: one or more, of one funnel and one latency.
        least: what has to be left [rad/s].
        workers: processes; as many as there are cores if -1.
    """
    slopes = Slopes(predictions[0].window)
    lefts = list[float]()
    tasks = (joblib.delayed(own.error_left)(slopes, _COARSE) for own in predictions)
    for left in joblib.Parallel(n_jobs=workers, return_as="generator")(tasks):
        lefts.append(left)
        progress(len(lefts) / len(predictions))
    refined = set[int]()
    worst = int(np.argmin(lefts))
    while worst not in refined:
        refined.add(worst)
        finer = predictions[worst].error_left(slopes, FINE)
        lefts[worst] = max(lefts[worst], finer)
        worst = int(np.argmin(lefts))
    left = round(float(np.floor(lefts[worst] / _DIGIT) * _DIGIT), 6)
    return ProvenLatency(latency=predictions[0].latency, error_left=left, least=least)


@np.errstate(all="ignore")  # What is infinite is bounded by infinity.
def _missed(prediction, slopes, rooms):
    """Returns bounds of |K δ|: without errors of commands, and per rad/s of error.

    Both are infinite where nothing is proven.
    """
    window = prediction.window
    nominal = window.nominal
    duration = prediction.latency / _PARTS
    enclosed, apart = _enclosed(window, slopes, duration, rooms)
    if not enclosed:
        return np.inf, np.inf
    step = scipy.linalg.expm(duration * linear_part(nominal.open_loop).mean(0))
    first = prediction.gains
    total = np.zeros(len(enclosed[0].pushes))
    for k, away in enumerate(apart):
        last = first @ step
        begin = nominal.times[-1] - (k + 1) * duration
        end = nominal.times[-1] - k * duration
        rates = [
            part.pulls(first, last, duration, away, rooms)
            for part in enclosed
            if part.last >= begin and part.first <= end
        ]
        total += np.max(rates, axis=0) * (duration * WIDER)
        first = last
    wind, error, *numbers = total
    return wind * enclosed[0].pushes[0] + sum(numbers), error


def _enclosed(window, slopes, duration, rooms):
    """Returns slopes near the sets of each interval, and bounds of |δ| along λ's lines.

    There are none where |δ| is not proven to stay near the sets.
    """
    near = np.zeros(window.num_states)
    flows = window.nominal.flows
    for _ in range(_TURNS):
        enclosed = [NearSets(slopes, window.between(k, k + 1), near) for k in flows]
        sizes = np.max([part.sizes(rooms) for part in enclosed], axis=0)
        apart = [_apart(sizes, duration * (_PARTS - k)) for k in range(_PARTS)]
        farthest = apart[0] @ enclosed[0].pushes
        if np.all(farthest <= near):
            return enclosed, apart
        near = _NEARBY * farthest
        if not np.all(np.isfinite(near)):
            break
    return [], []


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
