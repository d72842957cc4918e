"""Is a corrected model better where the library has no formula for what is wrong?

    python -m benchmarks.bench_adverse [KIND ...] [--seeds 2] [--first 0] [--jobs 1]

The gliders fly in the independent simulator of `tests.helpers.lifelike_flight`, with
effects, cameras and air that no formula of the library describes, or in conditions that
hardly show them. Ten fresh flights like the traced ones, and ten others (slower and
faster launches, doublets and late flares) are flown by the nominal and by the corrected
model, with their launches fitted on the first fifth.

A row a campaign: the verdict; the names, of which `!` marks those that the kind does
not accept; position errors [mm] on held-out flights (nominal, corrected, perfect), on
fresh and on other flights (nominal, corrected, and a perfect model's: that of the
nominal model on flights of the nominal glider); in how many of the others the flown
range is left, which a user is warned of. What must not be follows the row:

- `claims nothing`: `no_effect` where the nominal model leaves 2.5 times a perfect one,
  and the verdict's sentence excludes no flights;
- `worse`: a model that is offered for use leaves more than the nominal one;
- `no warning`: `effect_found`, ten times a perfect model's error on other flights, and
  neither a flown range nor the flights most unlike the others tell of it.
"""

import argparse
import dataclasses
import math
import time
from collections.abc import Callable, Sequence
from typing import NamedTuple

import joblib
import numpy as np

from benchmarks.bench_forms import with_play
from benchmarks.hidden import ROWS, campaign
from glider.campaign.logs import Campaign, Flight
from glider.errors import InputError
from glider.physics.effects import KINDS as KINDS_OF_LIBRARY
from glider.physics.flown_range import describe_departures
from glider.physics.model import GliderModel
from glider.simulation import refly
from glider.sysid.pipeline import close_the_loop
from glider.sysid.result import Errors
from tests.helpers.lifelike import (
    COMMAND_RATE,
    Capture,
    draw_commands,
    draw_starts,
    log_poses,
)
from tests.helpers.lifelike_flight import (
    STEP,
    Flow,
    Glider,
    Lag,
    Motion,
    Number,
    Servo,
    elevator_paths,
    fly,
    gusts,
    shown_pose,
)

FRESH = 10
"""Flights of either group that models are compared on."""

AIR = (0.05, 0.25)
"""Standard deviation [m/s] and correlation time [s] of every third seed's gusts."""


@dataclasses.dataclass(kw_only=True)
class Subject:
    """A glider and its log, to be changed by a kind.

    Attributes:
        glider: what flies.
        accepted: names that are right, whichever of them is given.
        play: of the hinge, half a gap that the log of the angle does not show [rad].
        distort: changes poses (n, F, 3) as the cameras do.
        commands: changes commands (H, F) of the traced flights and the fresh ones, not
            of the others.
        in_session: the glider as it is in so many traced flights.
    """

    glider: Glider = dataclasses.field(default_factory=Glider)
    accepted: frozenset[str] = frozenset()
    play: float = 0.0
    distort: Callable[[np.ndarray], np.ndarray] = lambda poses: poses
    commands: Callable[[np.ndarray], np.ndarray] = lambda rates: rates
    in_session: Callable[[Glider, int], Glider] = lambda glider, count: glider

    def accept(self, *kinds: str) -> None:
        """Adds right names."""
        assert set(kinds) <= set(KINDS_OF_LIBRARY)
        self.accepted |= frozenset(kinds)


Kind = Callable[[np.random.Generator, Subject], None]


def _lift_to_stall(f: Flow, slope: float, stall: float) -> np.ndarray:
    """Lift of attached flow, which ends softly at a stall angle."""
    beyond = np.clip((np.abs(f.alpha) - stall) / 0.05, -50.0, 50.0)
    return slope * np.sin(f.alpha) / (1.0 + np.exp(beyond))


