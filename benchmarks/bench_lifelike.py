"""How well does the tracer do on lifelike campaigns? Prints a table; asserts nothing.

    python -m benchmarks.bench_lifelike [--kind lifelike|turbulence|throws]
        [--seeds 8] [--first 0] [--flights 25] [--effects 3] [--jobs 1]

lifelike: several effects at once in other forms than the library's, differences from
    flight to flight, moving air, broken rows.
turbulence: nothing is wrong, the air moves and each flight has its trim.
throws: hand throws of a glider of unknown mass.

A line a campaign: what is true, what is found, the held-out position error of a free
rollout by the refitted plate, by the corrected model, and by who knows the true glider
and the flights' own trims, but not the gusts. `*`: a true kind that the
library lacks; `?`: the true one is among those that the found one may be; `!`: wrong.
"""

import argparse
import dataclasses
import time
from collections import Counter
from collections.abc import Callable

import joblib
import numpy as np

from benchmarks.lifelike_oracle import oracle_predict
from glider.campaign.logs import Campaign
from glider.errors import InputError
from glider.physics.effects import KINDS
from glider.sysid.pipeline import close_the_loop
from glider.sysid.result import Result
from tests.helpers.lifelike import (
    Truth,
    draw_campaign,
    draw_throws,
    turbulence_campaign,
)

NO_CLAIM = ("no_effect", "not_trusted")
"""Verdicts that name no effect as one of the glider's, whatever they list."""

