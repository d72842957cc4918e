"""Poses that cameras lost, repeated or took for others cost rows and no flight."""

import numpy as np
import pytest

from glider.campaign.checks.inspection import inspect
from glider.campaign.checks.rows import find_stale
from glider.campaign.importing.campaign_import import import_campaign, read_flights
from glider.campaign.logs import Campaign
from glider.campaign.reader import load_campaign
from tests.campaign.importing import foreign

MAP = """\
columns: {time: t, position: [px, py, pz], attitude: [qx, qy, qz, qw],
          elevator: servo, elevator_rate_command: rate}
"""
NAMES = "t,px,py,pz,qx,qy,qz,qw,servo,rate"
POSE = slice(1, 8)  # Its columns.
RATE = "elevator_rate_command"


@pytest.fixture(scope="module")
def campaign() -> Campaign:
    return foreign.flights("attached_lift", 4)


def tables(campaign):
    """Rows of each flight, as a router of poses would log them."""
    return [
        np.column_stack(
            [
                f.time - f.time[0],
                foreign.position(f),
                foreign.rotation(f).as_quat(),
                f.elevator,
                f.command,
            ]
        )
        for f in campaign.flights
    ]


def write(folder, logs):
    """Writes logs and their MAP."""
    files = [folder / f"take{k}.csv" for k in range(len(logs))]
    for file, rows in zip(files, logs, strict=True):
        foreign.write_table(file, NAMES, rows)
    path = folder / "MAP.yaml"
    path.write_text(MAP + foreign.VEHICLE)
    return files, path


def repeating(table, every):
    """Each `every`-th row has the pose of the row before."""
    stale = np.arange(len(table)) % every == every - 1
    rows = table.copy()
    rows[stale, POSE] = table[np.flatnonzero(stale) - 1, POSE]
    return rows


@pytest.mark.parametrize("lost", [12, 18, 24, 36])  # 0.1 to 0.3 s.
def test_a_throw_with_a_dropout_is_one_flight(tmp_path, campaign, lost):
    logs = [np.delete(t, np.s_[33 : 33 + lost], axis=0) for t in tables(campaign)]
    found = read_flights(*write(tmp_path, logs))
    assert [len(f.time) for f in found.campaign.flights] == [len(t) for t in logs]


def test_a_dropout_in_which_a_hand_throws_separates_two_flights(tmp_path, campaign):
    """The energy grows in it: half of the speed, and of the way, is lost before."""
    logs = []
    for table in tables(campaign):
        slow = table[:40].copy()
        slow[:, 1:4] = table[40, 1:4] + 0.4 * (table[:40, 1:4] - table[40, 1:4])
        fast = table[40:] + np.array([0.2, *np.zeros(9)])
        logs.append(np.concatenate([slow, fast]))
    found = read_flights(*write(tmp_path, logs))
    begins = [f.span[0] for r in found.recordings for f in r.flights]
    assert max(begins) > 0.4


def test_a_moment_after_a_dropout_is_no_flight(tmp_path, campaign):
    """Six rows do not show that the glider flies on."""
    logs = [np.concatenate([table[:70], table[88:94]]) for table in tables(campaign)]
    found = read_flights(*write(tmp_path, logs))
    ends = [f.span[1] for r in found.recordings for f in r.flights]
    assert max(ends) < min(table[70, 0] for table in logs)


def test_a_moment_between_two_dropouts_joins_no_flights(tmp_path, campaign):
    """Six rows do not show that the glider flies on from one to the other."""
    logs = [
        np.concatenate([table[:40], table[56:62], table[78:]])
        for table in tables(campaign)
    ]
    found = read_flights(*write(tmp_path, logs))
    ends = [f.span[1] for r in found.recordings for f in r.flights]
    assert max(ends) < min(table[40, 0] for table in logs)


