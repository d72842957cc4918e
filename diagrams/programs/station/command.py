"""The command `fly`: fly throws live, with a real or a simulated glider."""

import argparse
import contextlib
import dataclasses
from pathlib import Path

from glider.commands.parsing import CommandParser
from glider.errors import expect
from glider.files.writing import check_writable

DESCRIPTION = """\
Flies throws live: takes poses from a bus (LCM), estimates the glider's state, sends
commands of its elevator back, and logs every throw as a flight of a campaign.

--simulate puts a simulated glider on a bus of its own, unless the scenario names one: a
process with a launcher, a servo, and cameras that lose and delay frames. It has effects
that the planner's model lacks. Without it the drivers of cameras and servo are started
beside this command: diagrams.programs.station.drivers.poses shows one of the cameras,
python -m diagrams.programs.station.drivers.servo_board --help is that of the servo.
"""

EPILOG = """\
For each throw one line: whether it perched, the miss, the time from a pose to its
command, and the deadlines missed. Whatever is not right (no poses, impossible ones,
late commands, a filter that loses the glider, another operator, any key) turns the
elevator to neutral and says why; Enter arms again. A key stops every servo on the bus,
whichever station it obeys, until Enter is pressed at the same station.

The folder of --log is a campaign: flight_NNN.csv for close-the-loop, and throw_NNN.mcap
with all poses, commands, estimates, times, the plan and the versions.

examples:
  glider fly --simulate head_wind
  glider fly --simulate head_wind --throws 20 --controller mpc --log out/session
  glider close-the-loop out/session
  glider fly --simulate head_wind --model out/session/model.yaml --log out/after
  glider fly --scenario lab.yaml --log out/today
  glider fly --simulate head_wind --throws 1 --commands out/next_throw/commands_1.csv

exit code: 0 when all throws were flown, 1 if the simulated glider died, 2 when the
input cannot be used.
"""


def add_arguments(parser: CommandParser) -> None:
    """Adds its arguments to a parser."""
    words = "simulated glider: a model file, or a name in models/truths"
    parser.add_argument("--simulate", metavar="TRUTH", help=words)
    parser.add_path("--scenario", "YAML", "sensors, servo, limits, bus (default: ours)")
    words = "address of the bus, for LCM (default: the scenario's)"
    parser.add_argument("--bus", metavar="ADDRESS", help=words)
    parser.add_path("--model", "YAML", "model to plan with (default: the nominal one)")
    words = "fly these of a proposed throw (glider next-throw) without feedback"
    parser.add_path("--commands", "CSV", words)
    words = "tvlqr (default), mpc or mppi"
    parser.add_argument("--controller", choices=("tvlqr", "mpc", "mppi"), help=words)
    words = "end after so many (default: 10 with --simulate, else never)"
    parser.add_number("--throws", words, least=1)
    parser.add_path("--log", "FOLDER", "campaign to write (default: out/fly)")
    parser.add_number("--seed", "of simulated launches and noise (default: 0)")


def run(args: argparse.Namespace) -> int:
    """Runs it; returns the exit code."""
    throws = args.throws
    folder = args.log or Path("out/fly")
    check_writable(folder)
    good = args.commands is None or args.controller is None
    expect(good, "--controller", args.controller, "none with --commands")
    from diagrams.programs.station.bus import Bus
    from diagrams.programs.station.controllers import make_guidance
    from diagrams.programs.station.realtime import KEYS, run_station, simulated_glider
    from diagrams.programs.station.scenario import make_scenario
    from diagrams.programs.station.session import Session
    from diagrams.programs.station.station import Station
    from glider.commands.output import working

    scenario = make_scenario(
        args.scenario,
        args.simulate,
        controller=args.controller,
        bus=args.bus,
        model=args.model,
        commands=args.commands,
    )
    if args.seed is not None:
        simulation = scenario.simulation
        expect(simulation, "--seed", args.seed, "it only with --simulate")
        assert simulation is not None
        simulation = dataclasses.replace(simulation, seed=args.seed)
        scenario = dataclasses.replace(scenario, simulation=simulation)
    scenario.load_model(), scenario.load_problem()  # What is wrong is said once.
    with contextlib.ExitStack() as stack:
        is_alive = None
        if scenario.simulation is not None:  # It compiles while we plan.
            is_alive = stack.enter_context(simulated_glider(scenario))
        with working() as progress:
            progress("planning (compiles once)")
            guidance = make_guidance(scenario)
            session = Session(folder, scenario, guidance, _show)
            station = Station(
                scenario, guidance, Bus(scenario.address), session, show=_show
            )
        print(f"Station on {scenario.address}: {KEYS}.", flush=True)
        if is_alive is None:
            run_station(station, throws)
            return 0
        throws = throws or 10
        run_station(station, throws, is_alive)
    perched = sum(throw.perched for throw in station.throws)
    print(f"{perched} of {len(station.throws)} perched; campaign: {folder}")
    return 0 if len(station.throws) == throws else 1


def _show(line: str) -> None:
    print(line, flush=True)
