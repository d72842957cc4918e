"""A change shows where it is beyond the standard errors, and else it does not."""

import dataclasses
import io
import json
import math

import numpy as np
import pytest
from rich.console import Console

from glider.__main__ import main
from glider.comparison import (
    FALSE_ALARM,
    compare,
    headline,
    load_report,
    print_comparison,
    to_json,
)
from glider.errors import InputError
from glider.files.schema import json_text
from glider.physics.parameters import GliderParameters
from glider.sysid.result import Estimate
from tests.report.results import VARIANTS, WIND, make_result


def save(folder, result):
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "report.json").write_text(json_text(result.report), encoding="utf-8")
    return folder


def windy(x, std, **changes):
    wind = {"x": Estimate(value=x, std=std, unit="m/s"), "z": WIND.coefficients["z"]}
    effect = dataclasses.replace(WIND, coefficients=wind)
    return make_result(effects=(effect,), **changes)


@pytest.fixture
def changed(tmp_path):
    """Wind that changed by 0.1 ± 0.005 m/s, between campaigns of other names."""
    first = save(tmp_path / "a", windy(-0.6, 0.003))
    second = save(tmp_path / "b", windy(-0.5, 0.004, campaign="later"))
    return compare(load_report(first), load_report(second / "report.json"))


def shown(comparison, encoding="utf-8"):
    raw = io.BytesIO()
    file = io.TextIOWrapper(raw, encoding=encoding, write_through=True)
    print_comparison(comparison, Console(file=file, width=80))
    return raw.getvalue().decode(encoding)


def test_a_change_has_the_errors_of_both(changed):
    found = {d.label: d for d in changed.differences}
    wind = found["wind.x"]
    assert wind.change.value == pytest.approx(0.1)
    assert wind.change.std == pytest.approx(0.005)
    assert wind.z == pytest.approx(20.0)
    assert changed.is_significant(wind)
    assert found["wind.z"].z == 0.0
    spread = found["elevator_trim"]
    assert spread.first.std == pytest.approx(0.0203 / math.sqrt(2.0))  # Two flights.
    assert headline(changed) == (
        "Changed: wind.x by +0.100 ± 0.005 m/s (20.0 σ). 3 values agree within 3.0 σ."
    )


def test_alike_gliders_seldom_differ(tmp_path):
    """Of campaigns that only noise sets apart one in a hundred shows a change."""
    rng = np.random.default_rng(1)
    saved = load_report(save(tmp_path / "a", make_result()))
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
    assert 0.3 * FALSE_ALARM < alarms / 2000 < 1.5 * FALSE_ALARM


def test_what_one_report_lacks_is_told_and_not_called_a_change(tmp_path):
    first = save(tmp_path / "a", make_result())
    second = save(tmp_path / "b", make_result(effects=(), candidates={}))
    comparison = compare(load_report(first), load_report(second))
    missing = [d for d in comparison.differences if d.kind == "wind"]
    assert [d.second for d in missing] == [None, None]
    assert not any(map(comparison.is_significant, missing))
    assert missing[0].note == "not tried there"
    assert "Only A shows a steady wind." in headline(comparison)


def test_an_effect_under_another_name_is_told(tmp_path):
    tilt = dataclasses.replace(WIND, kind="frame_tilt", words="a tilted frame")
    first = save(tmp_path / "a", make_result())  # Could be a frame_tilt, it says.
    second = save(tmp_path / "b", make_result(effects=(tilt,)))
    comparison = compare(load_report(first), load_report(second))
    notes = {d.note for d in comparison.differences if d.kind == "wind"}
    assert notes == {"may be its frame_tilt: indistinguishable on these flights"}
    only_b = "Only B shows a motion-capture frame that is not level."
    assert f"Only A shows a steady wind. {only_b}" in headline(comparison)


def test_numbers_of_other_units_are_not_subtracted(tmp_path):
    vehicle = {"wing_area_per_mass": Estimate(value=0.1, std=0.02, unit="m²")}
    first = save(tmp_path / "a", make_result())
    second = save(tmp_path / "b", make_result(vehicle=vehicle))
    comparison = compare(load_report(first), load_report(second))
    (area,) = [d for d in comparison.differences if d.group == "vehicle"]
    assert area.change is None
    assert area.note == "units differ: m²/kg and m²"


def test_a_parameter_that_one_report_lacks_is_reported(tmp_path):
    """Servo limits are no part of a report whose campaign does not give them."""
    first = load_report(save(tmp_path / "a", make_result()))
    specified = GliderParameters()
    unlimited = dataclasses.replace(specified, elevator_limits=None)
    pair = (
        dataclasses.replace(first, given=specified),
        dataclasses.replace(first, campaign="other", given=unlimited),
    )
    [note] = compare(*pair).notes
    assert note.startswith("elevator_limits is -0.4463, 0.9473 for A, not given for B:")
    [note] = compare(*reversed(pair)).notes
    assert note.startswith("elevator_limits is not given for A, -0.4463, 0.9473 for B:")


def test_doubts_are_told(tmp_path):
    first = load_report(save(tmp_path / "a", make_result()))
    second = load_report(save(tmp_path / "b", VARIANTS["not trusted"]))
    notes = " ".join(compare(first, second).notes)
    assert "The verdict on B is not trusted" in notes
    assert "2 fitted flights of the same name" in notes
    assert not compare(first, dataclasses.replace(first, campaign="other")).notes


@pytest.mark.parametrize("name", VARIANTS)
@pytest.mark.parametrize("encoding", ["utf-8", "ascii"])
def test_any_two_reports_can_be_compared(tmp_path, name, encoding):
    first = load_report(save(tmp_path / "a", make_result()))
    second = load_report(save(tmp_path / "b", VARIANTS[name]))
    for comparison in (compare(first, second), compare(second, first)):
        text = shown(comparison, encoding)
        assert max(map(len, text.splitlines())) <= 80
        assert "…" not in text
        for word in ("nan", "inf", "None"):
            assert f" {word} " not in text
        json.loads(to_json(comparison), parse_constant=pytest.fail)


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
        load_report(folder)


def test_what_is_no_report_is_told(tmp_path):
    with pytest.raises(InputError, match="of close-the-loop: No such file"):
        load_report(tmp_path)
    (tmp_path / "report.json").write_text("no")
    with pytest.raises(InputError, match="not readable as JSON"):
        load_report(tmp_path)


def test_the_command_prints_a_table_or_json(tmp_path, capsys):
    first = save(tmp_path / "a", windy(-0.6, 0.003))
    second = save(tmp_path / "b", windy(-0.5, 0.004))
    command = ["compare", str(first), str(second)]
    assert main(command) == 0
    said = capsys.readouterr().out
    assert "x [m/s]" in said
    assert "Changed: wind.x by +0.100" in " ".join(said.split())
    assert main([*command, "--json"]) == 0
    data = json.loads(capsys.readouterr().out)
    (wind,) = [d for d in data["differences"] if d["name"] == "wind.x"]
    assert wind["change"] == {"value": pytest.approx(0.1), "std": pytest.approx(0.005)}
    assert wind["is_significant"] is True
    assert main(["compare", str(first), str(tmp_path / "none")]) == 2
    assert (
        "not a report.json of close-the-loop: No such file" in capsys.readouterr().err
    )
