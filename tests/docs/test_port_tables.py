"""Ports that docstrings list become tables, with nothing lost."""

import importlib
import inspect
from pathlib import Path

import pytest

from glider.systems.elevator_servo import ElevatorServo
from glider.systems.kalman_filter import ExtendedKalmanFilter
from glider.systems.mpc import ModelPredictiveController
from glider.systems.plant import GliderPlant

EXTENSIONS = Path(__file__).parents[2] / "docs" / "extensions"

PORTS = {
    GliderPlant: ["elevator_rate", "wind", "state", "forces", "pose"],
    ElevatorServo: ["command", "state", "elevator_rate"],
    ModelPredictiveController: ["state", "elevator_rate", "timing"],
}


@pytest.fixture
def port_tables(monkeypatch):
    monkeypatch.syspath_prepend(EXTENSIONS)
    return importlib.import_module("port_tables")


@pytest.mark.parametrize("system", [*PORTS, ExtendedKalmanFilter])
def test_each_port_has_a_row_and_each_word_is_kept(port_tables, system):
    lines = inspect.getdoc(system).splitlines()
    made = port_tables.with_tables(lines)
    assert sum(line.startswith(".. list-table:: ") for line in made) == 2
    rows = [line.split("``")[1] for line in made if line.startswith("   * - ``")]
    assert rows == PORTS.get(system, rows)
    assert rows
    heads = port_tables.head_of("Input ports") + port_tables.head_of("Output ports")
    words = " ".join(made).split()
    for word in " ".join(heads).split():
        words.remove(word)
    before = " ".join(lines).replace("Input ports:", "").replace("Output ports:", "")
    assert sorted(_letters(words)) == sorted(_letters(before.split()))


def _letters(words):
    """Returns the letters and digits of words, without the marks of a table."""
    return [c for word in words for c in word if c.isalnum()]


@pytest.mark.parametrize(
    ("name", "is_shown"),
    [
        ("set_tape", True),
        ("at_rest", True),
        ("ToAutoDiffXdMaybe", False),
        ("ToScalarType𝓣float𝓤", False),
        ("GliderPlant_𝓣float𝓤", False),
        ("DoCalcTimeDerivatives", False),
    ],
)
def test_what_drake_adds_to_a_class_is_left_out(port_tables, name, is_shown):
    skipped = port_tables.skip(None, "class", name, None, False, None)
    assert skipped is (None if is_shown else True)
