"""A flight's log made ready to be flown again: smoothed states, clean signals."""

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np

from glider.campaign.checks.clocks import find_stops
from glider.campaign.checks.masks import Masks, no_masks
from glider.campaign.checks.planarity import normal
from glider.campaign.checks.rows import pieces_with_commands
from glider.campaign.logs import Campaign, Flight
from glider.physics.actuator_replay import command_steps, elevator_path
from glider.physics.effects import Replay
from glider.sysid.replay.smoothing import Noise, smoothing_maps
from glider.sysid.replay.theta import LIBRARY_LAYOUT, Layout

_OF_NODES = (  # Arrays of a record with one row for each node.
    *("time", "pose", "elevator", "seen", "nodes"),
    *("acceleration", "acceleration_std"),
)

_GAP = 1.6
"""Time between two rows, over the usual one, above which nodes are inserted."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Record:
    """A flight, cleaned and smoothed, at nodes: its rows, and more in its gaps."""

    name: str  # Of the flight's file.
    has_servo: bool  # Whether the elevator was commanded and measured.
    time: np.ndarray  # (n,) of the nodes, from the first row that counts [s].
    layout: Layout  # Of the models that fly it.
    pose: np.ndarray  # (n, 3) measured x, z [m], pitch [rad]; smoothed where not seen.
    elevator: np.ndarray  # (n,) measured [rad]; zero where not seen.
    seen: np.ndarray  # (n, 4) which of x, z, pitch and elevator count as measured.
    # (n, layout.num_states) smoothed states, those of the effects at zero.
    nodes: np.ndarray
    # (n - 1, 3, 2) smoothed pitch and its rate at the start, middle and end of each
    # interval.
    pitch: np.ndarray
    acceleration: np.ndarray  # (n, 3) smoothed ẍ, z̈, θ̈.
    acceleration_std: np.ndarray  # (n, 3) of them, from the measurement noise alone.
    switch_times: np.ndarray  # (k,) of the commands, on the same clock [s].
    commands: np.ndarray  # (k,) [rad/s].
    limits: tuple[float, float] | None  # Where the elevator stops [rad], or None.
    rest: float  # Where the elevator stood before the first command [rad].
    # Whether a per-flight elevator trim makes a moment and no force, see
    # `glider.sysid.replay.signals.trimmed`.
    trim_is_moment: bool
    # (n - 1,) factor of the wing's force in the plane where it is rolled, see
    # `glider.sysid.replay.record`; one without attitude.
    bank: np.ndarray
    side_wind: np.ndarray  # (n - 1, 2) air that a sideways motion is like [m/s].
    # Cache of `glider.sysid.replay.signals`, by its settings.
    replays: dict[Replay, tuple[np.ndarray, ...]] = dataclasses.field(
        default_factory=dict, repr=False, compare=False
    )
    # Cache of `glider.sysid.replay.signals`, by the parameters of the vehicle and of
    # its sensors.
    undone: dict[bytes, np.ndarray] = dataclasses.field(
        default_factory=dict, repr=False, compare=False
    )

    def __getstate__(self) -> dict:
        """Returns the state for another process, without caches."""
        return {**self.__dict__, "replays": {}, "undone": {}}

    def first(self, count: int) -> "Record":
        """Returns the beginning of the flight, its first nodes."""
        rows = [
            "time",
            "pose",
            "elevator",
            "seen",
            "nodes",
            "acceleration",
            "acceleration_std",
        ]
        cut = {name: getattr(self, name)[:count] for name in rows}
        for name in ("pitch", "bank", "side_wind"):  # Of intervals.
            cut[name] = getattr(self, name)[: count - 1]
        return dataclasses.replace(self, **cut, replays={}, undone={})


def prepare(
    flights: Sequence[Flight],
    campaign: Campaign,
    noise: Noise,
    layout: Layout = LIBRARY_LAYOUT,
    masks: Mapping[str, Masks] | None = None,
    maps: dict[bytes, list[np.ndarray]] | None = None,
) -> list[Record]:
    """Smooths flights; the maps of equal time grids are shared."""
    maps = {} if maps is None else maps
    stops = None
    if campaign.elevator == "servo":
        stops = find_stops(campaign, masks or {}, noise.elevator)
    records = []
    for flight in flights:
        mask = (masks or {}).get(flight.name, no_masks(flight))
        records.append(_record(flight, mask, stops, maps, campaign, noise, layout))
    return records


def _record(
    flight: Flight,
    mask: Masks,
    stops: tuple[float, float] | None,
    kept: dict[bytes, list[np.ndarray]],
    campaign: Campaign,
    noise: Noise,
    layout: Layout,
) -> Record:
    turned = ~mask.elevator
    good = np.flatnonzero(mask.usable)
    rows = slice(good[0], good[-1] + 1)
    clock = flight.time - flight.time[good[0]]
    time, place = _with_gaps_filled(clock[rows])
    n = len(time)
    known = clock[good]
    key = np.round(np.concatenate([known, [np.inf], time]), 7).tobytes()
    if key not in kept:
        query = np.concatenate([time, 0.5 * (time[1:] + time[:-1])])
        kept[key] = [smoothing_maps(known, query, s.ratio) for s in noise.smoothing]
    maps = kept[key]
    bank, side_wind = np.ones(n - 1), np.zeros((n - 1, 2))
    pose = flight.pose[good]
    if flight.attitude is not None:
        turned_by = maps[1][0, :n] @ np.unwrap(flight.attitude[good, 1:], axis=0)
        sideways = maps[0][1, :n] @ flight.attitude[good, 0]
        pitch = maps[2][0, :n] @ pose[:, 2]
        bank, side_wind = in_plane(pitch, turned_by, sideways)
        pose = np.column_stack([pose[:, :2], planar_pitch(flight, good)])
    curves = np.stack([maps[j] @ pose[:, j] for j in range(3)], axis=2)
    nodes = np.zeros((n, layout.num_states))
    nodes[:, 0:3] = curves[0, :n]
    nodes[:, 4:7] = curves[1, :n]
    pitch = np.stack([curves[0, :, 2], curves[1, :, 2]], axis=1)
    pitch = np.stack([pitch[: n - 1], pitch[n:], pitch[1:n]], axis=1)
    levels = (noise.smoothing[0].noise, noise.smoothing[1].noise, noise.pitch)
    deviation = [
        level * np.linalg.norm(m[2, :n], axis=1)
        for level, m in zip(levels, maps, strict=True)
    ]
    measured, seen = curves[0, :n].copy(), np.zeros((n, 4), dtype=bool)
    at = place[good - good[0]]
    measured[at], seen[at, :3] = pose, True
    elevator, switches, commands, rest = np.zeros(n), np.zeros(1), np.zeros(1), 0.0
    has_servo = flight.command is not None and flight.elevator is not None
    if flight.command is not None and flight.elevator is not None:
        piece = pieces_with_commands(flight.time)
        # What was commanded before a gap that hides commands does not count.
        commanded = np.flatnonzero(piece == piece[good[0]])
        switches, commands = command_steps(
            clock[commanded], flight.command[commanded], campaign.command_rate
        )
        trusted = commanded[turned[commanded]]
        if len(trusted):
            first = trusted[:1]  # Its noise is what x[3] is for.
            travel = elevator_path(switches, commands, clock[first])
            rest = float((flight.elevator[first] - travel)[0])
        elevator[place] = flight.elevator[rows]
        seen[place, 3] = turned[rows]
    return Record(
        name=flight.name,
        has_servo=has_servo,
        time=time,
        layout=layout,
        pose=measured,
        elevator=elevator,
        seen=seen,
        nodes=nodes,
        pitch=pitch,
        acceleration=curves[2, :n],
        acceleration_std=np.stack(deviation, axis=1),
        switch_times=switches,
        commands=commands,
        limits=stops if has_servo else None,
        rest=rest,
        trim_is_moment=campaign.elevator == "fixed_per_flight"
        and "elevator_area" not in campaign.vehicle,
        bank=bank,
        side_wind=side_wind,
    )


def _with_gaps_filled(time: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Returns times with more in the gaps, and where the given ones are in them."""
    steps = np.diff(time)
    usual = np.median(steps)
    more = np.where(steps > _GAP * usual, np.ceil(steps / usual - 1e-6), 1).astype(int)
    if np.all(more == 1):
        return time, np.arange(len(time))
    parts = [
        time[k] + steps[k] * np.arange(more[k]) / more[k] for k in range(len(steps))
    ]
    filled = np.concatenate([*parts, time[-1:]])
    return filled, np.concatenate([[0], np.cumsum(more)])


def planar_pitch(flight: Flight, rows: np.ndarray) -> np.ndarray:
    """Returns the pitch of the wing's normal in the plane, at some rows [rad]."""
    assert flight.attitude is not None
    _, roll, yaw = flight.attitude[rows].T
    n = normal(flight.pose[rows, 2], roll, yaw)
    return np.unwrap(np.arctan2(n[:, 0], n[:, 2]))


def in_plane(
    pitch: np.ndarray, roll_and_yaw: np.ndarray, sideways: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Computes the planar equivalent of a rolled glider.

    Args:
        pitch: (n,) smoothed [rad].
        roll_and_yaw: (n, 2) smoothed [rad].
        sideways: (n,) smoothed velocity along y [m/s].

    Returns:
        the factor of the wing's force in each interval (n - 1,), and the air velocity
        (x, z) there that the sideways motion is like (n - 1, 2) [m/s].
    """
    n = normal(pitch, *roll_and_yaw.T)
    square = n[:, 0] ** 2 + n[:, 2] ** 2
    air = -(sideways * n[:, 1] / square)[:, None] * n[:, [0, 2]]
    return _middle(square), _middle(air)


def _middle(values: np.ndarray) -> np.ndarray:
    return 0.5 * (values[1:] + values[:-1])
