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
    return lambda f: dataclasses.replace(f, time=f.time * factor)


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
