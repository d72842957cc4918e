"""Launches of a simulated glider by the station, into the folder of a session."""

import dataclasses
import os
import signal
import subprocess
import sys
from pathlib import Path

from diagrams.programs.lab.state import CORRECTED, NOMINAL, PROPOSED
from glider.errors import expect
from glider.report.next_throw import commands_name

_MOST = 100
"""Launches that one request may ask for."""


@dataclasses.dataclass(kw_only=True)
class Launches:
    """Launches by the station, a process of its own.

    `ask` may be called by any thread; `step`, again and again, by that of the session.
    """

    folder: Path
    truth: str  #: Name or file of the simulated glider.
    scenario: Path | None = None
    seed: int = 0
    count: int = 10  #: That a person is offered.
    bus: str | None = None  #: Its address; None: one that the station chooses.
    fault: str = ""  #: Of the last launches.
    _asked: tuple[str, int] | None = None  # Planned with, and number.
    _words: str = ""
    _process: subprocess.Popen | None = None
    _is_stopped: bool = False  # Whether `stop` ended the last ones.

    def start(
        self, throws: int, model: Path | None, flown: int, commands: Path | None = None
    ) -> subprocess.Popen:
        """Starts launches, after so many that were flown.

        They are planned with a model, or, given a file of commands, fly these.
        """
        options = {
            "simulate": self.truth,
            "throws": throws,
            "log": self.folder,
            "seed": self.seed + flown,
            "scenario": self.scenario,
            "model": model,
            "commands": commands,
            "bus": self.bus,
        }
        given = [f"--{name}={v}" for name, v in options.items() if v is not None]
        # Launches end with this process: nobody would see, or stop, those that go on.
        program = ["-m", "diagrams.programs.station.processes", str(os.getpid()), "fly"]
        return subprocess.Popen([sys.executable, *program, *given])

    def ask(self, planned: str, throws: int) -> None:
        """Asks for launches; they begin with the next step, after those that fly.

        Raises:
            InputError: they cannot be.
        """
        ways = (NOMINAL, CORRECTED, PROPOSED)
        expect(planned in ways, "planned", planned, f"one of {', '.join(ways)}")
        expect(1 <= throws <= _MOST, "throws", throws, f"from 1 to {_MOST}")
        self._asked = planned, throws

    @property
    def doing(self) -> str:
        """What flies; "" for nothing."""
        return self._words

    def step(self, model: Path | None, flown: int) -> bool:
        """Starts what was asked for, and ends what is over; returns whether one flies.

        Args:
            model: file of the corrected model, if there is one.
            flown: number of throws so far.
        """
        if self._process is not None and (code := self._process.poll()) is not None:
            self._process = None
            self._words = ""
            self.fault = "" if self._is_stopped else _fault_of(code)
        if self._process is None and self._asked is not None:
            planned, throws = self._asked
            self._asked = None
            if planned != NOMINAL and model is None:
                self.fault = "There is no corrected model yet to plan with."
                return False
            self.fault = ""
            self._is_stopped = False
            self._words = f"flying {throws} launches planned with the {planned} model"
            with_model = model if planned != NOMINAL else None
            commands = None
            if planned == PROPOSED:
                assert model is not None
                commands = model.parent / "next_throw" / commands_name(1)
                self._words = "flying the proposed throw"
            self._process = self.start(throws, with_model, flown, commands)
        return self._process is not None

    def stop(self) -> None:
        """Ends what flies, the elevator at neutral; what was logged stays.

        By any thread; `close` waits for the end.
        """
        self._asked = None
        if (process := self._process) is not None and not self._is_stopped:
            self._is_stopped = True
            process.terminate()

    def close(self) -> None:
        """Ends what flies, and waits until it has ended."""
        self.stop()
        if self._process is not None:
            self._process.wait()


def _fault_of(code: int) -> str:
    """What an exit code of the station says; "" where all was flown."""
    if code < 0:
        name = signal.Signals(-code).name
        return f"Not all launches were flown: {name} ended the station."
    words = {1: "the simulated glider died", 2: "the terminal shows what it refused"}
    why = words.get(code, "the terminal shows why")
    return f"Not all launches were flown: {why}." if code else ""
