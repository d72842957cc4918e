"""How good and how fast is the tracing? Prints tables; asserts nothing.

    python -m tests.benchmarks.bench_tracing [practice|alarms|planted|all]

practice: verdict, coefficients, time and held-out error of the practice campaigns,
    beside the error of a fit that knows the truth.
alarms: twenty campaigns of our own simulator without any effect; noise halved and
    doubled, 10 to 40 flights.
planted: one and two effects of the library planted in our own simulator.
"""

import argparse
import dataclasses
import time

import numpy as np

from glider.campaign.motion_capture import MotionCapture
from glider.campaign.reader import load_campaign
from glider.physics.effects import KINDS
from glider.physics.effects.field import FieldData
from glider.physics.model import GliderModel
from glider.sysid.fit.folds import flown_by
from glider.sysid.fit.prediction import measure_errors
from glider.sysid.fit.simulate import (
    CampaignPlan,
    simulate_campaign,
)
from glider.sysid.likelihood.model_fit import fit_model
from glider.sysid.pipeline import close_the_loop
from tests.helpers.campaigns import PRACTICE, campaign_path
from tests.helpers.tasks import begin, fly, task_of, typical

TRUTH = {
    "still_air": None,
    "head_wind": "wind",
    "attached_lift": "attached_lift",
    "slow_servo": "servo_lag",
    "floor_vent": "vent",
}

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


VENT = FieldData(
    kind="unexplained",
    variables=["x"],
    centers=[[-1.8]],
    widths=[0.4],
    weights={"wind_z": [1.0]},
)
"""The truth of floor_vent: 1 m/s upward at x = -1.8 m, width 0.4 m."""


def floor_of(name: str, held_out: tuple[str, ...]) -> float:
    """Returns the held-out position error of a fit that knows the truth [m]."""
    whole, noise = task_of(load_campaign(campaign_path(name)))
    truth = TRUTH[name]
    task = whole.on([r for r in whole.records if r.name not in held_out])
    unseen = [r for r in whole.records if r.name in held_out]
    kinds = [] if truth in (None, "vent") else [truth]
    start = begin(task, noise, kinds)
    if truth == "vent":
        start = dataclasses.replace(start, extra=VENT)
    model = fit_model(task, start)
    return measure_errors(flown_by(task, model, model.scales), unseen)[0].position_rms_m


def practice() -> None:
    """Prints the practice campaigns' table."""
    print("campaign        verdict       s nominal  corrected  floor [mm]  effects")
    for name in PRACTICE:
        begin = time.perf_counter()
        result = close_the_loop(campaign_path(name))
        seconds = time.perf_counter() - begin
        nominal, corrected = (
            1e3 * result.errors[m].position_rms_m for m in ("as_drawn", "corrected")
        )
        floor = 1e3 * floor_of(name, result.held_out_flights)
        found = ", ".join(
            f"{n}={c.value:.4g}"
            for e in result.effects
            for n, c in e.coefficients.items()
        )
        found = f"{'+'.join(e.kind for e in result.effects)} {found}"
        print(
            f"{name:14s}  {result.verdict:12s} {seconds:4.1f} {nominal:7.2f} "
            f"{corrected:8.2f} {floor:8.2f}      {found}"
        )


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
        result = close_the_loop(simulate_campaign(GliderModel(), plan, rng), seed=seed)
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