COVERED = 1.96
"""Standard errors that hold 95 % of the errors."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Line:
    """How one campaign was answered.

    Attributes:
        seed: of the campaign.
        verdict: the result's; "refused" where it raised.
        true: names of the truth.
        named: those of them that were named.
        one_of: further ones that a found effect is said to be indistinguishable from.
        found: kinds found, in their order.
        wrong: kinds claimed that are neither true nor allowed.
        spreads: kinds that differ from flight to flight.
        z: "kind.coefficient" to (estimate - truth) / standard error.
        refitted: held-out position error of the refitted plate [m].
        corrected: the same of the corrected model [m].
        oracle: the same of the true glider [m].
        seconds: it took.
        note: of air, forms and faults.
    """

    seed: int
    verdict: str
    true: tuple[str, ...]
    named: tuple[str, ...] = ()
    one_of: tuple[str, ...] = ()
    found: tuple[str, ...] = ()
    wrong: tuple[str, ...] = ()
    spreads: tuple[str, ...] = ()
    z: dict[str, float] = dataclasses.field(default_factory=dict)
    refitted: float = np.nan
    corrected: float = np.nan
    oracle: float = np.nan
    seconds: float = np.nan
    note: str = ""


def judge(
    seed: int, truth: Truth, result: Result, seconds: float, oracle: float
) -> Line:
    """Returns how a result answers a truth."""
    claims = [] if result.verdict in NO_CLAIM else list(result.effects)
    kinds = [e.kind for e in claims]
    named = set(truth.named(kinds))
    missed = [e for e in truth.effects if e.name not in named]
    wrong, one_of = [], []
    for effect in claims:
        if not truth.wrong([effect.kind]):
            continue
        meant = [e for e in missed if e.accepted & set(effect.indistinguishable_from)]
        one_of += [e.name for e in meant]
        if not meant:
            wrong.append(effect.kind)
    z = {}
    for effect in claims:
        for name, estimate in effect.coefficients.items():
            key = f"{effect.kind}.{name}"
            if key in truth.coefficients and estimate.std > 0.0:
                z[key] = (estimate.value - truth.coefficients[key]) / estimate.std
    refitted, corrected = (result.errors[m] for m in ("refitted", "corrected"))
    return Line(
        seed=seed,
        verdict=result.verdict,
        true=tuple(e.name for e in truth.effects),
        named=tuple(sorted(named)),
        one_of=tuple(dict.fromkeys(one_of)),
        found=tuple(e.kind for e in result.effects),
        wrong=tuple(wrong),
        spreads=tuple(truth.spreads),
        z=z,
        refitted=np.nan if refitted is None else refitted.position_rms_m,
        corrected=np.nan if corrected is None else corrected.position_rms_m,
        oracle=oracle,
        seconds=seconds,
        note=note_of(truth),
    )


def oracle_error(campaign: Campaign, truth: Truth, result: Result) -> float:
    """Returns the held-out position error of the true glider [m]."""
    share = 0.2 if campaign.elevator == "servo" else 0.4
    predicted = oracle_predict(campaign, truth, share)
    squares = [
        np.sum((predicted[f.name] - f.pose)[:, :2] ** 2, axis=1)
        for f in campaign.flights
        if f.name in result.flights.held_out
    ]
    return float(np.sqrt(np.mean(np.concatenate(squares))))


def note_of(truth: Truth) -> str:
    """Returns forms, air, spreads and faults of a truth in short."""
    parts = [f"{e.name}/{e.form}" for e in truth.effects if e.form != "library"]
    if truth.air_std:
        parts.append(f"air {truth.air_std:.2f} m/s {truth.air_correlation:.2f} s")
    parts += [f"{kind} +-{spread:.3f}" for kind, spread in truth.spreads.items()]
    if truth.broken:
        parts.append(f"{len(truth.broken)} flights broken")
    return ", ".join(parts)


def run(draw: Callable[[], tuple[Campaign, Truth]], seed: int) -> Line:
    """Draws a campaign, closes the loop on it and judges the answer."""
    campaign, truth = draw()
    begin = time.perf_counter()
    try:
        result = close_the_loop(campaign, seed=seed)
    except InputError as error:
        return Line(
            seed=seed,
            verdict="refused",
            true=tuple(e.name for e in truth.effects),
            seconds=time.perf_counter() - begin,
            note=str(error),
        )
    seconds = time.perf_counter() - begin
    return judge(seed, truth, result, seconds, oracle_error(campaign, truth, result))


def show(line: Line) -> None:
    """Prints one campaign."""
    true = [name + "*" * (name not in KINDS) for name in line.true]
    marks = dict.fromkeys(line.wrong, "!")
    found = [kind + marks.get(kind, "") for kind in line.found]
    found += [name + "?" for name in line.one_of]
    right = set(line.named) == set(line.true) and not line.wrong
    print(
        f"{line.seed:4d} {'ok ' if right else '   '} {line.verdict:16s} "
        f"{line.seconds:6.1f} s {1e3 * line.refitted:7.1f} "
        f"{1e3 * line.corrected:7.1f} {1e3 * line.oracle:7.1f} mm\n"
        f"       true:  {' + '.join(true) or 'nothing'}   [{line.note}]\n"
        f"       found: {' + '.join(found) or 'nothing'}",
        flush=True,
    )
    if line.z:
        errors = ", ".join(f"{key} {z:+.1f}" for key, z in line.z.items())
        print(f"       (estimate - truth) / std: {errors}", flush=True)


def _share(part: int, whole: int) -> str:
    return f"{part} of {whole}" + (f" ({part / whole:.0%})" if whole else "")


def show_totals(lines: list[Line]) -> None:
    """Prints what all campaigns come to."""
    true = [name for line in lines for name in line.true]
    in_library = sum(name in KINDS for name in true)
    named = [name for line in lines for name in line.named]
    claiming = [line for line in lines if line.wrong]
    wrong = Counter(kind for line in lines for kind in line.wrong)
    z = np.array([z for line in lines for z in line.z.values()])
    ratio = np.array([line.corrected / line.refitted for line in lines])
    worse = int(np.sum(ratio > 1.0))
    print(f"\nverdicts: {dict(Counter(line.verdict for line in lines))}")
    right = sum(set(x.named) == set(x.true) and not x.wrong for x in lines)
    print(f"campaigns all right: {_share(right, len(lines))}")
    print(
        f"effects named: {_share(len(named), len(true))}; of those in the library: "
        f"{_share(sum(name in KINDS for name in named), in_library)}; "
        f"one of several: {sum(len(line.one_of) for line in lines)}"
    )
    per_true = sum(wrong.values()) / len(true) if true else np.nan
    print(
        f"wrong names: {sum(wrong.values())}, {per_true:.2f} per true name, in "
        f"{_share(len(claiming), len(lines))} campaigns: {dict(wrong.most_common())}"
    )
    missed = Counter(true) - Counter(named)
    print(f"missed: {dict(missed.most_common())}")
    spreads = [(kind, line) for line in lines for kind in line.spreads]
    seen = sum(kind in line.found for kind, line in spreads)
    print(f"per-flight differences named as effects: {_share(seen, len(spreads))}")
    if len(z):
        print(
            f"coefficients within {COVERED} standard errors: "
            f"{_share(int(np.sum(np.abs(z) <= COVERED)), len(z))}, "
            f"worst {np.abs(z).max():.1f}"
        )
    finite = ratio[np.isfinite(ratio)]
    if len(finite):
        print(
            f"corrected over refitted error: median {np.median(finite):.2f}, "
            f"worst {finite.max():.2f}; "
            f"worse than refitted: {_share(worse, len(lines))}"
        )
    above = np.array([line.corrected / line.oracle for line in lines])
    if np.any(np.isfinite(above)):
        print(f"corrected over oracle error: median {np.nanmedian(above):.2f}")
    seconds = np.array([line.seconds for line in lines])
    print(f"seconds: median {np.median(seconds):.1f}, most {seconds.max():.1f}")


def main() -> None:
    """Runs the chosen campaigns."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--kind", choices=("lifelike", "turbulence", "throws"), default="lifelike"
    )
    parser.add_argument("--seeds", type=int, default=8, help="number of campaigns")
    parser.add_argument("--first", type=int, default=0, help="first seed")
    parser.add_argument(
        "--flights", type=int, default=25, help="0: 12 to 40, drawn by the seed"
    )
    parser.add_argument("--effects", type=int, help="how many; drawn by default")
    parser.add_argument("--jobs", type=int, default=1, help="campaigns at a time")
    args = parser.parse_args()

    def drawing(seed: int) -> Callable[[], tuple[Campaign, Truth]]:
        drawn = int(np.random.default_rng(seed).integers(12, 41))
        flights = args.flights or drawn
        if args.kind == "turbulence":
            return lambda: turbulence_campaign(seed, flights)
        if args.kind == "throws":
            return lambda: draw_throws(seed, flights)
        return lambda: draw_campaign(seed, flights, args.effects)

    seeds = range(args.first, args.first + args.seeds)
    tasks = (joblib.delayed(run)(drawing(seed), seed) for seed in seeds)
    print("seed     verdict             time refitted corrected oracle (held-out)")
    lines = []
    for line in joblib.Parallel(n_jobs=args.jobs, return_as="generator")(tasks):
        show(line)
        lines.append(line)
    show_totals(lines)


if __name__ == "__main__":
    main()
