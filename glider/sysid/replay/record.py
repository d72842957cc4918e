"""A flight's log made ready to be flown again: its states smoothed, gaps filled."""

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from glider.campaign.checks.masks import Masks, masks_of
from glider.campaign.checks.planarity import in_plane, planar_pitch
from glider.campaign.checks.servo import command_tape
from glider.campaign.checks.servo_fit import measure_elevator_noise
from glider.campaign.logs import Campaign, Flight
from glider.campaign.smoothing import Smoothing, estimate_noise, smoothing_maps
from glider.compiled.parallel import in_parallel
from glider.physics.parameter_space import ParameterSpace
from glider.physics.servo import NO_LIMITS, Servo
from glider.sysid.replay.log_space import LIBRARY_SPACE

# Least noise of a log [m, rad]; a computed column has no noise at all.
_LEAST_POSITION = 1e-6
_LEAST_ANGLE = 1e-5
_GAP = 1.6  # Time between rows, over the usual one, above which nodes are inserted.


@dataclasses.dataclass(frozen=True, kw_only=True)
class Noise:
    """Standard deviation of the measurements, and what smooths them."""

    position: float  #: Of x and z [m].
    pitch: float  #: [rad].
    elevator: float  #: [rad]; 0 without a servo.
    smoothing: tuple[Smoothing, ...]  #: Of the channels x, z, pitch.


def measure_noise(
    campaign: Campaign, masks: Mapping[str, Masks] | None = None
) -> Noise:
    """Finds the noise of a campaign's channels from all its flights."""
    masks = masks or {}
    pairs = [(f, masks_of(f, masks)) for f in campaign.flights]
    times = [f.time[m.usable] for f, m in pairs]
    smoothing = estimate_noise(times, [f.pose[m.usable] for f, m in pairs])
    position = float(np.sqrt(np.mean([s.noise**2 for s in smoothing[:2]])))
    return Noise(
        position=max(position, _LEAST_POSITION),
        pitch=max(smoothing[2].noise, _LEAST_ANGLE),
        elevator=max(measure_elevator_noise(campaign, masks), _LEAST_ANGLE),
        smoothing=smoothing,
    )


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class Record:
    """A flight, cleaned and smoothed, at nodes: its rows, and more in its gaps."""

    name: str  #: Of the flight's file.
    space: ParameterSpace  #: Of the models that fly it.
    time: np.ndarray  #: (n,) of the nodes, from the first row that counts [s].
    pose: np.ndarray  #: (n, 3) measured x, z [m], pitch [rad]; smoothed where not seen.
    elevator: np.ndarray  #: (n,) measured [rad]; zero where not seen.
    seen: np.ndarray  #: (n, 4) which of x, z, pitch and elevator count as measured.
    nodes: np.ndarray  #: (n, num_states) smoothed states, those of effects at zero.
    pitch: np.ndarray  #: (n - 1, 3, 2) smoothed, and its rate: start, middle, end.
    acceleration: np.ndarray  #: (n, 3) smoothed ẍ, z̈, θ̈.
    acceleration_std: np.ndarray  #: (n, 3) of them, from the measurement noise alone.
    bank: np.ndarray  #: (n - 1,) factor of the wing's force where it is rolled, or one.
    side_wind: np.ndarray  #: (n - 1, 2) air that a sideways motion is like [m/s].
    has_servo: bool  #: Whether the elevator was commanded and measured.
    switch_times: np.ndarray  #: (k,) of the commands, on the same clock [s].
    commands: np.ndarray  #: (k,) [rad/s].
    place: float  #: In the session, from -0.5 for its first flight to 0.5.
    departure: np.ndarray  #: (n,) of the elevator from what a servo makes of them.
    departure_std: float  #: Its standard error [rad].
    departure_is_named: bool  #: Whether a form of the servo is known that explains it.
    servo: Servo  #: Limits of the servo.
    rest: float  #: Where the elevator stood before the first command [rad].
    trim_is_moment: bool  #: Whether a trim makes no force, see `replayed.trimmed`.
    usual_rest: float = 0.0  #: Where elevators of flights like it stand then [rad].
    is_cut: bool = False  #: Whether its log was cut: unknown commands moved it.
    replays: dict = dataclasses.field(init=False, repr=False, default_factory=dict)
    """What `replayed` keeps of its elevator, by the numbers of a model."""


