"""What is compiled is kept, and an edit never meets an old binary."""

import importlib.util
import linecache
import sys

import numpy as np
import pytest

from glider.compiled import jacobian as directional
from glider.compiled import kernel
from glider.compiled.constants import BLOCK
from glider.compiled.kernel import (
    cache_folder,
    compiled,
)
from glider.physics.effects import (
    NO_FIELD,
    PROFILE_DRAG,
    THRUST,
    Coefficient,
    EffectKind,
)
from tests.helpers.physics import NO_COEFFICIENTS, PARAMETERS, random_states

FORMULA = "def pull(flow, force):\n    return {factor} * force\n"


@pytest.fixture
def fresh_cache(monkeypatch, tmp_path):
    """An empty cache folder and no kernel in memory, before and after."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    compiled.cache_clear()
    yield tmp_path / "cache" / "drake-glider"
    compiled.cache_clear()


@pytest.fixture
def module_of(tmp_path, monkeypatch):
    """Writes a module with a formula and imports it, as often as it is edited."""

    def write(factor):
        path = tmp_path / "users_effect.py"
        path.write_text(FORMULA.format(factor=factor))
        importlib.invalidate_caches()
        spec = importlib.util.spec_from_file_location("users_effect", path)
        module = importlib.util.module_from_spec(spec)
        monkeypatch.setitem(sys.modules, "users_effect", module)
        spec.loader.exec_module(module)
        linecache.checkcache(str(path))
        return kind_of(module.pull)

    return write


def kind_of(formula):
    return EffectKind(
        kind="pull",
        stage="wrench",
        adds_to=("force_x",),
        coefficients=(Coefficient(name="force", unit="N"),),
        formula=formula,
        words="a horizontal pull",
        depends_on=("x",),
    )


def files_in(folder):
    return sorted(path.name for path in folder.glob("glider_kernel_*.py"))


def load(effects=(), has_field=False):
    """Asks for a loop, as its caller does, in a session that has none yet."""
    compiled.cache_clear()
    return compiled(effects, has_field).rollouts


def test_the_file_is_named_by_a_digest_of_its_sources(fresh_cache):
    load()
    [name] = files_in(fresh_cache)
    load()
    assert files_in(fresh_cache) == [name]
    load((PROFILE_DRAG,))
    assert len(files_in(fresh_cache)) == 2
    load((), True)
    assert len(files_in(fresh_cache)) == 3


def test_an_edited_formula_gets_another_file(fresh_cache, module_of):
    load((module_of("2.0"),))
    load((module_of("2.0"),))
    assert len(files_in(fresh_cache)) == 1
    load((module_of("3.0"),))
    assert len(files_in(fresh_cache)) == 2


def test_formulas_that_are_called_alike_get_files_of_their_own(fresh_cache):
    """Pulled along the body or against the air: one coefficient, the same terms."""
    load((PROFILE_DRAG,))
    load((THRUST,))
    assert len(files_in(fresh_cache)) == 2


@pytest.mark.parametrize(
    "module", ["aerodynamics", "chain", "trigonometry", "field", "constants"]
)
def test_an_edit_of_the_physics_gets_another_file(fresh_cache, module, monkeypatch):
    load()
    real = kernel.inspect.getsource
    target = getattr(kernel, module)

    def edited(thing):
        return real(thing) + "# edited\n" * (thing is target)

    monkeypatch.setattr(kernel.inspect, "getsource", edited)
    load()
    assert len(files_in(fresh_cache)) == 2


def test_an_edit_of_a_loop_gets_its_family_and_its_callers_another_file(
    fresh_cache, monkeypatch
):
    """The Riccati loop takes the slopes from the machine code of another family."""
    names = ("rollouts", "directional", "riccati")
    for name in names:
        getattr(compiled(), name)
    assert len(files_in(fresh_cache)) == 3
    text = kernel._TEXT_OF[directional] + "\n# edited"
    monkeypatch.setitem(kernel._TEXT_OF, directional, text)
    compiled.cache_clear()
    for name in names:
        getattr(compiled(), name)
    assert len(files_in(fresh_cache)) == 5


def test_a_loop_that_is_not_there_is_no_attribute():
    with pytest.raises(AttributeError, match="no loop is called 'rolouts'"):
        _ = compiled().rolouts


def test_a_formula_without_a_name_compiles_without_a_file(fresh_cache):
    functions = compiled((kind_of(lambda flow, force: 2.0 * force),))
    assert not fresh_cache.exists() or files_in(fresh_cache) == []
    values = np.empty((1, 9))
    x = random_states(1)
    functions.log_flow(
        np.zeros(1),
        x,
        np.zeros(1),
        np.zeros(1),
        np.append(PARAMETERS, 0.1),
        NO_FIELD,
        values,
    )
    drawn = np.empty((1, 9))
    theta = np.append(PARAMETERS, 0.0)
    functions.log_flow(np.zeros(1), x, np.zeros(1), np.zeros(1), theta, NO_FIELD, drawn)
    assert values[0, 5] - drawn[0, 5] == pytest.approx(0.2 / PARAMETERS[0])


def test_a_folder_that_cannot_be_written_is_not_used(monkeypatch, tmp_path):
    (tmp_path / "file").write_text("not a folder")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    folder = cache_folder()
    assert tmp_path not in folder.parents
    assert folder.is_dir()


@pytest.mark.parametrize("order", [1, 4])
@pytest.mark.parametrize("batch", [1, BLOCK - 1, BLOCK, BLOCK + 1])
def test_a_batch_flies_as_each_glider_alone(order, batch):
    start = random_states(batch)
    command = np.random.default_rng(1).uniform(-8, 8, (batch, 20))
    tail = (0.01, PARAMETERS, NO_COEFFICIENTS, NO_FIELD, order)
    functions = compiled()
    states = np.full((batch, 21, 7), np.nan)
    functions.rollouts(start, command, *tail, states)
    np.testing.assert_array_equal(states[:, 0], start)
    last = np.full((batch, 1, 7), np.nan)
    functions.rollouts(start, command, *tail, last)
    np.testing.assert_array_equal(last[:, 0], states[:, -1])
    for b in (0, batch - 1):
        alone = np.full((1, 21, 7), np.nan)
        functions.rollouts(start[b : b + 1], command[b : b + 1], *tail, alone)
        np.testing.assert_allclose(alone[0], states[b], rtol=1e-13, atol=1e-13)


def test_an_empty_batch_and_an_empty_tape_are_fine():
    tail = (0.01, PARAMETERS, NO_COEFFICIENTS, NO_FIELD, 1)
    functions = compiled()
    functions.rollouts(np.zeros((0, 7)), np.zeros((0, 5)), *tail, np.zeros((0, 6, 7)))
    start = random_states(3)
    states = np.full((3, 1, 7), np.nan)
    functions.rollouts(start, np.zeros((3, 0)), *tail, states)
    np.testing.assert_array_equal(states[:, 0], start)
