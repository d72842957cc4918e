"""The report says what was found, to programs and to people, whatever it was."""

import dataclasses
import datetime
import errno
import io
import json
import math
import re
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
import yaml
from rich.console import Console

from glider.errors import InputError
from glider.files.schema import json_text, to_builtins
from glider.physics.covariance import Covariance
from glider.physics.effects import KINDS
from glider.physics.model import GliderModel, load_covariance
from glider.report.as_page import STATIC
from glider.report.folder import to_html, write_report
from glider.report.terminal import print_summary
from glider.report.wording import headline, say
from glider.sysid.result import PERFECT, Alternative, Estimate
from tests.helpers.own_kinds import FLAP
from tests.report.results import VARIANTS, WIND, all_errors, make_result

SLOW = pytest.mark.slow

FIGURES = {*("free_functions", "coefficients"), *("held_out", "residual")}


@pytest.fixture(params=VARIANTS)
def variant(request):
    return VARIANTS[request.param]


@pytest.fixture(
    scope="module",
    params=[
        name if name in ("effect", "diverged") else pytest.param(name, marks=SLOW)
        for name in ("effect", "diverged", "unexplained", "no effect")
    ],
)
def written(request, tmp_path_factory):
    """A variant and its report, written into a folder that holds another file."""
    folder = tmp_path_factory.mktemp("report") / "new" / "deep"
    folder.mkdir(parents=True)
    (folder / "notes.txt").write_text("mine")
    write_report(VARIANTS[request.param], folder)
    return VARIANTS[request.param], folder


class Page(HTMLParser):
    """The text, figures and references of a page; its scripts are no text."""

    def __init__(self, text):
        super().__init__()
        self.text, self.figures, self.references = "", [], []
        self.is_code = False
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        self.is_code = tag in ("script", "style")
        for name, value in attrs:
            if name in ("src", "href", "srcset", "data", "poster", "action"):
                self.references.append(value)
            if name == "data-figure":
                self.figures.append(value)
        assert tag not in ("link", "iframe", "object", "embed", "img")

    def handle_endtag(self, tag):
        self.is_code = False

    def handle_data(self, data):
        self.text += "" if self.is_code else data


def summary(result, width=80):
    """Returns what a pipe gets."""
    raw = io.BytesIO()
    file = io.TextIOWrapper(raw, encoding="utf-8", write_through=True)
    print_summary(result, Console(file=file, width=width))
    return raw.getvalue().decode()


def drawn(result):
    """Returns the names of the figures that there is something to draw of."""
    needs = {"held_out": result.held_out, "free_functions": result.model.free_functions}
    return {name for name in FIGURES if needs.get(name, True)}


def to_json(result):
    return to_builtins(result.report)


def leaves(data):
    if isinstance(data, dict):
        return [leaf for value in data.values() for leaf in leaves(value)]
    if isinstance(data, list):
        return [leaf for value in data for leaf in leaves(value)]
    return [data]


def test_json_file_is_strict_whatever_the_numbers(written):
    variant, folder = written

    def refuse(name):
        raise AssertionError(f"{name} is no JSON")

    text = (folder / "report.json").read_text(encoding="utf-8")
    data = json.loads(text, parse_constant=refuse)
    assert data == to_json(variant)
    assert data["errors"].keys() - {PERFECT} == {"nominal", "refitted", "corrected"}
    for leaf in leaves(to_json(variant)):
        assert leaf is None or type(leaf) in (str, float, int)


def test_numpy_numbers_become_plain_ones():
    errors = all_errors(np.float32(0.5))
    result = make_result(
        errors={"nominal": None, "refitted": errors, "corrected": errors},
        settings={"seed": np.int64(7), "flag": np.bool_(True), "path": Path("a/b")},
    )
    data = json.loads(json_text(result.report))
    assert data["settings"] == {"seed": 7, "flag": True, "path": "a/b"}
    assert data["errors"]["nominal"] is None
    assert data["errors"]["refitted"]["equation"]["normal"] == 0.5


