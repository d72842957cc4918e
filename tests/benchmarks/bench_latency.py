"""Time from a pose received to the command sent, in flight, with two processes.

    python tests/benchmarks/bench_latency.py --minutes 10

Time of flight is counted, not that between throws. The time that a finished command
waits for its turn of the commands' clock is not part of it; with --each-pose there is
no clock, and a command follows each pose. Required: TVLQR 1 ms (median) and 3 ms
(99.9 %), MPC 6 and 15 ms, under 0.1 % of the deadlines missed.
"""

import argparse
import dataclasses
import tempfile
from pathlib import Path

import numpy as np

from diagrams.station.bus import Bus, free_address
from diagrams.station.controllers import make_guidance
from diagrams.station.realtime import run_station, simulated_glider
from diagrams.station.scenario import CONTROLLERS, Scenario, Simulation
from diagrams.station.session import Session
from diagrams.station.station import Station
from glider.physics.model import GliderModel


def measure(scenario: Scenario, minutes: float, folder: Path) -> str:
    """Flies for so long; returns a line of results."""
    guidance = make_guidance(scenario)
    session = Session(folder, scenario, guidance)
    station = Station(scenario, guidance, Bus(scenario.address), session, show=str)
    throws = round(60.0 * minutes / guidance.plan.duration)
    with simulated_glider(scenario) as is_alive:
        run_station(station, throws, is_alive)
    found = np.concatenate([throw.latencies for throw in station.throws])
    median, most = 1e3 * np.percentile(found, [50.0, 99.9])
    late = sum(throw.late for throw in station.throws)
    stopped = [throw.reason for throw in station.throws if throw.reason]
    perched = sum(throw.perched for throw in station.throws)
    return (
        f"{scenario.controller:6s} {throws:5d} {len(found):8d} {median:8.2f} "
        f"{most:8.2f} {1e3 * np.max(found):8.2f} {100.0 * late / len(found):8.3f} "
        f"{len(stopped):8d} {perched:8d}  {'; '.join(sorted(set(stopped)))}"
    )


def main() -> None:
    """Prints a line for each controller."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--minutes", type=float, default=1.0, help="of flight")
    parser.add_argument("--each-pose", action="store_true", help="no commands' clock")
    parser.add_argument("--controller", choices=CONTROLLERS, help="(default: all)")
    args = parser.parse_args()
    print(
        "       throws commands  median   99.9 %     most  late [%]  stopped  perched"
    )
    with tempfile.TemporaryDirectory() as name:
        GliderModel().save(Path(name, "nominal.yaml"))
        simulation = Simulation(truth=str(Path(name, "nominal.yaml")))
        for controller in [args.controller] if args.controller else CONTROLLERS:
            scenario = dataclasses.replace(
                Scenario(),
                controller=controller,
                simulation=simulation,
                bus=free_address(),
            )
            if args.each_pose:
                scenario = dataclasses.replace(scenario, command_rate=None)
            folder = Path(name, controller)
            print(measure(scenario, args.minutes, folder), flush=True)


if __name__ == "__main__":
    main()
