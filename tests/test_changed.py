"""`make quick` runs the tests of what has changed."""

import pytest

from tests.changed import ROOT, folder_of


@pytest.mark.parametrize(
    ("path", "tests"),
    [
        ("glider/physics/effects/wrench.py", "tests/physics"),
        ("glider/sysid/replay/record.py", "tests/sysid"),
        ("diagrams/scene.py", "tests/diagrams"),
        ("examples/perch.py", "tests/examples"),
        ("tests/test_floors.py", "tests/test_floors.py"),
        ("tests/physics/test_chain.py", "tests/physics/test_chain.py"),
        ("tests/physics/test_gone.py", None),
        ("tests/helpers/physics.py", None),
        ("glider/errors.py", None),
        ("README.md", None),
    ],
)
def test_a_changed_file_means_the_folder_of_its_package(path, tests):
    assert folder_of(path) == tests


def test_every_package_has_tests():
    packages = [p.parent for p in (ROOT / "glider").glob("*/__init__.py")]
    assert {folder_of(f"glider/{p.name}/a.py") for p in packages} == {
        f"tests/{p.name}" for p in packages
    }
