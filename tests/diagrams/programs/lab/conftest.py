"""Fixtures of the lab's tests."""

import shutil

import pytest

from glider.campaign.samples import campaign_folder


@pytest.fixture
def folder(tmp_path):
    """A session's folder with no throw yet."""
    path = tmp_path / "head_wind"
    path.mkdir()
    shutil.copy(campaign_folder("head_wind") / "campaign.yaml", path)
    return path
