"""One throw, as the station saw it."""

import dataclasses
import datetime
import math
from pathlib import Path

import numpy as np

from glider.files import schema
from glider.physics.state import VELOCITY
from glider.planning.problem import PerchingProblem
from glider.simulation.flown_flights import Pass, closest_pass


@dataclasses.dataclass(frozen=True, kw_only=True)
class ThrowResult:
    """How a throw ended, as its record has it."""

    perched: bool
    miss_m: schema.Number
    speed_m_s: schema.Number
    reason: str  #: Why it was stopped; "": it was not.
    commands: int
    late: int
    latency_s: list[float]
    flown: str = ""  #: When it began (ISO 8601).
    state: str = "result"


class Throw:
    """Estimated path, latencies and end of a throw.

    Args:
        problem: whose wire and hook.
    """

    def __init__(self, problem: PerchingProblem) -> None:
        self._problem = problem
        self._times: list[float] = []
        self._states: list[np.ndarray] = []
        self.latencies: list[float] = []  #: From a pose to the command it led to [s].
        self.late = 0  #: Number of commands that missed their deadline.
        self.reason = ""  #: Why it was stopped; "": it was not.
        self.stopped = math.nan  #: When, by the plan's time [s].
        #: When it began, by the calendar.
        self.flown = datetime.datetime.now().astimezone()
        self.file: Path | None = None  #: Of the flight; None: too short for one.

    def add_state(self, time: float, state: np.ndarray) -> None:
        """Appends an estimate (n,) of a time [s]."""
        self._times.append(time)
        self._states.append(state)

    def add_command(self, latency: float, late: bool) -> None:
        """Counts a command, `latency` [s] after its pose but for waiting."""
        self.latencies.append(latency)
        self.late += late

    @property
    def passed(self) -> Pass:
        """Where the estimated path is nearest to the wire."""
        wire = np.array(self._problem.wire)
        return closest_pass(np.array(self._times), np.array(self._states), wire)

    @property
    def perched(self) -> bool:
        """Whether the hook takes the glider there, and nothing stopped the throw."""
        passed = self.passed
        taken = self._problem.hook.takes(np.array(passed.miss), passed.arrival)
        return bool(taken) and not self.reason

    @property
    def result(self) -> ThrowResult:
        """How it ended."""
        passed = self.passed
        return ThrowResult(
            perched=self.perched,
            miss_m=passed.miss,
            speed_m_s=float(np.linalg.norm(passed.arrival[VELOCITY])),
            reason=self.reason,
            commands=len(self.latencies),
            late=self.late,
            latency_s=self.latencies,
            flown=self.flown.isoformat("T", "milliseconds"),
        )

    def describe(self) -> str:
        """One line: perched or not, the miss, latencies and deadlines."""
        r = self.result
        end = "perched" if r.perched else "no perch"
        text = f"{end}, {1e3 * r.miss_m:.0f} mm from the wire at {r.speed_m_s:.1f} m/s"
        if self.reason:
            text = f"stopped at {self.stopped:.2f} s: {self.reason}"
        if self.latencies:
            median = 1e3 * np.median(self.latencies)
            most = 1e3 * max(self.latencies)
            text += (
                f"; pose to command {median:.1f} ms (median), {most:.1f} ms (largest); "
                f"{self.late} of {len(self.latencies)} deadlines missed"
            )
        return text