def _add_state(glider: Glider, lag: Lag) -> Callable[[Flow], np.ndarray]:
    """Gives a glider one more state, and returns its value in a flow."""
    index = len(glider.lags)
    glider.lags.append(lag)
    return lambda f: f.lags[index]


def _bend(
    glider: Glider, compliance: float, force: Callable[[Flow], np.ndarray], late: float
) -> Callable[[Flow], np.ndarray]:
    """Returns the angle off a load that follows a force to first order [rad].

    Args:
        glider: what bends.
        compliance: [rad/N]
        force: [N]
        late: time constant [s].
    """

    def wanted(f: Flow) -> np.ndarray:
        return -compliance * force(f)

    lag = Lag(rate=lambda f, state: (wanted(f) - state) / late, rest=wanted)
    return _add_state(glider, lag)


def _plate_force(area: Number, angle: np.ndarray, speed: np.ndarray) -> np.ndarray:
    """Force on a flat plate along its normal [N]."""
    return 0.5 * Glider().air_density * area * speed**2 * 2.0 * np.sin(angle)


def nothing(rng: np.random.Generator, subject: Subject) -> None:
    """The nominal glider."""


def reynolds_drag(rng: np.random.Generator, subject: Subject) -> None:
    """A drag that falls with a power of the airspeed."""
    size, power = rng.uniform(0.05, 0.1), rng.uniform(0.6, 1.4)
    subject.glider.drag.append(lambda f: size * (7.0 / f.speed) ** power)
    subject.accept("profile_drag", "axial_drag", "airspeed_dependence")


def latched_stall(rng: np.random.Generator, subject: Subject) -> None:
    """Lift that is lost at one angle, and comes back at a smaller one."""
    slope, up = rng.uniform(1.5, 3.0), rng.uniform(0.28, 0.38)
    down, delay = up - rng.uniform(0.08, 0.18), rng.uniform(0.008, 0.02)

    def follow(f: Flow, state: np.ndarray) -> np.ndarray:
        angle = np.abs(f.alpha)
        end = np.where(angle > up, 0.0, np.where(angle < down, 1.0, np.round(state)))
        return (end - state) / delay

    lag = Lag(rate=follow, rest=lambda f: 1.0 * (np.abs(f.alpha) < up))
    attached = _add_state(subject.glider, lag)
    subject.glider.normal.append(lambda f: slope * np.sin(f.alpha) * attached(f))
    subject.accept("attached_lift", "dynamic_stall", "lagged_separation")


def tail_boom(rng: np.random.Generator, subject: Subject) -> None:
    """A boom that bends under the load of the tail, late."""
    bend, late = rng.uniform(0.1, 0.35), rng.uniform(0.01, 0.03)
    glider = subject.glider

    def force(f: Flow) -> np.ndarray:
        return _plate_force(Glider().elevator_area, f.alpha + f.elevator, f.speed)

    angle = _bend(glider, bend, force, late)
    glider.downwash.append(lambda f: -f.speed * angle(f))
    subject.accept("elevator_area", "elevator_blowback", "tail_wake", "downwash")
    subject.accept("stalled_downwash", "lagged_downwash", "pitch_damping")


def wing_twist(rng: np.random.Generator, subject: Subject) -> None:
    """A wing that twists off its load."""
    twist, late = rng.uniform(0.02, 0.05), rng.uniform(0.012, 0.03)
    glider = subject.glider

    def force(f: Flow) -> np.ndarray:
        return _plate_force(Glider().wing_area, f.alpha, f.speed)

    angle = _bend(glider, twist, force, late)
    glider.normal.append(lambda f: 2.0 * (np.sin(f.alpha + angle(f)) - np.sin(f.alpha)))
    subject.accept("airspeed_dependence", "attached_lift")
    subject.accept("pitch_rate_lift", "dynamic_stall", "lagged_separation")


def hinge_play(rng: np.random.Generator, subject: Subject) -> None:
    """A play between the servo, whose angle is logged, and the elevator."""
    subject.play = rng.uniform(0.01, 0.035)
    subject.accept("elevator_blowback", "elevator_scale", "servo_lag")


