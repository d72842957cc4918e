"""Sessions in which the glider changes: is the change named and dated? Prints a table.

    python -m benchmarks.bench_changes [--seeds 2] [--nulls 8] [--kinds mass,camber]

The gliders fly in the independent simulator of `benchmarks.hidden`, in moving air of
0.1 m/s, each flight with a trim of its own. A session has 10 to 24 flights; from a
random one on (three at least on either side) an effect acts that did not before, or the
servo lags, or stops earlier.

Of sessions without a change (`nulls`) half are in the order of their launch speeds, and
all have an effect that acts throughout: what is wrong of every flight is no change.
"""

import argparse
import dataclasses

import numpy as np

from benchmarks.hidden import Thrower, campaign
from glider.campaign.logs import Flight
from glider.sysid.pipeline import close_the_loop

SIZES = {
    "mass": 0.08,
    "elevator_area": -0.2,
    "elevator_trim": 0.05,
    "pitch_offset": 0.04,
    "profile_drag": 0.03,
    "attached_lift": 1.0,
    "camber": 0.06,
    "pitch_damping": 0.006,
}
"""Effects that begin during a session, and how large they are."""

SERVOS = {"servo_lag": 0.03, "upper_stop": 0.45}
"""What else begins: a lag of the servo [s], a nearer stop [rad]."""

SHAPES = {"stall_angle": 0.25, "fade": 0.05}


def begin_during_session(kind: str, seed: int) -> tuple[str, str]:
    """Returns what was found of an effect that begins, and when: two cells."""
    rng = np.random.default_rng([seed, 11])
    count = int(rng.integers(10, 25))
    at = int(rng.integers(3, count - 2))
    flights = Thrower(None, seed).random(at, 0)
    size = (SIZES | SERVOS)[kind]
    if kind == "upper_stop":
        changed = Thrower(None, seed + 1)
        low, _ = changed.glider.elevator_limits
        changed.glider.elevator_limits = (low, size)
    else:
        changed = Thrower(kind, seed + 1, size, SHAPES)
    flights += changed.random(count - at, at)
    found = close_the_loop(campaign(flights))
    name = f"flight_{at:03d}.csv"
    cells = [f"{c.kind} {c.value:+.3g} at {c.flight or 'all'}" for c in found.changes]
    effects = ", ".join(effect.kind for effect in found.effects) or "nothing"
    return (
        f"{kind} {size:+.3g} at {name} of {count}",
        f"{'; '.join(cells) or 'no change'} | {found.verdict}: {effects}",
    )


def change_nothing(seed: int) -> tuple[str, str]:
    """Returns what was found of a session without a change: two cells."""
    rng = np.random.default_rng([seed, 12])
    kind = str(rng.choice(list(SIZES)))
    thrower = Thrower(kind, seed, SIZES[kind] * rng.uniform(0.5, 1.0), SHAPES)
    flights = thrower.random(int(rng.integers(10, 25)), 0)
    if seed % 2:
        flights.sort(key=_launch_speed)
        names = sorted(flight.name for flight in flights)
        flights = [
            dataclasses.replace(flight, name=name)
            for flight, name in zip(flights, names, strict=True)
        ]
    found = close_the_loop(campaign(flights))
    cells = [change.sentence for change in found.changes]
    ordered = ", by launch speed" if seed % 2 else ""
    effects = ", ".join(effect.kind for effect in found.effects) or "nothing"
    return (
        f"{kind} in all {len(flights)}{ordered}",
        f"{'; '.join(cells) or 'no change'} | {found.verdict}: {effects}",
    )


def _launch_speed(flight: Flight) -> float:
    return float(flight.pose[10, 0] - flight.pose[0, 0])


def main() -> None:
    """Prints the table, a row a session."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seeds", type=int, default=2, help="sessions of each effect")
    parser.add_argument("--nulls", type=int, default=8, help="sessions without one")
    parser.add_argument("--kinds", default=",".join(SIZES | SERVOS), help="what begins")
    args = parser.parse_args()
    print("| session | change that is found | verdict and effects |\n|---|---|---|")
    for seed in range(args.seeds):
        for kind in args.kinds.split(","):
            print("| {} | {} |".format(*begin_during_session(kind, 50 + 7 * seed)))
    for seed in range(args.nulls):
        print("| {} | {} |".format(*change_nothing(900 + seed)), flush=True)


if __name__ == "__main__":
    main()
