"""Is the right name found in any functional form? Prints tables; asserts nothing.

    python -m benchmarks.bench_forms [--number 40] [--first 0] [--held-back]
        [--family ground] [--effects 2] [--nulls 200] [--jobs 2] [--json FILE.jsonl]

Campaigns of one to four effects, none in the library's formula
(`benchmarks.other_forms`), 12 to 40 flights; odd seeds fly in turbulence, and in a
third of them trims, pitch zeros and winds differ from flight to flight. The truth is
the library's own chain with hooks in its links. Of a nulls' campaign nothing is wrong
with the glider; every other pair of them has a fault of the measuring chain.

A line a campaign: found of true families; wrong names; held-out position error of the
corrected model, and of a perfect one, whose launches are fitted the same way. `!` marks
a wrong name, `?` a right one that a found one may be, `-` a family not found. Lines are
kept in FILE, and a seed that is there is not run again.

Seeds 0 to 9999 are for development. Those of --held-back are for final runs only: what
they give may be counted, and never looked into.
"""

import argparse
import dataclasses
import json
import math
import time
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import joblib
import numpy as np

from benchmarks.hooked_flight import EVERY, HookedGlider, predict
from benchmarks.other_forms import FAMILIES, FORMS, RIVALS, Family
from glider.campaign.logs import Campaign, Flight, campaign_of
from glider.errors import InputError
from glider.physics.effects import KINDS
from glider.physics.parameters import GliderParameters
from glider.sysid.pipeline import close_the_loop
from glider.sysid.result import FoundEffect, Result
from tests.campaign.checks import breaking as b
from tests.helpers.lifelike import (
    COMMAND_RATE,
    Capture,
    draw_air,
    draw_commands,
    draw_spreads,
    draw_starts,
    log_poses,
)
from tests.helpers.lifelike_flight import Servo, elevator_paths, gusts

COUNTS = (1, 1, 2, 2, 3, 4)
"""How many effects a campaign has, each as likely."""

HELD_BACK = 100_000
"""First seed of final runs."""

NO_CLAIM = ("no_effect", "not_trusted", "refused", "crashed")
"""Verdicts that name no effect as one of the glider's, whatever they list."""

MOST_LEFT = 2.0
"""Times a perfect model's error above which `effect_found` claims too much."""

ROWS = round(0.85 * Capture().rate) + 1

Line = dict[str, Any]


@dataclasses.dataclass(frozen=True, kw_only=True)
class Planted:
    """An effect of a truth."""

    family: str
    form: str
    words: str

    @property
    def of(self) -> Family:
        """Its link, variables and right names."""
        return FAMILIES[self.family]

    def is_named_by(self, effect: FoundEffect) -> bool:
        """Returns whether a found effect is this family, by name or by curve.

        A curve must be at its link and share a variable.
        """
        if effect.kind != "unexplained":
            return effect.kind in self.of.names
        common = set(effect.depends_on) & set(self.of.variables)
        return effect.link == self.of.link and bool(common)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Truth:
    """What is wrong with a campaign's glider, and its flights without noise."""

    planted: tuple[Planted, ...]
    glider: HookedGlider
    start: np.ndarray  #: (6, F) launches.
    air: tuple[float, float]  #: Standard deviation [m/s] and correlation time [s].
    spreads: dict[str, float]  #: Kind to its standard deviation over flights.


def draw_families(rng: np.random.Generator, first: str, count: int) -> list[str]:
    """Returns families of which no two are rivals."""
    families = [first]
    for family in map(str, rng.permutation(list(FAMILIES))):
        rivals = set().union(*(r for r in RIVALS if family in r), {family})
        if len(families) < count and not rivals & set(families):
            families.append(family)
    return families


