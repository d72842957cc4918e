"""The examples tell the story that they promise, in numbers too."""

import json
from types import SimpleNamespace

import numpy as np
import pytest

from diagrams.showing import run
from diagrams.simulate import simulate_flights
from diagrams.studies.rehearsal import (
    load_truth,
    rehearse,
)
from examples import perch, perch_corrected
from glider.errors import InputError
from glider.paths import models_path
from glider.physics.effects import (
    PITCH_DAMPING,
    WIND,
)
from glider.physics.model import (
    GliderModel,
    save_model,
)
from glider.planning.dircol import PlanningError
from glider.planning.plan import Attempt
from glider.planning.problem import PerchingProblem
from glider.simulation.monte_carlo import (
    LaunchSpread,
    draw_launches,
)
from tests.helpers.physics import FIELD


def test_perch_plans_replays_and_flies(tmp_path, capsys, monkeypatch):
    flown = []
    monkeypatch.setattr(
        perch,
        "simulate_flights",
        lambda *args, **options: (
            flown.append(simulate_flights(*args, **options)) or flown[-1]
        ),
    )
    out, figure, page = (tmp_path / n for n in ("p.json", "p.png", "p.html"))
    perch.main(
        [
            *("--launches", "4", "--headless", "--json", str(out)),
            *("--figure", str(figure), "--html", str(page)),
        ]
    )
    figures = json.loads(out.read_text())
    assert figures["cost"] == pytest.approx(194.05, abs=0.1)
    assert figures["duration"] == pytest.approx(0.8795, abs=1e-3)
    assert figures["knots"] == 41
    assert figures["max_defect"] < 1e-5
    assert figures["open_loop_miss_m"] < 0.001
    assert len(figures["closed_loop_miss_m"]) == figures["launches"] == 4
    assert figures["perched"] == 4
    _, replayed, fed_back = flown
    for name, flights in (
        ("open_loop_from_launches_miss_m", replayed),
        ("closed_loop_miss_m", fed_back),
    ):
        assert figures[name] == [flight.miss for flight in flights]
    blind, guided = (
        np.median(figures[name])
        for name in ("open_loop_from_launches_miss_m", "closed_loop_miss_m")
    )
    assert guided < 0.1 * blind
    assert "194.05" in capsys.readouterr().out
    assert figure.stat().st_size > 10_000
    assert "Perch" in page.read_text()


@pytest.mark.slow
def test_the_corrected_model_perches_where_the_drawn_one_misses(tmp_path):
    out = tmp_path / "c.json"
    perch_corrected.main(
        [
            *("--truth", "head_wind", "--launches", "10", "--seed", "3"),
            *("--headless", "--json", str(out), "--figure", str(tmp_path / "c.png")),
        ]
    )
    figures = json.loads(out.read_text())
    assert figures["effect_true"] == "wind"
    assert figures["effect_found"] == ["wind"]
    assert figures["before"]["perched"] <= 2
    assert figures["after"]["perched"] == figures["launches"] == 10
    assert max(figures["after"]["miss_m"]) < 0.05 < min(figures["before"]["miss_m"])
    assert (tmp_path / "c.png").stat().st_size > 10_000


def test_a_rehearsal_is_repeatable_and_its_logs_are_of_the_flights():
    problem, drawing = PerchingProblem(wire=[-0.2, -0.1]), GliderModel()
    starts = draw_launches(problem, LaunchSpread(), 3, np.random.default_rng(0))
    first, again = (
        rehearse(drawing, drawing, problem, starts, np.random.default_rng(1))
        for _ in range(2)
    )
    assert first.misses == again.misses
    assert first.perched == 3
    assert [f.name for f in first.campaign.flights] == [
        f"flight_{k:03d}.csv" for k in range(3)
    ]
    for flight, log in zip(first.flights, first.campaign.flights, strict=True):
        path = np.array(
            [np.interp(log.time, flight.times, column) for column in flight.states.T]
        )
        # Between the integrator's steps a straight line is a millimeter off.
        np.testing.assert_allclose(log.pose[:, :2], path[:2].T, atol=0.004)
        assert not np.allclose(log.pose[:, 2], path[2], atol=1e-4)  # Noise.


@pytest.mark.parametrize(
    ("truth", "expected"),
    [
        (GliderModel(), "nothing"),
        (GliderModel(effects=(WIND(x=-1.0), PITCH_DAMPING())), "wind + pitch_damping"),
        (GliderModel(effects=(WIND(x=-1.0),), field=FIELD), "wind + rbf_residual"),
    ],
)
def test_what_is_true_is_told_as_it_is(tmp_path, monkeypatch, truth, expected):
    """Of files with several effects or none; nothing is flown here."""
    save_model(tmp_path / "truth.yaml", truth)
    flown = SimpleNamespace(misses=[0.1], perched=0, campaign=None, plan=None)
    found = SimpleNamespace(effects=(), model=GliderModel())
    for name, result in (
        ("rehearse", flown),
        ("close_the_loop", found),
        ("headline", "found nothing"),
        ("flight_track", None),
        ("plan_track", None),
        ("show", None),
    ):
        monkeypatch.setattr(perch_corrected, name, lambda *_, _r=result, **__: _r)
    flown.flights = [None]
    out = tmp_path / "c.json"
    perch_corrected.main(
        ["--truth", str(tmp_path / "truth.yaml"), "--headless", "--json", str(out)]
    )
    assert json.loads(out.read_text())["effect_true"] == expected


@pytest.mark.parametrize("main", [perch.main, perch_corrected.main])
@pytest.mark.parametrize(
    ("option", "name"), [("--json", "a.json"), ("--html", "a.html"), ("--figure", "a")]
)
def test_a_file_without_a_folder_is_refused_before_the_work(
    tmp_path, monkeypatch, main, option, name, capsys
):
    def work(*_):
        raise AssertionError("the work has begun")

    for module in (perch, perch_corrected):
        monkeypatch.setattr(module, "draw_launches", work)
    arguments = [option, str(tmp_path / "absent" / name), "--headless"]
    assert run(lambda: main(arguments)) == 2
    assert "absent does not exist" in capsys.readouterr().err


def test_every_shipped_truth_is_a_model_with_one_effect_or_a_field():
    names = [path.stem for path in models_path("truths").glob("*.yaml")]
    assert len(names) >= 6
    for name in names:
        truth = load_truth(name)
        assert (len(truth.effects) == 1) != (truth.field is not None)


def test_an_unknown_truth_is_refused_with_the_known_ones():
    with pytest.raises(InputError, match=r"'tail_wind'.*head_wind"):
        load_truth("tail_wind")


def test_a_truth_that_is_not_there_is_one_sentence(capsys):
    args = ["--truth", "nowhere.yaml", "--headless"]
    assert run(lambda: perch_corrected.main(args)) == 2
    assert capsys.readouterr().err.count("\n") == 1


def test_a_problem_without_a_plan_is_one_sentence(capsys):
    attempt = Attempt(
        knots=25,
        solver="SNOPT",
        guess="a straight line over 0.80 s",
        tolerance=1e-6,
        solved=False,
        status="InfeasibleConstraints (13)",
        seconds=0.1,
    )

    def fail():
        raise PlanningError({"position at the wire": 0.25}, (attempt,))

    assert run(fail) == 2
    assert "position at the wire by 0.25" in capsys.readouterr().err
