"""Campaigns as life makes them, of an independent simulator, to judge the tracer by.

Several effects at once, in other forms than the library's; trims, pitch zeros and winds
that differ from flight to flight; moving air; noise, and rows that are broken. What is
wrong is known: each campaign comes with its Truth. The physics is in `lifelike_flight`
and the effects in `lifelike_forms`; neither shares code with the library.
"""

import dataclasses
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from glider.campaign.logs import Campaign, Flight
from tests.helpers.lifelike_flight import (
    STEP,
    Glider,
    Motion,
    elevator_paths,
    fly,
    gusts,
    shown_pose,
)
from tests.helpers.lifelike_forms import FORMS, RIVALS, Planted

COMMAND_RATE = 50.0
"""[Hz]"""

ELEVATOR_RATE_LIMIT = 13.0
"""[rad/s]"""

COUNTS = (1, 2, 2, 3, 3, 4, 5)
"""How many effects a campaign has, each as likely."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Capture:
    """Cameras and the elevator's sensor; the defaults are those of lifelike logs."""

    rate: float = 120.0  # [Hz]
    position: float = 0.0004  # Standard deviation of x and z [m].
    pitch: float = 0.0025  # [rad]
    elevator: float = 0.005  # [rad]


@dataclasses.dataclass(frozen=True, kw_only=True)
class Truth:
    """What is wrong with a campaign's glider, and what its air does.

    Attributes:
        effects: what a right answer names.
        air_std: of the gusts in x and in z, 0 where the air stands still [m/s].
        air_correlation: time of the gusts [s].
        spreads: kind to the standard deviation over flights of its (first) coefficient,
            about its value in `effects` or zero.
        per_flight: kind to its (F,) departures in the flights.
        broken: name of a flight to what was done to its rows.
        vehicle: the true glider before effects, where the campaign does not tell.
        capture: how it was measured.
        glider: the true glider itself.
        motion: the true flights, one row a STEP.
    """

    effects: tuple[Planted, ...] = ()
    air_std: float = 0.0
    air_correlation: float = 0.0
    spreads: dict[str, float] = dataclasses.field(default_factory=dict)
    per_flight: dict[str, np.ndarray] = dataclasses.field(default_factory=dict)
    broken: dict[str, tuple[str, ...]] = dataclasses.field(default_factory=dict)
    vehicle: dict[str, float] = dataclasses.field(default_factory=dict)
    capture: Capture = Capture()
    glider: Glider = dataclasses.field(repr=False)
    motion: Motion = dataclasses.field(repr=False)

    @property
    def names(self) -> frozenset[str]:
        """Kinds that a right answer gives."""
        return frozenset(effect.name for effect in self.effects)

    @property
    def allowed(self) -> frozenset[str]:
        """Kinds that are not wrong, asked for or not."""
        allowed = frozenset(kind for kind, spread in self.spreads.items() if spread)
        return allowed.union(*(e.accepted | e.allowed for e in self.effects))

    @property
    def coefficients(self) -> dict[str, float]:
        """Name "kind.coefficient" to value, where the library has the same one."""
        return {
            f"{effect.name}.{name}": value
            for effect in self.effects
            for name, value in effect.coefficients.items()
        }

    def named(self, kinds: Iterable[str]) -> tuple[str, ...]:
        """Returns the names that some kinds name rightly."""
        kinds = set(kinds)
        return tuple(e.name for e in self.effects if e.accepted & kinds)

    def wrong(self, kinds: Iterable[str]) -> tuple[str, ...]:
        """Returns those of some kinds that are wrong; "unexplained" is not."""
        return tuple(k for k in kinds if k not in self.allowed | {"unexplained"})


def draw_campaign(
    seed: int,
    flights: int = 25,
    effects: Sequence[str | tuple[str, str]] | int | None = None,
    *,
    moving_air: bool | None = None,
    spreads: bool = True,
    broken: bool | None = None,
) -> tuple[Campaign, Truth]:
    """Draws a campaign with a servo, of a known vehicle with several faults.

    Each of effects, spreads, air, flying and sensors has a stream of random numbers of
    its own: what is asked for here leaves the others as they are.

    Args:
        seed: of everything.
        flights: how many.
        effects: kinds, or pairs of a kind and its form; or how many; None to draw.
        moving_air: whether there are gusts; None to draw (two of three).
        spreads: whether trims, pitch zeros and winds may differ from flight to flight.
        broken: whether some rows are broken; None to draw (one of three).

    Returns:
        The campaign and its truth. The same arguments give the same.
    """
    streams = _streams(seed, 1)
    glider = Glider()
    if effects is None:
        effects = int(streams.effects.choice(COUNTS))
    planted = _plant(streams.effects, glider, effects)
    drawn = draw_spreads(streams.spreads, flights) if spreads else {}
    air = draw_air(streams.air)
    moves, breaks = streams.air.random() < 2 / 3, streams.sensors.random() < 1 / 3
    if not (moves if moving_air is None else moving_air):
        air = (0.0, 0.0)
    return _make(
        streams,
        f"lifelike_{seed:03d}",
        glider,
        flights,
        planted,
        drawn,
        air,
        breaks if broken is None else broken,
    )


