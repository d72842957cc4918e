"""The recorded campaigns are complete, and nothing in them tells the answer."""

import pytest
import yaml

from glider.paths import models_path
from tests.helpers.campaigns import BLIND, PRACTICE, campaign_path


@pytest.mark.parametrize("name", PRACTICE + BLIND)
def test_a_campaign_is_a_description_and_flights(name):
    folder = campaign_path(name)
    assert "vehicle" in yaml.safe_load((folder / "campaign.yaml").read_text())
    flights = sorted(path.name for path in folder.glob("flight_*.csv"))
    assert len(flights) >= 30
    assert flights == [f"flight_{i:03d}.csv" for i in range(len(flights))]


def test_no_folder_of_data_holds_the_truth():
    for root in (models_path(), campaign_path("a").parents[1]):
        names = {path.name for path in root.rglob("*") if path.is_file()}
        assert names & {"campaign.yaml", "samples.yaml"}
        assert not [name for name in names if "truth" in name.lower()]


def test_an_unknown_campaign_is_refused_by_name():
    with pytest.raises(FileNotFoundError, match="No campaign 'still_water'"):
        campaign_path("still_water")
