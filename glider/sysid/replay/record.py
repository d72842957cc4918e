"""A flight's log made ready to be flown again: its states smoothed, gaps filled.

`measure_noise` finds the noise of a campaign; `prepare` smooths flights by it. Nodes
are the rows of a log from its first usable row to its last, and more in its gaps.
"""

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from glider.campaign.checks.masks import Masks, masks_of
from glider.campaign.checks.planarity import in_plane, planar_pitch
from glider.campaign.checks.servo import CommandTape, command_tape
from glider.campaign.checks.servo_fit import measure_elevator_noise
from glider.campaign.logs import Campaign, Departure, Flight
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
    """Standard deviation of the measurements, and what smooths them.

    Attributes:
        position: of x and z [m].
        pitch: [rad].
        elevator: [rad]; the least one without a servo.
        smoothing: of the channels x, z, pitch.
    """

    position: float
    pitch: float
    elevator: float
    smoothing: tuple[Smoothing, ...]


def measure_noise(
    campaign: Campaign, masks: Mapping[str, Masks] | None = None
) -> Noise:
    """Finds the noise of a campaign's channels from the usable rows of all flights."""
    masks = masks or {}
    times = []
    poses = []
    for flight in campaign.flights:
        usable = masks_of(flight, masks).usable
        times.append(flight.time[usable])
        poses.append(flight.pose[usable])

    smoothing = estimate_noise(times, poses)
    x, z, pitch = (own.noise for own in smoothing)
    position = float(np.sqrt(np.mean([x**2, z**2])))
    return Noise(
        position=max(position, _LEAST_POSITION),
        pitch=max(pitch, _LEAST_ANGLE),
        elevator=max(measure_elevator_noise(campaign, masks), _LEAST_ANGLE),
        smoothing=smoothing,
    )


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class Record:
    """A flight, cleaned and smoothed, at n nodes.

    Attributes:
        name: of the flight's file.
        space: of the models that fly it.
        time: (n,) of the nodes, from the first row that counts [s].
        pose: (n, 3) measured x, z [m], pitch [rad]; smoothed where not seen.
        elevator: (n,) measured [rad]; zero where not seen.
        seen: (n, 4) which of x, z, pitch and elevator count as measured.
        nodes: (n, num_states) smoothed states, those of effects at zero.
        pitch: (n - 1, 3, 2) smoothed pitch [rad] and its rate [rad/s] at start, middle
            and end of each interval.
        acceleration: (n, 3) smoothed ẍ, z̈ [m/s²], θ̈ [rad/s²].
        acceleration_std: (n, 3) their standard error from the measurement noise alone.
        bank: (n - 1,) factor of the wing's force where it is rolled, or one.
        side_wind: (n - 1, 2) air that a sideways motion is like [m/s].
        has_servo: whether the elevator was commanded and measured.
        switch_times: (k,) of the commands, on the same clock [s].
        commands: (k,) rates of the elevator from then on [rad/s].
        place: in the session, from -0.5 for its first flight to 0.5.
        departure: (n,) of the elevator from what a servo makes of the commands [rad].
        departure_std: its standard error [rad].
        departure_is_named: whether a form of the servo is known that explains it.
        servo: limits of the servo.
        rest: where the elevator stood before the first command [rad].
        trim_is_moment: whether a trim makes no force, see `replayed.trimmed`.
        usual_rest: where elevators of flights like it stand then [rad].
        is_cut: whether its log was cut: unknown commands moved the elevator.
        replays: what `replayed` keeps of its elevator, by the numbers of a model.
    """

    name: str
    space: ParameterSpace
    time: np.ndarray
    pose: np.ndarray
    elevator: np.ndarray
    seen: np.ndarray
    nodes: np.ndarray
    pitch: np.ndarray
    acceleration: np.ndarray
    acceleration_std: np.ndarray
    bank: np.ndarray
    side_wind: np.ndarray
    has_servo: bool
    switch_times: np.ndarray
    commands: np.ndarray
    place: float
    departure: np.ndarray
    departure_std: float
    departure_is_named: bool
    servo: Servo
    rest: float
    trim_is_moment: bool
    usual_rest: float = 0.0
    is_cut: bool = False
    replays: dict = dataclasses.field(init=False, repr=False, default_factory=dict)


def prepare(
    flights: Sequence[Flight],
    campaign: Campaign,
    noise: Noise,
    space: ParameterSpace = LIBRARY_SPACE,
    masks: Mapping[str, Masks] | None = None,
) -> list[Record]:
    """Smooths flights.

    Args:
        flights: in the order of the session.
        campaign: whose elevator and vehicle they have.
        noise: of the campaign.
        space: of the models that will fly them.
        masks: excluded rows by a flight's name; none by default.
    """
    masks = masks or {}
    settings = dataclasses.replace(campaign, flights=())  # Less for workers to copy.
    places = np.linspace(-0.5, 0.5, len(flights)) if len(flights) > 1 else [0.0]

    def record(numbered: tuple[Flight, float]) -> Record:
        flight, place = numbered
        mask = masks_of(flight, masks)
        return _record(flight, mask, settings, noise, space, float(place))

    return in_parallel(record, list(zip(flights, places, strict=True)))


