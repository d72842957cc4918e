"""No forged file passes `check-funnel`, and each is refused in a sentence."""

import json
import os
import tracemalloc
import zipfile

import numpy as np
import pytest

from glider.__main__ import main
from glider.paths import models_path
from glider.physics.model import GliderModel
from tests.verification.forging import HELD, INVENTED, REVIEWED, SETS, forge, shorten

FORGED = REVIEWED | INVENTED
FEW = ["--every", "100"]

SHORTENED = {"held_head_wind_95_hook": 10, "head_wind_95": 12}
"""Shipped funnels of a set of gliders, and how many of their intervals are forged."""

TRUE = {"half of the remainder", "a remainder 14 % smaller", "a set 3 % wider"}
"""Changes that a short funnel of held commands has room for: V falls still."""

ELSEWHERE = {"a launch in mid-flight", "a wind that was not asked for"}
"""Changes that it cannot have: it is short, and its glider has a wind."""

PROVEN = TRUE | {
    "a bound below zero",
    "a bound of nearly nothing",
    "a bound that varies with the place",
    "heavier weights",
    "no Gram matrices",
    "no remainder in pitch",
    "slopes as of a saw",
}
"""Changes that only the whole check of a funnel of held commands finds, in seconds
each: of a funnel without them `make test` checks all."""

OF_HELD = [
    pytest.param(name, marks=pytest.mark.nightly if name in PROVEN else ())
    for name in FORGED
    if name not in ELSEWHERE
]


@pytest.fixture(scope="module")
def source():
    return models_path("funnels", "drawn.npz")


@pytest.fixture(scope="module")
def vehicle():
    return str(models_path("vehicles", "perching.yaml"))


@pytest.fixture(scope="module")
def short(tmp_path_factory):
    """Files of a few intervals each, and the arguments of the command for them."""
    folder = tmp_path_factory.mktemp("short")
    return {name: shorten(name, k, folder) for name, k in SHORTENED.items()}


def expect_refusal(code, said, words):
    """Requires an exit code of a refusal, and one sentence with some words."""
    assert code in (1, 2), said
    sentences = [line for line in said.splitlines() if words in line]
    assert sentences, said
    assert len(sentences[0]) < 300
    assert sentences[0].endswith(".")
    assert "".join(said.splitlines()).isprintable()


@pytest.mark.parametrize("name", FORGED)
def test_a_forged_file_is_refused_in_a_sentence(
    name, source, vehicle, tmp_path, capsys
):
    change, words = FORGED[name]
    path = tmp_path / "funnel.npz"
    forge(source, path, change)
    code = main(["check-funnel", str(path), *FEW, "--model", vehicle])
    expect_refusal(code, "".join(capsys.readouterr()), words)


@pytest.mark.parametrize("name", OF_HELD)
def test_a_forged_file_of_held_commands_is_refused_in_a_sentence(
    name, short, tmp_path, capsys
):
    """Of a set of gliders, too."""
    source, options = short["held_head_wind_95_hook"]
    forge(source, tmp_path / "funnel.npz", FORGED[name][0])
    code = main(["check-funnel", str(tmp_path / "funnel.npz"), *options])
    said = "".join(capsys.readouterr())
    if name in TRUE:
        assert code == 0, said
    else:
        expect_refusal(code, said, ".")


@pytest.mark.parametrize("name", HELD)
def test_forged_holds_and_sets_are_refused_in_a_sentence(name, short, tmp_path, capsys):
    source, options = short["held_head_wind_95_hook"]
    change, words = HELD[name]
    forge(source, tmp_path / "funnel.npz", change)
    code = main(["check-funnel", str(tmp_path / "funnel.npz"), *options])
    expect_refusal(code, "".join(capsys.readouterr()), words)


def test_a_set_that_is_flat_is_refused_as_json(short, tmp_path, capsys):
    """Also where its sizes are not finite."""
    source, options = short["held_head_wind_95_hook"]
    for factor in (0.0, -1.0, 1e308):

        def change(arrays, notes, factor=factor):
            arrays["S"][:] = factor

        forge(source, tmp_path / "funnel.npz", change)
        path = str(tmp_path / "funnel.npz")
        assert main(["check-funnel", path, *options, "--json"]) == 1
        assert json.loads(capsys.readouterr().out)["holds"] is False


@pytest.mark.parametrize("shape", [(10**12,), (10**7, 7, 7), (10**400,)])
def test_a_header_of_more_than_the_memory_is_refused_unread(
    shape, source, tmp_path, capsys
):
    path = tmp_path / "funnel.npz"
    with zipfile.ZipFile(source) as good, zipfile.ZipFile(path, "w") as forged:
        for name in good.namelist():
            with forged.open(name, "w") as stream:
                if name == "S.npy":
                    header = {"descr": "<f8", "fortran_order": False, "shape": shape}
                    np.lib.format.write_array_header_1_0(stream, header)
                else:
                    stream.write(good.read(name))
    assert main(["check-funnel", str(path), *FEW]) == 2
    assert "is a damaged funnel: " in capsys.readouterr().err


