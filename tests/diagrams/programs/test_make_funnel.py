"""The command `make-funnel`: what it asks of a funnel, writes, prints and refuses."""

import shlex

import pytest

from glider.__main__ import main, make_parser
from glider.control import tvlqr
from glider.paths import models_path
from glider.planning import dircol
from glider.verification.funnel import build
from glider.verification.funnel.funnel import load_funnel

IDENTIFIED = str(models_path("identified", "head_wind.yaml"))
VEHICLE = str(models_path("vehicles", "perching.yaml"))


@pytest.fixture
def asked(monkeypatch):
    """What a funnel is made with; a shipped one takes its place, without a plan."""
    given = {}
    monkeypatch.setattr(dircol, "plan", lambda *_, **__: None)
    monkeypatch.setattr(tvlqr, "tracking_policy", lambda *_: None)

    def made(model, policy, settings, **options):
        given.update(options, model=model, settings=settings)
        return load_funnel(models_path("funnels", "held_head_wind_95_hook.npz"))

    monkeypatch.setattr(build, "make_funnel", made)
    return given


def test_funnel_figure_and_page_are_written_and_the_proof_is_named(
    asked, tmp_path, capsys
):
    out = tmp_path / "funnel.npz"
    page = tmp_path / "funnel.html"
    options = ["--hook", "--hold", "0.02", "--wind", "0.02", "--latency", "0.01"]
    code = main(
        ["make-funnel", IDENTIFIED, "--out", str(out), "--html", str(page), *options]
    )
    printed, errors = capsys.readouterr()
    assert code == 0, errors
    assert load_funnel(out).is_of_set
    assert "<svg" in out.with_suffix(".svg").read_text()
    assert "Funnel of funnel" in page.read_text()
    assert "14.5 cm in height" in printed
    proof = printed.partition("To prove it: glider ")[2]
    args = make_parser().parse_args(shlex.split(proof))
    assert args.prove and args.hook
    assert (args.hold, args.wind, args.latency) == (0.02, 0.02, 0.01)
    assert args.command_error is None  # What the predictor leaves is for the proof.


@pytest.mark.nightly
def test_the_set_is_that_of_the_models_covariance(asked, tmp_path):
    out = str(tmp_path / "funnel.npz")
    main(["make-funnel", IDENTIFIED, "--out", out])
    assert asked["confidence"].level == 0.95
    assert asked["hook_of"] is None
    main(["make-funnel", IDENTIFIED, "--out", out, "--level", "0"])
    assert asked["confidence"] is None
    main(["make-funnel", VEHICLE, "--out", out])
    assert asked["confidence"] is None


@pytest.mark.nightly
def test_the_plan_of_a_hook_ends_in_the_middle_of_its_pitches(asked, tmp_path):
    main(["make-funnel", VEHICLE, "--hook", "--out", str(tmp_path / "funnel.npz")])
    problem = asked["hook_of"]
    low, high = problem.hook.pitch_limits
    assert sum(problem.final_pitch_limits) == pytest.approx(low + high)


@pytest.mark.nightly
def test_a_held_command_undoes_half_of_a_deviation(asked, tmp_path):
    out = str(tmp_path / "funnel.npz")
    main(["make-funnel", VEHICLE, "--out", out, "--hold", "0.025"])
    settings = asked["settings"]
    assert settings.period * settings.elevator_gain == pytest.approx(0.5)
    assert settings.command_error == 0.0
    options = ["--latency", "0.01", "--wind", "0.02"]
    main(["make-funnel", VEHICLE, "--out", out, "--hold", "0.025", *options])
    assert asked["settings"].command_error > 0.0
    assert asked["settings"].wind == 0.02


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["nowhere.yaml"], "nowhere.yaml"),
        ([VEHICLE, "--level", "0.9"], "covariance"),
        ([IDENTIFIED, "--level", "95"], "--level"),
        ([VEHICLE, "--latency", "0.01"], "--hold"),
        ([VEHICLE, "--hold", "-1"], "--hold"),
        ([VEHICLE, "--wind", "nan"], "--wind"),
        ([VEHICLE, "--seed", "-1"], "--seed"),
        ([VEHICLE, "--problem", "nowhere.yaml"], "nowhere.yaml"),
    ],
)
def test_bad_input_is_one_sentence(options, words, tmp_path, capsys):
    code = main(["make-funnel", *options, "--out", str(tmp_path / "funnel.npz")])
    errors = capsys.readouterr().err
    assert code == 2
    assert errors.count("\n") == 1
    assert words in errors


@pytest.mark.parametrize("name", ["funnel.txt", "nowhere/funnel.npz"])
def test_a_file_that_cannot_be_written_is_refused_before_the_work(
    asked, name, tmp_path, capsys
):
    assert main(["make-funnel", VEHICLE, "--out", str(tmp_path / name)]) == 2
    assert capsys.readouterr().err.count("\n") == 1
    assert not asked


@pytest.mark.nightly
@pytest.mark.parametrize("options", [[], ["--hold", "0.02", "--wind", "0.01"]])
def test_what_is_made_is_proven(options, tmp_path):
    out = str(tmp_path / "funnel.npz")
    assert main(["make-funnel", IDENTIFIED, "--hook", "--out", out, *options]) == 0
    proof = ["--hook", "--model", IDENTIFIED, "--prove", *options]
    assert main(["check-funnel", out, *proof]) == 0
    assert load_funnel(out).half_widths()[1] > 0.1
