"""A flight's log made ready to be flown again: smoothed states, clean signals."""

import dataclasses

import numpy as np

from glider.campaign.logs import (
    Campaign,
    Flight,
)
from glider.physics.actuator_replay import command_steps
from glider.physics.effects import Replay
from glider.sysid.replay.attitude import in_plane
from glider.sysid.replay.noise import Noise
from glider.sysid.replay.smoothing import smoothing_maps
from glider.sysid.replay.theta import (
    LIBRARY_LAYOUT,
    Layout,
)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Record:
    """A flight, cleaned and smoothed.

    Attributes:
        flight: as logged, with the signs of `angle_sign` undone.
        time: (n,) from the first row [s].
        layout: of the models that fly it.
        nodes: (n, layout.num_states) smoothed states, the effects' own at zero.
        pitch: (n - 1, 3, 2) smoothed pitch and its rate at the start, middle and
            end of each interval.
        acceleration: (n, 3) smoothed ẍ, z̈, θ̈.
        acceleration_std: (n, 3) of them, from the measurement noise alone.
        switch_times: (k,) of the commands, on the same clock [s].
        commands: (k,) [rad/s].
        limits: travel of the elevator [rad], or None.
        rest: where the elevator stood before the first command [rad].
        bank: (n - 1,) factor of the wing's force in the plane where it is rolled, see
            `glider.sysid.replay.attitude`; one without attitude.
        side_wind: (n - 1, 2) air that a sideways motion is like [m/s].
        replays: what `glider.sysid.replay.signals` was asked last, by its settings.
    """

    flight: Flight
    time: np.ndarray
    layout: Layout
    nodes: np.ndarray
    pitch: np.ndarray
    acceleration: np.ndarray
    acceleration_std: np.ndarray
    switch_times: np.ndarray
    commands: np.ndarray
    limits: tuple[float, float] | None
    rest: float
    bank: np.ndarray
    side_wind: np.ndarray
    replays: dict[Replay, tuple[np.ndarray, ...]] = dataclasses.field(
        default_factory=dict, repr=False, compare=False
    )

    @property
    def seen(self) -> np.ndarray:
        """Which of x, z, pitch and elevator were measured, (n, 4)."""
        seen = np.ones((len(self.time), 4), dtype=bool)
        seen[:, 3] = self.has_servo
        return seen

    @property
    def pose(self) -> np.ndarray:
        """Measured x, z [m] and pitch [rad], (n, 3)."""
        return self.flight.pose

    @property
    def elevator(self) -> np.ndarray:
        """Measured elevator [rad], (n,)."""
        return self.flight.elevator

    @property
    def doubt(self) -> np.ndarray:
        """Variance of the same over the usual one, (n, 4)."""
        return np.ones((len(self.time), 4))

    @property
    def has_servo(self) -> bool:
        """Whether the elevator was commanded and measured."""
        return self.flight.elevator is not None


def prepare(
    flights: tuple[Flight, ...],
    campaign: Campaign,
    noise: Noise,
    layout: Layout = LIBRARY_LAYOUT,
) -> list[Record]:
    """Smooths flights; the maps of equal time grids are shared."""
    maps: dict[bytes, list[np.ndarray]] = {}
    records = []
    for flight in flights:
        time = flight.time - flight.time[0]
        key = np.round(time, 7).tobytes()
        if key not in maps:
            query = np.concatenate([time, 0.5 * (time[1:] + time[:-1])])
            maps[key] = [smoothing_maps(time, query, s.ratio) for s in noise.smoothing]
        records.append(_record(flight, time, maps[key], campaign, noise, layout))
    return records


def _record(
    flight: Flight,
    time: np.ndarray,
    maps: list[np.ndarray],
    campaign: Campaign,
    noise: Noise,
    layout: Layout,
) -> Record:
    n = len(time)
    bank, side_wind = np.ones(n - 1), np.zeros((n - 1, 2))
    if flight.attitude is not None:
        sideways = maps[0][1, :n] @ flight.attitude[:, 0]
        flight, bank, side_wind = in_plane(flight, sideways)
    curves = np.stack([maps[j] @ flight.pose[:, j] for j in range(3)], axis=2)
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
    switches, commands, rest = np.zeros(1), np.zeros(1), 0.0
    if flight.command is not None and flight.elevator is not None:
        switches, commands = command_steps(time, flight.command, campaign.command_rate)
        rest = float(flight.elevator[0])  # Its noise is what x[3] is for.
    return Record(
        flight=flight,
        time=time,
        layout=layout,
        nodes=nodes,
        pitch=pitch,
        acceleration=curves[2, :n],
        acceleration_std=np.stack(deviation, axis=1),
        switch_times=switches,
        commands=commands,
        limits=campaign.elevator_limits if flight.command is not None else None,
        rest=rest,
        bank=bank,
        side_wind=side_wind,
    )