@pytest.mark.parametrize("name", SETS)
@pytest.mark.parametrize("of", SHORTENED)
def test_a_set_of_gliders_that_the_model_does_not_have_is_refused(
    name, of, short, tmp_path, capsys
):
    path, (source, options) = tmp_path / "funnel.npz", short[of]
    forge(source, path, SETS[name])
    code = main(["check-funnel", str(path), *options, "--prove"])
    said = capsys.readouterr().out
    assert code == 1
    assert "is smaller than the model's, the " in said
    assert "Proven" not in said and " 100 %" not in said


def test_a_set_must_contain_that_of_95_percent(short, tmp_path, capsys):
    path, (source, options) = tmp_path / "funnel.npz", short["head_wind_95"]
    command = ["check-funnel", str(path), *options]
    forge(source, path, HELD["a set of 50 %"][0])
    assert main(command) == 1
    assert "smaller than the model's, the 95 % ellipsoid" in capsys.readouterr().out
    forge(source, path, lambda arrays, notes: None)
    assert main([*command, "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert (found["set_level"], found["loop"]["set_level"]) == (0.95, 0.95)


def test_a_set_without_a_model_is_said_to_be_the_files_own(short, tmp_path, capsys):
    bare, (path, options) = tmp_path / "bare.yaml", short["head_wind_95"]
    few = ["check-funnel", str(path), *options]
    at = few.index("--model")
    del few[at : at + 2]
    assert main(few) == 0
    assert "which is the file's own statement: compare" in capsys.readouterr().out
    GliderModel.load(models_path("identified", "head_wind.yaml")).save(bare)
    assert main([*few, "--model", str(bare)]) == 0
    assert "bare.yaml has no covariance" in capsys.readouterr().out


@pytest.mark.parametrize("kind", ["pipe", "folder", "device", "large"])
def test_what_is_no_file_of_a_funnels_size_is_not_read(kind, tmp_path, capsys):
    path = tmp_path / "funnel.npz"
    if kind == "pipe":
        os.mkfifo(path)
    elif kind == "folder":
        path.mkdir()
    elif kind == "device":
        path.symlink_to("/dev/zero")
    else:
        with path.open("wb") as stream:
            stream.truncate(10**11)
    assert main(["check-funnel", str(path)]) == 2
    assert "is not a funnel" in capsys.readouterr().err


def test_a_bomb_is_given_none_of_the_memory_that_it_asks_for(source, tmp_path, capsys):
    """3 MB that are 3 GB: of one array that no funnel has, and of a long one."""
    path = tmp_path / "funnel.npz"
    with zipfile.ZipFile(source) as good:
        texts = {name: good.read(name) for name in good.namelist()}
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as forged:
        for name, text in texts.items():
            with forged.open(name, "w", force_zip64=True) as stream:
                stream.write(text)
                for _ in range(300 if name == "S.npy" else 0):
                    stream.write(bytes(10**6))
    tracemalloc.start()
    code = main(["check-funnel", str(path), "--every", "1000"])
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert code == 2
    assert "larger than 30,000,000 bytes" in capsys.readouterr().err
    assert peak < 2e8


def test_an_effects_name_reaches_no_terminal_raw(source, tmp_path, capsys):
    path = tmp_path / "funnel.npz"

    def change(arrays, notes):
        effect = 'effects:\n- kind: "\\e[2J"\n  coefficients: {}'
        notes["model"] = notes["model"].replace("effects: []", effect)

    forge(source, path, change)
    assert main(["check-funnel", str(path), *FEW]) == 2
    assert "unknown effect '\\x1b[2J'" in capsys.readouterr().err


def test_a_copy_by_the_forger_passes(source, vehicle, tmp_path, capsys):
    path = tmp_path / "funnel.npz"
    forge(source, path, lambda arrays, notes: None)
    assert main(["check-funnel", str(path), *FEW, "--model", vehicle]) == 0
    said = capsys.readouterr().out
    assert "holds in 3 of 200 intervals, at all times" in said
    assert "5.00 cm of the wire" in said


def test_a_goal_in_words_alone_is_not_the_hooks(tmp_path, capsys):
    """The sets are those of a wider goal, which the file says is the hook's."""
    path = tmp_path / "funnel.npz"

    def change(arrays, notes):
        notes["settings"]["goal"] = [0.0499, 0.0499, 0.16, 0.39, 0.7, 0.7, 2.0]

    source = models_path("funnels", "head_wind.npz")
    forge(source, path, change)
    assert main(["check-funnel", str(path), "--every", "1000", "--hook"]) == 1
    words = capsys.readouterr().out
    assert "last set" in words
    assert "The certificate does not hold: 1 fault." in words


def test_another_problem_and_glider_are_refused(source, tmp_path, capsys):
    problem = tmp_path / "problem.yaml"
    problem.write_text("wire: [0.1, 0.0]\n")
    command = ["check-funnel", str(source), *FEW]
    assert main([*command, "--problem", str(problem)]) == 1
    assert "distance from the wire = 0.15 m" in capsys.readouterr().out
    model = str(models_path("truths", "head_wind.yaml"))
    assert main([*command, "--model", model]) == 1
    assert "'effects' of its model is []; expected" in capsys.readouterr().out
    assert main([*command, "--model", str(problem)]) == 2
    assert "unknown field 'wire'" in capsys.readouterr().err