def draw(
    seed: int, family: str | None = None, count: int | None = None, null: bool = False
) -> tuple[Campaign, Truth]:
    """Draws a campaign; the families take turns at being the first."""
    streams = [np.random.default_rng([seed, 28 + null, i]) for i in range(5)]
    effects, flying, spreading, moving, sensing = streams
    flights = int(flying.integers(12, 41))
    count = int(effects.choice(COUNTS)) if count is None else count
    first = family or list(FAMILIES)[seed % len(FAMILIES)]
    planted, hooks, servo, play = [], [], Servo(), 0.0
    for chosen in [] if null else draw_families(effects, first, count):
        name = str(effects.choice(list(FORMS[chosen])))
        form = FORMS[chosen][name](effects)
        planted.append(Planted(family=chosen, form=name, words=form.words))
        hooks += form.hooks
        servo, play = (form.servo, form.play) if chosen == "servo" else (servo, play)
    differs = spreading.random() < (0.5 if null else 1 / 3)
    drawn = draw_spreads(spreading, flights) if differs else {}
    departures = {kind: values for kind, (_, values) in drawn.items()}
    wind = departures.get("wind", np.zeros(flights, complex))
    still = np.zeros(flights)
    constants = np.array(
        [
            *(wind.real, wind.imag, departures.get("elevator_trim", still)),
            departures.get("pitch_offset", still),
        ]
    )
    commands, half_steps = draw_commands(flying, flights), 2 * EVERY * (ROWS - 1)
    limits = GliderParameters().servo
    path = elevator_paths(
        servo, commands, 1.0 / COMMAND_RATE, half_steps, (limits.low, limits.high)
    )
    path = with_play(path, play)
    launched = draw_starts(flying, flights)
    start = np.array(
        [
            *(launched[0].real, launched[0].imag, launched[2].real),
            *(launched[1].real, launched[1].imag, launched[3].real),
        ]
    )
    std, correlation = draw_air(moving) if seed % 2 else (0.0, 0.0)
    air = gusts(moving, std, correlation, path.shape) if std else None
    glider = HookedGlider(hooks=tuple(hooks), elevator=path)
    pose = glider.fly(start, constants, air)
    logged = log_poses(sensing, pose, path[:: 2 * EVERY], Capture(), commands)
    campaign = campaign_of(
        f"forms_{seed}", GliderParameters(), logged, Capture().rate, COMMAND_RATE
    )
    truth = Truth(
        planted=tuple(planted),
        glider=glider,
        start=start,
        air=(std, correlation),
        spreads={kind: spread for kind, (spread, _) in drawn.items()},
    )
    return campaign, truth


def with_play(path: np.ndarray, play: float) -> np.ndarray:
    """Returns the angles of an elevator that follows paths with a play either way."""
    followed = path.copy()
    for before, here, wanted in zip(followed, followed[1:], path[1:], strict=False):
        here[:] = np.clip(before, wanted - play, wanted + play)
    return followed


def floor_of(campaign: Campaign, truth: Truth, held_out: Sequence[str]) -> float:
    """Returns the position error that a perfect model leaves on flights [m]."""
    spread = truth.spreads.get
    spreads = np.array(
        [
            *(spread("wind", 0.0), 0.3 * spread("wind", 0.0)),
            *(spread("elevator_trim", 0.0), spread("pitch_offset", 0.0)),
        ]
    )
    predicted = predict(truth.glider, campaign.flights, truth.start, spreads, truth.air)
    squares = [
        np.sum((predicted[:, i] - flight.pose)[:, :2] ** 2, axis=1)
        for i, flight in enumerate(campaign.flights)
        if flight.name in held_out
    ]
    return float(np.sqrt(np.mean(squares)))


def judge(campaign: Campaign, truth: Truth, result: Result) -> Line:
    """Returns how a result answers a truth."""
    claims = [] if result.verdict in NO_CLAIM else list(result.effects)
    found = [any(p.is_named_by(e) for e in claims) for p in truth.planted]
    missed = [
        p for p, is_found in zip(truth.planted, found, strict=True) if not is_found
    ]
    right = set(truth.spreads).union(
        *(p.of.names | p.of.allowed for p in truth.planted)
    )
    wrong, one_of = {}, set()
    for effect in claims:
        named = any(p.is_named_by(effect) for p in truth.planted)
        # A formula whose size may be zero has lost its name: it cannot be a wrong one.
        label = label_of(effect)
        if named or effect.kind in right or label == "unexplained":
            continue
        rivals = set(effect.indistinguishable_from)
        meant = [p.family for p in missed if p.of.names & rivals]
        one_of.update(meant)
        if not meant:
            wrong[label] = taken_place(effect, truth.planted, missed)
    corrected = result.errors["corrected"]
    error = math.nan if corrected is None else corrected.position_rms_m
    perfect = floor_of(campaign, truth, result.flights.held_out)
    return {
        "verdict": result.verdict,
        "found": found,
        "one_of": sorted(one_of),
        "kinds": [label_of(e) for e in result.effects],
        "names": len(set(map(label_of, claims)) - {*truth.spreads, "unexplained"}),
        "wrong": wrong,
        "error": error,
        "perfect": perfect,
        "ratio": error / perfect,
    }


def label_of(effect: FoundEffect) -> str:
    """Returns an effect's kind; of a curve its link."""
    is_curve = effect.kind == "unexplained" and effect.link
    return f"{effect.link} curve" if is_curve else effect.kind


def taken_place(
    effect: FoundEffect, planted: Sequence[Planted], missed: Sequence[Planted]
) -> str:
    """Returns the families that a wrong name stands for.

    They are missed ones of its link, else all that were missed; where none was, it
    stands beside those that were found.
    """
    link = effect.link or link_of(effect.kind)
    if others := [p for p in missed if p.of.link == link] or missed:
        return "for " + " or ".join(p.family for p in others)
    close = [p for p in planted if p.of.link == link] or planted
    return "beside " + " or ".join(p.family for p in close) if close else "for nothing"


