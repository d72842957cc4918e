"""What does a broken log do to the answer? Prints a table; asserts nothing.

    python -m benchmarks.bench_broken [--campaign NAME] [--flights N] [--checks]
        [KIND ...]

A good campaign is broken in one way at a time, written to a folder and taken through
`close_the_loop`. A line a kind: the outcome, the median position error of held-out
flights by the refitted plate and by the corrected model, and what was answered.

refused: one sentence says why. right: the effects of the good campaign, and what the
break itself is an effect of, with the good one's coefficients. withheld: nothing is
claimed that could be wrong. WRONG: other effects, or coefficients, are claimed; the
correction is worse than the plate; or an effect is missed. CRASH: a traceback.
"""

import argparse
import dataclasses
import tempfile
import time
import warnings
from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from glider.campaign.checks.inspection import inspect
from glider.campaign.logs import Campaign, Flight
from glider.campaign.reader import load_campaign
from glider.campaign.turning import turn_campaign
from glider.campaign.writer import save_campaign
from glider.errors import InputError
from glider.physics.effects import KINDS
from glider.physics.model import GliderModel
from glider.physics.parameters import GliderParameters
from glider.simulation.campaigns import CampaignPlan
from glider.sysid.likelihood.outliers import find_outlying
from glider.sysid.likelihood.task import make_task
from glider.sysid.pipeline import close_the_loop
from glider.sysid.replay.record import measure_noise, prepare
from glider.sysid.replay.vehicle import make_vehicle
from glider.sysid.result import Result
from glider.sysid.search.signs import find_signs
from tests.campaign.checks import breaking as b
from tests.helpers.campaigns import campaign_path

CLAIMS = ("effect_found", "partly_explained")
"""Verdicts that say that the names are right."""

Z = 4.0
"""Standard errors of both answers by which a coefficient may move."""

NEAR = 0.1
"""... and part of its value by which it may: rows are fewer, clocks are not exact."""

ODD = 5
"""The flight that is broken where only one is."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Break:
    """A way to break a campaign.

    Attributes:
        campaign: what it becomes in memory.
        folder: what is done to the folder that it was written to.
        means: effects that a rightly traced log of this kind shows, too.
    """

    campaign: Callable[[Campaign], Campaign] = lambda campaign: campaign
    folder: Callable[[Path], None] = lambda folder: None
    means: tuple[str, ...] = ()


def every(edit, *means: str) -> Break:
    """Breaks all flights."""
    return Break(campaign=lambda c: b.change(c, edit), means=means)


def one(edit) -> Break:
    """Breaks one flight."""
    return Break(campaign=lambda c: b.change(c, edit, only=ODD))


def some(edit) -> Break:
    """Breaks every fifth flight."""

    def change(campaign: Campaign) -> Campaign:
        for k in range(1, len(campaign.flights), 5):
            campaign = b.change(campaign, edit, only=k)
        return campaign

    return Break(campaign=change)


def told(*means: str, **vehicle: float) -> Break:
    """Writes other numbers into campaign.yaml."""
    return Break(campaign=lambda c: b.tell(c, **vehicle), means=means)


def scaled(*means: str, **factors: float) -> Break:
    """Multiplies numbers in campaign.yaml."""

    def change(campaign: Campaign) -> Campaign:
        vehicle = {n: campaign.vehicle[n] * f for n, f in factors.items()}
        return b.tell(campaign, **vehicle)

    return Break(campaign=change, means=means)


def setting(**fields) -> Break:
    """Replaces a campaign's fields."""
    return Break(campaign=lambda c: dataclasses.replace(c, **fields))


def lines(edit: Callable[[list[str]], list[str]], everywhere: bool = False) -> Break:
    """Edits the text of one file, or of all."""

    def change(folder: Path) -> None:
        files = sorted(folder.glob("flight_*.csv"))
        for file in files if everywhere else [files[ODD]]:
            file.write_text("\n".join(edit(file.read_text().splitlines())) + "\n")

    return Break(folder=change)


