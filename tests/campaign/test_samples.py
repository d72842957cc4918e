"""The recorded campaigns are complete, and nothing in them tells the answer."""

import zipfile
from pathlib import Path

import pytest
import yaml

from glider.__main__ import main
from glider.campaign import samples
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


def test_a_sample_goes_by_name_by_path_and_by_the_path_of_its_folder(fresh_cache):
    archive = models_path("campaigns", "four_at_once.zip")
    folder = campaign_folder("four_at_once")
    assert fresh_cache in folder.parents
    assert campaign_folder(archive) == folder
    assert campaign_folder(archive.with_suffix("")) == folder
    assert load_campaign("four_at_once").name == "four_at_once"
    assert len(load_campaign(archive).flights) == 25
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
    path.write_text("no archive")
    with pytest.raises(InputError, match=r"throws\.zip: cannot be unpacked"):
        campaign_folder(path)
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("notes.txt", "hello")
    with pytest.raises(InputError, match=r"holds 0 files campaign\.yaml"):
        campaign_folder(path)


@pytest.mark.parametrize(
    ("kind", "words"),
    [
        ("one file", "bytes when unpacked; expected at most 50,000,000"),
        ("many files", "files; expected at most 10,000"),
        ("nested text", "times its packed size in a file; expected at most 100"),
    ],
)
def test_an_archive_that_would_fill_the_disk_is_refused(
    tmp_path, fresh_cache, monkeypatch, kind, words
):
    monkeypatch.setattr(samples, "_MOST_BYTES", 50_000_000)
    path = tmp_path / "bomb.zip"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("campaign.yaml", "vehicle: {}")
        if kind == "one file":
            with archive.open("flight_000.csv", "w", force_zip64=True) as stream:
                for _ in range(100):
                    stream.write(bytes(1 << 20))
        elif kind == "many files":
            for i in range(10_001):
                archive.writestr(f"flight_{i:05d}.csv", "")
        else:
            archive.writestr("flight_000.csv", "0,0,0,0\n" * 4_000_000)
    with pytest.raises(InputError, match=rf"bomb\.zip: has .* {words}"):
        campaign_folder(path)
    left = [p for p in fresh_cache.rglob("*") if p.is_file()]
    assert sum(p.stat().st_size for p in left) < 1e6


def test_an_archive_that_lies_about_its_size_is_refused(tmp_path, fresh_cache):
    """The size in its directory is a claim: what is unpacked is counted."""
    path = tmp_path / "liar.zip"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("campaign.yaml", "vehicle: {}" + " " * 10_000_000)
    data = path.read_bytes()
    size = (10_000_011).to_bytes(4, "little")
    path.write_bytes(data.replace(size, (11).to_bytes(4, "little")))
    with pytest.raises(InputError, match=r"liar\.zip: "):
        campaign_folder(path)
    left = [p for p in fresh_cache.rglob("*") if p.is_file()]
    assert sum(p.stat().st_size for p in left) < 1e6


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