def link_of(kind: str) -> str:
    """Returns the link of the force chain that a kind of the library changes."""
    if kind not in KINDS:
        return ""
    effect = KINDS[kind]
    if effect.stage in ("actuator", "air", "inertia", "sensor"):
        return effect.stage
    by_term = {
        **{"wing_incidence": "wing_angle", "wing_shift": "moment"},
        **{"elevator_trim": "tail_angle", "downwash": "tail_angle"},
        **{"elevator_factor": "tail_pressure", "moment": "moment"},
    }
    return by_term.get(effect.adds_to[0], "wing_force")


def jitter(flight: Flight, rng: np.random.Generator, _: float) -> Flight:
    """Stamps poses on receipt, each with another delay."""
    late = rng.exponential(rng.uniform(0.5e-3, 3e-3), flight.time.size)
    return dataclasses.replace(flight, time=np.sort(flight.time + late))


def repeat(flight: Flight, rng: np.random.Generator, _: float) -> Flight:
    """Sends every tenth pose again."""
    count = len(flight.pose)
    for row in np.sort(rng.choice(np.arange(1, count), count // 10)):
        flight = b.freeze(row - 1, 1)(flight)
    return flight


def drift(flight: Flight, _: np.random.Generator, when: float) -> Flight:
    """Shifts the servo's clock by up to 3 ms, from the first flight to the last."""
    return b.shift_servo(6e-3 * (when - 0.5))(flight)


def lose(flight: Flight, rng: np.random.Generator, _: float) -> Flight:
    """Leaves one command in fifty out of the log."""
    command = np.array(flight.command)
    ticks = np.flatnonzero(np.diff(command)) + 1
    for first, last in zip(ticks, [*ticks[1:], len(command)], strict=True):
        if rng.random() < 0.02:
            command[first:last] = command[first - 1]
    return dataclasses.replace(flight, command=command)


def quantize(flight: Flight, _: np.random.Generator, __: float) -> Flight:
    """Logs commands in steps of 0.2 rad/s."""
    return dataclasses.replace(flight, command=np.round(flight.command / 0.2) * 0.2)


CHAIN_FAULTS = (jitter, repeat, drift, lose, quantize)
"""Faults of the measuring chain, which say nothing of the glider."""


def spoil(campaign: Campaign, seed: int) -> tuple[Campaign, str]:
    """A campaign with the fault of the measuring chain that its seed has."""
    fault = CHAIN_FAULTS[(seed // 4) % len(CHAIN_FAULTS)]
    rng = np.random.default_rng([seed, 60])
    whens = np.linspace(0.0, 1.0, len(campaign.flights))
    pairs = zip(campaign.flights, whens, strict=True)
    flights = tuple(fault(flight, rng, float(when)) for flight, when in pairs)
    return dataclasses.replace(campaign, flights=flights), fault.__name__


def run(seed: int, family: str | None, count: int | None, null: bool) -> Line:
    """Draws a campaign, closes the loop on it and judges the answer."""
    campaign, truth = draw(seed, family, count, null)
    fault = ""
    if null and seed % 4 < 2:
        campaign, fault = spoil(campaign, seed)
    line: Line = {
        "fault": fault,
        "seed": seed,
        "null": null,
        "flights": len(campaign.flights),
        "air": truth.air[0],
        "spreads": truth.spreads,
        "families": [p.family for p in truth.planted],
        "forms": [f"{p.form}: {p.words}" for p in truth.planted],
    }
    begin = time.perf_counter()
    try:
        result = close_the_loop(campaign, seed=seed)
    except Exception as error:  # A crash is one campaign's answer, not the end.
        verdict = "refused" if isinstance(error, InputError) else "crashed"
        missed = {"found": [False] * len(truth.planted), "one_of": [], "kinds": []}
        blank = {"names": 0, "wrong": {}, "error": math.nan, "perfect": math.nan}
        refused = {"verdict": verdict, "reason": repr(error), "ratio": math.nan}
        seconds = time.perf_counter() - begin
        return line | missed | blank | refused | {"seconds": seconds}
    seconds = time.perf_counter() - begin
    return line | judge(campaign, truth, result) | {"seconds": seconds}


def claims_too_much(line: Line) -> bool:
    """Returns whether `effect_found` leaves more than twice a perfect model's error."""
    return (
        not line["air"]
        and line["verdict"] == "effect_found"
        and not line["ratio"] <= MOST_LEFT
    )


def show(line: Line) -> None:
    """Prints one campaign."""
    true = [
        family + ("" if found else "?" if family in line["one_of"] else "-")
        for family, found in zip(line["families"], line["found"], strict=True)
    ]
    kinds = [
        f"{kind}! ({line['wrong'][kind]})" if kind in line["wrong"] else kind
        for kind in line["kinds"]
    ]
    air = f"{line['air']:.2f}" if line["air"] else "still"
    print(
        f"{line['seed']:6d} {line['flights']:3d} {air:>5s} {line['verdict']:16s}"
        f"{sum(line['found'])}/{len(line['found'])} {len(line['wrong']):2d} "
        f"{1e3 * line['error']:7.1f} {1e3 * line['perfect']:7.1f} {line['ratio']:6.1f}"
        f"{'!' if claims_too_much(line) else ' '} {line['seconds']:6.1f}  "
        f"{' + '.join(true) or line.get('fault') or 'nothing'}  ->  "
        f"{', '.join(kinds) or 'nothing'}",
        flush=True,
    )


def show_totals(lines: Sequence[Line]) -> None:
    """Prints what all campaigns come to."""
    true = Counter(f for x in lines for f in x["families"])
    found = Counter(
        family
        for x in lines
        for family, is_found in zip(x["families"], x["found"], strict=True)
        if is_found
    )
    instead = Counter(f"{k} {why}" for x in lines for k, why in x["wrong"].items())
    names, wrong = sum(x["names"] for x in lines), instead.total()
    print(f"\nverdicts: {dict(Counter(x['verdict'] for x in lines))}")
    if true:
        print(f"families found: {found.total()} of {true.total()}")
        print("  " + ", ".join(f"{f} {found[f]}/{n}" for f, n in sorted(true.items())))
        one_of = sum(len(x["one_of"]) for x in lines)
        print(f"one of several that cannot be told apart: {one_of}")
    campaigns = sum(bool(x["wrong"]) for x in lines)
    print(f"wrong names: {wrong} of {names}, in {campaigns} of {len(lines)} campaigns")
    for what, times in instead.most_common():
        print(f"  {times} x {what}")
    for where, own in (
        ("still air", [x for x in lines if not x["air"]]),
        ("turbulence", [x for x in lines if x["air"]]),
    ):
        ratios = [x["ratio"] for x in own if math.isfinite(x["ratio"])]
        if ratios:
            print(
                f"error over a perfect model's in {where}: median "
                f"{np.median(ratios):.2f}, worst {max(ratios):.1f}"
            )
    too_much = [x["seed"] for x in lines if claims_too_much(x)]
    still = sum(not x["air"] and x["verdict"] == "effect_found" for x in lines)
    print(
        f"effect_found in still air with more than {MOST_LEFT:g} times it left: "
        f"{len(too_much)} of {still}, seeds {too_much}"
    )
    seconds = [x["seconds"] for x in lines]
    print(f"seconds: median {np.nanmedian(seconds):.1f}, most {np.nanmax(seconds):.1f}")


def main() -> None:
    """Runs the chosen campaigns, and the nulls."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--number", type=int, default=40, help="of campaigns")
    parser.add_argument("--nulls", type=int, default=0, help="campaigns of no effect")
    parser.add_argument("--first", type=int, default=0, help="first seed")
    parser.add_argument("--held-back", action="store_true", help="seeds of final runs")
    parser.add_argument("--family", choices=list(FAMILIES), help="in every campaign")
    parser.add_argument("--effects", type=int, help="how many; drawn by default")
    parser.add_argument("--jobs", type=int, default=2, help="campaigns at a time")
    parser.add_argument("--json", type=Path, help="file of lines that are done")
    args = parser.parse_args()
    first = args.first + HELD_BACK * args.held_back
    kept: dict[tuple[bool, int], Line] = {}
    if args.json and args.json.exists():
        for text in args.json.read_text().splitlines():
            line = json.loads(text)
            kept[line["null"], line["seed"]] = line
    for null, number in ((False, args.number), (True, args.nulls)):
        wanted = [(null, seed) for seed in range(first, first + number)]
        if not wanted:
            continue
        lines = [kept[key] for key in wanted if key in kept]
        tasks = [
            joblib.delayed(run)(seed, args.family, args.effects, null)
            for _, seed in wanted
            if (null, seed) not in kept
        ]
        print("\n  seed   F   air verdict       found wrong  mm perfect  ratio      s")
        for line in lines:
            show(line)
        parallel = joblib.Parallel(n_jobs=args.jobs, return_as="generator_unordered")
        for line in parallel(tasks):
            show(line)
            lines.append(line)
            if args.json:
                with args.json.open("a") as file:
                    file.write(json.dumps(line) + "\n")
        show_totals(lines)


if __name__ == "__main__":
    main()