def cells(column: str, edit: Callable[[float], float], everywhere: bool) -> Break:
    """Edits the numbers of a column in the text."""

    def change(text: list[str]) -> list[str]:
        k = text[0].split(",").index(column)
        rows = [line.split(",") for line in text[1:]]
        changed = [[*r[:k], f"{edit(float(r[k])):.9g}", *r[k + 1 :]] for r in rows]
        return [text[0], *(",".join(r) for r in changed)]

    return lines(change, everywhere)


def swap_cells(first: str, second: str) -> Break:
    """Exchanges two names of the header in all files."""

    def change(text: list[str]) -> list[str]:
        names = {first: second, second: first}
        header = [names.get(n, n) for n in text[0].split(",")]
        return [",".join(header), *text[1:]]

    return lines(change, everywhere=True)


def first_flights(count: int) -> Break:
    """Keeps a few flights."""
    return Break(campaign=lambda c: dataclasses.replace(c, flights=c.flights[:count]))


def doubled(campaign: Campaign) -> Campaign:
    """Logs a flight under two names."""
    again = dataclasses.replace(campaign.flights[ODD], name="flight_900.csv")
    return dataclasses.replace(campaign, flights=(*campaign.flights, again))


def appended(campaign: Campaign) -> Campaign:
    """Logs a flight and the next one in one file."""
    first, second = campaign.flights[ODD], campaign.flights[ODD + 1]
    step = first.time[-1] - first.time[-2]
    late = first.time[-1] + step - second.time[0]
    both = b.joined(first, dataclasses.replace(second, time=second.time + late))
    return b.change(campaign, lambda f: both, only=ODD)


def servo_of_next(campaign: Campaign, count: int | None = None) -> Campaign:
    """Gives flights the servo columns of the next flight."""
    flights = list(campaign.flights)
    for i in range(len(flights)) if count is None else range(ODD, ODD + count):
        flights[i] = b.with_servo_of(
            campaign.flights[i], campaign.flights[(i + 1) % len(flights)]
        )
    return dataclasses.replace(campaign, flights=tuple(flights))


def another_glider(effects, count: int = 1, mass: float = 1.0) -> Break:
    """Puts flights of another glider in place of the first ones."""

    def change(campaign: Campaign) -> Campaign:
        plain = GliderParameters()
        parameters = dataclasses.replace(plain, mass=mass * plain.mass)
        model = GliderModel(parameters=parameters, effects=effects)
        drawn = CampaignPlan(flights=max(count, 2)).simulate(
            model, np.random.default_rng(7)
        )
        flights = list(campaign.flights)
        for k in range(count):
            i = (ODD + 3 * k) % len(flights)
            flights[i] = dataclasses.replace(drawn.flights[k], name=flights[i].name)
        return dataclasses.replace(campaign, flights=tuple(flights))

    return Break(campaign=change)


def pose(edit: Callable[[Flight], np.ndarray]):
    """Returns an edit of the flight by its new poses."""
    return lambda f: b.with_pose(f, edit(f))


