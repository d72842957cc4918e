"""A perching problem reads what is meant and refuses what cannot be."""

import pytest

from glider.errors import InputError
from glider.paths import models_path
from glider.planning.problem import PerchingProblem


def test_the_shipped_problem_is_the_default_one():
    shipped = PerchingProblem.load(models_path("problems", "perching.yaml"))
    assert shipped == PerchingProblem()


def test_a_file_gives_only_what_differs(tmp_path):
    path = tmp_path / "near.yaml"
    path.write_text("launch: [-2.0, 0.0, 0.0, 0.0, 6.0, 0.0, 0.0]\n")
    problem = PerchingProblem.load(path)
    assert problem.launch[0] == -2.0
    assert problem.rate_cost == 100.0


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("launch: [1.0, 2.0]", ("'launch'", "7 finite numbers", "pitchdot")),
        ("rate_cost: -1.0", ("'rate_cost'", "negative")),
        ("pitch_limits: [1.0, -1.0]", ("'pitch_limits'", "lower < upper")),
        ("wire: [0.0, .nan]", ("'wire'", "finite")),
        ("final_speed_limit: 0.0", ("'final_speed_limit'", "positive")),
        ("hook: {reach: 0.0}", ("'hook.reach'", "positive")),
        ("hook: {speed_limit: -2.8}", ("'hook.speed_limit'", "positive")),
        ("hook: {pitch_limits: [-0.35, -1.17]}", ("'hook.pitch_limits'", "lower < up")),
        ("hook: {pitch_limits: [-1.0]}", ("'hook.pitch_limits'", "2 finite numbers")),
        ("hook: {strength: 2.0}", ("unknown field 'strength' of hook", "reach")),
        ("launhc: [0.0]", ("unknown field 'launhc'", "did you mean 'launch'?")),
        ("launch: fast", ("'launch' is 'fast'; expected a list",)),
        ("5: 6", ("unknown field 5, expected one of launch",)),
        ("launch: [0.0, 0.1, 0.0, 0.0, 0.0, 0.0, 1.0]", ("'launch'", "other than 0")),
        ("launch: [-3.5, 0.1, 10, 0, 7.0, 0, 0]", ("'launch'", "within ±π rad")),
        ("goal: [0, 0, -45, 0, 0, 0, 0]", ("'goal'", "within ±π rad")),
        ("wire: [1.1, 0.0]", ("'wire'", "'x_limits'")),
        ("wire: [0.0, -1.1]", ("'wire'", "'z_limits'")),
    ],
)
def test_what_cannot_be_is_refused_with_its_place(tmp_path, text, words):
    path = tmp_path / "odd.yaml"
    path.write_text(text + "\n")
    with pytest.raises(InputError) as caught:
        PerchingProblem.load(path)
    for word in ("odd.yaml", *words):
        assert word in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_name_that_does_not_ship_is_refused_with_those_that_do():
    assert PerchingProblem.load("perching") == PerchingProblem()
    with pytest.raises(InputError, match=r"^peching: does not exist.*perching_hook"):
        PerchingProblem.load("peching")


def test_a_file_that_is_not_there_is_refused(tmp_path):
    with pytest.raises(InputError, match=r"nowhere\.yaml"):
        PerchingProblem.load(tmp_path / "nowhere.yaml")
