"""What all examples have in common: a story, help, and faults in one sentence."""

import dataclasses
import importlib
import inspect
import typing
from pathlib import Path

import pytest

from diagrams.programs import program
from tests.helpers.examples import known_story, story_name

FOLDER = Path(__file__).parents[2] / "examples"
SOURCES = {
    path.stem: path.relative_to(FOLDER.parent)
    for path in sorted(FOLDER.glob("*.py"))
    if "program.run(main)" in path.read_text(encoding="utf-8")
}

NAMES = list(SOURCES)

GIVEN = {"watch_log": ["attached_lift", "flight_003"]}
"""What must be on the command line."""

SHOWN = {"--json", "--html", "--figure"}
WRITES = {name: SHOWN for name in NAMES} | {
    "close_the_loop": {"--json", "--model"},
    "cruise": {"--json", "--html"},
    "lab_session": {"--json"},
    "launch_map": {"--json", "--figure"},
    "watch_log": {"--json", "--html"},
}
"""The files that an example writes."""

TRUTHS = ["lab_session", "perch_corrected", "perching_funnel"]
"""Examples that fly a glider of the user's choice."""


def load(name):
    return importlib.import_module(f"examples.{name}")


@pytest.fixture(params=NAMES)
def example(request):
    return load(request.param)


def name_of(example):
    return example.__name__.rpartition(".")[2]


def help_of(example, capsys):
    with pytest.raises(SystemExit) as end:
        example.main(["--help"])
    assert end.value.code == 0
    return capsys.readouterr().out


def fail(example, arguments, capsys):
    """Returns the message of a user's fault, which must come before the work."""
    with known_story(example, None) as asked:
        code = program.run(
            lambda: example.main([*GIVEN.get(name_of(example), []), *arguments])
        )
    assert code == 2
    assert not asked.called
    output = capsys.readouterr()
    assert output.out == ""
    return output.err


def test_a_story_returns_a_frozen_dataclass(example):
    story = getattr(example, story_name(example))
    result = typing.get_type_hints(story)["return"]
    assert dataclasses.is_dataclass(result)
    assert result.__dataclass_params__.frozen


def test_the_help_is_the_docstring_with_a_usage(example, capsys):
    output = help_of(example, capsys)
    assert inspect.cleandoc(example.__doc__) in output
    assert f"python {SOURCES[name_of(example)]}" in output
    options = {option for option in SHOWN if f"  {option} " in output}
    assert options == WRITES[name_of(example)] & SHOWN


@pytest.mark.parametrize(
    ("name", "option"),
    [(name, option) for name in NAMES for option in sorted(WRITES[name])],
)
def test_a_file_without_a_folder_is_refused_before_the_work(
    name, option, tmp_path, capsys
):
    said = fail(load(name), [option, str(tmp_path / "absent" / "a.png")], capsys)
    assert "absent does not exist" in said
    assert said.count("\n") == 1


@pytest.mark.parametrize("name", [n for n in NAMES if "--figure" in WRITES[n]])
def test_a_figure_in_a_format_that_is_none_is_refused_before_the_work(name, capsys):
    said = fail(load(name), ["--figure", "f.txt"], capsys)
    assert "no format of pictures" in said
    assert said.count("\n") == 1


@pytest.mark.parametrize("name", TRUTHS)
@pytest.mark.parametrize("truth", ["tail_wind", "nowhere.yaml"])
def test_a_truth_that_is_not_there_is_one_sentence(name, truth, capsys):
    said = fail(load(name), ["--truth", truth], capsys)
    assert truth in said
    assert said.count("\n") == 1
