"""Ways to break a campaign's logs, as cameras, clocks and people do."""

import dataclasses

import numpy as np

from glider.campaign.logs import Campaign, Flight


def change(campaign: Campaign, edit, *, only=None) -> Campaign:
    """Returns the campaign with `edit(flight)` in place of flights (`only` one)."""
    flights = tuple(
        edit(f) if only is None or i == only else f
        for i, f in enumerate(campaign.flights)
    )
    return dataclasses.replace(campaign, flights=flights)


def with_pose(flight: Flight, pose: np.ndarray) -> Flight:
    return dataclasses.replace(flight, pose=pose)


def values(column: str, edit):
    """Makes `edit(values)` of one column of a flight: "time", "pose", ..."""
    return lambda f: dataclasses.replace(f, **{column: edit(getattr(f, column))})


def scale(*factors):
    """Multiplies x, z and pitch."""
    return lambda f: with_pose(f, f.pose * np.array(factors))


def exchange(flight: Flight) -> Flight:
    """Takes x for z."""
    return with_pose(flight, flight.pose[:, [1, 0, 2]])


def half_turn(flight: Flight) -> Flight:
    return with_pose(flight, flight.pose + np.array([0.0, 0.0, np.pi]))


def from_behind(flight: Flight) -> Flight:
    """Looks at the flight from the other side: x and the nose point backwards."""
    x, z, pitch = flight.pose.T
    return with_pose(flight, np.column_stack([-x, z, np.pi - pitch]))


def level(rng):
    """Makes noise of z: another axis of the room."""

    def edit(flight):
        pose = flight.pose.copy()
        pose[:, 1] = rng.normal(0.0, 4e-4, len(pose))
        return with_pose(flight, pose)

    return edit


def stretch_time(factor):
    return values("time", lambda time: time * factor)


def backwards(flight: Flight) -> Flight:
    return with_pose(flight, flight.pose[::-1].copy())


def freeze(first, count, columns=(0, 1, 2)):
    """The cameras repeat the row `first` for `count` further rows."""

    def edit(flight):
        pose = flight.pose.copy()
        for k in columns:
            pose[first + 1 : first + 1 + count, k] = pose[first, k]
        return with_pose(flight, pose)

    return edit


def jump(first, last=None, by=(0.03, 0.0, 0.0)):
    """Another marker is followed from row `first` on (until `last`)."""

    def edit(flight):
        pose = flight.pose.copy()
        pose[first:last] += np.array(by)
        return with_pose(flight, pose)

    return edit


def spikes(rows, size=(0.02, -0.02, 0.1)):
    """Rows that stick out, to either side."""

    def edit(flight):
        pose = flight.pose.copy()
        side = np.where(np.arange(len(rows)) % 2, 1.0, -1.0)
        pose[rows] += side[:, None] * np.array(size)
        return with_pose(flight, pose)

    return edit


def lose(first, count):
    """Rows are missing."""

    def edit(f):
        kept = np.ones(len(f.time), dtype=bool)
        kept[first : first + count] = False
        return dataclasses.replace(
            f,
            time=f.time[kept],
            pose=f.pose[kept],
            elevator=f.elevator[kept],
            command=f.command[kept],
        )

    return edit


def land(first, rng):
    """From row `first` on the glider lies where it is, under noisy cameras."""

    def edit(flight):
        pose = flight.pose.copy()
        pose[first:] = pose[first]
        pose[first:] += rng.normal(size=pose[first:].shape) * [4e-4, 4e-4, 2.5e-3]
        return with_pose(flight, pose)

    return edit


def hold_before(count, push, rng):
    """The log begins in the hand: at rest for `count` rows, then pushed by `push`.

    The hand speeds the glider up along its launch velocity, within [m/s²].
    """

    def edit(f):
        step = float(np.median(np.diff(f.time)))
        start = np.polynomial.polynomial.polyfit(f.time[:8] - f.time[0], f.pose[:8], 1)
        speed = float(np.hypot(*start[1, :2]))
        pushing = round(speed / push / step)
        back = np.arange(-pushing, 0) * step  # From rest to the launch speed.
        run = speed * back + 0.5 * push * back**2
        path = start[0, :2] + run[:, None] * start[1, :2] / speed
        before = np.concatenate([np.repeat(path[:1], count, axis=0), path])
        pose = np.column_stack([before, np.full(len(before), start[0, 2])])
        pose += rng.normal(size=pose.shape) * [4e-4, 4e-4, 2.5e-3]
        time = f.time[0] + np.arange(-len(before), 0) * step
        none = np.zeros(len(before))
        return dataclasses.replace(
            f,
            time=np.concatenate([time, f.time]),
            pose=np.concatenate([pose, f.pose]),
            elevator=np.concatenate([f.elevator[0] + none, f.elevator]),
            command=np.concatenate([none, f.command]),
        )

    return edit


def with_servo(elevator=None, command=None):
    """Replaces the columns of the servo by functions of the flight."""

    def edit(f):
        return dataclasses.replace(
            f,
            elevator=f.elevator if elevator is None else elevator(f),
            command=f.command if command is None else command(f),
        )

    return edit


def tell(campaign: Campaign, **vehicle) -> Campaign:
    """Returns the campaign with other numbers in campaign.yaml."""
    return dataclasses.replace(campaign, vehicle={**campaign.vehicle, **vehicle})


