"""Tracing where no model comes near the noise: real flights of an undrawn glider.

Motion capture is good to a tenth of a millimetre; a model of a real, thrown
glider is good to centimetres. Errors then last for whole flights, and their
squares over the noise say nothing. Here the errors of free rollouts are compared
flight against flight: an effect must make flights foretold that its fit has not
seen, by a share, in most of them. Coefficients start from a prior, since there
is no drawing to hold them against.
"""

import dataclasses

import numpy as np

from glider.sysid.fit.information import (
    cost,
    held_out_costs,
    solve,
)
from glider.sysid.fit.output_error import Fit, fit, gather, in_parallel
from glider.sysid.fit.prediction import foretell
from glider.sysid.replay.problem import Problem
from glider.sysid.search.candidates import (
    Fitted,
    Search,
    Weighed,
    starts,
)
from glider.sysid.search.explanation import Explanation

INDEPENDENT = 30.0
"""Independent errors that a flight's channels are worth together, for evidence."""

SURE = 2.0
"""Mean gain of the flights over its standard error that an effect needs."""

LEAST = 0.04
"""Share by which the held-out error must fall for an effect."""

MOST = 6
"""Effects at most."""

_ALIKE = 6.0
"""Difference of evidence below which two effects are one to us [nats]."""

_REFINED = 5
"""Candidates of each round that are fitted in full."""


def roughened(problem: Problem, theta: np.ndarray, free: tuple[int, ...]) -> Problem:
    """Returns the problem on rollouts, its noise as large as a model's errors."""
    elevator = max(problem.noise.elevator, 0.05)
    guess = dataclasses.replace(
        problem.noise, position=0.05, pitch=0.15, elevator=elevator
    )
    problem = dataclasses.replace(problem, noise=guess, is_exact=True)
    found = fit(problem, theta, free, iterations=20)
    errors = np.concatenate(
        [
            record.flight.pose - forecast.pose
            for record, forecast in zip(
                problem.records,
                in_parallel(
                    lambda r: foretell(problem, found.theta, r, whole=True),
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
    total = 0.5 * INDEPENDENT * float(ratios.sum())
    return total, float(np.mean(ratios)) / error, share


def explain_roughly(search: Search) -> Explanation:
    """Finds effects that foretell unseen flights better, one at a time.

    What they leave is not tested: it is real, and centimetres.
    """
    search.progress("fitting the plate to free rollouts")
    problem = roughened(search.problem, search.theta, search.free(()))
    search = search.on(problem)
    base = fit(problem, search.theta, search.free(()), iterations=20)
    chosen = Fitted(kinds=(), fit=base)
    found: list[Weighed] = []
    candidates: dict[str, float] = {}
    for step in range(MOST):
        search.progress(f"trying effect {step + 1}")
        tried = [(c, *evidence_of(chosen.fit, c.fit)) for c in _further(search, chosen)]
        if step == 0:
            candidates = {c.kinds[-1]: gain for c, gain, _, _ in tried}
        good = [t for t in tried if t[1] > 3.0 and t[2] > SURE and t[3] > LEAST]
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
                    t[0].kinds[-1] for t in good if gain - _ALIKE < t[1] < gain
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
    for _, kind in promised[:_REFINED]:
        kinds_now = (*parent.kinds, kind)
        start = starts(search.layout, search.layout.kinds[kind], parent.fit.theta)[0]
        result = fit(search.problem, start, search.free(kinds_now), iterations=20)
        found.append(Fitted(kinds=kinds_now, fit=result))
    return found
