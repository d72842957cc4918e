"""Figures show the numbers of the result; page and file draw the same of them."""

import dataclasses
import json
import math
import types

import numpy as np
import pytest

from glider.files.schema import json_text
from glider.physics.effects.families import FAMILIES
from glider.physics.effects.free_functions import FreeFunction
from glider.report.as_page import page_data, rounded
from glider.report.error_table import distance
from glider.report.flight_figures import _MOST_FLIGHTS, flights_in_page
from glider.report.folder import FIGURES, to_html
from glider.report.model_figures import free_functions_figure
from glider.report.plots.binning import binned_quantiles
from glider.report.plots.figure import Ground, Level, Line, Points
from glider.report.plots.style import INKS, VARIABLES
from tests.report.results import VARIANTS, make_flight, make_result

NORMAL = "equation.normal"


def make_figures(result):
    figures = {name: make(result) for name, make in FIGURES.items()}
    return {name: figure for name, figure in figures.items() if figure}


def panels_of(figure):
    return [*figure.panels, *(p for c in figure.choices for p in c.panels)]


def of_kind(panel, kind, key=None):
    marks = [m for m in panel.marks if isinstance(m, kind)]
    return [m for m in marks if key is None or m.key == key]


@pytest.fixture(params=VARIANTS)
def variant(request):
    return VARIANTS[request.param]


def test_every_mark_is_in_the_legend_and_has_its_colors(variant):
    for figure in make_figures(variant).values():
        marks = [m for panel in panels_of(figure) for m in panel.marks]
        keys = {m.key for m in marks if not isinstance(m, (Level, Ground))}
        assert keys <= figure.keys.keys() <= INKS.keys()
        assert {m.key for m in marks if isinstance(m, Ground)} <= INKS.keys()


def test_a_page_holds_the_numbers_of_the_figures(variant):
    """The page finds the figure's numbers, rounded."""
    figures = make_figures(variant)
    data = json.loads(json_text(page_data(figures)))

    for name, figure in figures.items():
        found = data["figures"][name]
        panels = [*found["panels"], *(p for c in found["choices"] for p in c["panels"])]
        for panel, drawn in zip(panels_of(figure), panels, strict=True):
            lines = [m for m in drawn["marks"] if m["is"] == "Line"]
            for mark, line in zip(of_kind(panel, Line), lines, strict=True):
                finite = np.where(np.isfinite(mark.y), mark.y, math.nan)
                numbers = np.array(line["y"], dtype=float)
                np.testing.assert_allclose(numbers, finite, rtol=1e-4)


def test_held_out_flights_are_drawn_as_they_are():
    result = make_result()
    figure = FIGURES["held_out"](result)
    assert [c.label for c in figure.choices] == [
        f"flight_1{i:02d}" for i in range(6)[::-1]
    ]
    assert sum(c.is_shown for c in figure.choices) == 4
    flight = result.held_out[5]
    path, pitch, apart = figure.choices[0].panels
    (line,) = of_kind(path, Line, "corrected")
    np.testing.assert_allclose(line.x, flight.flown["corrected"][:, 0])
    np.testing.assert_allclose(line.extra, flight.time)
    (line,) = of_kind(pitch, Line, "measured")
    np.testing.assert_allclose(line.y, np.degrees(flight.measured[:, 2]))
    (line,) = of_kind(apart, Line, "refitted")
    away = 1e3 * distance(flight.flown["refitted"], flight.measured)  # [mm]
    np.testing.assert_allclose(line.y[1:], away[1:])
    assert math.isnan(line.y[0])  # Of zero there is no logarithm.
    assert pitch.x.link == apart.x.link != path.x.link


def test_points_have_their_flight_and_time():
    result = make_result()
    figure = FIGURES["residual"](result)
    table = result.residual_before
    assert figure.flights == table.names
    for panel in figure.panels:
        (cloud,) = of_kind(panel, Points, "nominal")
        np.testing.assert_array_equal(cloud.flight, table.flight)
        np.testing.assert_array_equal(cloud.time, table.variables["t"])


