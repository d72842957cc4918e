"""The pages for people name what is there, and their recipes work."""

import ast
import functools
import importlib
import re
import types
from pathlib import Path

import numpy as np
import pytest

from diagrams import playback
from diagrams.programs import program
from glider.compiled.user_effects import check_user_effects
from glider.physics.model import GliderModel
from glider.planning.dircol import plan
from glider.planning.problem import PerchingProblem
from glider.report.as_page import page_data
from glider.simulation.fly import fly
from tests.helpers.floors import FLOORS
from tests.helpers.held_policy import HeldPolicy

ROOT = Path(__file__).parents[1]
PAGES = ("CHANGELOG.md", "CONTRIBUTING.md", "README.md")
NOW = ("CONTRIBUTING.md", "README.md", "docs/glossary.md")
"""Pages about the code as it is; a changelog names what is gone, too."""

BLOCK = re.compile(r"^```(\w*)\n(.*?)^```$", re.DOTALL | re.MULTILINE)
LINK = re.compile(r"\[([^][]*(?:\[[^][]*\][^][]*)*)\]\(([^)\s]+)\)")
CODE = re.compile(r"`([^`\n]+)`")
OURS = "glider|diagrams|examples|tests"


def text_of(page):
    return (ROOT / page).read_text(encoding="utf-8")


def prose_of(page):
    """A page without its blocks of code."""
    return BLOCK.sub("", text_of(page))


def links_of(page):
    """Words and target of the links into the project, without their anchors."""
    return [
        (words, target.partition("#")[0])
        for words, target in LINK.findall(prose_of(page))
        if "://" not in target and not target.startswith("#")
    ]


@functools.cache
def defined(path):
    """Names that a Python file defines, the members of its classes with a dot."""
    names = set()
    for node in ast.parse(path.read_text(encoding="utf-8")).body:
        if isinstance(node, ast.FunctionDef):
            names.add(node.name)
        elif isinstance(node, ast.ClassDef):
            names.add(node.name)
            members = (m.name for m in node.body if isinstance(m, ast.FunctionDef))
            names |= {f"{node.name}.{member}" for member in members}
        elif isinstance(node, ast.Assign | ast.AnnAssign):
            targets = node.targets if isinstance(node, ast.Assign) else [node.target]
            names |= {t.id for t in targets if isinstance(t, ast.Name)}
    return names


def is_there(name):
    """Whether a dotted name is a module, or an attribute of one."""
    parts = name.split(".")
    for count in range(len(parts), 0, -1):
        try:
            found = importlib.import_module(".".join(parts[:count]))
        except ModuleNotFoundError:
            continue
        for part in parts[count:]:
            if not hasattr(found, part):
                return False
            found = getattr(found, part)
        return True
    return False


@pytest.mark.parametrize("page", PAGES)
def test_what_a_page_links_to_is_there(page):
    missing = [target for _, target in links_of(page) if not (ROOT / target).exists()]
    assert missing == []


@pytest.mark.parametrize("page", NOW)
def test_a_link_leads_to_the_file_that_holds_the_name(page):
    missing = []
    for words, target in links_of(page):
        if target.endswith(".py"):
            module = target.removesuffix(".py").replace("/", ".")
            names = [n for n in CODE.findall(words) if "/" not in n and n != module]
            missing += [(n, target) for n in names if n not in defined(ROOT / target)]
    assert missing == []


@pytest.mark.parametrize("page", NOW)
def test_what_a_page_names_is_there(page):
    named = CODE.findall(prose_of(page))
    modules = [m.group() for n in named if (m := re.match(rf"({OURS})(\.\w+)+", n))]
    paths = [n for n in named if re.fullmatch(rf"({OURS}|models)/[\w./]*", n)]
    assert modules or page == "README.md"
    assert paths
    assert [name for name in modules if not is_there(name)] == []
    assert [path for path in paths if not (ROOT / path).exists()] == []


def test_packages_are_listed_from_the_ground_up():
    """All that have a floor, in the order of the floors."""
    rows = re.findall(
        r"^\| (`(?:glider|diagrams|examples)\b.*?) \|", text_of("CONTRIBUTING.md"), re.M
    )
    told = [n.strip("/").replace("/", ".") for row in rows for n in CODE.findall(row)]
    assert [name for name in told if name not in FLOORS] == []
    places = [FLOORS.index(name) for name in told]
    assert places == sorted(places)
    packages = {
        n for n in FLOORS if re.fullmatch(r"glider(\.\w+)?|diagrams|examples", n)
    }
    packages = {n for n in packages if (ROOT / n.replace(".", "/")).is_dir()}
    assert packages <= set(told)


