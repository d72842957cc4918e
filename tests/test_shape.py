"""The shape of the library: budgets of its packages, and names of its modules."""

import collections
import dataclasses

import pytest

from tests.helpers.shape import LIBRARY, ROOT, Shape, measure, read_budgets, shape_of

ADVICE = "make it smaller, or give it what another package gives up in tests/shape.yaml"
WRITE = "run `python -m tests.helpers.shape --write`, so that it stays so"
LOOSE = 0.02
"""Share of a budget that may be unused: below it nobody need touch the file."""


def over(sizes, budgets):
    """Sentences on packages that are larger than their budgets."""
    return [
        f"{package} has {size} {unit}; expected at most {allowed}: {ADVICE}."
        for package, shape in sizes.items()
        for unit, size in dataclasses.asdict(shape).items()
        for allowed in [getattr(budgets.get(package, Shape(0, 0, 0)), unit)]
        if size > allowed
    ]


def test_no_package_outgrows_its_budget():
    _, budgets = read_budgets()
    assert over(measure(), budgets) == []


def test_budgets_only_move_between_packages():
    total, budgets = read_budgets()
    together = sum(budgets.values(), Shape(0, 0, 0))
    assert over({"the library": together}, {"the library": total}) == []


def test_what_became_smaller_stays_so():
    _, budgets = read_budgets()
    sizes = measure()
    unused = [
        f"{package}: {sizes.get(package, Shape(0, 0, 0)).nodes} of {budget.nodes} nodes"
        for package, budget in budgets.items()
        if sizes.get(package, Shape(0, 0, 0)).nodes < (1.0 - LOOSE) * budget.nodes
    ]
    assert unused == [], WRITE


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("", Shape(1, 1, 0)),
        ("a = 1", Shape(5, 1, 1)),
        ("a, _b = 1, 2", Shape(12, 1, 1)),
        ("\n\na  =  1  # a comment", Shape(5, 1, 1)),
        ("_a: int", Shape(6, 1, 0)),
        ("def f(): pass\nclass C: pass\nimport x", Shape(8, 1, 2)),
    ],
)
def test_content_is_counted_whatever_the_layout(text, expected):
    assert shape_of(text) == expected


def test_a_package_without_a_budget_is_reported():
    sentence = over({"glider.more": Shape(5, 0, 0)}, {})
    assert sentence == [f"glider.more has 5 nodes; expected at most 0: {ADVICE}."]


def test_no_name_stands_for_three_modules():
    homes = collections.defaultdict(set)
    for folder in LIBRARY:
        for path in (ROOT / folder).rglob("*.py"):
            if path.stem not in ("__init__", "__main__"):
                homes[path.stem].add(path.relative_to(ROOT).parts[:2])
    assert {name: where for name, where in homes.items() if len(where) > 2} == {}


def test_the_readme_is_short():
    assert len((ROOT / "README.md").read_text("utf-8").splitlines()) <= 200
