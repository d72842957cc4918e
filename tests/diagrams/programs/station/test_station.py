"""The station with a simulated glider, by turns in one process: throws and logs."""

import dataclasses
import datetime
import gc
import time

import numpy as np
import pytest
from mcap.records import Message
from mcap.stream_reader import StreamReader

from diagrams.programs.station.autopilot import Autopilot
from diagrams.programs.station.scenario import (
    Limits,
    Scenario,
    Sensors,
    Servo,
    Simulation,
    load_scenario,
)
from diagrams.programs.station.session import Session
from diagrams.programs.station.throw_log import read_throw
from glider.campaign.checks.inspection import inspect
from glider.campaign.checks.servo import measure_elevators
from glider.campaign.checks.travel import _calc_travel
from glider.campaign.motion_capture import MotionCapture
from glider.campaign.reader import load_campaign
from glider.campaign.writer import flight_csv
from glider.compiled.actuators import elevator_path
from glider.errors import InputError
from glider.files import schema
from glider.physics.held_commands import command_steps
from glider.physics.model import GliderModel
from glider.sysid.pipeline import close_the_loop
from tests.campaign.importing import foreign
from tests.helpers.lockstep import Lockstep

PERFECT = {"lost": 0.0, "duplicated": 0.0, "late": 0.0}


@pytest.fixture
def nominal(tmp_path):
    """File of the glider without effects."""
    GliderModel().save(tmp_path / "nominal.yaml")
    return str(tmp_path / "nominal.yaml")


@pytest.mark.parametrize("controller", ["tvlqr", "mpc", "mppi"])
def test_a_known_glider_perches_and_the_station_sees_it(tmp_path, nominal, controller):
    simulation = Simulation(truth=nominal)
    lab = Lockstep(tmp_path / "s", simulation, controller=controller)
    throws = lab.fly(3)
    assert [throw.perched for throw in throws] == [True] * 3, lab.lines
    for throw, landing in zip(throws, lab.glider.landings, strict=True):
        assert landing.perched
        assert throw.passed.miss == pytest.approx(landing.miss, abs=0.005)


def test_a_controller_that_takes_its_lead_is_never_late(tmp_path, nominal, monkeypatch):
    """Nor with the first command of a throw."""
    lab = Lockstep(tmp_path / "s", Simulation(truth=nominal), controller="mppi")
    pilot, lead = lab.station._autopilot, lab.guidance.lead
    command = pilot.command
    assert lead > lab.scenario.limits.deadline

    def command_slowly(time):
        lab.now += lead
        return command(time)

    monkeypatch.setattr(pilot, "command", command_slowly)
    [throw] = lab.fly()
    assert throw.late == 0 and throw.perched


def test_before_a_throw_only_new_objects_are_looked_at_for_garbage(tmp_path, nominal):
    """Through all of them it takes so long that the last pose is stale then."""
    lab = Lockstep(tmp_path / "s", Simulation(truth=nominal))
    lab.fly(2)
    assert lab.station.state == "waiting"
    assert len(gc.get_objects()) < 0.1 * gc.get_freeze_count()
    lab.station.close()
    assert gc.get_freeze_count() == 0 and gc.isenabled()


def test_a_glider_with_an_effect_misses(tmp_path):
    lab = Lockstep(tmp_path / "s", Simulation(truth="head_wind"))
    [throw] = lab.fly()
    assert not throw.perched and 0.2 < throw.passed.miss < 0.4
    assert not throw.reason


def test_the_log_is_a_campaign_with_the_commands_that_the_servo_got(tmp_path, nominal):
    lab = Lockstep(tmp_path / "s", Simulation(truth=nominal, servo_latency=0.004))
    lab.fly(2)
    campaign = load_campaign(tmp_path / "s")
    assert len(campaign.flights) == 2 and campaign.command_rate == 50.0
    for flight in campaign.flights:
        assert flight.time[-1] > 0.7 and np.all(np.diff(flight.time) > 0.008)
        # The measured angle is the integral of the commands, but for its noise.
        turned = np.cumsum(flight.command[:-1] * np.diff(flight.time))
        rest = flight.elevator[1:] - turned
        assert np.std(rest) < 0.03, np.std(rest)


@pytest.mark.parametrize("lost", [0.0, 0.25])
def test_commands_that_are_late_are_logged_when_they_acted(
    tmp_path, nominal, monkeypatch, lost
):
    """Also those of which lost frames show nothing."""
    rng, command = np.random.default_rng(0), Autopilot.command

    def late(self, time):
        lab.now += rng.uniform(0.0, 0.009)
        return command(self, time)

    simulation = Simulation(truth=nominal, **{**PERFECT, "lost": lost})
    parts = {"limits": Limits(stale=0.1)}
    lab = Lockstep(tmp_path / "s", simulation, **parts)
    monkeypatch.setattr(Autopilot, "command", late)
    lab.fly(3)
    monkeypatch.undo()
    campaign, errors = load_campaign(tmp_path / "s"), []
    for flight in campaign.flights:
        tape = flight.time, flight.command, campaign.switch_rate
        with_times = command_steps(*tape, flight.command_time)
        for steps in (with_times, command_steps(*tape)):
            path = elevator_path(*steps, flight.time, campaign.limits)
            errors.append(np.std(flight.elevator - path))
    own, rows = np.array(errors[::2]), np.array(errors[1::2])
    noise = MotionCapture().elevator
    assert np.all(own < 1.2 * noise) and np.mean(rows) > 1.3 * noise, (own, rows)