def sliding_payload(rng: np.random.Generator, subject: Subject) -> None:
    """A load that slides forward as the flight goes on."""
    far, late = rng.uniform(0.005, 0.012), rng.uniform(0.2, 0.4)
    glider = subject.glider

    def shift(f: Flow) -> float:
        return -far * (1.0 - math.exp(-f.t / late))

    glider.wing_shift.append(shift)
    subject.accept("center_of_pressure")


def tether(rng: np.random.Generator, subject: Subject) -> None:
    """A thread that is pulled out: a force that grows with distance and speed."""
    size = rng.uniform(0.01, 0.04)
    subject.glider.drag.append(lambda f: size * np.maximum(f.x + 3.5, 0.0))
    subject.accept("profile_drag", "axial_drag")


def bent_cameras(rng: np.random.Generator, subject: Subject) -> None:
    """A scale of the cameras that varies over the room."""
    a, b = 0.005 * rng.uniform(0.5, 1.0, 2)

    def distort(poses: np.ndarray) -> np.ndarray:
        bent = poses.copy()
        bent[..., 0] += a * (poses[..., 0] + 1.0) ** 2
        bent[..., 1] *= 1.0 + 2.0 * b * (poses[..., 0] + 1.0)
        return bent

    subject.distort = distort
    subject.accept("position_scale", "frame_tilt")


def fan(rng: np.random.Generator, subject: Subject) -> None:
    """A jet across the path, at one place."""
    size, place = rng.uniform(0.6, 1.2), rng.uniform(-2.0, -1.2)

    def jet(f: Flow) -> np.ndarray:
        return -size * np.exp(-(((f.x - place) / 0.3) ** 2) - (f.z / 0.4) ** 2)

    subject.glider.winds.append(jet)
    subject.accept("wind")


def table(rng: np.random.Generator, subject: Subject) -> None:
    """A ground effect over a table."""
    strength, height = rng.uniform(0.2, 0.4), -0.35

    def factor(f: Flow) -> np.ndarray:
        over = 0.5 * (np.tanh((f.x + 2.3) / 0.05) - np.tanh((f.x + 1.2) / 0.05))
        return strength * over * np.exp(-np.maximum(f.z - height, 0.0) / 0.2)

    subject.glider.wing_factor.append(factor)
    subject.accept("ground_effect")


def propeller(rng: np.random.Generator, subject: Subject) -> None:
    """A propeller that brakes less the faster it spins."""
    size, late = rng.uniform(0.05, 0.12), rng.uniform(0.15, 0.3)
    lag = Lag(
        rate=lambda f, spin: (f.speed / 7.0 - spin) / late, rest=lambda f: 0.0 * f.speed
    )
    spin = _add_state(subject.glider, lag)
    subject.glider.axial.append(lambda f: size * (1.0 - 0.7 * spin(f)))
    subject.accept("axial_drag", "profile_drag", "thrust")


def dense_air(rng: np.random.Generator, subject: Subject) -> None:
    """Air whose density drifts over the session: of traced flights alone."""
    drift = rng.uniform(0.03, 0.06) * rng.choice([-1.0, 1.0])
    usual = Glider().air_density
    subject.glider.air_density = usual * (1.0 + drift)

    def drifts(glider: Glider, count: int) -> Glider:
        densities = usual * (1.0 + np.linspace(-drift, drift, count))
        return dataclasses.replace(glider, air_density=densities)

    subject.in_session = drifts
    subject.accept("mass")


def rare_camber(rng: np.random.Generator, subject: Subject) -> None:
    """A camber in one flight of seven."""
    size = rng.uniform(0.05, 0.1)

    def normal(f: Flow) -> np.ndarray:
        return np.where(np.arange(f.speed.size) % 7 == 3, size, 0.0)

    subject.glider.normal.append(normal)
    subject.accept("camber", "wing_incidence")


