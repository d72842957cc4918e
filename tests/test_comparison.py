"""A change shows where it is beyond the standard errors, and else it does not."""

import dataclasses
import io
import json
import math
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

from glider.__main__ import main
from glider.comparison import _FALSE_ALARM, compare, print_comparison
from glider.errors import InputError
from glider.files.schema import json_text
from glider.sysid.result import Estimate, read_report
from tests.report.results import VARIANTS, WIND, make_result


def save(folder, result):
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "report.json").write_text(json_text(result.report), encoding="utf-8")
    return folder


def load(path):
    return read_report(path)[0]


def windy(x, std, **changes):
    wind = {"x": Estimate(value=x, std=std, unit="m/s"), "z": WIND.coefficients["z"]}
    effect = dataclasses.replace(WIND, coefficients=wind)
    return make_result(effects=(effect,), **changes)


def shown(first, second):
    raw = io.BytesIO()
    file = io.TextIOWrapper(raw, encoding="utf-8", write_through=True)
    console = Console(file=file, width=80)
    files = Path("a/report.json"), Path("b/report.json")
    pairs = zip((first, second), files, strict=True)
    print_comparison(compare(first, second), *pairs, console)
    return raw.getvalue().decode()


def test_a_change_has_the_errors_of_both():
    """Wind that changed by 0.1 ± 0.005 m/s, between campaigns of other names."""
    second = windy(-0.5, 0.004, campaign="later")
    comparison = compare(windy(-0.6, 0.003), second)
    found = {d.name: d for d in comparison.differences}
    wind = found["wind.x"]
    assert wind.change.value == pytest.approx(0.1)
    assert wind.change.std == pytest.approx(0.005)
    assert wind.z == pytest.approx(20.0)
    assert comparison.is_significant(wind)
    assert found["wind.z"].z == 0.0
    spread = found["elevator_trim, from flight to flight"]
    assert spread.first.std == pytest.approx(0.0203 / math.sqrt(2.0))  # Two flights.
    assert comparison.summary == "1 of 4 values changed beyond 3.0 σ."


def test_alike_gliders_seldom_differ():
    """Of campaigns that only noise sets apart one in a hundred shows a change."""
    rng = np.random.default_rng(1)
    saved = make_result()
    effect = saved.effects[0]
    alarms = 0
    for _ in range(2000):
        both = []
        for _ in range(2):
            drawn = {
                name: dataclasses.replace(c, value=c.std * rng.normal())
                for name, c in effect.coefficients.items()
            }
            effects = (dataclasses.replace(effect, coefficients=drawn),)
            both.append(dataclasses.replace(saved, effects=effects, spreads={}))
        comparison = compare(*both)
        alarms += any(map(comparison.is_significant, comparison.differences))
    # Three numbers are compared, of which the vehicle's one is the same.
    assert 0.3 * _FALSE_ALARM < alarms / 2000 < 1.5 * _FALSE_ALARM


@pytest.mark.parametrize("size, changed", [(-0.6, True), (-0.015, False)])
def test_an_effect_that_one_report_lacks_is_none_there(size, changed):
    """A wind of 5 standard errors may be missed by chance, one of 200 not."""
    comparison = compare(windy(size, 0.003), make_result(effects=()))
    wind = next(d for d in comparison.differences if d.name == "wind.x")
    assert wind.second.value == 0.0
    assert comparison.is_significant(wind) == changed
    # Not where it was not tried.
    untried = make_result(effects=(), settings={"effects": ["mass"]})
    differences = compare(windy(size, 0.003), untried).differences
    assert next(d for d in differences if d.name == "wind.x").second is None


def test_numbers_of_other_units_are_not_subtracted():
    vehicle = {"wing_area_per_mass": Estimate(value=0.1, std=0.02, unit="m²")}
    comparison = compare(make_result(), make_result(vehicle=vehicle))
    [area] = [d for d in comparison.differences if d.name.startswith("vehicle.")]
    assert area.change is None


def test_doubts_are_told():
    summary = compare(make_result(), VARIANTS["not trusted"]).summary
    assert "The verdict on B is not trusted" in summary
    assert "verdict on A" not in summary


@pytest.mark.parametrize("name", VARIANTS)
def test_any_two_reports_can_be_compared(name):
    pair = make_result(), VARIANTS[name]
    for first, second in (pair, pair[::-1]):
        text = shown(first, second)
        assert max(map(len, text.splitlines())) <= 80
        assert "…" not in text
        for word in ("nan", "inf", "None"):
            assert f" {word} " not in text
        json.loads(json_text(compare(first, second)), parse_constant=pytest.fail)


@pytest.mark.parametrize(
    "change, message",
    [
        (lambda d: d.pop("effects"), "'effects' is missing .run close-the-loop again"),
        (lambda d: d["effects"][0].pop("kind"), r"'effects\[0\].kind' is missing"),
        (lambda d: d.update(vehicle=[]), r"'vehicle' is \[\]; expected a mapping"),
        (
            lambda d: d["effects"][0]["coefficients"]["x"].update(value="much"),
            r"'effects\[0\].coefficients.*.value' is .*'much'.*; expected a number",
        ),
        (
            lambda d: d["errors"].update(as_drawn=None),
            "a model of 'errors' is 'as.drawn'; expected .*run close-the-loop",
        ),
    ],
)
def test_a_fault_of_a_report_is_named(tmp_path, change, message):
    folder = save(tmp_path / "a", make_result())
    data = json.loads((folder / "report.json").read_text("utf-8"))
    change(data)
    (folder / "report.json").write_text(json.dumps(data), "utf-8")
    with pytest.raises(InputError, match=message):
        load(folder)


def test_what_is_no_report_is_told(tmp_path):
    with pytest.raises(InputError, match="of close-the-loop, to be run first"):
        load(tmp_path)
    (tmp_path / "report.json").write_text("no")
    with pytest.raises(InputError, match="not readable as JSON"):
        load(tmp_path)


def test_the_command_prints_a_table_or_json(tmp_path, capsys):
    first = save(tmp_path / "a", windy(-0.6, 0.003))
    second = save(tmp_path / "b", windy(-0.5, 0.004))
    command = ["compare", str(first), str(second)]
    assert main(command) == 0
    said = capsys.readouterr().out
    assert "wind.x [m/s]" in said
    joined = "".join(said.split())  # Long paths are wrapped.
    assert f"A:{first}," in joined and f"B:{second}," in joined
    assert "+0.100" in said
    assert main([*command, "--json"]) == 0
    data = json.loads(capsys.readouterr().out)
    [wind] = [d for d in data["differences"] if d["name"] == "wind.x"]
    assert wind["change"]["value"] == pytest.approx(0.1)
    assert wind["z"] > data["z_significant"]
    assert main(["compare", str(first), str(tmp_path / "none")]) == 2
    assert (
        "not a report.json of close-the-loop, to be run first"
        in capsys.readouterr().err
    )


def test_a_pipe_that_takes_ascii_alone_gets_what_it_can_show(tmp_path, monkeypatch):
    raw = io.BytesIO()
    pipe = io.TextIOWrapper(raw, encoding="ascii", write_through=True)
    monkeypatch.setattr("sys.stdout", pipe)
    folder = str(save(tmp_path / "a", make_result()))
    assert main(["compare", folder, folder]) == 0
    assert "-0.600 ? 0.003" in raw.getvalue().decode("ascii")
