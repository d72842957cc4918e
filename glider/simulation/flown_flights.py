"""Simulated flights: where they pass the wire, and how they end."""

import dataclasses
from collections.abc import Iterator, Sequence

import numpy as np
from scipy.interpolate import CubicHermiteSpline

from glider.campaign.logs import Campaign, Flight
from glider.errors import InputError
from glider.physics.state import PITCH, POSITION, VELOCITY
from glider.planning.problem import Hook, PerchingProblem

INSTANT = 1e-9
"""Time within which two steps of an integrator are one [s]: events make some that are
a rounding error apart."""


_REFINEMENT = 16
"""Segments that each step of a simulator's log is divided into."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Pass:
    """The moment at which a flight is nearest to the wire."""

    time: float  #: Of the flight [s].
    miss: float  #: Distance of the center of mass from the wire [m].
    arrival: np.ndarray  #: (n,) state.


def closest_pass(times: np.ndarray, states: np.ndarray, wire: np.ndarray) -> Pass:
    """Returns where a logged flight is nearest to the wire.

    A simulator's steps are long; between them the path is the cubic of the
    positions and velocities at both ends, followed by short segments; what else the
    state holds lies on a straight line. Times (K,) may be equal now and then [s].
    """
    kept = np.flatnonzero(np.append(np.diff(times) > 0.0, True))
    times = times[kept]
    states = states[kept]
    fine, path = _refine(times, states)
    start = path[:-1] - wire
    along = np.diff(path, axis=0)
    square = np.sum(along**2, axis=1)
    share = -np.sum(start * along, axis=1) / np.where(square > 0.0, square, 1.0)
    share = np.append(np.clip(share, 0.0, 1.0), 0.0)
    along = np.vstack([along, np.zeros(2)])
    places = path + share[:, None] * along
    distances = np.linalg.norm(places - wire, axis=1)
    k = int(np.argmin(distances))
    time = float(fine[k] + share[k] * (fine[min(k + 1, len(fine) - 1)] - fine[k]))
    arrival = np.array([np.interp(time, times, column) for column in states.T])
    arrival[POSITION] = places[k]
    return Pass(time=time, miss=float(distances[k]), arrival=arrival)


def _refine(times: np.ndarray, states: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Returns finer times and the places (..., 2) there, of times that increase."""
    places = states[:, POSITION]
    if len(times) == 1:
        return times, places
    steps = np.diff(times)[:, None] * np.arange(_REFINEMENT) / _REFINEMENT
    fine = np.append((times[:-1, None] + steps).ravel(), times[-1])
    return fine, CubicHermiteSpline(times, places, states[:, VELOCITY])(fine)


@dataclasses.dataclass(frozen=True, kw_only=True)
class FlownFlight:
    """One flight of a simulated glider; a hook that takes it ends it at the wire."""

    times: np.ndarray  #: (K,) of the integrator's steps [s].
    states: np.ndarray  #: (K, n) of the glider.
    miss: float  #: Least distance of the center of mass from the wire [m].
    arrival: np.ndarray  #: (n,) state there.
    hook: Hook  #: At the glider.
    #: (K, 2) of wing and elevator along their normals [N], if asked for.
    forces: np.ndarray | None = None
    #: Of motion capture and of the commands, where there is one.
    log: Flight | None = None

    def __repr__(self) -> str:
        """Returns one line, as a notebook shows it."""
        end = "perches" if self.perched else "does not perch"
        return f"FlownFlight({end}, miss {1e3 * self.miss:.1f} mm)"

    @property
    def speed(self) -> float:
        """Speed at the wire [m/s]."""
        return float(np.linalg.norm(self.arrival[VELOCITY]))

    @property
    def perched(self) -> bool:
        """Whether the hook holds the glider at the wire."""
        return bool(self.hook.takes(np.array(self.miss), self.arrival))