def fast_drag(rng: np.random.Generator, subject: Subject) -> None:
    """A drag above a speed that hardly any flight reaches."""
    size, above = rng.uniform(0.1, 0.3), rng.uniform(7.6, 8.2)
    subject.glider.drag.append(lambda f: size * (f.speed > above))
    subject.accept("profile_drag", "axial_drag", "airspeed_dependence")


def shallow_flights(rng: np.random.Generator, subject: Subject) -> None:
    """A stall and a polar, flown with hardly any elevator."""
    slope, stall = rng.uniform(1.5, 2.8), rng.uniform(0.22, 0.3)
    subject.glider.normal.append(lambda f: _lift_to_stall(f, slope, stall))
    subject.glider.drag.append(lambda f: 0.04 + 0.05 * (2.0 * np.sin(f.alpha)) ** 2)
    subject.commands = lambda rates: 0.15 * rates
    subject.accept("attached_lift", "profile_drag", "axial_drag", "induced_drag")


def one_profile(rng: np.random.Generator, subject: Subject) -> None:
    """Damping and a downwash, flown with one sequence of commands."""
    damping, wash = rng.uniform(0.003, 0.008), rng.uniform(0.1, 0.3)
    subject.glider.moment.append(lambda f: -damping * f.pitchdot / f.speed)
    subject.glider.downwash.append(lambda f: wash * f.speed * np.sin(f.alpha))
    one = draw_commands(rng, 1)
    subject.commands = lambda rates: np.broadcast_to(one, rates.shape)
    subject.accept("pitch_damping", "downwash", "stalled_downwash")


def cancelling_forces(rng: np.random.Generator, subject: Subject) -> None:
    """A thrust and the drag that cancels it at the speed of launch."""
    thrust = rng.uniform(0.1, 0.25)
    subject.glider.thrust = thrust
    pressure_area = 0.5 * Glider().air_density * 7.0**2 * Glider().wing_area
    subject.glider.axial.append(lambda f: thrust / pressure_area)
    subject.accept("thrust", "axial_drag", "profile_drag")


def drifting_cameras(rng: np.random.Generator, subject: Subject) -> None:
    """Positions that drift by a millimeter over a second, otherwise in each flight."""
    size = rng.uniform(0.0006, 0.0012)

    def distort(poses: np.ndarray) -> np.ndarray:
        keep = math.exp(-1.0 / Capture().rate)
        noise = size * math.sqrt(1.0 - keep**2) * rng.normal(size=poses[..., :2].shape)
        drift = np.zeros_like(noise)
        for row in range(1, len(noise)):
            drift[row] = keep * drift[row - 1] + noise[row]
        moved = poses.copy()
        moved[..., :2] += drift
        return moved

    subject.distort = distort


KINDS: dict[str, Kind] = {
    kind.__name__: kind
    for kind in (
        nothing,
        reynolds_drag,
        latched_stall,
        tail_boom,
        wing_twist,
        hinge_play,
        sliding_payload,
        tether,
        bent_cameras,
        fan,
        table,
        propeller,
        dense_air,
        rare_camber,
        fast_drag,
        shallow_flights,
        one_profile,
        cancelling_forces,
        drifting_cameras,
    )
}


def other_launches(rng: np.random.Generator, start: np.ndarray) -> np.ndarray:
    """Launches (4, F), half slower by about 1 m/s than some, half faster."""
    speeds = start[1].real
    beyond = np.where(
        np.arange(FRESH) % 2, speeds.max() + 0.8, speeds.min() - 0.8
    ) + 0.2 * rng.normal(size=FRESH)
    others = draw_starts(rng, FRESH)
    others[1] = beyond + 1j * others[1].imag
    return others


