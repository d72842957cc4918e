"""How good and how fast is the tracing? Prints tables; asserts nothing.

    python -m benchmarks.bench_tracing [practice|alarms|planted|all]

practice: verdict, coefficients, time and held-out error of the samples, beside the
    error of a fit that knows the truth.
alarms: twenty campaigns of our own simulator without any effect; noise halved and
    doubled, 10 to 40 flights.
planted: one and two effects of the library planted in our own simulator.
"""

import argparse
import time

import numpy as np

from benchmarks import tables
from benchmarks.table_rows import TABLES
from glider.campaign.motion_capture import MotionCapture
from glider.physics.effects import KINDS
from glider.physics.model import GliderModel
from glider.simulation.campaigns import CampaignPlan
from glider.sysid.pipeline import close_the_loop
from tests.helpers.tasks import fly, typical

PAIRS = (
    ("wind", "attached_lift"),
    ("servo_lag", "profile_drag"),
    ("pitch_damping", "wing_incidence"),
    ("tail_wake", "command_delay"),
    ("elevator_trim", "added_mass"),
    ("downwash", "marker_offset"),
    ("pitch_offset", "pose_latency"),
    ("dynamic_stall", "profile_drag"),
    ("mass", "pitch_moment"),
    ("frame_tilt", "wind"),
    ("center_of_pressure", "inertia"),
    ("airspeed_dependence", "elevator_area"),
)


def practice() -> None:
    """Prints the samples' table, as `make tables` writes it into the pages."""
    tables.measure(TABLES["samples"])


def alarms(count: int = 20) -> None:
    """Prints how often an effect is found where there is none."""
    false = 0
    for seed in range(count):
        rng = np.random.default_rng(1000 + seed)
        flights = int(rng.integers(10, 41))
        level = float(rng.choice([0.5, 1.0, 2.0]))
        plan = CampaignPlan(
            flights=flights,
            capture=MotionCapture(
                position=0.0004 * level, pitch=0.0025 * level, elevator=0.005 * level
            ),
        )
        result = close_the_loop(plan.simulate(GliderModel(), rng), seed=seed)
        false += result.verdict != "no_effect"
        kinds = [e.kind for e in result.effects]
        print(f"  {flights:2d} flights, noise x {level}: {result.verdict} {kinds}")
    print(f"false alarms: {false} of {count}")


def planted() -> None:
    """Prints whether planted effects are found, alone and in pairs."""
    alone = [(k,) for k in KINDS if k not in ("angle_sign", "ground_effect")]
    right = 0
    for i, kinds in enumerate([*alone, *PAIRS]):
        size = 1.0 if len(kinds) == 1 else 0.5
        effects = [typical(name, size) for name in kinds]
        campaign = fly(*effects, seed=i, flights=20)
        begin = time.perf_counter()
        result = close_the_loop(campaign)
        seconds = time.perf_counter() - begin
        found = sorted(e.kind for e in result.effects)
        right += found == sorted(kinds)
        mark = "ok " if found == sorted(kinds) else "BAD"
        print(f"  {mark} {'+'.join(kinds):36s} {seconds:5.1f} s  {found}", flush=True)
    print(f"right: {right} of {len(alone) + len(PAIRS)}")


def main() -> None:
    """Runs the chosen tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("what", nargs="?", default="all")
    what = parser.parse_args().what
    for name, table in (
        ("practice", practice),
        ("alarms", alarms),
        ("planted", planted),
    ):
        if what in (name, "all"):
            table()


if __name__ == "__main__":
    main()
