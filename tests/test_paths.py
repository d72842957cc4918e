"""The models are found from a source tree and from an installed wheel."""

import re

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
