"""What the report says of how sure a finding is, beside its figures and words."""

import dataclasses
import math
import re
from pathlib import Path

import numpy as np
import pytest

from glider.campaign.checks.masks import ExcludedRows
from glider.paths import cache_folder
from glider.report.error_table import position_rms, rank_flights
from glider.report.folder import to_html
from glider.report.plots.style import COLORS
from glider.report.wording import headline, say, spread_rows
from glider.sysid.result import (
    MODELS,
    VERDICTS,
    Air,
    Estimate,
    FlightNames,
    Residual,
    Spread,
)
from tests.report.results import UNEXPLAINED, VARIANTS, WIND, make_flight, make_result
from tests.report.test_report import Page, summary


def flat(text):
    return " ".join(text.replace("\u00a0", " ").split())


# Errors: one unit a row, those of a perfect model beside them.


def test_summary_with_all_models_fits_a_narrow_terminal():
    text = summary(make_result())
    assert max(len(line) for line in text.splitlines()) <= 80
    assert "…" not in text
    table = text[text.index("Errors on") : text.index("Noise:")]
    rows = [line for line in table.splitlines() if line.strip()]
    assert len(rows) == 3 + 3 + 7  # Heading, groups, errors: none is broken.


def test_every_model_that_is_shown_has_a_colour_and_a_name():
    assert set(MODELS) <= COLORS.keys()


# Words.


@pytest.mark.parametrize("verdict", VERDICTS)
def test_each_verdict_has_its_badge_and_its_sentence(verdict):
    result = make_result(verdict=verdict)
    text = to_html(result)
    assert f'class="badge {verdict}">{verdict.replace("_", " ")}<' in text
    others = [make_result(verdict=v) for v in VERDICTS if v != verdict]
    same = [r.verdict for r in others if headline(r) == headline(result)]
    # An error without a name is told alike, however much of it has one.
    assert set(same) <= {"partly_explained", "unexplained"}


EXCLUDED = tuple(
    ExcludedRows(file=f"flight_{k}.csv", rows="all", why="no model") for k in range(3)
)


@pytest.mark.parametrize("verdict", VERDICTS)
def test_the_headline_counts_the_flights_that_are_excluded(verdict):
    result = make_result(verdict=verdict, set_aside=EXCLUDED)
    count = result.flights.count
    words = f"{count} of {count + 3} flights "
    assert words in headline(result)
    some = dataclasses.replace(EXCLUDED[0], rows="41-80")
    assert "flights show" in headline(make_result(set_aside=(some,)))
    assert words not in headline(make_result(verdict=verdict, set_aside=(some,)))


def test_an_error_without_a_correction_does_not_fall():
    result = make_result(verdict="unexplained", effects=(), spreads={})
    assert "; the position error of the nominal model on held-out" in headline(result)


def test_what_has_no_name_is_told_with_what_it_varies_with():
    left = Residual(ratio_to_floor=9.0, position_m=0.01, depends_on=("elevator",))
    result = make_result(verdict="partly_explained", left=left)
    assert "; and an error that varies with elevator and" in headline(result)
    result = make_result(
        verdict="partly_explained", effects=(WIND, UNEXPLAINED), left=left
    )
    assert "an error that varies with x and" in headline(result)


def test_a_difference_between_flights_alone_is_a_finding():
    result = make_result(effects=())
    assert headline(result).startswith(
        "8 of 9 flights show that elevator trim varies from flight to flight by 0.020 "
    )


def test_the_reason_follows_the_verdict():
    result = make_result()
    for text in (Page(to_html(result)).text, summary(result)):
        said = flat(text)
        assert said.index(headline(result)) < said.index(result.reason)
        assert said.index(result.reason) < said.index("evidence")


@pytest.mark.parametrize(
    "ratio, position, text",
    [
        (13.25, 5.3e-3, "error of 5.30 mm (RMS) on held-out flights, 13.2 times that"),
        (12_499_590.0, 2.0, "2,000 mm (RMS) on held-out flights, 12,499,590 times"),
        (math.inf, 0.02, "20.0 mm (RMS) on held-out flights; it varies with V."),
        (0.41, 0.02, "held-out flights, no more than a perfect model would leave;"),
        (0.39, 0.02, "held-out flights; noise and moving air as strong as estimated"),
    ],
)
def test_what_is_left_is_a_length_and_a_ratio(ratio, position, text):
    left = Residual(ratio_to_floor=ratio, position_m=position, depends_on=("V",))
    assert text in " ".join(say("left", make_result(left=left)))
    assert "σ" not in " ".join(say("left", make_result(left=left)))


@pytest.mark.parametrize(
    "ratio, chance, may_be", [(1.5, 0.5, True), (1.5, 1e-4, False), (2.5, 0.5, False)]
)
def test_what_is_left_may_be_chance_as_the_verdict_has_it(ratio, chance, may_be):
    left = Residual(ratio_to_floor=ratio, position_m=0.01, chance=chance, depends_on=())
    assert left.may_be_chance is may_be
    said = " ".join(say("left", make_result(left=left)))
    assert ("which may be chance" in said) is may_be


def test_what_is_left_is_not_told_where_it_is_not_known():
    left = Residual(ratio_to_floor=1.0, position_m=math.nan, depends_on=())
    assert " ".join(say("left", make_result(left=left))) == ""


@pytest.mark.parametrize(
    "std, correlation, text",
    [
        (0.12, 0.31, "Turbulence σ = 0.12 m/s, correlation time 0.31 s; "),
        (0.12, math.inf, "Turbulence σ = 0.12 m/s; model "),
        (0.0, 0.3, "The flights show no turbulence."),
        (math.nan, 0.3, ""),
    ],
)
def test_air_is_told_as_it_moves(std, correlation, text):
    said = " ".join(
        say("air", make_result(air=Air(std_m_s=std, correlation_s=correlation)))
    )
    assert said.startswith(text)
    assert bool(said) == bool(text)