# ---------------------------------------------------------------------- recipes


def recipe(word):
    """The block of Python in CONTRIBUTING that holds a word."""
    blocks = [code for kind, code in BLOCK.findall(text_of("CONTRIBUTING.md"))]
    [block] = [code for code in blocks if word in code]
    return block


@pytest.fixture
def effects(tmp_path, monkeypatch):
    """A user's module with the effects of the recipe."""
    (tmp_path / "recipe_effects.py").write_text(recipe("EffectKind("), encoding="utf-8")
    monkeypatch.syspath_prepend(tmp_path)
    module = importlib.import_module("recipe_effects")
    return module.SKIN_FRICTION, module.WEAK_SERVO


def test_the_effects_of_the_recipe_can_be_used(effects):
    check_user_effects(effects)
    model = GliderModel(effects=(effects[1](loss=0.2),))
    x = np.array([-2.0, 0.3, -0.2, 0.1, 6.0, -1.0, 0.5])
    rates = model.chain.derivatives(0.0, x, 5.0, 0.0, 0.0, model.numbers)
    assert rates[3] == 4.0


@pytest.mark.slow
def test_the_effect_of_the_recipe_is_traced(effects):
    names = {"SKIN_FRICTION": effects[0], "WEAK_SERVO": effects[1]}
    exec(compile(recipe("CampaignPlan(flights=6)"), "CONTRIBUTING.md", "exec"), names)
    assert names["result"].verdict == "effect_found"
    [effect] = names["result"].effects
    assert effect.kind == "skin_friction"
    found = effect.coefficients["coefficient"]
    assert abs(found.value - 0.02) < 4.0 * found.std


def test_the_planner_of_the_recipe_plans():
    names = {}
    exec(compile(recipe("def random_search"), "CONTRIBUTING.md", "exec"), names)
    model, problem = GliderModel(), PerchingProblem.load("sampling")
    few, many = (
        names["random_search"](model, problem, np.random.default_rng(0), tries=tries)
        for tries in (10, 100)
    )
    assert many.cost < few.cost
    policy, start = HeldPolicy(plan=many), many.states[:1]
    flown = fly(model, policy, start, command_rate=100.0, step=0.01, keep_paths=True)
    path = flown.paths[0, : len(many.states)]
    np.testing.assert_allclose(path, many.states, rtol=0, atol=1e-9)


def test_the_source_of_a_loop_is_shown(capsys):
    exec(compile(recipe("module_text"), "CONTRIBUTING.md", "exec"), {})
    shown = capsys.readouterr().out
    assert "def flights(" in shown
    assert "def air_terms(motion, x, c, values):\n    e0 = formula_0(" in shown


def test_the_figure_of_the_recipe_is_drawn():
    names = {}
    exec(compile(recipe("def held_out_height"), "CONTRIBUTING.md", "exec"), names)
    pose = np.array([[-3.5, 0.1, 0.0], [-3.4, 0.2, 0.0]])
    flight = types.SimpleNamespace(time=np.array([0.0, 0.1]), measured=pose)
    specified = names["held_out_height"](types.SimpleNamespace(held_out=[flight]))
    [panel] = specified.panels
    assert page_data({"height": specified})["figures"]["height"]["panels"]
    assert (panel.title, panel.x.label, panel.y.label) == (
        "height",
        "time [s]",
        "z [m]",
    )
    [line] = panel.marks
    assert list(line.y) == [0.1, 0.2]
    assert names["held_out_height"](types.SimpleNamespace(held_out=[])) is None


def test_the_example_of_the_recipe_tells_its_story(capsys):
    names = {"__doc__": "A story.", "program": program, "playback": playback}
    names |= {"plan": plan, "GliderModel": GliderModel}
    exec(compile(recipe("def main("), "CONTRIBUTING.md", "exec"), names)
    names["main"](["--launches=3", "--headless"])
    assert capsys.readouterr().out == "The plan costs 194.05.\n"
