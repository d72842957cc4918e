"""Commands as a file, and as a Drake source that plays it."""

import numpy as np
import pytest

from glider.errors import InputError
from glider.systems.command_tape import command_source, load_commands, tape_text

TIMES = 0.02 * np.arange(4)
COMMANDS = np.array([0.0, 12.35, -3.25, 7.5])


@pytest.fixture
def path(tmp_path):
    path = tmp_path / "commands_1.csv"
    path.write_text(tape_text(TIMES, COMMANDS, 0.08))
    return path


def test_a_tape_comes_back_with_its_end(path):
    times, commands = load_commands(path)
    assert np.array_equal(times, [*TIMES, 0.08])
    assert np.array_equal(commands, [*COMMANDS, 0.0])


def test_the_source_holds_each_command_and_then_stands_still(path):
    source = command_source(path)
    context = source.CreateDefaultContext()

    def at(time):
        context.SetTime(time)
        return source.get_output_port().Eval(context)[0]

    for time, command in zip(TIMES, COMMANDS, strict=True):
        assert at(time + 1e-9) == command
        assert at(time + 0.019) == command
    assert at(0.081) == 0.0
    assert at(5.0) == 0.0


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "line 1 is ''; expected time,"),
        ("time,rate\n", "line 1 is 'time,rate'; expected"),
        ("time,elevator_rate_command\n0,1\n", "the number of rows is 1"),
        ("time,elevator_rate_command\n0,1\n0.02,nan\n", "line 3"),
        ("time,elevator_rate_command\n0,1\n0.02\n", "line 3"),
        ("time,elevator_rate_command\n0.1,1\n0.05,1\n", "'0.05,1'; expected a time"),
    ],
)
def test_what_is_no_tape_is_told_by_its_line(tmp_path, text, words):
    path = tmp_path / "tape.csv"
    path.write_text(text)
    with pytest.raises(InputError, match=words):
        command_source(path)


def test_a_missing_file_is_told(tmp_path):
    with pytest.raises(InputError, match="cannot be read"):
        load_commands(tmp_path / "none.csv")
