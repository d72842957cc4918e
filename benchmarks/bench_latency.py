"""Time from a pose received to the command sent, in flight, with two processes.

    python -m benchmarks.bench_latency --minutes 10

Time of flight is counted, not that between throws. The time that a finished command
waits for its turn of the commands' clock is not part of it; with --each-pose there is
no clock, and a command follows each pose. Required: TVLQR 1 ms (median) and 3 ms
(99.9 %), MPC 6 and 15 ms, under 0.1 % of the deadlines missed.
"""

import argparse
import tempfile
from pathlib import Path

import numpy as np

from benchmarks.tables import line_of
from diagrams.programs.station.bus import Bus, free_address
from diagrams.programs.station.controllers import make_guidance
from diagrams.programs.station.realtime import run_station, simulated_glider
from diagrams.programs.station.scenario import Scenario, Simulation
from diagrams.programs.station.session import Session
from diagrams.programs.station.station import Station
from diagrams.programs.station.throw import Throw
from glider.physics.model import GliderModel

COLUMNS = (
    *("controller", "commands", "median", "99.9 %", "largest"),
    *("deadlines missed", "throws stopped", "perched"),
)


def measure(controller: str, minutes: float, *, each_pose: bool = False) -> list[str]:
    """Flies for so long; returns a row of results."""
    with tempfile.TemporaryDirectory() as name:
        model = Path(name, "nominal.yaml")
        GliderModel().save(model)
        scenario = Scenario(
            controller=controller,  # type: ignore[arg-type]
            simulation=Simulation(truth=str(model)),
            bus=free_address(),
            command_rate=None if each_pose else Scenario().command_rate,
        )
        throws = _fly(scenario, minutes, Path(name, controller))
    found = np.concatenate([throw.latencies for throw in throws])
    median, most = 1e3 * np.percentile(found, [50.0, 99.9])
    late = sum(throw.late for throw in throws)
    return [
        f"`{controller}`",
        str(len(found)),
        *(f"{ms:.2f} ms" for ms in (median, most, 1e3 * np.max(found))),
        f"{100.0 * late / len(found):.3f} %",
        str(sum(bool(throw.reason) for throw in throws)),
        f"{sum(throw.perched for throw in throws)} of {len(throws)}",
    ]


def _fly(scenario: Scenario, minutes: float, folder: Path) -> list[Throw]:
    guidance = make_guidance(scenario)
    session = Session(folder, scenario, guidance)
    station = Station(scenario, guidance, Bus(scenario.address), session, show=str)
    throws = round(60.0 * minutes / guidance.plan.duration)
    with simulated_glider(scenario) as is_alive:
        run_station(station, throws, is_alive)
    return station.throws


def main() -> None:
    """Prints a line for each controller."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--minutes", type=float, default=1.0, help="of flight")
    parser.add_argument("--each-pose", action="store_true", help="no commands' clock")
    controllers = ("tvlqr", "mpc", "mppi")
    parser.add_argument("--controller", choices=controllers, help="(default: all)")
    args = parser.parse_args()
    print(line_of(list(COLUMNS)))
    for controller in [args.controller] if args.controller else controllers:
        row = measure(controller, args.minutes, each_pose=args.each_pose)
        print(line_of(row), flush=True)


if __name__ == "__main__":
    main()
