"""The loop of a station in real time, and the keys that stop and arm it."""

import contextlib
import os
import select
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path

from diagrams.programs.station.operators import ARM, KILL
from diagrams.programs.station.processes import Ending, hasten
from diagrams.programs.station.scenario import Scenario
from diagrams.programs.station.station import Station
from glider.files import schema

KEYS = "space or any key stops, Enter arms again, Ctrl-C ends"


@contextlib.contextmanager
def _keyboard() -> Iterator[Callable[[], str]]:
    """Yields what reads the keys pressed, "" for none; only on a terminal of ours.

    One of which this is a program in the background would stop us for asking.
    """
    own = sys.stdin.isatty() and os.tcgetpgrp(sys.stdin.fileno()) == os.getpgrp()
    if not own:
        yield lambda: ""
        return
    import termios
    import tty

    file = sys.stdin.fileno()
    before = termios.tcgetattr(file)

    def read() -> str:
        pressed, _, _ = select.select([file], [], [], 0.0)
        return os.read(file, 32).decode(errors="replace") if pressed else ""

    try:
        tty.setcbreak(file)
        yield read
    finally:
        termios.tcsetattr(file, termios.TCSADRAIN, before)


def run_station(
    station: Station, throws: int | None, is_alive: Callable[[], bool] = lambda: True
) -> None:
    """Runs a station until it has seen so many throws; None: until it is ended.

    However it ends, the elevator is neutral then, and the record of a throw complete.

    Args:
        station: ready to run.
        throws: their number.
        is_alive: asked now and then; the loop ends when it is false.

    Raises:
        KeyboardInterrupt: the process was asked to end.
    """
    asked = time.monotonic()
    if not hasten():
        print("No real-time priority: other programs may delay commands (ulimit -r).")
    with Ending() as ending:
        try:
            with _keyboard() as pressed:
                while throws is None or len(station.throws) < throws:
                    station.bus.rest_until(station.tick())
                    if key := pressed():
                        station.operate(ARM if key in "\r\n" else KILL)
                    if ending:
                        raise KeyboardInterrupt
                    if time.monotonic() > asked + 1.0:
                        asked = time.monotonic()
                        if not (station.in_flight or is_alive()):
                            return
        finally:
            station.close()


@contextlib.contextmanager
def simulated_glider(scenario: Scenario) -> Iterator[Callable[[], bool]]:
    """Runs a simulated glider as a process; yields whether it still runs."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder, "scenario.yaml")
        file.write_text(schema.yaml_text(scenario), encoding="utf-8")
        program = [
            sys.executable,
            "-m",
            "diagrams.programs.station.simulated",
            str(file),
        ]
        process = subprocess.Popen([*program, f"--parent={os.getpid()}"])
        try:
            yield lambda: process.poll() is None
        finally:
            process.terminate()
            process.wait()
