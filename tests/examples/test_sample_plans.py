"""The example of sampled plans tells its story in numbers."""

import json

import numpy as np
import pytest

from diagrams.showing import run
from examples import sample_plans


def test_planning_anew_perches_where_a_replayed_plan_misses(tmp_path, capsys):
    out, figure = tmp_path / "s.json", tmp_path / "s.png"
    sample_plans.main(
        [
            *("--searches", "3", "--launches", "3", "--headless"),
            *("--json", str(out), "--figure", str(figure)),
        ]
    )
    figures = json.loads(out.read_text())
    receding = figures["receding"]
    assert receding["truth"] == "set_wing"
    assert receding["perched"] == len(receding["miss_m"]) == 3
    assert max(receding["miss_m"]) < 0.05 < min(receding["open_loop_miss_m"])
    assert min(receding["tracking_miss_m"]) > 0.05
    assert receding["real_time_factor"] > 0.0
    assert figures["rollouts_per_second"] > 1000.0
    for name, least, largest in (("cem", 8.0, 15.0), ("mppi", 11.0, 15.5)):
        costs = figures[name]
        assert len(costs["cost"]) == 101
        assert least < costs["cost"][-1] < largest
        assert np.all(np.array(costs["lowest"]) <= costs["cost"])
        assert np.all(np.array(costs["highest"]) >= costs["cost"])
    assert figure.stat().st_size > 10_000
    assert "set_wing, MPPI, planning anew: 3 of 3 perch" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--truth", "tail_wind"), "'tail_wind'"),
        (("--json", "nowhere/s.json"), "nowhere does not exist"),
    ],
)
def test_a_user_s_fault_is_one_sentence(options, words, capsys):
    assert run(lambda: sample_plans.main([*options, "--headless"])) == 2
    said = capsys.readouterr().err
    assert words in said
    assert said.count("\n") == 1
