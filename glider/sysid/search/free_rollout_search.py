"""Effects by the criterion of free rollouts, where no model comes near the noise.

For real flights of a glider without a nominal model. Motion capture is good to a tenth
of a millimetre; a model of a real, thrown glider is good to centimetres. Errors then
last for whole flights, and their squares over the noise say nothing. Here the errors of
free rollouts are compared flight against flight: an effect must predict
flights that its fit has not seen, and do so better by a share. Coefficients start from
a prior, since there is no nominal model to hold them against.
"""

import dataclasses

import numpy as np

from glider.sysid.likelihood.information import (
    cost,
    held_out_costs,
    solve,
)
from glider.sysid.fit.output_error import Fit, fit, gather, in_parallel
from glider.sysid.fit.prediction import predict
from glider.sysid.replay.problem import Problem
from glider.sysid.search.candidates import (
    LEAST_EVIDENCE,
    Fitted,
    Search,
    Weighed,
    starts,
)
from glider.sysid.search.explanation import Explanation

INDEPENDENT_ERRORS = 30.0
"""Number of independent errors that a flight's channels are worth, for evidence."""

T_SIGNIFICANT = 2.0
"""Mean gain of the flights over its standard error (Student's t) that an effect
needs."""

LEAST_SHARE = 0.04
"""Share by which the held-out error must fall for an effect."""

MOST_EFFECTS = 6
"""Effects at most."""

_EVIDENCE_GAP = 6.0
"""Difference of evidence below which two effects are one to us [nats]."""

_FULL_FITS = 5
"""Candidates of each round that are fitted in full."""


def on_free_rollouts(
    problem: Problem, theta: np.ndarray, free: tuple[int, ...]
) -> Problem:
    """Returns the problem on free rollouts, its noise as large as a model's errors."""
    elevator = max(problem.noise.elevator, 0.05)
    guess = dataclasses.replace(
        problem.noise, position=0.05, pitch=0.15, elevator=elevator
    )
    problem = dataclasses.replace(problem, noise=guess, is_exact=True)
    found = fit(problem, theta, free, iterations=20)
    errors = np.concatenate(
        [
            record.flight.pose - predicted.pose
            for record, predicted in zip(
                problem.records,
                in_parallel(
                    lambda r: predict(problem, found.theta, r, whole=True),
                    problem.records,
                ),
                strict=True,
            )
        ]
    )
    size = np.sqrt(np.mean(errors**2, axis=0))
    noise = dataclasses.replace(
        problem.noise, position=float(np.hypot(*size[:2])), pitch=float(size[2])
    )
    return dataclasses.replace(problem, noise=noise)


def evidence_of(small: Fit, large: Fit) -> tuple[float, float, float]:
    """Returns the evidence for a larger fit, how sure it is, and its share.

    The evidence is a log-likelihood ratio of flights left out, with the errors'
    size unknown: Σ ½ N log(c_small / c_large). Sureness is the mean of the
    flights' terms over its standard error.
    """
    flights = len(small.degrees)
    before = held_out_costs(small.information)[:flights]
    after = held_out_costs(large.information)[:flights]
    ratios = np.log(before / after)
    error = max(float(np.std(ratios, ddof=1)), 1e-9) / np.sqrt(flights)
    share = 1.0 - float(after.sum() / before.sum())
    total = 0.5 * INDEPENDENT_ERRORS * float(ratios.sum())
    return total, float(np.mean(ratios)) / error, share


def explain_by_free_rollouts(search: Search) -> Explanation:
    """Finds effects that predict unseen flights better, one at a time.

    What they leave is not tested: it is real, and centimetres.
    """
    search.progress("fitting the plate to free rollouts")
    problem = on_free_rollouts(search.problem, search.theta, search.free(()))
    search = search.on(problem)
    base = fit(problem, search.theta, search.free(()), iterations=20)
    chosen = Fitted(kinds=(), fit=base)
    found: list[Weighed] = []
    candidates: dict[str, float] = {}
    for step in range(MOST_EFFECTS):
        search.progress(f"trying effect {step + 1}")
        tried = [(c, *evidence_of(chosen.fit, c.fit)) for c in _further(search, chosen)]
        if step == 0:
            candidates = {c.kinds[-1]: gain for c, gain, _, _ in tried}
        good = [
            t
            for t in tried
            if t[1] > LEAST_EVIDENCE and t[2] > T_SIGNIFICANT and t[3] > LEAST_SHARE
        ]
        if not good:
            break
        best, gain, _, _ = max(good, key=lambda t: t[1])
        share = (chosen.fit.cost - best.fit.cost) / base.cost
        found.append(
            Weighed(
                kind=best.kinds[-1],
                evidence=gain,
                share=float(share),
                alternatives=tuple(
                    t[0].kinds[-1] for t in good if gain - _EVIDENCE_GAP < t[1] < gain
                ),
            )
        )
        chosen = best
    return Explanation(
        fit=chosen.fit,
        weighed=tuple(sorted(found, key=lambda w: -w.share)),
        unexplained=None,
        candidates=candidates,
        plate=base.theta,
    )


def _further(search: Search, parent: Fitted) -> list[Fitted]:
    """Fits a set with each effect that promises most to first order."""
    kinds = [k for k in search.kinds if k not in parent.kinds]
    free = set(search.free(parent.kinds))
    columns = tuple(sorted(free | set(search.free(tuple(kinds)))))
    information = gather(search.problem, parent.fit.theta, columns).sum(axis=0)
    promised = []
    for kind in kinds:
        mine = free | set(search.free((kind,)))
        keep = [j for j, i in enumerate(columns) if i in mine] + [len(columns)]
        own = information[np.ix_(keep, keep)]
        promised.append((cost(own, solve(own)), kind))
    promised.sort()
    found = []
    for _, kind in promised[:_FULL_FITS]:
        kinds_now = (*parent.kinds, kind)
        start = starts(search.layout, search.layout.kinds[kind], parent.fit.theta)[0]
        result = fit(search.problem, start, search.free(kinds_now), iterations=20)
        found.append(Fitted(kinds=kinds_now, fit=result))
    return found
