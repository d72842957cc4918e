"""How often 95 % intervals and joint sets hold the truth; asserts nothing.

    python -m benchmarks.bench_coverage [--draws 200] [--fitted 0] [--traced 0]

Four tables, each of marginal intervals (Student's t) and joint ellipsoids (Hotelling's
T²) of all coefficients:

- campaigns that are exactly linear, of columns correlated by 0.9, whose coefficients
  vary from flight to flight by so much more than noise shows;
- the same with the columns of simulated flights, about their fit;
- --fitted: lifelike campaigns of an independent simulator, their true effects fitted;
- --traced: the same, as close-the-loop finds and reports them.
"""

import argparse
from collections.abc import Callable, Iterable

import numpy as np
from scipy.special import stdtrit
from threadpoolctl import threadpool_limits

from benchmarks.bench_floor import RIGHT
from glider import close_the_loop
from glider.physics.confidence import ConfidenceSet
from glider.physics.covariance import Covariance
from glider.sysid.likelihood.model_fit import fit_model, grams_of, linear_flights
from glider.sysid.likelihood.uncertainty import jackknife, larger_of, uncertainty_of
from glider.sysid.outcome import covariance_of
from tests.helpers.known_truth import starts_of, task_of
from tests.helpers.lifelike import draw_campaign
from tests.helpers.linear_campaigns import LinearCampaigns, estimate

LEVEL = 0.95
VARIATIONS = 0.0, 1.0, 10.0
LINEAR = (2, 20), (5, 20), (8, 40), (3, 12)
"""Coefficients and flights of campaigns that are exactly linear."""


def covered(errors: np.ndarray, known: Covariance) -> tuple[np.ndarray, bool]:
    """Returns which marginal intervals hold their errors, and whether the set does."""
    freedom = known.degrees_of_freedom
    most = stdtrit(freedom, 0.5 * (1.0 + LEVEL))
    each = np.abs(errors) <= most * np.sqrt(np.diag(known.matrix))
    return each, bool(ConfidenceSet(covariance=known, level=LEVEL).holds(errors))


def show(words: str, drawn: Iterable[tuple[np.ndarray, bool]]) -> None:
    """Prints the shares of intervals and of sets that hold."""
    each, joint = zip(*drawn, strict=True)
    count, sets = np.concatenate(each), np.array(joint)
    error = np.sqrt(LEVEL * (1.0 - LEVEL) / len(sets))
    print(
        f"{words:58s} {count.mean():6.1%} of {len(count):5d}   {sets.mean():6.1%} of "
        f"{len(sets):4d} (± {error:.1%})",
        flush=True,
    )


def known_of(grams: np.ndarray, precision: np.ndarray) -> Covariance:
    """Returns the covariance of all columns."""
    count = len(precision)
    matrix, freedom = larger_of(*jackknife(grams, precision))
    names = tuple(f"wind.{k}" for k in range(count))
    return Covariance(names=names, matrix=matrix, degrees_of_freedom=freedom)


def drawn_from(
    draw: Callable[[], tuple[np.ndarray, np.ndarray]], draws: int
) -> Iterable[tuple[np.ndarray, bool]]:
    """Yields the coverage of drawn linear campaigns."""
    for _ in range(draws):
        error, grams = draw()
        yield covered(error, known_of(grams, np.zeros(len(error))))


def fitted_campaign(seed: int):
    """Returns a lifelike campaign, its truth, and the right effects fitted."""
    planted = RIGHT[seed % len(RIGHT)]
    flights = int(np.random.default_rng(seed).integers(12, 41))
    campaign, truth = draw_campaign(
        seed, flights, planted, moving_air=bool(seed // len(RIGHT) % 2), broken=False
    )
    task, noise = task_of(campaign)
    starts = starts_of(task, noise, tuple(name for name, _ in planted))
    model = min((fit_model(task, s) for s in starts), key=lambda fit: fit.cost)
    return campaign, truth, task, model


def of_truth(names: Iterable[str], values: Iterable[float], known, truth):
    """Returns the coverage of the coefficients that the truth has, or None."""
    found = dict(zip(names, values, strict=True))
    mine = [n for n in known.names if n in truth.coefficients and n in found]
    if not mine:
        return None
    rows = [known.names.index(n) for n in mine]
    part = Covariance(
        names=tuple(mine),
        matrix=known.matrix[np.ix_(rows, rows)],
        degrees_of_freedom=known.degrees_of_freedom,
    )
    errors = np.array([found[n] - truth.coefficients[n] for n in mine])
    return covered(errors, part)


def of_fitted(seed: int):
    """Returns the coverage of one lifelike campaign, its true effects fitted.

    None where the drawn glider flies through the floor, and no log is left.
    """
    _, truth, task, model = fitted_campaign(seed)
    if not np.isfinite(model.cost):
        return None
    known = covariance_of(task, uncertainty_of(task, model))
    names = [task.space.names[i] for i in model.free]
    return of_truth(names, model.theta[list(model.free)], known, truth)


def of_traced(seed: int):
    """Returns the coverage of one lifelike campaign, traced; None if withheld."""
    planted = RIGHT[seed % len(RIGHT)]
    campaign, truth = draw_campaign(seed, 25, planted, broken=False)
    result = close_the_loop(campaign, seed=seed)
    if result.covariance is None or result.verdict == "not_trusted":
        return None
    found = {
        f"{effect.kind}.{name}": estimate.value
        for effect in result.effects
        for name, estimate in effect.coefficients.items()
    }
    return of_truth(found, found.values(), result.covariance, truth)


def main() -> None:
    """Prints the tables."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--draws", type=int, default=200)
    parser.add_argument("--fitted", type=int, default=0, help="lifelike, fitted")
    parser.add_argument("--traced", type=int, default=0, help="lifelike, traced")
    args = parser.parse_args()
    rng = np.random.default_rng(0)
    print(f"{'':58s} {'marginal':>15s}   joint")
    for count, flights in LINEAR:
        for variation in VARIATIONS:
            linear = LinearCampaigns(
                flights=flights,
                coefficients=count,
                correlation=0.9,
                variation=variation,
            )
            words = f"linear, {count} of {flights} flights, variation {variation:g}"
            show(words, drawn_from(lambda own=linear: own.draw(rng), args.draws))
    for seed in range(len(RIGHT)):
        *_, task, model = fitted_campaign(seed)
        if not model.free:
            continue
        grams = grams_of(linear_flights(task, model), model.scales)
        hessians = grams[:, :-1, :-1]
        names = "+".join(model.kinds)
        for variation in VARIATIONS:
            words = f"{names}, {len(hessians)} flights, variation {variation:g}"
            show(
                words,
                drawn_from(
                    lambda own=hessians, size=variation: estimate(own, size, rng),
                    args.draws,
                ),
            )
    for words, count, of in (
        ("lifelike, fitted", args.fitted, of_fitted),
        ("lifelike, traced", args.traced, of_traced),
    ):
        found = [own for own in map(of, range(count)) if own is not None]
        if found:
            show(f"{words}: {len(found)} of {count} campaigns", found)


if __name__ == "__main__":
    with threadpool_limits(limits=1, user_api="blas"):
        main()