def kinds() -> dict[str, Break]:
    """Returns all ways, by name."""
    rng = np.random.default_rng(0)
    zero = b.with_servo(elevator=lambda f: 0.0 * f.elevator)
    still = b.with_servo(elevator=lambda f: 0.0 * f.elevator + 0.1)
    no_command = b.with_servo(command=lambda f: 0.0 * f.command)
    return {
        # Axes and units of the poses.
        "z down": every(b.scale(1, -1, 1)),
        "x backwards": every(b.scale(-1, 1, 1)),
        "x and z exchanged": every(b.exchange),
        "seen from behind": every(b.from_behind),
        "z down, nose up positive": every(b.scale(1, -1, -1), "angle_sign"),
        "pitch sign": every(b.scale(1, 1, -1), "angle_sign"),
        "half a turn": every(b.half_turn),
        "degrees": cells("pitch", np.degrees, True),
        "millimeters": every(b.scale(1e3, 1e3, 1)),
        "centimeters": every(b.scale(1e2, 1e2, 1)),
        "feet": every(b.scale(3.28, 3.28, 1)),
        "positions 10 % large": every(b.scale(1.1, 1.1, 1), "position_scale"),
        "x alone 10 % large": every(b.scale(1.1, 1, 1), "position_scale"),
        "in body axes": every(b.in_body_axes),
        "z is level": every(b.level(rng)),
        "pitch of the velocity": every(pose(b.pitch_of_path)),
        "pitch zero 0.1": every(
            b.jump(0, by=(0, 0, 0.1)), "pitch_offset", "wing_incidence"
        ),
        "axes tilted 0.1": every(b.tilt(0.1), "frame_tilt"),
        "z down in one": one(b.scale(1, -1, 1)),
        "x backwards in one": one(b.scale(-1, 1, 1)),
        "seen from behind in one": one(b.from_behind),
        "half a turn in one": one(b.half_turn),
        "pitch sign in one": one(b.scale(1, 1, -1)),
        "pitch sign in some": some(b.scale(1, 1, -1)),
        "degrees in one": cells("pitch", np.degrees, False),
        "millimeters in one": one(b.scale(1e3, 1e3, 1)),
        "feet in one": one(b.scale(3.28, 3.28, 1)),
        "positions 10 % large in one": one(b.scale(1.1, 1.1, 1)),
        "positions 5 % large in some": some(b.scale(1.05, 1.05, 1)),
        "pitch zero 0.2 in one": one(b.jump(0, by=(0, 0, 0.2))),
        "axes tilted 0.2 in one": one(b.tilt(0.2)),
        # The vehicle.
        "gravity 0": told(gravity=0.0),
        "gravity in feet": told(gravity=32.2),
        "gravity upside down": told(gravity=-9.81),
        "mass doubled": scaled("mass", mass=2.0),
        "mass in grams": scaled(mass=1e3),
        "area in cm²": scaled(wing_area=1e4),
        "inertia tenfold": scaled("inertia", pitch_inertia=10.0),
        "tail ahead": scaled(hinge_offset=-1.0),
        "no density": scaled(air_density=0.0),
        "limits in degrees": setting(elevator_limits=(-25.6, 54.3)),
        "limits turned": setting(elevator_limits=(-0.9473, 0.4463)),
        "rate limit 1": setting(elevator_rate_limit=1.0),
        "said to be fixed": setting(elevator="fixed"),
        "pose rate doubled": Break(
            campaign=lambda c: dataclasses.replace(c, pose_rate=2.0 * c.pose_rate)
        ),
        "pose rate in ms": setting(pose_rate=8.33),
        "command rate halved": setting(command_rate=25.0),
        # Elevator and commands.
        "elevator sign": every(b.with_servo(lambda f: -f.elevator), "angle_sign"),
        "command sign": every(b.with_servo(command=lambda f: -f.command), "angle_sign"),
        "both signs": every(
            b.with_servo(lambda f: -f.elevator, lambda f: -f.command), "angle_sign"
        ),
        "elevator sign in one": one(b.with_servo(lambda f: -f.elevator)),
        "both signs in one": one(
            b.with_servo(lambda f: -f.elevator, lambda f: -f.command)
        ),
        "elevator of zeros": every(zero),
        "elevator constant": every(still),
        "elevator of zeros in one": one(zero),
        "elevator of zeros in some": some(zero),
        "no commands": every(no_command),
        "no commands in one": one(no_command),
        "constant command": every(b.with_servo(command=lambda f: 0 * f.command + 2)),
        "elevator and commands exchanged": swap_cells(
            "elevator", "elevator_rate_command"
        ),
        "elevator and pitch exchanged": swap_cells("elevator", "pitch"),
        "elevator in degrees": cells("elevator", np.degrees, True),
        "elevator in degrees in one": cells("elevator", np.degrees, False),
        "commands in degrees": cells("elevator_rate_command", np.degrees, True),
        "elevator halved": every(b.with_servo(lambda f: 0.5 * f.elevator)),
        "elevator halved in one": one(b.with_servo(lambda f: 0.5 * f.elevator)),
        "elevator zero 0.1 off": every(
            b.with_servo(lambda f: f.elevator + 0.1), "elevator_trim"
        ),
        "elevator zero 0.2 off in one": one(b.with_servo(lambda f: f.elevator + 0.2)),
        "elevator is noise": every(
            b.with_servo(lambda f: rng.normal(0.0, 0.2, len(f.time)))
        ),
        "servo of the next flight": Break(campaign=servo_of_next),
        "servo of the next in one": Break(campaign=lambda c: servo_of_next(c, 1)),
        "servo stuck midway in one": one(b.stuck(50)),
        # Clocks.
        "commands 20 ms late": every(b.shift_commands(0.02)),
        "commands 50 ms late": every(b.shift_commands(0.05)),
        "commands 80 ms late": every(b.shift_commands(0.08)),
        "commands 20 ms early": every(b.shift_commands(-0.02), "command_delay"),
        "commands 50 ms early": every(b.shift_commands(-0.05), "command_delay"),
        "commands 80 ms early": every(b.shift_commands(-0.08), "command_delay"),
        "commands 50 ms late in one": one(b.shift_commands(0.05)),
        "commands 80 ms early in some": some(b.shift_commands(-0.08)),
        "servo 50 ms late": every(b.shift_servo(0.05), "pose_latency"),
        "servo 50 ms early": every(b.shift_servo(-0.05), "pose_latency"),
        "servo 60 ms late in one": one(b.shift_servo(0.06)),
        "servo 60 ms early in some": some(b.shift_servo(-0.06)),
        "milliseconds": every(b.stretch_time(1e3)),
        "milliseconds in one": one(b.stretch_time(1e3)),
        "rows for times": every(b.stretch_time(120.0)),
        "clock half as fast": every(b.stretch_time(2.0)),
        "clock 5 % slow": every(b.stretch_time(1.05)),
        "clock 10 % slow in one": one(b.stretch_time(1.1)),
        "clock of 60 Hz in one": one(b.stretch_time(2.0)),
        "commands drift by 5 %": every(b.drift_servo(1.05)),
        "times jitter by 1 ms": every(b.jitter(1e-3, rng)),
        "times jitter by 4 ms": every(b.jitter(4e-3, rng)),
        "times jitter in one": one(b.jitter(4e-3, rng)),
        "a time twice": lines(lambda t: [*t[:40], t[39], *t[40:]]),
        "a step back in time": lines(lambda t: [*t[:40], t[41], t[40], *t[42:]]),
        "rows backwards in one": one(b.backwards),
        "rows backwards": every(b.backwards),
        "every other row in one": one(b.thin(2)),
        "every third row in some": some(b.thin(3)),
        "every other row in some": some(b.thin(2)),
        # Rows.
        "a gap of 40 rows": one(b.lose(30, 40)),
        "gaps of 40 rows in all": every(b.lose(30, 40)),
        "a tenth of all rows lost": every(b.lose_some(0.1, rng)),
        "frozen for 20 rows": one(b.freeze(40, 20)),
        "frozen for 5 rows in some": some(b.freeze(40, 5)),
        "frozen for 15 rows in all": every(b.freeze(40, 15)),
        "frozen to the end in one": one(b.freeze(60, 99)),
        "pitch frozen in some": some(b.freeze(40, 25, (2,))),
        "an outlier": one(b.spikes([50])),
        "outliers in all": every(b.spikes([5, 14, 23, 32, 41])),
        "small outliers in all": every(
            b.spikes(list(range(4, 45, 6)), size=(0.002, -0.002, 0.01))
        ),
        "a jump that stays in some": some(b.jump(60)),
        "a slow drift in one": one(pose(b.drifting(0.1))),
        "not a number": one(b.jump(50, 53, by=(np.nan, 0, 0))),
        "torn at the end": lines(lambda t: [*t[:-1], t[-1][: len(t[-1]) // 2]]),
        "an empty file": lines(lambda t: t[:1]),
        "no header": lines(lambda t: t[1:]),
        "half a flight": one(b.lose(45, 999)),
        "twelve rows": one(b.lose(12, 999)),
        "22 rows in one": one(b.lose(22, 999)),
        "25 rows in all": every(b.lose(25, 999)),
        "landed in one": one(b.land(60, rng)),
        "landed in all": every(b.land(60, rng)),
        "in the hand": every(b.hold_before(30, 20.0, rng)),
        "in the hand in some": some(b.hold_before(20, 15.0, rng)),
        "a flight twice": Break(campaign=doubled),
        "two flights in one file": Break(campaign=appended),
        "rows shuffled in one": one(b.shuffle(rng)),
        # The cameras.
        "digits of 1 cm": every(pose(b.rounded(0.01))),
        "digits of 2 mm": every(pose(b.rounded(0.002))),
        "smoothed": every(b.smooth(5)),
        "smoothed in one": one(b.smooth(15)),
        "smoothed in some": some(b.smooth(9)),
        "lagged by 30 ms": every(pose(b.lagged(0.03)), "pose_latency"),
        "lagged by 60 ms in one": one(pose(b.lagged(0.06))),
        "noise of 5 mm in one": one(b.noisy((5e-3, 5e-3, 0.02), rng)),
        "noise of 20 mm in one": one(b.noisy((2e-2, 2e-2, 0.1), rng)),
        "noise of 5 mm in some": some(b.noisy((5e-3, 5e-3, 0.02), rng)),
        "noise of 5 mm in all": every(b.noisy((5e-3, 5e-3, 0.02), rng)),
        "heavy tails in all": every(b.heavy_tails((1e-3, 1e-3, 4e-3), rng)),
        # Flights.
        "a hit in one": one(b.hit(50, (-1.0, 0.5, 4.0))),
        "a small hit in one": one(b.hit(50, (-0.2, 0.0, 0.5))),
        "a hit in some": some(b.hit(50, (-1.0, 0.5, 4.0))),
        "another glider": another_glider((KINDS["profile_drag"](cd0=0.5),)),
        "a heavier glider": another_glider((), mass=1.5),
        "a glider in wind": another_glider((KINDS["wind"](x=-1.0),)),
        "two of another glider": another_glider(
            (KINDS["profile_drag"](cd0=0.3), KINDS["wind"](x=1.0)), count=2
        ),
        "one flight": first_flights(1),
        "two flights": first_flights(2),
        "three flights": first_flights(3),
    }


@dataclasses.dataclass(frozen=True, kw_only=True)
class Answer:
    """What is said of a campaign."""

    outcome: str
    words: str
    refitted: float = np.nan
    corrected: float = np.nan
    seconds: float = 0.0


def median_error(result: Result, name: str) -> float:
    """Returns the median over held-out flights of the position RMS [m]."""
    each = [
        np.sqrt(np.mean(np.sum((f.flown[name] - f.measured)[:, :2] ** 2, axis=1)))
        for f in result.held_out
    ]
    return float(np.median(each))


def answer(campaign: Campaign, broken: Break) -> Result:
    """Breaks, writes and answers a campaign.

    Raises:
        InputError: it is refused.
    """
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place) / "campaign"
        save_campaign(folder, broken.campaign(campaign))
        broken.folder(folder)
        return close_the_loop(folder)


def judge(good: Result, broken: Break, result: Result) -> tuple[str, str]:
    """Returns the outcome, and what is wrong with it."""
    claims = result.verdict in CLAIMS
    found = {e.kind: e for e in result.effects}
    wanted = {e.kind: e for e in good.effects}
    errors = [median_error(result, m) for m in ("refitted", "corrected")]
    if result.verdict in ("not_trusted", "unexplained"):
        return "withheld", result.reason
    faults = []
    if claims and errors[1] > 1.02 * errors[0]:
        faults.append("worse than the plate")
    faults += [f"misses {k}" for k in wanted if k not in found]
    allowed = {*wanted, *broken.means, "unexplained"}
    if result.verdict == "effect_found":
        allowed.discard("unexplained")
    faults += [f"names {k}" for k in found if k not in allowed]
    for kind in found.keys() & wanted.keys():
        for name, true in wanted[kind].coefficients.items():
            mine = found[kind].coefficients.get(name)
            if mine is None or kind == "unexplained":
                continue
            std = np.hypot(true.std, mine.std)
            if abs(mine.value - true.value) > max(Z * std, NEAR * abs(true.value)):
                faults.append(f"{kind}.{name} {mine.value:.3g} for {true.value:.3g}")
    return ("WRONG", "; ".join(faults)) if faults else ("right", "")


def check(campaign: Campaign, broken: Break) -> Answer:
    """Takes a broken campaign through the checks alone: refused, reported or silent."""
    begin = time.perf_counter()
    try:
        with tempfile.TemporaryDirectory() as place:
            folder = Path(place) / "campaign"
            save_campaign(folder, broken.campaign(campaign))
            broken.folder(folder)
            inspection = inspect(load_campaign(folder))
        whole, masks = inspection.campaign, inspection.masks
        vehicle = make_vehicle(whole)
        turned = turn_campaign(whole, find_signs(whole, whole.flights, masks, vehicle))
        noise = measure_noise(turned, masks)
        records = prepare(turned.flights, turned, noise, vehicle.space, masks)
        outlying = find_outlying(make_task(records, vehicle, vehicle.kinds), noise)
    except InputError as error:
        words, outcome = str(error), "refused"
    else:
        notes = [f"{s.file}: {s.why}" for s in inspection.excluded]
        notes += [f"{name} stands out ({r:.3g})" for name, r in outlying.items()]
        notes += inspection.warnings
        outcome = "reported" if notes else "silent"
        words = " | ".join(notes[:3])
    return Answer(outcome=outcome, words=words, seconds=time.perf_counter() - begin)


def run(campaign: Campaign, good: Result, broken: Break) -> Answer:
    """Answers a broken campaign and judges the answer."""
    begin = time.perf_counter()
    try:
        result = answer(campaign, broken)
    except InputError as error:
        return Answer(
            outcome="refused", words=str(error), seconds=time.perf_counter() - begin
        )
    except Exception as error:  # The table tells it and goes on.
        return Answer(outcome="CRASH", words=repr(error))
    outcome, words = judge(good, broken, result)
    said = [e.kind for e in result.effects]
    aside = Counter(s.why for s in result.set_aside)
    notes = [f"{result.verdict}: {' + '.join(said) or 'nothing'}", words]
    notes += [f"{n} excluded ({why})" for why, n in aside.most_common(2)]
    notes += result.warnings[:2]
    return Answer(
        outcome=outcome,
        words=" | ".join(n for n in notes if n),
        refitted=median_error(result, "refitted"),
        corrected=median_error(result, "corrected"),
        seconds=time.perf_counter() - begin,
    )


def show(name: str, line: Answer) -> None:
    """Prints one kind."""
    print(
        f"{line.outcome:8s} {name:32s} {line.seconds:5.1f} s "
        f"{1e3 * line.refitted:7.1f} {1e3 * line.corrected:7.1f} mm  {line.words}",
        flush=True,
    )


def main(arguments: Sequence[str] | None = None) -> None:
    """Runs the chosen kinds."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("kinds", nargs="*", metavar="KIND", help="all by default")
    parser.add_argument("--campaign", default="attached_lift")
    parser.add_argument("--flights", type=int, default=20)
    parser.add_argument(
        "--checks", action="store_true", help="no tracing: refused, reported or silent"
    )
    args = parser.parse_args(arguments)
    warnings.simplefilter("ignore")
    whole = load_campaign(campaign_path(args.campaign))
    campaign = dataclasses.replace(whole, flights=whole.flights[: args.flights])
    ways = kinds()
    if not args.checks:
        good = answer(campaign, Break())
        said = " + ".join(e.kind for e in good.effects) or "nothing"
        print(f"unbroken: {good.verdict}: {said}")
    count: Counter[str] = Counter()
    for name in args.kinds or ways:
        way = ways[name]
        line = check(campaign, way) if args.checks else run(campaign, good, way)
        show(name, line)
        count[line.outcome] += 1
    print(f"\n{sum(count.values())} kinds: {dict(count.most_common())}")


if __name__ == "__main__":
    main()
