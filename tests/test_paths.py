"""Models are found in a source tree and in a wheel; the cache is its user's alone."""

import os
import re
import stat
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest

from glider import paths
from glider.paths import models_path


def test_finds_the_models():
    assert models_path().is_dir()
    assert models_path("vehicles", "perching.yaml").is_file()


def test_what_is_not_there_is_named_with_what_is():
    with pytest.raises(FileNotFoundError, match=r"perch\.yaml.*heavy\.yaml") as error:
        models_path("vehicles", "perch.yaml")
    assert str(models_path("vehicles")) in str(error.value)


def test_a_missing_folder_is_answered_from_the_last_that_is_there():
    with pytest.raises(FileNotFoundError, match="vehicles") as error:
        models_path("boats", "canoe", "paddle.yaml")
    assert f"folder {models_path()} holds" in str(error.value)


def make_package(folder):
    package = folder / "glider"
    package.mkdir()
    return package


def test_an_installed_package_uses_its_own_models(tmp_path):
    package = make_package(tmp_path)
    (package / "_models").mkdir()
    (tmp_path / "models").mkdir()
    (tmp_path / "pyproject.toml").touch()
    assert paths._models_folder(package) == package / "_models"


def test_a_source_tree_uses_the_folder_beside_the_package(tmp_path):
    package = make_package(tmp_path)
    (tmp_path / "models").mkdir()
    (tmp_path / "pyproject.toml").touch()
    assert paths._models_folder(package) == tmp_path / "models"


def test_somebody_elses_models_in_site_packages_are_not_ours(tmp_path):
    package = make_package(tmp_path)
    (tmp_path / "models").mkdir()
    with pytest.raises(FileNotFoundError, match=re.escape(str(tmp_path / "models"))):
        paths._models_folder(package)


# ------------------------------------------------------------------- the cache


@pytest.fixture
def home(tmp_path, monkeypatch):
    """A folder for caches, empty."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.delenv("DRAKE_GLIDER_CACHE", raising=False)
    return tmp_path


def mode_of(folder):
    return stat.S_IMODE(folder.stat().st_mode)


def test_the_cache_is_for_its_user_alone(home):
    folder = paths.cache_folder()
    assert folder == home / "drake-glider"
    assert mode_of(folder) == 0o700


def test_an_own_cache_that_others_could_read_is_closed_to_them(home):
    (home / "drake-glider").mkdir(mode=0o755)
    assert paths.cache_folder() == home / "drake-glider"
    assert mode_of(home / "drake-glider") == 0o700


def test_a_cache_that_others_could_write_is_not_used(home):
    """Whatever they put there would be run."""
    shared = home / "drake-glider"
    shared.mkdir()
    shared.chmod(0o777)
    folder = paths.cache_folder()
    assert shared not in (folder, *folder.parents)
    assert mode_of(folder) == 0o700


def test_a_cache_of_another_user_is_not_used(home, monkeypatch):
    folder = paths.cache_folder()
    monkeypatch.setattr(os, "getuid", lambda: folder.stat().st_uid + 1)
    assert paths.cache_folder() != folder


def test_without_a_place_for_caches_a_process_has_its_own(home, monkeypatch):
    """Its name cannot be guessed, so nobody can put a kernel there before."""
    (home / "drake-glider").write_text("a file is in the way")
    folder = paths.cache_folder()
    assert folder == paths.cache_folder()
    assert folder.parent == Path(tempfile.gettempdir())
    assert folder.name != f"drake-glider-{os.getuid()}"
    assert mode_of(folder) == 0o700
    command = "from glider.paths import cache_folder; print(cache_folder())"
    child = subprocess.run(
        [sys.executable, "-c", command], capture_output=True, text=True, check=True
    )
    assert child.stdout.strip() == str(folder)
    assert folder.is_dir()
