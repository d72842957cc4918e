"""What an effect needs and resembles is said by the effect, in one place."""

import ast
import dataclasses
from pathlib import Path

import pytest

from glider.errors import InputError
from glider.physics.effects import KINDS, LIBRARY, PITCH_DAMPING
from glider.physics.effects.families import FAMILIES
from glider.physics.parameters import PARAMETER_NAMES
from glider.sysid.likelihood.scales import NAMES

GLIDER = Path(__file__).parents[2] / "glider"

OTHER_MEANINGS = {
    "mass": "a parameter of the vehicle",
    "elevator_area": "a parameter of the vehicle",
    "wind": "a scale of the noise, a port of the plant, a setting of funnels",
    "added_mass": "a term of free functions",
}
"""Names of effects that something else has, too, and what that is."""


def literals():
    """Yields the file, line and text of each string outside the effects."""
    for path in sorted(GLIDER.rglob("*.py")):
        if path.is_relative_to(GLIDER / "physics" / "effects"):
            continue
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Constant) and isinstance(node.value, str):
                yield path.relative_to(GLIDER), node.lineno, node.value


def test_no_effect_is_named_outside_the_effects():
    """Nor a coefficient, "kind.coefficient": lists of names would miss a new effect."""
    found = [
        f"{path}:{line}: {text}"
        for path, line, text in literals()
        if text.partition(".")[0] in KINDS.keys() - OTHER_MEANINGS.keys()
        and " " not in text
    ]
    assert found == []


def test_the_names_with_other_meanings_have_them():
    assert {"mass", "elevator_area"} <= {*PARAMETER_NAMES}
    assert "wind" in NAMES
    assert "added_mass" in {own.free_function.kind for own in FAMILIES.values()}
    used = {text for _, _, text in literals()}
    assert OTHER_MEANINGS.keys() <= used & KINDS.keys()


@pytest.mark.parametrize("kind", LIBRARY, ids=repr)
def test_what_an_effect_resembles_exists(kind):
    links = {name.partition(" over ")[0] for name in FAMILIES}
    assert {*kind.families} <= FAMILIES.keys()
    assert {*kind.bent_by} <= links | FAMILIES.keys()
    assert {*kind.like} <= {*PARAMETER_NAMES, *KINDS}
    assert kind.varies_by in ("", *NAMES)


def test_a_free_function_bends_its_own_formulas_and_those_of_its_link():
    by_rate = FAMILIES["lift over reduced_rate"]
    assert {*by_rate.formulas} == {
        "pitch_rate_lift",
        "dynamic_stall",
        "lagged_separation",
    }
    assert by_rate.bends == {*by_rate.formulas, "added_mass"}
    # Any function of the lift may be a lag that is soon over.
    assert {"dynamic_stall", "lagged_separation"} <= FAMILIES["lift over alpha"].bends


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"needs": ("servo or tailwind",)}, "its needs.*tailwind.*elevator_angle"),
        ({"unknown_without": ("size", 1.0)}, "its needs.*size"),
    ],
)
def test_an_effect_with_other_needs_is_refused(changes, words):
    with pytest.raises(InputError, match=words):
        dataclasses.replace(PITCH_DAMPING, **changes)
