"""Prints the tests of what has changed: `make quick` runs them.

Changed is what is not committed yet, or else what the last commit changed. A change of
a package's module means the tests in the folder of that name.
"""

import subprocess
from pathlib import Path

ROOT = Path(__file__).parents[1]

ALWAYS = ("tests/test_floors.py", "tests/test_front_door.py", "tests/test_shape.py")


def changed_files() -> list[str]:
    """Returns paths from the root, as git has them."""
    for command in (
        ("diff", "--name-only", "HEAD"),
        ("ls-files", "--others", "--exclude-standard"),
        ("diff", "--name-only", "HEAD~1", "HEAD"),
    ):
        found = subprocess.run(
            ["git", *command], cwd=ROOT, capture_output=True, text=True, check=False
        )
        if found.stdout.strip():
            return found.stdout.split()
    return []


def folder_of(path: str, root: Path = ROOT) -> str | None:
    """Returns the test file or the folder of tests of a changed file.

    None where none is known: of a deleted test, a page, a figure.
    """
    parts = Path(path).parts
    if parts[0] == "tests" and Path(path).name.startswith("test_"):
        return path if (root / path).exists() else None
    package = parts[1] if parts[0] in ("glider", "tests") else parts[0]
    folder = f"tests/{package}"
    return folder if (root / folder).is_dir() and package != "helpers" else None


if __name__ == "__main__":
    found = {folder_of(path) for path in changed_files() if path.endswith(".py")}
    if "tests/physics" in found:
        found.add("tests/helpers/test_lifelike.py")  # The independent simulator.
    print(*sorted({*filter(None, found), *ALWAYS}))