def prepare(
    flights: Sequence[Flight],
    campaign: Campaign,
    noise: Noise,
    space: ParameterSpace = LIBRARY_SPACE,
    masks: Mapping[str, Masks] | None = None,
) -> list[Record]:
    """Smooths flights."""
    masks = masks or {}
    servo = campaign.limits if campaign.elevator == "servo" else NO_LIMITS
    settings = dataclasses.replace(campaign, flights=())
    places = np.linspace(-0.5, 0.5, len(flights)) if len(flights) > 1 else [0.0]

    def record(numbered: tuple[Flight, float]) -> Record:
        flight, place = numbered
        mask = masks_of(flight, masks)
        own = _record(flight, mask, settings, noise, space, servo)
        return dataclasses.replace(own, place=float(place))

    return in_parallel(record, list(zip(flights, places, strict=True)))


def _record(
    flight: Flight,
    mask: Masks,
    campaign: Campaign,
    noise: Noise,
    space: ParameterSpace,
    servo: Servo,
) -> Record:
    good = np.flatnonzero(mask.usable)
    rows = slice(good[0], good[-1] + 1)
    clock = flight.time - flight.time[good[0]]
    time, place = _with_gaps_filled(clock[rows])
    n = len(time)
    at = place[good - good[0]]
    query = np.concatenate([time, 0.5 * (time[1:] + time[:-1])])
    maps = [smoothing_maps(clock[good], query, s.ratio) for s in noise.smoothing]
    pose = flight.pose[good]
    bank = np.ones(n - 1)
    side_wind = np.zeros((n - 1, 2))
    if flight.attitude is not None:
        turned_by = maps[1][0, :n] @ np.unwrap(flight.attitude[good, 1:], axis=0)
        sideways = maps[0][1, :n] @ flight.attitude[good, 0]
        bank, side_wind = in_plane(maps[2][0, :n] @ pose[:, 2], turned_by, sideways)
        pose = np.column_stack([pose[:, :2], planar_pitch(flight, good)])

    curves = np.stack([maps[j] @ pose[:, j] for j in range(3)], axis=2)
    nodes = np.zeros((n, space.num_states))
    nodes[:, 0:3], nodes[:, 4:7] = curves[:2, :n]
    pitch = curves[:2, :, 2].T
    levels = (noise.smoothing[0].noise, noise.smoothing[1].noise, noise.pitch)
    measured = curves[0, :n].copy()
    seen = np.zeros((n, 4), dtype=bool)
    measured[at], seen[at, :3] = pose, True
    elevator = np.zeros(n)
    rest = 0.0
    switches = np.zeros(1)
    commands = np.zeros(1)
    departure = np.zeros(n)
    departure_std = 0.0
    is_named = False
    has_servo = flight.command is not None and flight.elevator is not None
    if flight.elevator is not None and has_servo:
        begin = float(flight.time[good[0]])
        tape = command_tape(flight, mask, campaign.switch_rate, begin)
        switches, commands, rest = tape
        if flight.departure is not None:
            departure = np.interp(time, clock, flight.departure.angle)
            departure_std = flight.departure.std
            is_named = flight.departure.is_named
            rest = flight.departure.rest

        elevator[place] = flight.elevator[rows]
        seen[place, 3] = ~mask.elevator[rows] & (campaign.servo.angle == "measured")

    return Record(
        name=flight.name,
        space=space,
        time=time,
        pose=measured,
        elevator=elevator,
        seen=seen,
        nodes=nodes,
        pitch=np.stack([pitch[: n - 1], pitch[n:], pitch[1:n]], axis=1),
        acceleration=curves[2, :n],
        acceleration_std=np.linalg.norm([m[2, :n] for m in maps], axis=2).T * levels,
        bank=bank,
        side_wind=side_wind,
        has_servo=has_servo,
        switch_times=switches,
        commands=commands,
        place=0.0,
        departure=departure,
        departure_std=departure_std,
        departure_is_named=is_named,
        servo=servo,
        rest=rest,
        is_cut=has_servo and mask.first > 0,
        trim_is_moment=campaign.elevator == "fixed_per_flight"
        and "elevator_area" not in campaign.vehicle,
    )


def evenly(flights: Sequence[Any], count: int) -> list[Any]:
    """Returns at most so many of some flights, evenly picked."""
    last = len(flights) - 1
    keep = np.linspace(0, last, min(count, last + 1)).round().astype(int)
    return [flights[i] for i in keep]


def _with_gaps_filled(time: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Times with more in the gaps, and where the given ones are in them."""
    steps = np.diff(time)
    usual = np.median(steps)
    more = np.where(steps > _GAP * usual, np.ceil(steps / usual - 1e-6), 1).astype(int)
    place = np.concatenate([[0], np.cumsum(more)])
    return np.interp(np.arange(place[-1] + 1), place, time), place
