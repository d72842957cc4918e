"""Numbers in messages are as people write them."""

import errno
import warnings

import numpy as np
import pytest

from diagrams.programs import program
from glider.errors import InputError, os_error_line, show
from glider.physics.parameters import check_parameters
from glider.planning.problem import PerchingProblem


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (np.float64(0.6333333333333333), "0.633333"),
        (0.1 + 0.2, "0.3"),
        (np.int64(3), "3"),
        (np.array([[1.0, 0.25]]), "[[1.0, 0.25]]"),
        ((np.float64(-0.4463), 0.9473), "[-0.4463, 0.9473]"),
        ({"x": np.float64(0.5)}, "{x: 0.5}"),
        (np.nan, "nan"),
        ("a word", "'a word'"),
        (None, "None"),
        ("long" * 50, "'" + "long" * 19 + "lon..."),
    ],
)
def test_what_was_found_is_written_plainly(value, text):
    assert show(value) == text


def test_what_a_few_aliases_make_endless_is_cut_off_at_once():
    """As hostile YAML has it: nine times nine, nine levels deep, or itself."""
    nested = [1] * 9
    for _ in range(20):
        nested = [nested] * 9
    assert show(nested).startswith("[[[[") and show(nested).endswith("...")
    nested.clear()
    nested.append(nested)
    assert show(nested) == "[" * 80 + "..."


def test_messages_do_not_name_numpy():
    with pytest.raises(InputError, match=r"'elevator_limits' is \[0\.5, 0\.2\]"):
        check_parameters({"elevator_limits": [np.float64(0.5), 0.2]})
    with pytest.raises(InputError) as error:
        PerchingProblem(x_limits=[np.float64(2.0), np.float64(1.0)])
    assert "np." not in str(error.value)


def test_a_full_disk_is_told_with_what_to_do():
    line = os_error_line(OSError(errno.ENOSPC, "No space left on device", "out/a"))
    assert line.startswith("out/a: No space left on device; the disk must have room")
    assert line.count(".") == 1


def test_a_program_prints_a_warning_without_a_place_in_its_source(capsys):
    with warnings.catch_warnings():
        warnings.simplefilter("always")
        assert program.run(lambda: warnings.warn("mass not given", stacklevel=2)) == 0
    assert capsys.readouterr().err == "warning: mass not given\n"