def test_a_slow_servo_under_feedback_is_no_wrong_clock(tmp_path):
    """It swings: half a period earlier the elevator turns against the commands."""
    lab = Lockstep(tmp_path / "s", Simulation(truth="slow_servo"))
    lab.fly(4)
    campaign = load_campaign(tmp_path / "s")
    found = inspect(campaign)
    assert len(found.campaign.flights) == 4 and found.warnings == ()
    gain, error = _calc_travel(measure_elevators(campaign, {}), campaign.limits)
    assert abs(gain - 1.0) < 0.03 < 3.0 * error


@pytest.mark.nightly
def test_throws_of_one_plan_show_no_turned_frame(tmp_path):
    """A feedback holds them to one path: forces may explain it with any gravity."""
    lab = Lockstep(tmp_path / "s", Simulation(truth="attached_flow"))
    lab.fly(20)
    found = inspect(load_campaign(tmp_path / "s"))
    assert found.warnings == ()


@pytest.mark.nightly
@pytest.mark.parametrize(
    "truth",
    ["attached_flow", "head_wind", "rough_skin", "set_wing", "slow_servo", "wing_wash"],
)
def test_sixty_throws_show_the_effects_of_the_glider_alone(truth, tmp_path):
    """The station's clocks are no delay of the servo."""
    lab = Lockstep(tmp_path / "s", Simulation(truth=truth))
    lab.fly(60)
    result = close_the_loop(tmp_path / "s")
    planted = [effect.kind.kind for effect in GliderModel.load(truth).effects]
    assert [effect.kind for effect in result.effects] == planted
    errors = result.errors
    assert errors["corrected"].position_rms_m < 1.2 * errors["floor"].position_rms_m


def test_a_record_holds_all_that_is_needed_to_repeat_a_throw(tmp_path, nominal):
    lab = Lockstep(tmp_path / "s", Simulation(truth=nominal))
    lab.fly()
    facts, topics = read_throw(tmp_path / "s" / "throw_001.mcap")
    assert {"scenario", "model", "truth", "plan", "versions", "begun"} == set(facts)
    # Its times are of the calendar, as a video's and a lab book's are.
    age = time.time() - datetime.datetime.fromisoformat(facts["begun"]).timestamp()
    assert 0.0 <= age < 60.0
    flown = datetime.datetime.fromisoformat(topics["/event"][-1]["flown"])
    assert flown.tzinfo and abs(time.time() - flown.timestamp()) < 60.0
    with (tmp_path / "s" / "throw_001.mcap").open("rb") as stream:
        records = list(StreamReader(stream).records)
    logged = [m.log_time for m in records if isinstance(m, Message)]
    assert all(abs(time.time() - 1e-9 * stamp) < 60.0 for stamp in logged)
    relative = [p["received"] for p in topics["/pose"]]
    assert max(logged) - min(logged) >= 0.9e9 * (relative[-1] - relative[0])
    assert "# Begun 2" in (tmp_path / "s" / "campaign.yaml").read_text()
    assert (
        schema.convert(schema.parse_yaml(facts["scenario"], "s"), Scenario, "s")
        == lab.scenario
    )
    asked = [command for command in topics["/command"] if "asked" in command]
    assert len(asked) == len(lab.station.throws[0].latencies)
    used = [p for p in topics["/pose"] if p["free"] and not p["fault"]]
    assert len(topics["/estimate"]) == len(used) - 1  # The first begins the filter.
    states = [event["state"] for event in topics["/event"]]
    assert states[0] == "ready" and states[-1] == "result" and "flying" in states


def test_a_command_for_each_pose(tmp_path, nominal):
    simulation = Simulation(truth=nominal, **PERFECT)
    lab = Lockstep(tmp_path / "s", simulation, command_rate=None)
    [throw] = lab.fly()
    assert throw.perched
    _, topics = read_throw(tmp_path / "s" / "throw_001.mcap")
    assert len(topics["/command"]) == pytest.approx(len(topics["/estimate"]), abs=3)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"command_rate": 40.0}, "its command_rate is 50.0, ours 40.0"),
        ({"sensors": Sensors(elevator=False)}, "its servo is"),
        ({"simulation": Simulation(truth="head_wind")}, "simulated with other effects"),
    ],
)
def test_a_folder_of_other_throws_is_refused(tmp_path, nominal, changes, message):
    lab = Lockstep(tmp_path / "s", Simulation(truth=nominal))
    lab.run(lambda: lab.station.state == "ready")
    lab.station.close()
    lab = Lockstep(tmp_path / "s", Simulation(truth=nominal, seed=3))
    lab.fly()
    lab.station.close()
    scenario = dataclasses.replace(lab.scenario, **changes)
    with pytest.raises(InputError, match="expected a new folder") as error:
        Session(tmp_path / "s", scenario, lab.guidance)
    assert message in str(error.value)


