"""Only a test that fails, and fails because of the fault, notices a fault."""

import pytest

from benchmarks import mutate

pytestmark = pytest.mark.nightly  # Of a benchmark.

READERS = "tests/campaign/importing/test_readers.py"
LIST_OF_FORMATS = f"{READERS}::test_one_list_of_formats"  # Reads docs/import.md.
MODULE = "glider/campaign/importing/readers/tables.py"


@pytest.fixture(scope="module")
def tree(tmp_path_factory):
    return mutate.copy_tree(tmp_path_factory.mktemp("copy"))


@pytest.fixture
def outcome(tree, monkeypatch):
    """Returns the function that replaces a module by a text, and runs tests."""

    def plant(text, *tests, limit=100.0):
        monkeypatch.setattr(mutate, "tests_of", lambda path: list(tests))
        end = len((tree / MODULE).read_bytes())
        return mutate.plant(mutate.Fault(MODULE, 1, "", text, 0, end), tree, limit)

    return plant


def test_the_copy_has_what_tests_read(tree, monkeypatch):
    monkeypatch.setattr(mutate, "tests_of", lambda path: [LIST_OF_FORMATS])
    mutate.check_tests([mutate.Fault(MODULE, 1, "", "", 0, 0)], tree)


def test_without_a_fault_the_tests_must_pass(tmp_path, monkeypatch):
    monkeypatch.setattr(mutate, "LEFT_OUT", (*mutate.LEFT_OUT, "docs"))
    monkeypatch.setattr(mutate, "tests_of", lambda path: [LIST_OF_FORMATS])
    tree = mutate.copy_tree(tmp_path)
    with pytest.raises(SystemExit, match=r"fail without one: FAILED .*_list_of_form"):
        mutate.check_tests([mutate.Fault(MODULE, 1, "", "", 0, 0)], tree)


def test_a_module_that_cannot_be_imported_is_noticed(outcome, tree):
    right = (tree / MODULE).read_bytes()
    assert outcome("1 / 0", READERS) == "noticed"
    assert (tree / MODULE).read_bytes() == right


def test_a_fault_of_another_module_survives(outcome, tree):
    text = (tree / MODULE).read_text()
    assert outcome(text, LIST_OF_FORMATS) == "survived"


@pytest.mark.parametrize(
    "tests", [("tests/test_gone.py",), (READERS, "-k", "none_of_these")]
)
def test_where_no_test_ran_none_noticed(outcome, tree, tests):
    assert outcome((tree / MODULE).read_text(), *tests) == "not run"


def test_a_timeout_is_told(outcome):
    assert outcome("1 / 0", LIST_OF_FORMATS, limit=0.01) == "too slow"


def test_the_tests_of_a_module_come_before_those_of_its_package():
    tests = mutate.tests_of("glider/campaign/importing/guess.py")
    near = tests.index("tests/campaign/importing/test_guess.py")
    assert near < tests.index("tests/campaign/checks/test_broken_logs.py")
    assert len(tests) == len(set(tests))