def test_page_needs_nothing_else(variant):
    text = to_html(variant)
    page = Page(text)
    assert set(page.figures) == drawn(variant)
    assert all(r.startswith("#") for r in page.references)
    assert all(f'id="{r[1:]}"' in text for r in page.references)
    ours = text.replace((STATIC / "plotly-basic.min.js").read_text("utf-8"), "")
    assert not re.search(r"@import|url\(|https?://", ours)
    assert not re.search(r"\b(nan|inf|None)\b", page.text)


def test_page_has_a_chart_of_every_figure(written):
    variant, folder = written
    page = Page((folder / "report.html").read_text(encoding="utf-8"))
    assert set(page.figures) == drawn(variant)


def test_page_and_terminal_say_the_verdict(variant):
    for text in (Page(to_html(variant)).text, summary(variant)):
        flat = " ".join(text.replace("\u00a0", " ").split())
        assert headline(variant) in flat
        for remark in say("remarks", variant):
            assert remark in flat
        for effect in variant.effects:
            assert effect.words in flat
            assert all(n.replace("_", " ") in flat for n in effect.coefficients)
            assert all(KINDS[k].words in flat for k in effect.indistinguishable_from)
        assert "A mass of 1 kg is assumed." in flat


def test_page_escapes_names():
    result = make_result(campaign="<b>&wind</b>")
    assert "<b>&wind" not in to_html(result)
    assert "&lt;b&gt;&amp;wind" in to_html(result)


@pytest.mark.filterwarnings("ignore:.*varies from flight to flight:UserWarning")
def test_folder_holds_the_report_and_keeps_what_was_there(written):
    variant, folder = written
    names = {path.name for path in folder.iterdir()}
    ours = {"report.json", "report.html", "model.yaml"}
    assert names == ours | {"notes.txt"}
    assert (folder / "notes.txt").read_text() == "mine"
    assert GliderModel.load(folder / "model.yaml") == variant.model


@pytest.mark.filterwarnings("ignore:.*varies from flight to flight:UserWarning")
def test_rivals_are_models_of_their_own(tmp_path):
    result, rival = make_result(), VARIANTS["unexplained"].model
    known = Covariance(names=("mass",), matrix=np.array([[4e-6]]))
    alternatives = (
        Alternative(probability=0.7, model=result.model, covariance=None),
        Alternative(probability=0.1, model=GliderModel(), covariance=None),
        Alternative(probability=0.2, model=rival, covariance=known),
    )
    write_report(dataclasses.replace(result, alternatives=alternatives), tmp_path)
    folder = tmp_path / "rivals"
    for name in ("mine.yaml", "rival_1_mine.yaml"):
        (folder / name).write_text("mine")
    first, second = folder / "rival_1.yaml", folder / "rival_2.yaml"
    assert GliderModel.load(first) == rival
    assert GliderModel.load(second) == GliderModel()
    assert load_covariance(first).matrix == known.matrix
    assert load_covariance(second) is None
    text = first.read_text()
    assert "mass: 0.002" in text
    assert "its probability is 0.2, that of model.yaml 0.7" in " ".join(text.split())
    page = (tmp_path / "report.html").read_text()
    rows = re.findall(r"<code>([^<]*yaml)</code>.*?(\d+ %)</td>", page)
    expected = (
        ("model.yaml", "70 %"),
        ("rival_1.yaml", "20 %"),
        ("rival_2.yaml", "10 %"),
    )
    assert rows == [expected[0], *((f"rivals/{n}", share) for n, share in expected[1:])]
    first, second = re.findall(r"rival_\d.yaml</code></td><td>([^<]*)</td>", page)
    free = ", ".join(rival.free_functions[0].variables)
    assert first.split(" + ")[-1] == f"free functions of {free}"
    assert first.count(" + ") == len(rival.effects)
    assert second == "none: the flat-plate model"
    assert 'id="rivals"' not in to_html(result)
    sure = (
        dataclasses.replace(alternatives[0], probability=0.9996),
        dataclasses.replace(alternatives[1], probability=0.0004),
    )
    page = to_html(dataclasses.replace(result, alternatives=sure))
    assert "100 %</td>" in page and "0.04 %</td>" in page
    write_report(dataclasses.replace(result, alternatives=alternatives[:2]), tmp_path)
    mine = {"mine.yaml", "rival_1_mine.yaml"}
    assert {path.name for path in folder.iterdir()} == mine | {"rival_1.yaml"}