def shift_commands(late):
    """Moves the commands by `late` seconds; beyond their ends they are zero."""

    def edit(f):
        at = f.time - late
        known = (at >= f.time[0]) & (at <= f.time[-1])
        row = np.clip(np.searchsorted(f.time, at, side="right") - 1, 0, None)
        return dataclasses.replace(f, command=np.where(known, f.command[row], 0.0))

    return edit


def in_body_axes(flight: Flight) -> Flight:
    """Turns each position by the pitch, as if cameras rode along."""
    x, z, pitch = flight.pose.T
    s, c = np.sin(pitch), np.cos(pitch)
    return with_pose(flight, np.column_stack([c * x - s * z, s * x + c * z, pitch]))


def tilt(angle):
    """Turns the axes of the cameras about +y."""

    def edit(flight):
        x, z, pitch = flight.pose.T
        s, c = np.sin(angle), np.cos(angle)
        return with_pose(
            flight, np.column_stack([c * x + s * z, c * z - s * x, pitch + angle])
        )

    return edit


def pitch_of_path(flight: Flight) -> np.ndarray:
    """Returns poses whose pitch is the direction of the path."""
    slope = np.gradient(flight.pose[:, :2], flight.time, axis=0)
    return np.column_stack([flight.pose[:, :2], -np.arctan2(slope[:, 1], slope[:, 0])])


def joined(first: Flight, second: Flight) -> Flight:
    """Returns two flights in one file, times as they are."""
    return dataclasses.replace(
        first,
        **{
            name: np.concatenate([getattr(first, name), getattr(second, name)])
            for name in ("time", "pose", "elevator", "command")
        },
    )


def with_servo_of(flight: Flight, other: Flight) -> Flight:
    """Gives a flight the servo columns of another one, row by row."""
    rows = np.minimum(np.arange(len(flight.time)), len(other.time) - 1)
    return dataclasses.replace(
        flight, elevator=other.elevator[rows], command=other.command[rows]
    )


def stuck(first):
    """The elevator stays where it is from row `first` on."""

    def edit(f):
        elevator = f.elevator.copy()
        elevator[first:] = elevator[first]
        return dataclasses.replace(f, elevator=elevator)

    return edit


def shift_servo(late):
    """Moves elevator and commands by `late` seconds against the poses."""

    def edit(f):
        time = f.time + late  # Of the servo's rows.
        row = np.clip(np.searchsorted(time, f.time + 1e-9, side="right") - 1, 0, None)
        return dataclasses.replace(
            f, command=f.command[row], elevator=np.interp(f.time, time, f.elevator)
        )

    return edit


def drift_servo(rate):
    """Lets the clock of the servo run `rate` times as fast as that of the poses."""

    def edit(f):
        at = f.time[0] + (f.time - f.time[0]) / rate
        row = np.clip(np.searchsorted(f.time, at + 1e-9, side="right") - 1, 0, None)
        return dataclasses.replace(
            f, command=f.command[row], elevator=np.interp(at, f.time, f.elevator)
        )

    return edit


def jitter(size, rng):
    """Logs each row at a wrong time, evenly within ±size [s]; the order stays."""

    def edit(f):
        time = np.sort(f.time + rng.uniform(-size, size, len(f.time)))
        return dataclasses.replace(f, time=np.maximum.accumulate(time))

    return edit


def thin(factor):
    """Keeps every `factor`-th row."""
    return lambda f: _rows(f, np.arange(0, len(f.time), factor))


def lose_some(share, rng):
    """Rows are missing here and there."""
    return lambda f: _rows(f, np.flatnonzero(rng.random(len(f.time)) > share))


def shuffle(rng):
    """Exchanges rows; the times stay."""
    return lambda f: with_pose(f, f.pose[rng.permutation(len(f.time))])


def _rows(flight: Flight, rows: np.ndarray) -> Flight:
    return dataclasses.replace(
        flight,
        time=flight.time[rows],
        pose=flight.pose[rows],
        elevator=flight.elevator[rows],
        command=flight.command[rows],
    )


def drifting(speed):
    """Returns poses whose x drifts by `speed` [m/s]."""
    return lambda f: f.pose + np.outer(f.time - f.time[0], [speed, 0.0, 0.0])


def rounded(digit):
    """Returns poses of few digits."""
    return lambda f: np.round(f.pose / digit) * digit


def smooth(width):
    """Somebody smoothed the poses already, with a moving average of `width` rows."""

    def edit(f):
        half = width // 2
        inner = np.apply_along_axis(
            lambda c: np.convolve(c, np.ones(width) / width, "valid"), 0, f.pose
        )
        pose = f.pose.copy()
        pose[half : len(pose) - half] = inner
        return with_pose(f, pose)

    return edit


def lagged(time_constant):
    """Returns poses after a first-order lag, as a causal filter makes."""

    def edit(f):
        pose = f.pose.copy()
        for k in range(1, len(pose)):
            keep = np.exp(-(f.time[k] - f.time[k - 1]) / time_constant)
            pose[k] = keep * pose[k - 1] + (1.0 - keep) * f.pose[k]
        return pose

    return edit


def noisy(size, rng):
    """Adds noise."""
    return lambda f: with_pose(f, f.pose + rng.normal(size=f.pose.shape) * size)


def heavy_tails(size, rng):
    """Adds noise of Student's t with two degrees of freedom."""
    return lambda f: with_pose(f, f.pose + rng.standard_t(2, size=f.pose.shape) * size)


def hit(first, change):
    """Something hits the glider: its velocity changes by `change` at row `first`."""

    def edit(flight):
        since = np.maximum(flight.time - flight.time[first], 0.0)
        return with_pose(flight, flight.pose + np.outer(since, change))

    return edit