def hooked(
    times: np.ndarray,
    states: np.ndarray,
    problem: PerchingProblem,
    *,
    forces: np.ndarray | None = None,
    log: Flight | None = None,
) -> FlownFlight:
    """Returns a flight, with its end at the wire where the hook takes it.

    The stop itself, some hundredths of a second, is not simulated: the glider stays
    where it was and as it was, and its log ends with the contact. The arguments are
    those of `FlownFlight`, with steps beyond the wire.
    """
    passed = closest_pass(times, states, np.array(problem.wire))
    if problem.hook.takes(np.array(passed.miss), passed.arrival):
        count = int(np.searchsorted(times, passed.time - INSTANT))  # Steps before it.
        ended = [*range(count), min(count, len(times) - 1)]
        times = np.append(times[:count], passed.time)
        states = np.vstack([states[:count], passed.arrival])
        forces = None if forces is None else forces[ended]
        if log is not None:
            kept = log.time <= passed.time
            names = ("time", "pose", "elevator", "command", "attitude")
            columns = {n: v[kept] for n in names if (v := getattr(log, n)) is not None}
            log = dataclasses.replace(log, **columns)
    return FlownFlight(
        times=times,
        states=states,
        miss=passed.miss,
        arrival=passed.arrival,
        hook=problem.hook,
        forces=forces,
        log=log,
    )


@dataclasses.dataclass(frozen=True)
class Perches:
    """Flights to a wire under one policy: how many perch, and how they come there."""

    flights: Sequence[FlownFlight]  #: In the order of the launches.
    logged: Campaign | None = None  #: Their logs as a campaign, or None.

    @property
    def campaign(self) -> Campaign:
        """Their logs, of a vehicle with the parameters of the glider that flew.

        Its effects stay undeclared.

        Raises:
            InputError: there are none.
        """
        if self.logged is None:
            raise InputError(
                "flights without a campaign; expected a diagram with motion_capture "
                "and a command_rate."
            )
        return self.logged

    @property
    def misses(self) -> list[float]:
        """Least distance of each flight from the wire [m]."""
        return [flight.miss for flight in self.flights]

    @property
    def speeds(self) -> list[float]:
        """Speed of each flight there [m/s]."""
        return [flight.speed for flight in self.flights]

    @property
    def pitches(self) -> list[float]:
        """Pitch of each flight there [rad]."""
        return [float(flight.arrival[PITCH]) for flight in self.flights]

    @property
    def perched(self) -> int:
        """Number of flights that perch."""
        return sum(flight.perched for flight in self.flights)

    @property
    def worst(self) -> FlownFlight:
        """The flight that misses by most."""
        return max(self.flights, key=lambda flight: flight.miss)

    def describe(self) -> str:
        """Describes the number that perch, and the median flight at the wire."""
        pitch = np.degrees(np.median(self.pitches))
        return (
            f"{self.perched} of {len(self)} launches perch, median miss "
            f"{1000 * np.median(self.misses):.1f} mm at {np.median(self.speeds):.1f} "
            f"m/s, nose {abs(pitch):.0f}° {'down' if pitch > 0.0 else 'up'}"
        )

    def __repr__(self) -> str:
        """Returns one line, as a notebook shows it."""
        return f"Perches({self.perched} of {len(self)} flights perch)"

    def __len__(self) -> int:
        """Number of flights."""
        return len(self.flights)

    def __iter__(self) -> Iterator[FlownFlight]:
        """Returns an iterator over the flights."""
        return iter(self.flights)

    def __getitem__(self, k: int) -> FlownFlight:
        """Returns one of the flights."""
        return self.flights[k]


@dataclasses.dataclass(frozen=True, kw_only=True)
class Flights:
    """Many flights of one glider under one policy, over the same time."""

    times: np.ndarray  #: (N + 1,) of the steps [s].
    miss: np.ndarray  #: (B,) least distance of the center of mass from the wire [m].
    arrivals: np.ndarray  #: (B, n) states there.
    problem: PerchingProblem  #: That was flown: its wire, and the hook at the glider.
    ends: np.ndarray  #: (B, n) the last states, as if there were no hook.
    #: (B, N + 1, n) all states, if asked for, as if there were no hook.
    paths: np.ndarray | None = None

    @property
    def perched(self) -> np.ndarray:
        """(B,) whether the hook holds the glider at the wire."""
        return self.problem.hook.takes(self.miss, self.arrivals)

    def flight(self, b: int) -> FlownFlight:
        """Returns one of them, with its end at the wire where the hook takes it.

        The paths must be there.
        """
        if self.paths is None:
            raise ValueError("expected flights with paths")
        return hooked(self.times, self.paths[b], self.problem)

    def __repr__(self) -> str:
        """Returns one line, as a notebook shows it."""
        return f"Flights({self.perched.sum()} of {len(self)} perch)"

    def __len__(self) -> int:
        """Number of flights."""
        return len(self.miss)