def turbulence_campaign(seed: int, flights: int = 25) -> tuple[Campaign, Truth]:
    """Draws a campaign in which nothing is wrong: moving air, and a trim a flight."""
    streams = _streams(seed, 2)
    spread = streams.spreads.uniform(0.01, 0.03)
    departures = spread * streams.spreads.normal(size=flights)
    drawn = {"elevator_trim": (spread, departures)}
    return _make(
        streams,
        f"turbulence_{seed:03d}",
        Glider(),
        flights,
        (),
        drawn,
        draw_air(streams.air),
        False,
    )


def draw_throws(seed: int, flights: int = 16) -> tuple[Campaign, Truth]:
    """Draws hand throws of a glider that nobody has weighed, its tail set by hand.

    Camber, drag along the body and lift by pitch rate, and in half of the campaigns a
    stall, are what such a glider shows; the tail's angle differs a lot between throws.
    """
    streams = _streams(seed, 3)
    rng = streams.effects
    mass = rng.uniform(0.04, 0.07)
    glider = Glider(
        mass=mass,
        wing_area=rng.uniform(0.06, 0.09),
        elevator_area=rng.uniform(0.012, 0.02),
        pitch_inertia=mass * rng.uniform(0.012, 0.018),
        wing_offset=rng.uniform(0.0, 0.015),
        hinge_offset=0.18,
        elevator_offset=0.02,
        air_density=1.2,
    )
    vehicle = {
        name: float(getattr(glider, name))
        for name in (
            "mass",
            "pitch_inertia",
            "wing_area",
            "elevator_area",
            "wing_offset",
            "hinge_offset",
            "elevator_offset",
            "air_density",
        )
    }
    kinds = ["camber", "axial_drag", "pitch_rate_lift"]
    if rng.random() < 0.5:
        kinds.append(str(rng.choice(["attached_lift", "dynamic_stall"])))
    planted = _plant(rng, glider, kinds)
    trim, spread = rng.uniform(0.08, 0.2), rng.uniform(0.05, 0.11)
    departures = spread * streams.spreads.normal(size=flights)
    rng = streams.flights
    capture = Capture(rate=240.0, position=0.0001, pitch=0.0009)
    seconds = rng.uniform(0.6, 1.2, flights)
    steps = round(seconds.max() / STEP)
    start = np.empty((4, flights), complex)
    start[0] = 1j * (1.8 + 0.2 * rng.normal(size=flights))
    climb = np.arcsin(np.clip(0.25 + 0.2 * rng.normal(size=flights), -0.6, 0.6))
    start[1] = (5.7 + 0.5 * rng.normal(size=flights)) * np.exp(1j * climb)
    start[2] = -climb + 0.15 * rng.normal(size=flights)
    start[3] = 2.0 * rng.normal(size=flights)
    shape = (2 * steps + 1, flights)
    air_std, correlation = (
        streams.air.uniform(0.01, 0.04),
        streams.air.uniform(0.1, 0.5),
    )
    air = gusts(streams.air, air_std, correlation, shape)
    motion = fly(glider, start, np.broadcast_to(trim + departures, shape), air)
    landed = np.argmax(motion.position.imag < 0.1, axis=0) * STEP
    seconds = np.where(landed > 0.0, np.minimum(seconds, landed), seconds)
    logged = log_flights(streams.sensors, glider, motion, capture, None)
    campaign = Campaign(
        name=f"throws_{seed:03d}",
        path=Path(f"throws_{seed:03d}"),
        vehicle={"hinge_offset": 0.18, "air_density": 1.2, "gravity": 9.81},
        elevator="fixed_per_flight",
        elevator_limits=None,
        elevator_rate_limit=None,
        pose_rate=capture.rate,
        command_rate=None,
        flights=tuple(map(_cut, logged, seconds)),
    )
    truth = Truth(
        effects=planted,
        air_std=air_std,
        air_correlation=correlation,
        spreads={"elevator_trim": spread},
        per_flight={"elevator_trim": departures},
        vehicle=vehicle | {"elevator": trim},
        capture=capture,
        glider=glider,
        motion=motion,
    )
    return campaign, truth