@pytest.mark.parametrize("other", [[0, 0, 0, 0], [0, 0, 0, 1]])
def test_rows_of_zeros_are_not_seen(tmp_path, campaign, other):
    logs = tables(campaign)
    for rows in logs:
        rows[40:43, POSE] = [0.0, 0.0, 0.0, *other]
    found = read_flights(*write(tmp_path, logs))
    assert [len(f.time) for f in found.campaign.flights] == [len(t) - 3 for t in logs]
    words = "3 rows in which the position is zero: the body was not seen"
    assert f"{len(logs)} recordings: {words}" in found.describe()


def polled(table):
    """Each row twice, as where poses are asked for twice as often as they come."""
    rows = np.repeat(table, 2, axis=0)
    rows[1::2, 0] += 0.5 * np.median(np.diff(table[:, 0]))
    return rows


SENT_AGAIN = {"polled": (polled, 2), "missed": (lambda t: repeating(t, 8), 8)}


@pytest.mark.parametrize("kind", SENT_AGAIN)
def test_repeated_poses_are_dropped_and_counted(tmp_path, campaign, kind):
    repeat, every = SENT_AGAIN[kind]
    logs = [repeat(table) for table in tables(campaign)]
    found = read_flights(*write(tmp_path, logs))
    for flight, rows in zip(found.campaign.flights, logs, strict=True):
        assert len(flight.time) == len(rows) - len(rows) // every
    assert "rows that repeat the pose before: they are dropped" in found.describe()


@pytest.mark.parametrize("kind", SENT_AGAIN)
def test_repeated_poses_of_a_folder_are_excluded_alone(tmp_path, campaign, kind):
    repeat, every = SENT_AGAIN[kind]
    flights = []
    for k, table in enumerate(tables(campaign)):
        time, x, _, z, *_, elevator, command = repeat(table).T
        pitch = campaign.flights[k].pose[np.searchsorted(table[:, 1], x), 2]
        columns = {"time": time, "x": x, "z": z, "pitch": pitch}
        flights.append({**columns, "elevator": elevator, RATE: command})
    vehicle = {"mass": 0.08, "wing_area": 0.0885, "elevator_rate_limit": 13.0}
    found = inspect(Campaign.from_arrays(flights, vehicle, command_rate=50.0))
    assert len(found.campaign.flights) == len(campaign.flights)
    assert found.excluded == ()
    assert "rows repeat the pose before" in found.warnings[-1]
    for mask in found.masks.values():
        stale = np.arange(len(mask.pose)) % every == every - 1
        assert np.array_equal(mask.pose, stale)


def test_coarse_digits_of_a_slow_body_are_no_repeats():
    """A tenth of its equal rows, at a tenth of a digit a row, each measured again."""
    rng = np.random.default_rng(0)
    time = np.arange(400) / 1000.0
    place = np.column_stack([0.8 * time, 0.02 * time, -0.2 * time])
    coarse = np.round(place + rng.normal(0.0, 2e-4, place.shape), 3)
    equal = np.all(np.diff(coarse, axis=0) == 0.0, axis=1)
    assert np.sum(equal) > 20
    assert not find_stale(time, coarse).any()


def test_exchanged_markers_cost_their_rows(tmp_path, campaign):
    """The roll, without noise, jumps by half a turn, in either direction."""
    logs = tables(campaign)
    for k, rows in enumerate(logs):
        x, y, z, w = rows[40:50, 4:8].T
        turned = [w, z, -y, -x] if k % 2 else [-w, -z, y, x]
        rows[40:50, 4:8] = np.transpose(turned)
    import_campaign(*write(tmp_path, logs), tmp_path / "out")
    found = inspect(load_campaign(tmp_path / "out"))
    assert len(found.campaign.flights) == len(logs)
    for mask in found.masks.values():
        assert list(np.flatnonzero(mask.pose)) == list(range(40, 50))
    whys = {e.why for e in found.excluded}
    assert whys == {"pose: its attitude jumps, as where markers are taken for others"}