def _smooth(
    flight: Flight, usable: np.ndarray, time: np.ndarray, noise: Noise
) -> tuple[np.ndarray, ...]:
    """Smooths the poses of a flight at nodes and midpoints.

    A flight whose attitude is logged is replaced by a planar one that flies like it,
    see `planarity.in_plane`.

    Args:
        flight: as it was logged.
        usable: indices of the rows to smooth (m,).
        time: of the nodes, from the first usable row (n,) [s].
        noise: of the campaign.

    Returns:
        the pose at the m rows, in the plane (m, 3); value, rate and acceleration of x,
        z and pitch (3, n + n - 1, 3), of the nodes and then of the midpoints; and the
        acceleration's standard error, bank and side wind, see `Record`.
    """
    n = len(time)
    middles = 0.5 * (time[1:] + time[:-1])
    query = np.concatenate([time, middles])
    since_start = flight.time[usable] - flight.time[usable[0]]
    # Of each channel, (3, 2 n - 1, m): value, rate and acceleration from samples.
    maps = [smoothing_maps(since_start, query, own.ratio) for own in noise.smoothing]
    of_x, of_z, of_pitch = maps

    pose = flight.pose[usable]
    bank = np.ones(n - 1)
    side_wind = np.zeros((n - 1, 2))
    if flight.attitude is not None:
        attitude = flight.attitude[usable]
        pitch = of_pitch[0, :n] @ pose[:, 2]
        roll_and_yaw = of_z[0, :n] @ np.unwrap(attitude[:, 1:], axis=0)
        sideways = of_x[1, :n] @ attitude[:, 0]
        bank, side_wind = in_plane(pitch, roll_and_yaw, sideways)
        pose = np.column_stack([pose[:, :2], planar_pitch(flight, usable)])

    curves = np.stack([maps[j] @ pose[:, j] for j in range(3)], axis=2)
    x, z, _ = noise.smoothing
    # Errors of samples are independent: those of their weighted sums add in squares.
    gains = np.linalg.norm([own[2, :n] for own in maps], axis=2).T
    acceleration_std = gains * (x.noise, z.noise, noise.pitch)
    return pose, curves, acceleration_std, bank, side_wind


def _record(
    flight: Flight,
    mask: Masks,
    campaign: Campaign,
    noise: Noise,
    space: ParameterSpace,
    place: float,
) -> Record:
    """Smooths one flight, `place` in the session."""
    usable = np.flatnonzero(mask.usable)
    rows = slice(usable[0], usable[-1] + 1)
    begin = float(flight.time[usable[0]])
    clock = flight.time - begin
    time, node_of_row = _with_gaps_filled(clock[rows])
    n = len(time)
    smoothed = _smooth(flight, usable, time, noise)
    pose, curves, acceleration_std, bank, side_wind = smoothed
    value, rate, acceleration = curves
    pitch = curves[:2, :, 2].T  # And its rate: at nodes, then at midpoints.
    nodes = np.zeros((n, space.num_states))
    nodes[:, 0:3] = value[:n]
    nodes[:, 4:7] = rate[:n]

    seen = np.zeros((n, 4), dtype=bool)
    measured = value[:n].copy()
    at = node_of_row[usable - usable[0]]
    measured[at] = pose
    seen[at, :3] = True

    elevator = np.zeros(n)
    tape = CommandTape(np.zeros(1), np.zeros(1), rest=0.0)
    departure = None
    has_servo = flight.command is not None and flight.elevator is not None
    if flight.elevator is not None and has_servo:
        elevator[node_of_row] = flight.elevator[rows]
        is_measured = campaign.servo.angle == "measured"
        seen[node_of_row, 3] = ~mask.elevator[rows] & is_measured
        tape = command_tape(flight, mask, campaign.switch_rate, begin)
        departure = flight.departure

    if departure is None:
        departure = Departure(np.zeros(len(clock)), rest=tape.rest, std=0.0)

    return Record(
        name=flight.name,
        space=space,
        time=time,
        pose=measured,
        elevator=elevator,
        seen=seen,
        nodes=nodes,
        pitch=np.stack([pitch[: n - 1], pitch[n:], pitch[1:n]], axis=1),
        acceleration=acceleration[:n],
        acceleration_std=acceleration_std,
        bank=bank,
        side_wind=side_wind,
        has_servo=has_servo,
        switch_times=tape.switches,
        commands=tape.commands,
        place=place,
        departure=np.interp(time, clock, departure.angle),
        departure_std=departure.std,
        departure_is_named=departure.is_named,
        servo=campaign.limits if campaign.elevator == "servo" else NO_LIMITS,
        rest=departure.rest,
        is_cut=has_servo and mask.first > 0,
        trim_is_moment=campaign.elevator == "fixed_per_flight"
        and "elevator_area" not in campaign.vehicle,
    )


def evenly(flights: Sequence[Any], count: int) -> list[Any]:
    """Returns at most `count` of some flights, evenly picked."""
    last = len(flights) - 1
    keep = np.linspace(0, last, min(count, last + 1)).round().astype(int)
    return [flights[i] for i in keep]


def _with_gaps_filled(time: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Inserts times into the gaps of given ones (m,), about the usual step apart.

    Returns:
        the times of n nodes, and which of them the given times are (m,).
    """
    # The number of parts that each step is cut into.
    steps = np.diff(time)
    usual = np.median(steps)
    parts = np.ceil(steps / usual - 1e-6)
    count = np.where(steps > _GAP * usual, parts, 1).astype(int)

    place = np.concatenate([[0], np.cumsum(count)])
    return np.interp(np.arange(place[-1] + 1), place, time), place