def test_a_file_in_the_place_of_a_folder_leaves_the_report_as_it_was(tmp_path):
    write_report(make_result(verdict="no_effect"), tmp_path)
    before = {p.name: p.read_bytes() for p in tmp_path.iterdir() if p.is_file()}
    (tmp_path / "rivals").write_text("mine")
    other = Alternative(probability=0.4, model=GliderModel(), covariance=None)
    chosen = dataclasses.replace(other, probability=0.6)
    result = dataclasses.replace(make_result(), alternatives=(chosen, other))
    with pytest.raises(OSError, match="File exists"):
        write_report(result, tmp_path)
    assert {n: (tmp_path / n).read_bytes() for n in before} == before
    assert (tmp_path / "rivals").read_text() == "mine"


def test_a_second_report_replaces_the_first(tmp_path):
    write_report(make_result(model=VARIANTS["unexplained"].model), tmp_path)
    write_report(VARIANTS["no effect"], tmp_path)
    data = json.loads((tmp_path / "report.json").read_text(encoding="utf-8"))
    assert data["verdict"] == "no_effect"
    assert headline(VARIANTS["no effect"]) in (tmp_path / "report.html").read_text(
        encoding="utf-8"
    )


def test_a_failure_leaves_the_old_report(tmp_path, monkeypatch):
    write_report(make_result(), str(tmp_path))
    before = {p: p.read_bytes() for p in tmp_path.rglob("*") if p.is_file()}
    monkeypatch.setattr("glider.report.folder.to_html", lambda *_: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        write_report(make_result(verdict="no_effect"), tmp_path)
    assert before == {p: p.read_bytes() for p in tmp_path.rglob("*") if p.is_file()}


@pytest.mark.parametrize("file", ["model.yaml", "report.html", "report.json"])
def test_a_full_disk_leaves_the_old_report(tmp_path, monkeypatch, file):
    write_report(make_result(), tmp_path)
    before = {p: p.read_bytes() for p in tmp_path.rglob("*") if p.is_file()}
    write = Path.write_bytes

    def fill_the_disk(path, data):
        if path.name == file:
            write(path, data[: len(data) // 2])
            raise OSError(errno.ENOSPC, "No space left on device")
        return write(path, data)

    monkeypatch.setattr(Path, "write_bytes", fill_the_disk)
    with pytest.raises(OSError, match="No space left") as error:
        write_report(VARIANTS["no effect"], tmp_path)
    assert error.value.filename == str(tmp_path)
    assert before == {p: p.read_bytes() for p in tmp_path.rglob("*") if p.is_file()}


def test_the_model_says_where_it_comes_from_and_how_well_it_is_known(tmp_path):
    known = Covariance(names=("wind.x",), matrix=np.array([[4e-6]]))
    result = make_result(covariance=known)
    write_report(result, tmp_path)
    assert load_covariance(tmp_path / "model.yaml").matrix == 4e-6
    origin = yaml.safe_load((tmp_path / "model.yaml").read_text())["origin"]
    assert origin["source"] == result.path.name
    assert origin["version"] == f"drake-glider {result.version}"
    age = datetime.datetime.now().astimezone() - datetime.datetime.fromisoformat(
        origin["date"]
    )
    assert 0.0 <= age.total_seconds() < 60.0
    assert origin["standard_errors"] == {"wind.x": pytest.approx(2e-3)}


def test_a_file_in_the_folders_place_is_an_input_error(tmp_path):
    path = tmp_path / "taken"
    path.write_text("")
    with pytest.raises(InputError, match="taken: is a file"):
        write_report(make_result(), path)


@pytest.mark.parametrize("width", [80, 120])
def test_summary_fits_a_pipe(variant, width):
    text = summary(variant, width)
    assert max(len(line) for line in text.splitlines()) <= width
    assert "\x1b" not in text  # No colours.
    assert "…" not in text  # Nothing was cut.


def test_summary_has_the_errors_of_each_model():
    text = summary(make_result())
    row = next(line for line in text.splitlines() if "position, RMS" in line)
    assert " ".join(row.split()) == ("position, RMS [mm] 413 206 0.413 0.566 1,000×")
    assert "x = -0.600 ± 0.003 m/s" in text
    assert "nominal" not in summary(VARIANTS["unknown vehicle"])


@pytest.mark.parametrize(
    "name, start, end",
    [
        (
            "effect",
            "8 of 9 flights show a steady wind: x = -0.600 ± 0.003 m/s, z = 0.0502 ",
            "m/s; held-out position error falls from 413 mm to 0.413 mm (RMS).",
        ),
        (
            "two effects",
            "8 of 9 flights show a steady wind: ",
            "; and an error that varies with x and that no effect of the library "
            "explains; held-out position error falls from 413 mm to 0.413 mm (RMS).",
        ),
        (
            "unexplained",
            "8 of 9 flights show an error that varies with x and that no effect",
            "falls from 413 mm to 0.413 mm (RMS).",
        ),
        (
            "no effect",
            "The flights show no effect that the nominal model lacks; ",
            "its position error on held-out flights is 413 mm (RMS).",
        ),
        ("unknown vehicle", "8 of 9 flights show", "from 206 mm to 4.13 mm (RMS)."),
        (
            "diverged",
            "8 of 9 flights show a steady wind: x = 1.00 m/s; ",
            "have an error of 0.413 mm (RMS).",
        ),
    ],
)
def test_headline_is_one_sentence(name, start, end):
    text = headline(VARIANTS[name])
    assert text.startswith(start)
    assert text.endswith(end)
    assert not re.search(r"\.\s|nan|inf|None|  ", text)


def test_an_own_effect_is_called_by_its_words():
    effect = dataclasses.replace(WIND, indistinguishable_from=("flap",))
    result = make_result(effects=(effect,), own_effects=(FLAP,))
    assert say("remarks", result)[0].endswith(f" from {FLAP.words}.")
    for text in (Page(to_html(result)).text, summary(result, 200)):
        assert f"{FLAP.words} (flap)" in " ".join(text.split())


def test_an_error_that_is_not_known_is_null_and_not_shown():
    place = Estimate(value=-1.8, std=math.nan, unit="m")
    effect = dataclasses.replace(WIND, coefficients={"place": place})
    result = make_result(effects=(effect,))
    data = to_json(result)["effects"][0]["coefficients"]["place"]
    assert data == {"value": -1.8, "std": None, "unit": "m"}
    assert "place = -1.80 m;" in headline(result)


@pytest.mark.parametrize(
    "value, std, unit, text",
    [
        (-0.59987, 0.00312, "m/s", "-0.600 ± 0.003 m/s"),
        (-0.59987, 0.00112, "m/s", "-0.5999 ± 0.0011 m/s"),
        (0.2601, 0.0, "-", "0.260"),
        (1234.4, 31.0, "", "1230 ± 30"),
        (0.0999, 0.00096, "m", "0.0999 ± 0.0010 m"),
        (2.5e-8, 3e-9, "kg", "2.5e-08 ± 3e-09 kg"),
        (math.nan, 0.1, "m", "–"),
    ],
)
def test_coefficients_have_the_digits_that_their_errors_allow(value, std, unit, text):
    c = Estimate(value=value, std=std, unit=unit)
    effect = dataclasses.replace(WIND, coefficients={"x": c})
    assert f"x = {text}" in headline(make_result(effects=(effect,)))


def test_a_model_that_is_not_trusted_says_so_where_it_is_loaded(tmp_path):
    result = make_result(verdict="not_trusted", reason="Too few.", spreads={})
    write_report(result, tmp_path)
    with pytest.warns(UserWarning, match='is "not trusted": Too few') as given:
        GliderModel.load(tmp_path / "model.yaml", own_effects=result.own_effects)
    assert len(given) == 1
    assert str(given[0].message).startswith(f"{tmp_path / 'model.yaml'}: ")


def test_what_varies_from_flight_to_flight_is_said_of_the_model(tmp_path):
    write_report(make_result(verdict="effect_found"), tmp_path)
    words = "elevator trim varies from flight to flight by 0.020 ± .*covariance"
    with pytest.warns(UserWarning, match=words):
        GliderModel.load(tmp_path / "model.yaml")