def test_a_folder_of_another_glider_is_refused(tmp_path, nominal):
    Lockstep(tmp_path / "s", Simulation(truth=nominal)).station.close()
    text = (tmp_path / "s" / "campaign.yaml").read_text()
    (tmp_path / "s" / "campaign.yaml").write_text(text.replace("mass: 0.08", "mass: 1"))
    with pytest.raises(InputError, match="its vehicle is"):
        Lockstep(tmp_path / "s", Simulation(truth=nominal))


def test_a_simulated_throw_does_not_join_flights_that_no_station_recorded(
    tmp_path, nominal
):
    """As those of a real glider that were imported."""
    folder = tmp_path / "s"
    Lockstep(folder, Simulation(truth=nominal)).station.close()
    [flight] = foreign.flights(count=1).flights
    (folder / "flight_000.csv").write_bytes(flight_csv(flight))
    with pytest.raises(InputError, match=r"flight_000\.csv: is of another glider"):
        Lockstep(folder, Simulation(truth=nominal))
    assert [file.name for file in folder.glob("flight_*")] == ["flight_000.csv"]


def test_two_stations_do_not_share_a_folder(tmp_path, nominal):
    lab = Lockstep(tmp_path / "s", Simulation(truth=nominal))
    with pytest.raises(
        InputError, match="another station writes to it; expected a folder"
    ):
        Session(tmp_path / "s", lab.scenario, lab.guidance)


def test_a_folder_with_damaged_records_and_lone_flights_goes_on(tmp_path, nominal):
    folder = tmp_path / "s"
    lab = Lockstep(folder, Simulation(truth=nominal))
    lab.fly(2)
    lab.station.close()
    whole = (folder / "throw_002.mcap").read_bytes()
    (folder / "throw_002.mcap").unlink()
    lone = (folder / "flight_002.csv").rename(folder / "flight_005.csv")
    kept = lone.read_bytes()
    place = whole.index(b"/pose") + 2000
    damaged = whole[:place] + bytes(200) + whole[place + 200 :]
    (folder / "throw_003.mcap").write_bytes(damaged)
    (folder / "throw_004.mcap").write_bytes(b"no record at all")
    lab.start_station()
    assert [line for line in lab.lines if line.startswith("skipped: ")] == [
        line for line in lab.lines if "expected a record of the station" in line
    ]
    assert sum("throw_003" in line for line in lab.lines) == 1
    lab.fly()
    assert lone.read_bytes() == kept
    assert (folder / "flight_006.csv").exists()


def test_before_the_first_command_the_elevator_rests_at_neutral(tmp_path, nominal):
    parts = {"sensors": Sensors(elevator=False), "servo": Servo(neutral=0.2)}
    lab = Lockstep(tmp_path / "s", Simulation(truth=nominal), **parts)
    lab.fly()
    [flight] = load_campaign(tmp_path / "s").flights
    assert flight.elevator[0] == pytest.approx(0.2, abs=1e-6)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("controller: pid", "controller"),
        ("command_rate: 5", "a number >= 10.0"),
        ("sensors: {rate: 0}", "field 'sensors.rate' is 0; expected"),
        ("limits: {x: [1]}", "a list of length 2"),
        ("limits: {x: [1, 0]}", "[least, largest]"),
        ("simulation: {truth: breeze}", "the name of one in models/truths"),
        ("sensor: {}", "did you mean 'sensors'"),
        ("servo: {timeout: -1}", "field 'servo.timeout' is -1"),
        ("servo: {timeout: 0.02}", "at least 0.03 s, a command's time and its"),
        ("servo: {neutral: .nan}", "field 'servo.neutral' is nan; expected"),
        ("limits: {stale: 0.01}", "above 0.0143 s, the age of a pose when"),
        ("filter: {pitch: 0}", "field 'filter.pitch' is 0; expected"),
        ("simulation: {lost: 1.5}", "field 'simulation.lost' is 1.5; expected"),
        ("simulation: {jitter: -1}", "field 'simulation.jitter' is -1"),
        ("simulation: {acceleration: 0}", "field 'simulation.acceleration' is 0"),
        ("simulation: {clock_drift: .inf}", "field 'simulation.clock_drift' is inf"),
        ("simulation: {seed: -1}", "field 'simulation.seed' is -1"),
    ],
)
def test_a_wrong_scenario_is_one_sentence(tmp_path, text, message):
    (tmp_path / "lab.yaml").write_text(text)
    with pytest.raises(InputError, match=r"lab\.yaml|simulated glider") as error:
        assert load_scenario(tmp_path / "lab.yaml").truth
    assert message in str(error.value)
