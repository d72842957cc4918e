"""What is compiled is kept, and an edit never meets an old binary."""

import importlib.util
import linecache
import sys

import numpy as np
import pytest
from numba.core.runtime import _nrt_python, rtsys

from glider.compiled import jacobian, kernel, riccati, rollouts
from glider.compiled.constants import BLOCK
from glider.compiled.kernel import Family
from glider.compiled.replay import flow_at
from glider.compiled.rollouts import fly_tapes
from glider.estimation.perching import launch_prior, perching_ekf
from glider.estimation.running import run_ekf
from glider.paths import cache_folder
from glider.physics.effects import (
    NO_FIELD,
    PROFILE_DRAG,
    THRUST,
    Coefficient,
    EffectKind,
)
from glider.physics.model import GliderModel
from glider.planning.problem import PerchingProblem
from tests.helpers.physics import PARAMETERS, random_states

FORMULA = "def pull(flow, force):\n    return {factor} * force\n"


@pytest.fixture
def fresh_cache(monkeypatch, tmp_path):
    """An empty cache folder."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    return tmp_path / "cache" / "drake-glider"


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


def family(module, uses=()):
    """Returns the loops of a module as a session has them that has none yet."""
    known = {name: getattr(module, name) for name in module.LOOPS.entries}
    fresh = Family(tuple(known.values()), tuple(known.values()), uses)
    fresh.text = module.LOOPS.text
    return fresh


def load(effects=(), has_field=False):
    """Asks for a loop, as its caller does, in a session that has none yet."""
    return family(rollouts).over(effects, has_field).rollouts


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
    "module",
    ["aerodynamics", "chain", "trigonometry", "field", "constants", "numbers", "servo"],
)
def test_an_edit_of_the_physics_gets_another_file(fresh_cache, module, monkeypatch):
    load()
    text = kernel._SOURCES[module] + "# edited\n"
    monkeypatch.setitem(kernel._SOURCES, module, text)
    load()
    assert len(files_in(fresh_cache)) == 2


def test_an_edit_of_the_runge_kutta_step_gets_another_file(fresh_cache, monkeypatch):
    load()
    monkeypatch.setattr(kernel, "_STEP", kernel._STEP + "# edited\n")
    load()
    assert len(files_in(fresh_cache)) == 2


def test_an_edit_of_a_loop_gets_its_family_and_its_callers_another_file(fresh_cache):
    """The Riccati loop takes the slopes from the machine code of another family."""

    def load_all(edit=""):
        slopes = family(jacobian)
        slopes.text += edit
        for loops in (family(rollouts), slopes, family(riccati, uses=(slopes,))):
            loops.over()

    load_all()
    assert len(files_in(fresh_cache)) == 3
    load_all("\n# edited")
    assert len(files_in(fresh_cache)) == 5


def test_an_edit_of_the_tuples_that_a_loop_takes_gets_another_file(fresh_cache):
    """What numba keeps names their classes; one that is gone cannot be loaded."""
    load()
    edited = family(rollouts)
    edited._module += "# edited"
    edited.over()
    assert len(files_in(fresh_cache)) == 2


def test_a_loop_that_is_not_there_is_no_attribute():
    with pytest.raises(AttributeError, match="rolouts"):
        _ = rollouts.LOOPS.over().rolouts


def test_a_formula_without_a_name_compiles_without_a_file(fresh_cache):
    kinds, zero = (kind_of(lambda flow, force: 2.0 * force),), np.zeros(1)
    x = random_states(1)
    pulled, plate = (
        flow_at(kinds, zero, x, zero, zero, np.append(PARAMETERS, force), NO_FIELD)
        for force in (0.1, 0.0)
    )
    assert not fresh_cache.exists() or files_in(fresh_cache) == []
    assert pulled[0, 5] - plate[0, 5] == pytest.approx(0.2 / PARAMETERS.mass)


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
    states = fly_tapes(GliderModel(), start, command, 0.01, order=order)
    np.testing.assert_array_equal(states[:, 0], start)
    last = fly_tapes(GliderModel(), start, command, 0.01, order=order, only_last=True)
    np.testing.assert_array_equal(last[:, 0], states[:, -1])
    for b in (0, batch - 1):
        one = slice(b, b + 1)
        alone = fly_tapes(GliderModel(), start[one], command[one], 0.01, order=order)
        np.testing.assert_allclose(alone[0], states[b], rtol=1e-13, atol=1e-13)


def test_an_empty_batch_and_an_empty_tape_are_fine():
    none = fly_tapes(GliderModel(), np.zeros((0, 7)), np.zeros((0, 5)), 0.01)
    assert none.shape == (0, 6, 7)
    start = random_states(3)
    states = fly_tapes(GliderModel(), start, np.zeros((3, 0)), 0.01)
    np.testing.assert_array_equal(states[:, 0], start)


def test_loops_give_back_the_memory_that_they_take():
    """The chain's functions borrow arrays: counted wrongly, they would stay or go."""
    ekf = perching_ekf(GliderModel())
    prior = launch_prior(ekf, PerchingProblem().launch)
    flight = np.zeros((1, 5, 1)), np.zeros((1, 5, 4))
    run_ekf(ekf, prior, *flight)
    _nrt_python.memsys_enable_stats()
    before = rtsys.get_allocation_stats()
    for _ in range(10):
        run_ekf(ekf, prior, *flight)
    after = rtsys.get_allocation_stats()
    _nrt_python.memsys_disable_stats()
    assert after.mi_alloc > before.mi_alloc
    assert after.mi_alloc - before.mi_alloc == after.mi_free - before.mi_free
