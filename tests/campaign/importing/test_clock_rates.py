"""A servo's clock that gains on that of the poses over a session of throws."""

import re

import numpy as np
import pytest

from glider.campaign.importing.campaign_import import import_campaign
from tests.campaign.importing import foreign

AHEAD = 12.0  # Of the servo's clock when the session begins [s].
PAUSE = 7.0  # From throw to throw [s].


def session(folder, rate, count):
    """Writes throws as one log of poses and one of the servo, whose clock gains."""
    campaign = foreign.flights("attached_lift", count)
    poses = []
    servo = []
    for k, flight in enumerate(campaign.flights):
        time = 2.0 + k * PAUSE + flight.time
        own = AHEAD + (1.0 + rate) * time
        poses.append(np.column_stack([time, flight.pose]))
        servo.append(np.column_stack([own, flight.elevator, flight.command]))
    names = {"s_poses.csv": "t,x,z,pitch", "s_servo.csv": "ts,angle,rate"}
    for (name, header), rows in zip(names.items(), (poses, servo), strict=True):
        foreign.write_table(folder / name, header, np.concatenate(rows))
    own = folder / "MAP.yaml"
    own.write_text(
        "join: ['*_poses.csv', '*_servo.csv']\n"
        "columns: {time: [t, ts], x: x, z: z, pitch: pitch, elevator: angle,\n"
        f"          elevator_rate_command: rate}}\n{foreign.VEHICLE}"
    )
    return import_campaign([folder / name for name in names], own, folder / "throws")


NIGHTLY = pytest.mark.nightly


@pytest.mark.parametrize("rate", [pytest.param(7e-4, marks=NIGHTLY), -1.85e-3])
def test_the_rate_of_a_clock_is_taken_out(tmp_path, rate):
    result = session(tmp_path, rate, 12)
    (warning,) = result.warnings
    (gain,) = re.findall(r"gains (-?\d+) µs in a second", warning)
    assert float(gain) == pytest.approx(1e6 * rate, abs=100.0)
    # Each elevator is where it was, within the error of the offset.
    truth = foreign.flights("attached_lift", 12).flights
    for made, flight in zip(result.campaign.flights, truth, strict=True):
        along = np.linspace(0.2, 0.7, 26)
        own = np.interp(along, flight.time, flight.elevator)
        errors = [
            np.std(np.interp(along + late, made.time, made.elevator) - own)
            for late in (0.0, 0.02, -0.02)
        ]
        assert errors[0] == min(errors)


@pytest.mark.parametrize("count", [3, pytest.param(12, marks=NIGHTLY)])
def test_a_clock_that_keeps_step_has_an_offset_alone(tmp_path, count):
    assert " gains " not in session(tmp_path, 0.0, count).describe()
