"""What is compiled is kept, and an edit never meets an old binary."""

import importlib.util
import inspect
import linecache
import math
import os
import subprocess
import sys

import numpy as np
import pytest
from numba.core.runtime import _nrt_python, rtsys

from glider.compiled import (
    boxes,
    evidence,
    fast_functions,
    filter_error,
    flight,
    jacobian,
    kernel,
    riccati,
)
from glider.compiled.flight import fly_tapes
from glider.compiled.kernel import Family, reached
from glider.compiled.replay import flow_at
from glider.compiled.runge_kutta import BLOCK
from glider.estimation.perching import perching_filter
from glider.estimation.running import run_ekf
from glider.paths import cache_folder
from glider.physics import aerodynamics, chain, servo
from glider.physics.effects import (
    FREE_FUNCTIONS,
    NO_GAUSSIANS,
    PROFILE_DRAG,
    THRUST,
    Coefficient,
    EffectKind,
)
from glider.physics.model import GliderModel
from glider.planning.problem import PerchingProblem
from tests.helpers.physics import PARAMETERS, random_states

FORMULA = "def pull(flow, force):\n    return {factor} * force\n"
HELPED = """
from users_helper import gain
def pull(flow, force):
    return {factor} * gain(force)
"""
SCALAR = "from glider.physics.formulas import scalar\n"
SESSION = """
import numpy as np
from glider.compiled.flight import fly_tapes
from glider.physics.effects import Coefficient, EffectKind
from glider.physics.model import GliderModel
from users_helper import gain

def pull(flow, force):
    return gain(force)

def fly():
    force = Coefficient(name="force", unit="N", lower=-1.0, upper=1.0)
    kind = EffectKind(
        kind="pull", stage="wrench", adds_to=("force_x",), coefficients=(force,),
        formula=pull, words="a horizontal pull", depends_on=("x",),
    )
    model, launch = GliderModel(effects=(kind(force=0.1),)), np.zeros((1, 7))
    launch[0, 4] = 7.0
    states = fly_tapes(model, launch, np.zeros((1, 10)), 0.01)
    print(states[0, -1, 4])
"""