def test_a_difference_between_flights_is_told_once():
    spread = Spread(std=0.0512, unit="m/s", values={"flight_001.csv": 0.1})
    result = make_result(spreads={"wind": spread})
    assert say("differences", result) == [
        "wind varies from flight to flight by 0.0512 m/s"
    ]
    assert summary(result).count("0.0512") == 1


def test_the_headline_of_many_effects_has_no_coefficients():
    kinds = [dataclasses.replace(WIND, words=f"effect {i}") for i in range(3)]
    assert headline(make_result(effects=tuple(kinds[:2]))).count("-0.600") == 2
    text = headline(make_result(effects=tuple(kinds)))
    assert text.startswith(
        "8 of 9 flights show effect 0; effect 1; and effect 2; held-"
    )


def test_warnings_and_rows_set_aside_are_told():
    result = make_result()
    for text in (summary(result), Page(to_html(result)).text):
        assert result.warnings[0] in flat(text)
        for aside in result.set_aside:
            assert aside.file in text
            assert aside.why in text
    many = make_result(set_aside=result.set_aside * 4)
    assert "Excluded: 3 more" in summary(many)
    assert Page(to_html(many)).text.count("the pose is frozen.") == 4


# Tables.


def test_the_evidence_threshold_on_the_page_is_the_one_that_was_used():
    """Forty flights and fewer have another than more, one effect another than two."""
    for effect, words in ((6.6, "at least 6.6."), (20.0, "at least 20.")):
        page = flat(Page(to_html(make_result(evidence_threshold=effect))).text)
        assert f"must contribute {words}" in page
    forces = make_result(evidence_threshold=3.0, knows_forces=False)
    assert "at least 3, and more if" in flat(Page(to_html(forces)).text)


def test_the_flight_that_differs_most_is_named():
    assert spread_rows(make_result()) == [
        (
            "elevator trim",
            "0.020 ± 0.014 rad (1.16°)",
            "flight_002.csv: -0.0310 rad (-1.78°)",
        )
    ]
    unknown = Spread(std=0.1, unit="m/s", values={"a.csv": math.nan})
    assert spread_rows(make_result(spreads={"wind": unknown})) == [
        ("wind", "0.100 m/s", "–")
    ]


def test_a_flight_that_diverged_is_the_worst():
    lost = make_flight("lost.csv", 0.1)
    flown = {**lost.flown, "corrected": np.full((50, 3), np.nan)}
    flights = (
        make_flight("b.csv", 0.2),
        dataclasses.replace(lost, flown=flown),
        make_flight("a.csv", 0.1),
    )
    ranked = rank_flights(make_result(held_out=flights))
    assert [flight.name for flight in ranked] == ["a.csv", "b.csv", "lost.csv"]
    assert math.isinf(position_rms(ranked[-1], "corrected"))


def test_evidence_is_told_as_it_was_found():
    """A known glider's is of the fitted flights, another's of held-out flights."""
    known = flat(Page(to_html(make_result())).text)
    assert "marginal log-likelihood of the fitted flights that is lost without" in known
    assert "of held-out flights that is lost" not in known
    # So is that of a glider of which only the tracked point is not told.
    offset = {"wing_offset": Estimate(value=0.02, std=0.001, unit="m")}
    partly = make_result(vehicle=offset, errors=VARIANTS["unknown vehicle"].errors)
    assert "of held-out flights that is lost" not in flat(Page(to_html(partly)).text)
    unknown = flat(Page(to_html(VARIANTS["unknown vehicle"])).text)
    assert "log-likelihood of held-out flights that is lost" in unknown


def test_an_effect_without_evidence_has_no_line_of_it_and_no_zero_a_sign():
    zero = {"x": Estimate(-0.0001, 0.02, "m/s")}
    effect = dataclasses.replace(WIND, evidence=math.nan, coefficients=zero)
    said = say("effect", make_result(), effect)
    assert said[1] == "x = 0.00 ± 0.02 m/s"
    assert not any("nats" in line for line in said)


def test_every_section_has_an_anchor_and_is_in_the_contents():
    text = to_html(make_result())
    headings = dict(re.findall(r'<h2 id="([^"]+)">(.*?)</h2>', text))
    contents = text[text.index("<nav>") : text.index("</nav>")]
    assert re.findall(r'href="#([^"]+)">', contents) == list(headings)
    assert text.count("<h2") == len(headings) > 9
    assert headings["section-warnings"] == "Warnings"


def test_a_page_names_a_campaign_and_the_folder_around_but_no_more_of_the_machine():
    own = Path("/home/somebody/a21/head_wind"), "a21/head_wind"
    for path, name in (own, (cache_folder() / "head_wind", "head_wind")):
        page = to_html(make_result(path=path))
        assert "somebody" not in page and str(cache_folder()) not in page
        assert f"From {name}." in flat(Page(page).text)


def test_one_flight_is_one_and_an_empty_setting_none():
    flights = FlightNames(fit=("a.csv",), held_out=("b.csv",))
    result = make_result(flights=flights, settings={"own_effects": []})
    text = flat(Page(to_html(result)).text)
    assert "All errors are on 1 held-out flight, which" in text
    assert re.search(r"own effects ?none", text)


def test_an_effect_has_one_evidence():
    """Its loss when it is omitted."""
    effect = dataclasses.replace(WIND, evidence=1234.0)
    result = make_result(effects=(effect,))
    page = to_html(result)
    assert "+1,234" in page
    assert not re.search(r"5,?678(?!\d)", Page(page).text)
