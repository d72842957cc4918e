"""The recorded campaigns are complete, and nothing in them tells the answer."""

from pathlib import Path

import pytest
import yaml

from glider.__main__ import main
from glider.campaign.reader import load_campaign
from glider.campaign.samples import campaign_folder, list_samples, sample_names
from glider.errors import InputError
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


# ------------------------------------------------------------ those that ship


@pytest.fixture
def fresh_cache(monkeypatch, tmp_path):
    """An empty cache folder."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    return tmp_path / "cache" / "drake-glider"


def test_the_samples_are_small_and_every_archive_is_listed():
    archives = list(models_path("campaigns").glob("*.zip"))
    assert {path.stem for path in archives} == set(sample_names())
    assert set(PRACTICE) < set(sample_names())
    assert sum(path.stat().st_size for path in archives) < 1e6


def test_a_sample_goes_by_its_name(fresh_cache):
    folder = campaign_folder("four_at_once")
    assert fresh_cache in folder.parents
    assert campaign_folder("four_at_once") == folder
    assert len(load_campaign("four_at_once").flights) == 25
    assert [p.name for p in folder.parent.iterdir()] == ["four_at_once"]


def test_a_folder_comes_before_a_sample_of_its_name(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "head_wind").mkdir()
    with pytest.raises(InputError, match=r"head_wind: no campaign\.yaml"):
        load_campaign("head_wind")


def test_what_is_no_campaign_names_the_samples(tmp_path):
    with pytest.raises(InputError, match=r"nowhere: does not exist.*still_air"):
        campaign_folder("nowhere")
    path = tmp_path / "throws.zip"
    path.write_text("no folder")
    with pytest.raises(InputError, match=r"throws\.zip: is not a folder.*still_air"):
        campaign_folder(path)


def test_the_command_lists_and_copies(tmp_path, capsys, fresh_cache):
    assert main(["samples"]) == 0
    text = capsys.readouterr().out
    assert max(map(len, text.splitlines())) <= 80
    assert "glider close-the-loop" in text
    for sample in list_samples():
        assert f"{sample.name:14s} {sample.flights:7d}  {sample.holds}" in text
    assert not fresh_cache.exists()
    out = tmp_path / "mine"
    assert main(["samples", "four_at_once", "--out", str(out)]) == 0
    assert len(load_campaign(out).flights) == 25
    capsys.readouterr()
    assert main(["samples", "four_at_once", "--out", str(out)]) == 2
    assert "exists" in capsys.readouterr().err
    blocked = tmp_path / "file"
    blocked.touch()
    assert main(["samples", "four_at_once", "--out", str(blocked / "mine")]) == 2
    assert f"{blocked}: is a file; expected a folder." in capsys.readouterr().err
    nowhere = "/proc/mine" if Path("/proc").exists() else "/dev/null/mine"
    assert main(["samples", "four_at_once", "--out", nowhere]) == 2
    assert f"error: {nowhere}: cannot be written" in capsys.readouterr().err
    assert main(["samples", "--out", str(out)]) == 2
    assert main(["samples", "lunar_air"]) == 2