@pytest.fixture
def fresh_cache(monkeypatch, tmp_path):
    """An empty cache folder."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    return tmp_path / "cache" / "drake-glider"


@pytest.fixture
def module_of(tmp_path, monkeypatch):
    """Writes and imports a formula and its helpers, as often as they are edited."""

    def write(factor, helpers=None):
        formula = HELPED if helpers else FORMULA
        for name, text in {
            **(helpers or {}),
            "users_effect": formula.format(factor=factor),
        }.items():
            path = tmp_path / f"{name}.py"
            path.write_text(text)
            importlib.invalidate_caches()
            spec = importlib.util.spec_from_file_location(name, path)
            module = importlib.util.module_from_spec(spec)
            monkeypatch.setitem(sys.modules, name, module)
            exec(compile(text, str(path), "exec"), vars(module))  # No bytecode kept.
            linecache.checkcache(str(path))
        return kind_of(module.pull)

    return write


def kind_of(formula):
    return EffectKind(
        kind="pull",
        stage="wrench",
        adds_to=("force_x",),
        coefficients=(Coefficient(name="force", unit="N", lower=-10.0, upper=10.0),),
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


def load(effects=()):
    """Asks for a loop, as its caller does, in a session that has none yet."""
    return family(flight).over(effects).flights


def test_the_file_is_named_by_a_digest_of_its_sources(fresh_cache):
    load()
    [name] = files_in(fresh_cache)
    load()
    assert files_in(fresh_cache) == [name]
    load((PROFILE_DRAG,))
    assert len(files_in(fresh_cache)) == 2
    load((*FREE_FUNCTIONS.values(),))
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
    ("module", "name", "edited"),
    [
        (aerodynamics, "SPEED_SMOOTHING", 2e-8),
        (chain, "NUM_INPUTS", 6),
        (servo, "STOPPING_TIME", 0.01),
        (fast_functions, "_PI", (math.pi, 0.0, 0.0)),
    ],
)
def test_an_edit_of_the_physics_gets_another_file(
    fresh_cache, module, name, edited, monkeypatch
):
    load()
    assert hasattr(module, name)
    monkeypatch.setattr(module, name, edited)
    load()
    assert len(files_in(fresh_cache)) == 2


def test_an_edit_of_what_a_formula_calls_gets_another_file(fresh_cache, module_of):
    """A helper of a helper, a constant, a closure and a built-in, in other modules."""

    def edited(**changes):
        return module_of(
            "2.0",
            {
                "users_number": f"SIZE = {changes.get('size', 1.0)}\n",
                "users_inner": "def make(k):\n    return scalar(lambda x: k * x)\n"
                f"{SCALAR}inner = make({changes.get('closure', 1.0)})\n",
                "users_helper": f"{SCALAR}import users_number\n"
                "from users_inner import inner\n"
                f"from math import {changes.get('root', 'sin')} as root\n"
                "@scalar\ndef gain(x):\n    return "
                f"{changes.get('gain', 1.0)} * inner(root(x)) * users_number.SIZE\n",
            },
        )

    load((edited(),))
    load((edited(),))
    assert len(files_in(fresh_cache)) == 1
    edits = {"gain": 3.0, "size": 3.0, "closure": 3.0, "root": "tan"}
    for count, name in enumerate(edits, start=2):
        load((edited(**{name: edits[name]}),))
        assert len(files_in(fresh_cache)) == count


@pytest.mark.nightly
@pytest.mark.slow
def test_a_new_session_flies_the_edited_helper(fresh_cache, tmp_path):
    """Formula and helper in two modules, the helper edited between two sessions."""
    (tmp_path / "users_effect.py").write_text(SESSION)

    def speed(gain):
        text = f"{SCALAR}@scalar\ndef gain(x):\n    return {gain} * x\n"
        (tmp_path / "users_helper.py").write_text(text)
        paths = os.pathsep.join([str(tmp_path), *sys.path])
        command = [sys.executable, "-B", "-c", "import users_effect as e; e.fly()"]
        environment = os.environ | {"PYTHONPATH": paths}
        return float(subprocess.check_output(command, env=environment, text=True))

    pull = 0.1 / GliderModel().parameters.mass  # Along x, for a tenth of a second.
    once, ten_times = speed(1.0), speed(10.0)
    assert ten_times - once == pytest.approx(9.0 * 0.1 * pull, rel=0.05)


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
        for loops in (family(flight), slopes, family(riccati, uses=(slopes,))):
            loops.over()

    load_all()
    assert len(files_in(fresh_cache)) == 3
    load_all("\n# edited")
    assert len(files_in(fresh_cache)) == 5


def test_an_edit_of_the_tuples_that_a_loop_takes_gets_another_file(fresh_cache):
    """What numba keeps names their classes; one that is gone cannot be loaded."""
    load()
    edited = family(flight)
    edited._module += "# edited"
    edited.over()
    assert len(files_in(fresh_cache)) == 2


def test_a_loop_that_moves_to_another_module_gets_another_file(
    fresh_cache, monkeypatch
):
    """An old file names the classes of tuples by a module that is gone."""
    load()
    monkeypatch.setitem(sys.modules, "moved", flight)
    monkeypatch.setattr(flight.flights, "__module__", "moved")
    family(flight).over()
    assert len(files_in(fresh_cache)) == 2


def test_what_is_kept_beside_its_own_file_reaches_no_other_file():
    """Numba looks at the outermost function's file alone, see `machine_code`."""
    for module in (boxes, evidence, filter_error, riccati):
        for name, function in vars(module).items():
            plain = getattr(function, "py_func", None)
            if plain is None or plain.__module__ != module.__name__:
                continue
            for what, value in reached(plain):
                defined = f"\n{what} = " in inspect.getsource(module)
                here = getattr(value, "__module__", None) == module.__name__
                assert here or defined or what == "defaults", (name, what)


def test_a_loop_that_is_not_there_is_no_attribute():
    with pytest.raises(AttributeError, match="flihgts"):
        _ = flight.LOOPS.over().flihgts


def test_a_formula_without_a_name_compiles_without_a_file(fresh_cache):
    kinds, zero = (kind_of(lambda flow, force: 2.0 * force),), np.zeros(1)
    x = random_states(1)
    pulled, plate = (
        flow_at(kinds, zero, x, zero, zero, np.append(PARAMETERS, force), NO_GAUSSIANS)
        for force in (0.1, 0.0)
    )
    assert not fresh_cache.exists() or files_in(fresh_cache) == []
    assert pulled[0, 0] - plate[0, 0] == pytest.approx(0.2 / PARAMETERS.mass)


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
    ekf, prior = perching_filter(GliderModel(), PerchingProblem().launch)
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