def other_commands(rng: np.random.Generator, count: int) -> np.ndarray:
    """Rates (H, F) of doublets, late flares, ramps and chirps [rad/s]."""
    low, high = Glider().elevator_limits
    ticks = np.arange(draw_commands(rng, 1).shape[0])
    t = ticks / COMMAND_RATE
    angles = np.empty((len(t), count))
    for i in range(count):
        size, begin = rng.uniform(0.3, 0.9), rng.uniform(0.1, 0.45)
        if i % 4 == 0:
            wave = np.sign(np.sin(2.0 * np.pi * (t - begin) / 0.3))
            path = 0.4 * size * wave * (np.abs(t - begin - 0.15) < 0.15)
        elif i % 4 == 1:
            path = size * np.clip((t - begin) / 0.1, 0.0, 1.0)
        elif i % 4 == 2:
            path = size * t
        else:
            path = 0.3 * size * np.sin(2.0 * np.pi * (1.0 + 4.0 * t) * t)
        angles[:, i] = np.clip(path, low + 0.05, high - 0.05)
    rates = np.diff(angles, axis=0, prepend=0.0) * COMMAND_RATE
    return np.clip(rates, -11.7, 11.7)


class Flown(NamedTuple):
    """Flights of one glider."""

    flights: tuple[Flight, ...]
    motion: Motion
    elevator: np.ndarray  #: (K, F) at the rows of the motion [rad].


def fly_and_log(
    rng: np.random.Generator,
    subject: Subject,
    start: np.ndarray,
    commands: np.ndarray,
    moves: bool,
) -> Flown:
    """Flies commands from launches, and logs it as the subject's cameras would."""
    every = round(1.0 / (Capture().rate * STEP))
    glider = subject.glider
    asked = elevator_paths(
        Servo(),
        commands,
        1.0 / COMMAND_RATE,
        2 * every * (ROWS - 1),
        glider.elevator_limits,
    )
    path = with_play(asked, subject.play)
    air = gusts(rng, *AIR, path.shape) if moves else None
    motion = fly(glider, start, path, air)
    poses = subject.distort(shown_pose(glider, motion)[::every])
    flights = log_poses(rng, poses, asked[:: 2 * every], Capture(), commands)
    return Flown(flights=flights, motion=motion, elevator=path[::2])


def errors_of(
    traced: Campaign, flown: Flown, models: dict[str, GliderModel]
) -> list[float]:
    """Position errors of models on flights, over these [m]."""
    rollouts = refly.rollout_models(traced, models)
    squares: dict[str, list[float]] = {name: [] for name in models}
    for flight in flown.flights:
        motions = refly.refly(traced, flight, models, rollouts=rollouts)
        for name, (rms, _) in refly.position_errors(motions).items():
            squares[name].append(rms**2)
    return [float(np.sqrt(np.mean(own))) for own in squares.values()]


def count_departures(model: GliderModel, flown: Flown) -> int:
    """In how many flights a model's flown range is left."""
    motion, count = flown.motion, 0
    for i in range(motion.pitch.shape[1]):
        position, velocity = motion.position[:, i], motion.velocity[:, i]
        states = np.zeros((len(motion.time), model.num_states))
        states[:, :7] = np.column_stack(
            [
                *(position.real, position.imag, motion.pitch[:, i]),
                *(flown.elevator[:, i], velocity.real, velocity.imag),
                motion.pitchdot[:, i],
            ]
        )
        rates = np.gradient(flown.elevator[:, i], STEP)
        count += bool(describe_departures(model, motion.time, states, rates))
    return count