def test_coefficients_are_drawn_as_measured_and_as_modelled():
    result = make_result()
    figure = FIGURES["coefficients"](result)
    table = result.residual_after
    for panel in figure.panels:
        (cloud,) = of_kind(panel, Points)
        np.testing.assert_array_equal(cloud.flight, table.flight)
    (cloud,) = of_kind(figure.panels[3], Points, "measured")
    np.testing.assert_allclose(cloud.y, np.sin(2.0 * np.radians(cloud.x)))
    (line,) = of_kind(figure.panels[3], Line, "corrected")
    np.testing.assert_allclose(line.y, np.sin(2.0 * np.radians(line.x)), atol=0.1)


def test_what_is_unidentified_is_drawn():
    (panel,) = FIGURES["free_functions"](
        VARIANTS["unexplained"]
    ).panels  # Wind along x is 0.
    (line,) = of_kind(panel, Line)
    assert panel.title == "air moving up [m/s]"
    peak = int(np.argmax(line.y))
    assert line.x[peak] == pytest.approx(-2.0, abs=0.02)
    assert line.y[peak] == pytest.approx(1.0, rel=0.1)


@pytest.mark.nightly
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
        flight=np.repeat(np.arange(500), 60),
        names=tuple(f"flight_{i:03d}.csv" for i in range(500)),
    )
    result = make_result(
        held_out=tuple(flights), residual_before=table, residual_after=table
    )
    inside = flights_in_page(result)
    assert len(inside) <= _MOST_FLIGHTS + 4
    text = to_html(result)
    assert len(text.encode()) < 5_000_000
    assert f"({len(inside)} of the 150 held-out flights are here)" in text


def test_numbers_of_a_page_have_five_digits():
    values = np.array([1.0 / 3.0, 123456.7, -2e-9, 0.0, math.nan, math.inf, 1e300])
    found = rounded(values)
    assert found[:4].tolist() == [0.33333, 123460.0, -2e-9, 0.0]
    assert json.loads(json_text(found)) == [
        *(0.33333, 123460.0, -2e-9, 0.0, None, None, 1e300)
    ]
    assert rounded(np.array([-0.00012345678])).tolist() == [-0.00012346]


def test_binned_quantiles_are_those_of_each_bin():
    rng = np.random.default_rng(0)
    x = rng.uniform(0.0, 1.0, 20_000)
    y = 3.0 * x + rng.normal(size=x.size)
    centers, (low, middle, high) = binned_quantiles(x, y, (0.1587, 0.5, 0.8413))
    np.testing.assert_allclose(middle, 3.0 * centers, atol=0.15)
    np.testing.assert_allclose(high - low, 2.0, atol=0.2)
    centers, lines = binned_quantiles(x[:3], y[:3], (0.1, 0.5))
    assert centers.shape == (0,)
    assert lines.shape == (2, 0)


def test_every_free_function_can_be_drawn():
    """Terms and variables have names: a report of any family can be written."""
    for name, kind in FAMILIES.items():
        data = FreeFunction(
            kind="unexplained",
            variables=list(kind.variables),
            centers=[[at] * len(kind.variables) for at in (0.0, 0.1)],
            widths=[0.1] * len(kind.variables),
            weights={kind.free_function.kind: [0.1, 0.2]},
        )
        result = types.SimpleNamespace(
            model=types.SimpleNamespace(free_functions=[data]),
            residual_after=types.SimpleNamespace(
                variables=dict.fromkeys(kind.variables, np.array([0.02, 0.0, 0.05]))
            ),
        )
        figure = free_functions_figure(result)
        assert figure is not None and len(figure.panels) == 1, name
        lines = [m for m in figure.panels[0].marks if isinstance(m, Line)]
        assert len(lines) == 1
        _, factor, *_ = VARIABLES[kind.variables[0]]  # Drawn where flights were.
        assert lines[0].x[[0, -1]] == pytest.approx([0.0, 0.05 * factor])