class _Streams(NamedTuple):
    effects: np.random.Generator
    spreads: np.random.Generator
    air: np.random.Generator
    flights: np.random.Generator
    sensors: np.random.Generator


def _streams(seed: int, family: int) -> _Streams:
    return _Streams(*(np.random.default_rng([seed, family, i]) for i in range(5)))


def _plant(
    rng: np.random.Generator,
    glider: Glider,
    effects: Sequence[str | tuple[str, str]] | int,
) -> tuple[Planted, ...]:
    """Changes the glider by effects, drawn where only their number is given."""
    if isinstance(effects, int):
        effects = draw_kinds(rng, effects)
    planted: list[Planted] = []
    for effect in effects:
        kind, form = effect if isinstance(effect, tuple) else (effect, None)
        forms = FORMS[kind]
        planted += forms[form or str(rng.choice(list(forms)))](rng, glider)
    return tuple(planted)


def draw_kinds(rng: np.random.Generator, count: int) -> list[str]:
    """Returns kinds of which no two are rivals."""
    kinds: list[str] = []
    for kind in rng.permutation(list(FORMS)):
        rivals = frozenset().union(*(r for r in RIVALS if kind in r))
        if len(kinds) < count and not rivals & set(kinds):
            kinds.append(str(kind))
    return kinds


Spreads = dict[str, tuple[float, np.ndarray]]
"""Kind to a standard deviation and the departures in the flights."""


def draw_spreads(rng: np.random.Generator, flights: int) -> Spreads:
    """Returns the flight-to-flight variation, drawn by chance."""
    drawn: Spreads = {}
    for kind, chance, low, high in (
        ("elevator_trim", 0.6, 0.01, 0.03),
        ("pitch_offset", 0.4, 0.005, 0.02),
        ("wind", 0.4, 0.05, 0.2),
    ):
        spread = rng.uniform(low, high)
        departures = spread * rng.normal(size=(flights, 2)) @ np.array([1.0, 0.3j])
        if kind != "wind":
            departures = departures.real
        if rng.random() < chance:
            drawn[kind] = (spread, departures)
    return drawn


def draw_air(rng: np.random.Generator) -> tuple[float, float]:
    """Returns the standard deviation [m/s] and correlation time [s] of gusts."""
    return rng.uniform(0.05, 0.25), rng.uniform(0.1, 0.5)


def _make(
    streams: _Streams,
    name: str,
    glider: Glider,
    flights: int,
    planted: tuple[Planted, ...],
    spreads: Spreads,
    air: tuple[float, float],
    broken: bool,
) -> tuple[Campaign, Truth]:
    """Flies and logs a campaign of the vehicle that the practice campaigns tell of."""
    drawing, capture = Glider(), Capture()
    departures = {kind: values for kind, (_, values) in spreads.items()}
    glider.elevator_trim = glider.elevator_trim + departures.get("elevator_trim", 0.0)
    glider.pitch_offset = glider.pitch_offset + departures.get("pitch_offset", 0.0)
    glider.wind = glider.wind + departures.get("wind", 0.0)
    rows = round(0.85 * capture.rate) + 1
    steps = round((rows - 1) / capture.rate / STEP)
    commands = draw_commands(streams.flights, flights)
    elevator = elevator_paths(
        glider.servo, commands, 1.0 / COMMAND_RATE, 2 * steps, glider.elevator_limits
    )
    std, correlation = air
    moving = gusts(streams.air, std, correlation, elevator.shape) if std else None
    motion = fly(glider, draw_starts(streams.flights, flights), elevator, moving)
    logged = log_flights(streams.sensors, glider, motion, capture, commands)
    faults: dict[str, tuple[str, ...]] = {}
    if broken:
        logged, faults = _break_rows(streams.sensors, logged)
    campaign = Campaign(
        name=name,
        path=Path(name),
        vehicle={
            "mass": drawing.mass,
            "pitch_inertia": drawing.pitch_inertia,
            "wing_area": drawing.wing_area,
            "elevator_area": drawing.elevator_area,
            "wing_offset": drawing.wing_offset,
            "hinge_offset": drawing.hinge_offset,
            "elevator_offset": drawing.elevator_offset,
            "air_density": drawing.air_density,
            "gravity": drawing.gravity,
        },
        elevator="servo",
        elevator_limits=drawing.elevator_limits,
        elevator_rate_limit=ELEVATOR_RATE_LIMIT,
        pose_rate=capture.rate,
        command_rate=COMMAND_RATE,
        flights=logged,
    )
    truth = Truth(
        effects=planted,
        air_std=std,
        air_correlation=correlation,
        spreads={kind: spread for kind, (spread, _) in spreads.items()},
        per_flight=departures,
        broken=faults,
        capture=capture,
        glider=glider,
        motion=motion,
    )
    return campaign, truth