def ask(kind: str, seed: int) -> str:
    """Returns a row: the campaign, what is said of it, and how the model does."""
    rng = np.random.default_rng([seed, list(KINDS).index(kind), 97])
    subject = Subject()
    KINDS[kind](rng, subject)
    count, moves = int(rng.integers(14, 25)), seed % 3 == 2
    start = draw_starts(rng, count)
    commands = subject.commands(draw_commands(rng, count))
    like = draw_starts(rng, FRESH), subject.commands(draw_commands(rng, FRESH))
    other = other_launches(rng, start), other_commands(rng, FRESH)
    session = subject.in_session(subject.glider, count)
    in_session = dataclasses.replace(subject, glider=session)
    logged = fly_and_log(rng, in_session, start, commands, moves).flights
    traced = campaign(logged)
    begin = time.perf_counter()
    try:
        found = close_the_loop(traced, seed=seed)
    except InputError as error:
        return f"| {kind} | {seed} | {count} | refused | {error} |{' |' * 6}"
    taken = time.perf_counter() - begin

    nominal = refly.nominal_model(traced)
    assert nominal is not None
    models = {"nominal": nominal, "corrected": found.model}
    fresh, oracle = [], []
    beyond = 0
    perfect = Subject()
    plain = campaign(fly_and_log(rng, perfect, start, commands, False).flights)
    for launched, tape in (like, other):
        flown = fly_and_log(rng, subject, launched, tape, moves)
        fresh.append(errors_of(traced, flown, models))
        beyond = count_departures(found.model, flown)
        ideal = fly_and_log(rng, perfect, launched, tape, moves)
        oracle += errors_of(plain, ideal, {"nominal": nominal})
    kinds = [
        effect.kind + ("" if effect.kind in {*subject.accepted, "unexplained"} else "!")
        for effect in found.effects
    ]
    held = [_millimeters(found.errors[n]) for n in ("nominal", "corrected", "floor")]
    told = beyond > 0 or any(
        "most unlike the others" in words for words in found.warnings
    )
    excluded = "excluded" in found.reason
    faults = find_faults(found.verdict, fresh, oracle, told, excluded)
    return (
        f"| {kind} | {seed} | {count} | {found.verdict} | "
        f"{', '.join(kinds) or 'nothing'} | {' / '.join(held)} | "
        + "".join(
            f"{1e3 * bare:.1f} / {1e3 * own:.1f} / {1e3 * best:.1f} | "
            for (bare, own), best in zip(fresh, oracle, strict=True)
        )
        + f"{beyond} | {', '.join(faults) or '-'} | {taken:.0f} |"
    )


def _millimeters(errors: Errors | None) -> str:
    return "-" if errors is None else f"{1e3 * errors.position_rms_m:.1f}"


def find_faults(
    verdict: str,
    fresh: Sequence[Sequence[float]],
    oracle: Sequence[float],
    told: bool,
    excluded: bool,
) -> list[str]:
    """What must not be, of errors (nominal, corrected) on fresh and other flights."""
    faults = []
    if verdict == "no_effect" and fresh[0][0] > 2.5 * oracle[0] and not excluded:
        faults.append("claims nothing")
    offered = verdict in ("effect_found", "partly_explained", "unexplained")
    if offered and any(own > 1.02 * bare for bare, own in fresh):
        faults.append("worse")
    if verdict == "effect_found" and fresh[1][1] > 10.0 * oracle[1] and not told:
        faults.append("no warning")
    return faults


def main() -> None:
    """Prints the table, a row a campaign."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("kinds", nargs="*", default=list(KINDS), metavar="KIND")
    parser.add_argument("--seeds", type=int, default=2, help="campaigns of each kind")
    parser.add_argument("--first", type=int, default=0, help="first seed")
    parser.add_argument("--jobs", type=int, default=1, help="campaigns at a time")
    args = parser.parse_args()
    if unknown := [kind for kind in args.kinds if kind not in KINDS]:
        parser.error(f"no kind '{unknown[0]}'; expected some of {', '.join(KINDS)}")
    tasks = [
        joblib.delayed(ask)(kind, seed)
        for seed in range(args.first, args.first + args.seeds)
        for kind in args.kinds
    ]
    print(
        "| kind | seed | flights | verdict | names | held out | fresh | others "
        "| beyond | faults | s |"
    )
    print("|---" * 11 + "|")
    for row in joblib.Parallel(n_jobs=args.jobs, return_as="generator")(tasks):
        print(row, flush=True)


if __name__ == "__main__":
    main()
