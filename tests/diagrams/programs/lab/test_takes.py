"""Measured throws and takes, dropped into a session's folder file by file."""

import shutil
from pathlib import Path

import pytest

from diagrams.programs.lab.session import LabSession
from diagrams.programs.lab.state import trace_of
from glider.campaign.importing.campaign_import import read_flights
from glider.campaign.reader import load_campaign
from glider.errors import InputError
from glider.report.wording import headline
from glider.sysid.pipeline import close_the_loop
from tests.helpers.lab import finish, update

MEASURED = Path(__file__).parents[5] / "shared" / "measured"

pytestmark = [
    pytest.mark.nightly,
    pytest.mark.skipif(not MEASURED.is_dir(), reason="no measured flights are here"),
]

MAP = """\
columns: {position: V3Glider.Position, attitude: V3Glider.Rotation}
frame: {up: y, nose: x, top: y}
vehicle: {elevator: fixed_per_flight}
"""


@pytest.fixture
def session(tmp_path):
    session = LabSession(tmp_path)
    yield session
    session.close()


def test_takes_one_by_one_give_the_flights_of_an_import_of_all(tmp_path, session):
    (tmp_path / "MAP.yaml").write_text(MAP)
    update(session)
    assert session.state.throws == ()
    takes = sorted((MEASURED / "raw_motive").glob("*.csv"))
    for count, take in enumerate(takes, start=1):
        shutil.copy(take, tmp_path)
        update(session)
        copies = [tmp_path / take.name for take in takes[:count]]
        try:
            imported = read_flights(copies, tmp_path / "MAP.yaml").campaign.flights
        except InputError as error:  # The first take holds no flight.
            assert session.state.notes == (str(error),)
            assert session.state.throws == ()
            continue
        assert all(throw.is_drawn for throw in session.state.throws)
        flights = load_campaign(session.watched.campaign).flights
        assert [t.name for t in session.state.throws] == [f.name for f in flights]
        for flight, same in zip(flights, imported, strict=True):
            assert flight.pose == pytest.approx(same.pose, nan_ok=True)
    assert len(session.state.throws) == 2


@pytest.mark.filterwarnings("ignore:.*not trusted")  # Three throws are few.
def test_measured_throws_one_by_one_give_the_answer_of_a_full_run(tmp_path, session):
    source = MEASURED / "motion_studio_v3"
    shutil.copy(source / "campaign.yaml", tmp_path)
    for number in range(23):
        shutil.copy(source / f"flight_{number:03d}.csv", tmp_path)
        update(session)
        if number + 1 not in (3, 6, 12, 23):
            continue
        finish(session)
        last = session.state.traces[-1]
        assert len(last.flights) == number + 1
        full = close_the_loop(source, flights=last.flights)
        expected = trace_of(full.report, headline(full), last.sha256)
        assert (last.verdict, last.headline) == (expected.verdict, expected.headline)
        assert last.effects == expected.effects and last.errors == expected.errors
    assert last.verdict != "not_trusted"
