"""The charts of a page show the numbers of the figures and tables, and stay small."""

import dataclasses
import math

import numpy as np
import pytest

from glider.report.chart import numbers, symlog
from glider.report.charts import CHARTS, DARK_KEYS, LIGHT_KEYS, make_charts
from glider.report.error_table import noise_floor
from glider.report.figures import FIGURES
from glider.report.flight_charts import MOST_FLIGHTS, flights_in_page
from glider.report.flight_errors import distance
from glider.report.page import to_html
from tests.report.results import VARIANTS, make_flight, make_result


def keyed(panel, key):
    return [t for t in panel.traces if t["key"] == key]


@pytest.fixture(params=VARIANTS)
def variant(request):
    return VARIANTS[request.param]


def test_each_figure_has_its_chart(variant):
    assert CHARTS.keys() == FIGURES.keys()
    for name, draw in FIGURES.items():
        assert (draw(variant) is None) == (CHARTS[name](variant) is None)


def test_every_trace_is_in_the_legend_and_has_both_colors(variant):
    for chart in make_charts(variant).values():
        panels = [*chart.panels, *(p for c in chart.choices for p in c.panels)]
        drawn = {t["key"] for panel in panels for t in panel.traces if len(t["x"])}
        assert drawn <= chart.keys.keys()
    assert LIGHT_KEYS.keys() == DARK_KEYS.keys()


def test_bars_are_the_errors_and_their_noise():
    result = make_result()
    chart = CHARTS["errors"](result)
    place = chart.panels[2]
    (bars,) = keyed(place, "nominal")
    assert bars["y"] == [413.0, 900.0, 220.0]
    (noise,) = keyed(place, "noise")
    floor = [noise_floor(result, f) for f in ("position_rms_m", "position_end_m")]
    np.testing.assert_allclose(noise["y"][:2], np.array(floor) * 1e3, rtol=1e-4)


def test_noise_of_accelerations_is_that_of_held_out_flights():
    result = make_result()
    table = result.residual_after
    assert noise_floor(result, "normal") == pytest.approx(0.002)
    noise = table.noise.copy()
    noise[table.flight == 0] = 5.0
    louder = dataclasses.replace(table, noise=noise)
    unseen = make_result(
        residual_after=louder, held_out_flights=result.held_out_flights[1:]
    )
    assert noise_floor(unseen, "normal") == pytest.approx(0.002)
    assert noise_floor(make_result(residual_after=louder), "normal") > 1.0
    assert math.isnan(noise_floor(make_result(held_out_flights=()), "normal"))


def test_held_out_flights_are_told_as_they_are():
    result = make_result()
    chart = CHARTS["held_out"](result)
    assert [c.label for c in chart.choices] == [f"flight_1{i:02d}" for i in range(6)][
        ::-1
    ]
    assert sum(c.is_shown for c in chart.choices) == 4
    flight = result.held_out[5]
    path, pitch, apart = chart.choices[0].panels
    (line,) = keyed(path, "corrected")
    np.testing.assert_allclose(line["x"], flight.flown["corrected"][:, 0], rtol=1e-4)
    assert line["customdata"] == f"#{flight.name}"
    np.testing.assert_allclose(chart.columns[flight.name], flight.time, rtol=1e-4)
    (line,) = keyed(pitch, "measured")
    np.testing.assert_allclose(line["y"], np.degrees(flight.measured[:, 2]), rtol=1e-4)
    (line,) = keyed(apart, "refitted")
    away = distance(flight.flown["refitted"], flight.measured)
    np.testing.assert_allclose(line["y"][1:], away[1:], rtol=1e-4)
    assert line["y"][0] is None  # Of zero there is no logarithm.


def test_points_tell_their_flight_and_time():
    result = make_result()
    chart = CHARTS["residual"](result)
    table = result.residual_before
    assert chart.flights == table.names
    np.testing.assert_array_equal(chart.columns["nominal flight"], table.flight)
    time = np.array(chart.columns["nominal t"])
    np.testing.assert_allclose(time, table.variables["t"], rtol=1e-4)
    for panel in chart.panels:
        for trace in panel.traces:
            if "of" in trace:
                assert trace["x"][1:] in chart.columns
                assert trace["y"][1:] in chart.columns


def test_each_flight_has_its_line_of_coefficients():
    result = make_result()
    columns = CHARTS["coefficients"](result).columns
    table = result.residual_after
    rows = np.array(columns["corrected flight"]) == 3
    lift = np.array(columns["corrected c_lift"], dtype=float)[rows]
    alpha = np.radians(np.array(columns["corrected alpha"], dtype=float)[rows])
    assert np.isnan(lift[-1])  # A gap before the next flight.
    np.testing.assert_allclose(lift[:-1], np.sin(2.0 * alpha[:-1]), atol=0.1)
    assert set(columns["corrected flight"]) == set(table.flight)


def test_what_has_no_name_is_drawn():
    chart = CHARTS["carried"](VARIANTS["unexplained"])
    (panel,) = chart.panels  # A wind along x of zero is none.
    (line,) = panel.traces
    assert panel.title == "air moving up [m/s]"
    peak = int(np.argmax(line["y"]))
    assert line["x"][peak] == pytest.approx(-2.0, abs=0.02)
    assert line["y"][peak] == pytest.approx(1.0 + 0.2 * math.exp(-2.0), rel=1e-3)


def test_a_page_of_five_hundred_flights_stays_below_five_megabytes():
    time = np.linspace(0.0, 2.0, 480)
    rng = np.random.default_rng(0)
    flights = []
    for i in range(150):
        pose = rng.normal(size=(480, 3))
        flown = {m: pose + rng.normal(size=(480, 3)) for m in ("refitted", "corrected")}
        flights.append(
            dataclasses.replace(
                make_flight(f"flight_{i:03d}.csv", 0.1),
                time=time,
                measured=pose,
                flown=flown | {"nominal": pose + rng.normal(size=(480, 3))},
            )
        )
    table = make_result().residual_before
    more = 100
    table = dataclasses.replace(
        table,
        **{
            field: {k: np.tile(v, more) for k, v in getattr(table, field).items()}
            for field in ("variables", "coefficients", "modelled")
        },
        residual=np.tile(table.residual, (more, 1)),
        noise=np.tile(table.noise, (more, 1)),
        unit=np.tile(table.unit, (more, 1)),
        flight=np.repeat(np.arange(500), 60),
        names=tuple(f"flight_{i:03d}.csv" for i in range(500)),
    )
    result = make_result(
        held_out=tuple(flights), residual_before=table, residual_after=table
    )
    inside = flights_in_page(result)
    assert len(inside) <= MOST_FLIGHTS + 4
    text = to_html(result)
    assert len(text.encode()) < 5_000_000
    assert f"({len(inside)} of the 150 held-out flights are here)" in text


def test_numbers_are_finite_or_none():
    assert numbers([1.0 / 3.0, math.nan, math.inf]) == [0.33333, None, None]


def test_an_axis_of_evidence_is_linear_then_logarithmic():
    assert symlog(10.0) == pytest.approx(0.6)
    assert symlog(1000.0) == pytest.approx(2.6)
    assert symlog(-5.0) == pytest.approx(-0.3)
    assert symlog(10.0 + 1e-9) == pytest.approx(symlog(10.0))