def draw_starts(rng: np.random.Generator, flights: int) -> np.ndarray:
    """Returns launches (4, flights): position, velocity, pitch, its rate; complex."""
    noise = rng.normal(size=(6, flights))
    start = np.empty((4, flights), complex)
    start[0] = -3.5 + 0.05 * noise[0] + 1j * (0.15 + 0.1 * noise[1])
    start[1] = 7.0 + 0.3 * noise[2] + 1j * 0.2 * noise[3]
    start[2] = -0.04 + 0.055 * noise[4]
    start[3] = 0.3 * noise[5]
    return start


def draw_commands(rng: np.random.Generator, flights: int) -> np.ndarray:
    """Returns elevator rates (43, flights) that chase targets within the travel."""
    low, high = Glider().elevator_limits
    tape = np.empty((43, flights))
    angle, rate = np.zeros(flights), rng.normal(0.0, 4.0, flights)
    target = rng.uniform(-0.1, 0.8, flights)
    for row in tape:
        jump = rng.random(flights) < 0.15
        target = np.where(jump, rng.uniform(-0.2, 0.75, flights), target)
        rate = 0.5 * rate + 0.5 * 12.0 * (target - angle)
        rate = rate + rng.normal(0.0, 2.2, flights)
        room = COMMAND_RATE * np.array([low + 0.02 - angle, high - 0.02 - angle])
        rate = np.clip(np.clip(rate, -11.7, 11.7), *room)
        row[:] = rate
        angle = angle + rate / COMMAND_RATE
    return tape


def log_flights(
    rng: np.random.Generator,
    glider: Glider,
    motion: Motion,
    capture: Capture,
    commands: np.ndarray | None,
) -> tuple[Flight, ...]:
    """Returns the flights as measured; without commands, without a servo."""
    every = round(1.0 / (capture.rate * STEP))
    pose = shown_pose(glider, motion)[::every]
    return log_poses(rng, pose, motion.elevator[::every], capture, commands)


def log_poses(
    rng: np.random.Generator,
    pose: np.ndarray,
    angle: np.ndarray,
    capture: Capture,
    commands: np.ndarray | None,
) -> tuple[Flight, ...]:
    """Returns flights as measured of poses (n, F, 3) and elevator angles (n, F)."""
    pose = pose + rng.normal(size=pose.shape) * (
        capture.position,
        capture.position,
        capture.pitch,
    )
    time = np.arange(len(pose)) / capture.rate
    angle = angle + capture.elevator * rng.normal(size=angle.shape)
    held = np.floor(time * COMMAND_RATE + 1e-6).astype(int)
    return tuple(
        Flight(
            name=f"flight_{i:03d}.csv",
            time=time,
            pose=pose[:, i],
            elevator=None if commands is None else angle[:, i],
            command=None if commands is None else commands[held, i],
        )
        for i in range(pose.shape[1])
    )


def _cut(flight: Flight, seconds: float) -> Flight:
    """Returns the first seconds of a flight without a servo."""
    keep = flight.time <= seconds
    return dataclasses.replace(flight, time=flight.time[keep], pose=flight.pose[keep])


def _break_rows(
    rng: np.random.Generator, flights: tuple[Flight, ...]
) -> tuple[tuple[Flight, ...], dict[str, tuple[str, ...]]]:
    """Breaks rows of about a third of the flights: jumps, frozen and missing rows."""
    result, faults = [], {}
    for flight in flights:
        what = tuple(
            fault for fault in ("jumps", "frozen", "missing") if rng.random() < 0.15
        )
        pose, keep = flight.pose.copy(), np.ones(len(flight.time), bool)
        n = len(pose)
        if "jumps" in what:  # The cameras take one marker for another.
            for row in rng.integers(2, n - 2, rng.integers(1, 4)):
                pose[row] += rng.normal(size=3) * (0.05, 0.05, 0.3)
        if "frozen" in what:  # They lose the glider and repeat its last pose.
            row = rng.integers(5, n - 10)
            pose[row : row + rng.integers(2, 6)] = pose[row]
        if "missing" in what:
            keep[rng.integers(3, n - 3, rng.integers(1, 7))] = False
        if what:
            faults[flight.name] = what
        assert flight.elevator is not None and flight.command is not None
        result.append(
            dataclasses.replace(
                flight,
                time=flight.time[keep],
                pose=pose[keep],
                elevator=flight.elevator[keep],
                command=flight.command[keep],
            )
        )
    return tuple(result), faults
